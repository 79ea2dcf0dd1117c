# SPDX-License-Identifier: GPL-3.0-or-later
"""The machine itself: its options, and what it refuses."""

from collections.abc import Callable
from pathlib import Path

import pytest

from nuc980.twin.machine import Machine, MachineError

SDIC_SIZE0 = 0xB0002010


@pytest.mark.parametrize(("option", "code"), [("64M", 6), ("32M", 5), ("128M", 7)])
def test_ram_size_is_what_the_sdram_controller_says(
    board: Callable[..., Machine], option: str, code: int
) -> None:
    assert board("-m", option, registers=True).read(SDIC_SIZE0) & 7 == code


@pytest.mark.parametrize("size", ["3M", "256M", "1M"])
def test_impossible_ram_is_refused(board: Callable[..., Machine], size: str) -> None:
    with pytest.raises(MachineError, match="RAM of a NUC980 is 2, 4, 8, 16, 32, 64 or 128 MiB"):
        board("-m", size, registers=True)


@pytest.mark.parametrize("address", [0x100000, 0x3FFFFFC])
def test_ram_is_a_second_time_where_the_bsp_has_its_dma_buffers(bus: Machine, address: int) -> None:
    bus.write(address, 0x12345678)
    assert bus.read(0x80000000 + address) == 0x12345678


def test_second_serial_is_refused(board: Callable[..., Machine]) -> None:
    with pytest.raises(MachineError, match="only UART0 is -serial"):
        board("-serial", "null", registers=True)


def test_uart_without_wires_is_refused(board: Callable[..., Machine]) -> None:
    with pytest.raises(MachineError, match="no pins to UART5"):
        board(registers=True, uarts=(0, 5))


def test_uart0_by_its_name_alone_is_refused(board: Callable[..., Machine]) -> None:
    with pytest.raises(MachineError, match="chardev uart0 needs -serial chardev:uart0"):
        board("-chardev", "null,id=uart0", registers=True, uarts=())


def test_another_processor_is_refused(board: Callable[..., Machine]) -> None:
    with pytest.raises(MachineError, match="Invalid CPU type: cortex-a9-arm-cpu"):
        board("-cpu", "cortex-a9", registers=True)


def test_kernel_beside_a_loader_is_refused(board: Callable[..., Machine], tmp_path: Path) -> None:
    (tmp_path / "both").write_bytes(b"\xfe\xff\xff\xea")
    with pytest.raises(MachineError, match="-kernel cannot go with -bios"):
        board("-kernel", tmp_path / "both", "-bios", tmp_path / "both")


def test_loader_beyond_the_ram_is_refused(board: Callable[..., Machine], tmp_path: Path) -> None:
    (tmp_path / "loader").write_bytes(b"\xfe\xff\xff\xea")
    with pytest.raises(MachineError, match="needs -m 16M at least"):
        board("-m", "8M", "-bios", tmp_path / "loader")


def test_loader_too_long_is_refused(board: Callable[..., Machine], tmp_path: Path) -> None:
    (tmp_path / "loader").write_bytes(bytes((1 << 20) + 1))
    with pytest.raises(MachineError, match="a boot loader of at most 1 MiB"):
        board("-bios", tmp_path / "loader")


def test_nothing_to_start_is_said(board: Callable[..., Machine]) -> None:
    assert "nothing to start: give -kernel, -bios or boot-source=nand" in board().output
