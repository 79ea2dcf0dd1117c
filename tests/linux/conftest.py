# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests of Linux on the emulated board share. A module's tests share one boot."""

import dataclasses
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lab.board import Ssh
from lab.gateway import free_port, remove, run_directory
from nuc980.twin.linux import SAME_ADDRESSES, Kernel, Linux
from peers.tls_gateway import Pki, public_keys

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """None of them is quick: they need `make linux system`."""
    for item in items:
        if item.path.is_relative_to(HERE):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def kernel() -> Kernel:
    """The kernel of `make linux`, or of the folder OPENRTU_KERNEL; the root of `make image-debian`.

    Who looks at an image as it is, boots it with arguments of its own.
    """
    folder = Path(os.environ.get("OPENRTU_KERNEL", ROOT / "build/linux")).resolve()
    root = Path(os.environ.get("OPENRTU_ROOT", ROOT / "build/system.parts/initramfs.cpio")).resolve()
    dtb = ROOT / "build/dtb/nuc980-gateway.dtb"
    for file in (folder / "zImage", root, dtb):
        if not file.exists():
            pytest.fail(f"{file} is not there: `make linux system dtb`", pytrace=False)
    return Kernel(folder / "zImage", dtb, root, f"{Kernel.arguments} {SAME_ADDRESSES}")


@pytest.fixture(scope="session")
def kernel_with_pdma(kernel: Kernel, tmp_path_factory: pytest.TempPathFactory) -> Kernel:
    """The same, whose six lines move their bytes by PDMA."""
    dtb = tmp_path_factory.mktemp("pdma") / "nuc980-gateway.dtb"
    source = ROOT / "dts/nuvoton/nuc980-gateway.dts"
    subprocess.run([ROOT / "scripts/build-dtb.sh", source, dtb, "GATEWAY_PDMA=1"], check=True)
    return dataclasses.replace(kernel, dtb=dtb)


@pytest.fixture(scope="session")
def serial_line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program for the board, at the near end of a serial line."""
    program = tmp_path_factory.mktemp("serial") / "serial-line"
    subprocess.run(
        ["arm-linux-gnueabi-gcc", "-static", "-std=c11", "-D_GNU_SOURCE", "-O2", "-Wall", "-Wextra",
         "-Werror", "-o", program, HERE / "programs/serial-line.c"],
        check=True,
    )  # fmt: skip
    return program


@pytest.fixture(scope="module")
def pki() -> Iterator[Pki]:
    """Of a site with TLS."""
    folder = run_directory()
    yield public_keys(folder)
    remove(folder)


@pytest.fixture(scope="module")
def port() -> int:
    """A free TCP port of this machine, for the board's station."""
    return free_port()


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    """What the module's run leaves on this machine."""
    directory = run_directory()
    yield directory
    remove(directory)


@pytest.fixture(scope="module")
def key(folder: Path) -> Path:
    """Of who may log in to the module's board; its public half has the suffix .pub."""
    file = folder / "key"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", file], check=True)
    return file


@pytest.fixture(scope="module")
def ssh(key: Path, folder: Path) -> Iterator[Ssh]:
    """The way in of a board that has its key; faster than the debug UART."""
    with Ssh(free_port(), key, folder) as ssh:
        yield ssh


Boot = Callable[..., Linux]


@pytest.fixture(scope="module")
def booted() -> list[Linux]:
    """The boards of this module."""
    return []


@pytest.fixture(scope="module")
def boot(qemu: Path, kernel: Kernel, booted: list[Linux]) -> Iterator[Boot]:
    """Boots boards, as Linux.boot does but for the program; they end with the module.

    `kernel` replaces the kernel.
    """

    def start(*arguments: str | Path, kernel: Kernel = kernel, **settings: object) -> Linux:
        booted.append(Linux.boot(qemu, kernel, *arguments, **settings))
        return booted[-1]

    yield start
    for linux in booted:
        linux.close()


@pytest.fixture(scope="module")
def board_arguments() -> tuple[str | Path, ...]:
    """What the module's board has besides, as arguments of QEMU. A module replaces it by its own."""
    return ()


@pytest.fixture(scope="module")
def board_uarts() -> tuple[int, ...]:
    """The UARTs whose far ends the module's tests want, the debug UART 0 among them."""
    return (0,)


@pytest.fixture(scope="module")
def board_chardevs() -> dict[int, str]:
    """What is at the wires of others, as Machine has it. A module replaces it by its own."""
    return {}


@pytest.fixture(scope="module")
def extra_files() -> dict[str, Path | str]:
    """Files over the root of the module's board, by their paths. A module replaces it by its own."""
    return {}


@pytest.fixture(scope="module")
def linux(
    boot: Boot,
    board_arguments: tuple[str | Path, ...],
    board_uarts: tuple[int, ...],
    board_chardevs: dict[int, str],
    extra_files: dict[str, Path | str],
) -> Linux:
    """The module's board, booted."""
    return boot(*board_arguments, uarts=board_uarts, chardevs=board_chardevs, files=extra_files)


@pytest.fixture(autouse=True)
def no_trouble(booted: list[Linux]) -> Iterator[None]:
    """A panic, an oops or a warning of a kernel fails the test that saw it."""
    yield
    seen = [trouble for linux in booted for trouble in (linux.log, linux.troubles)[1]]
    for linux in booted:
        linux.troubles.clear()
    assert not seen, "the kernel said:\n" + "\n".join(seen)
