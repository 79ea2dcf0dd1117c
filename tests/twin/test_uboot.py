# SPDX-License-Identifier: GPL-3.0-or-later
"""Our U-Boot on the emulated board: from reset to its prompt, what it loads, what it keeps, how it leaves."""

import os
import random
import re
import shutil
import signal
import socket
import statistics
import struct
import threading
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from busy import busy_processes
from nuc980.netboot.board import Nand
from nuc980.netboot.flash.tables import tables_content, tables_slot
from nuc980.twin.machine import ANSWER_SECONDS, Machine
from nuc980.twin.nand import NandImage
from nuc980.twin.uboot import PROMPT, Console, text

ROOT = Path(__file__).parents[2]
BOARD = ROOT / "dts/nuvoton/nuc980-gateway.dts"

# The vendor's SPL reads this much of U-Boot, and no more.
SPL_READS = 500 * 1024
SYS_MFP = range(0xB0000070, 0xB00000A8, 4)
MFP_PF_HIGH = 0xB000009C
NAND_PAGES, NAND_PAGE = 65536, 2048 + 64
FACTORY = {
    "baudrate": "115200",
    "bootcmd": "nand read 0x7FC0 0x200000 0x500000; nand read 0xA00000 0x700000 0x100000; "
    "bootm 0x7Fc0 - 0xA00000",
    "bootdelay": "3",
}
COMMANDS = (
    "bdinfo bootm cmp cp crc32 echo editenv env fdt go iminfo imxtract itest loadb md mii mm mtdparts mw "
    "nand ping printenv reset run saveenv setenv setexpr sleep source tftp tftpboot tftpput ubi"
)


@pytest.fixture(scope="session")
def erased_nand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return NandImage.blank(tmp_path_factory.mktemp("nand") / "erased").path


@pytest.fixture
def console(board: Callable[..., Machine], uboot: Path) -> Iterator[Callable[..., Console]]:
    """Starts boards with U-Boot in their RAM, up to the prompt."""

    def start(*arguments: str | Path, **settings: str) -> Console:
        return Console(board("-bios", uboot, *arguments, **settings))

    return start


@pytest.fixture
def with_nand(console: Callable[..., Console], erased_nand: Path) -> Console:
    """With an erased flash. What is written to it lasts as long as the machine."""
    return console("-drive", f"if=mtd,format=raw,snapshot=on,file={erased_nand}")


@pytest.fixture
def with_network(console: Callable[..., Console], tmp_path: Path) -> Console:
    """With a TFTP server at each port's 10.0.N.2."""
    for port in (0, 1):
        (tmp_path / f"port{port}").mkdir()
    return console(
        *("-nic", f"user,net=10.0.0.0/24,tftp={tmp_path}/port0"),
        *("-nic", f"user,net=10.0.1.0/24,tftp={tmp_path}/port1"),
    )


def configure(console: Console, port: int) -> None:
    console.run("setenv ethaddr 02:00:00:00:00:01; setenv eth1addr 02:00:00:00:00:02")
    console.run(f"setenv ethact emac{port}; setenv ipaddr 10.0.{port}.15; setenv serverip 10.0.{port}.2")


def crc_of(answer: str) -> int:
    found = re.search(r"==> ([0-9a-f]{8})$", answer, re.MULTILINE)
    assert found, answer
    return int(found[1], 16)


def flip(image: Path, offset: int, bits: Sequence[int]) -> None:
    """Turns bits over that are counted from a byte of the image on."""
    with image.open("r+b") as file:
        for bit in bits:
            file.seek(offset + bit // 8)
            byte = file.read(1)[0]
            file.seek(-1, os.SEEK_CUR)
            file.write(bytes([byte ^ 1 << bit % 8]))


# ---- reset


def test_from_reset_to_the_prompt(console: Callable[..., Console]) -> None:
    at = console()
    for line in ("U-Boot 2023.01", "NUC980", "DRAM:  64 MiB", "BLIIoT gateway", "No ethernet found."):
        assert line in at.banner
    assert at.machine.complaints == ""


def test_console_has_the_pins_of_the_device_tree(console: Callable[..., Console]) -> None:
    pins = console().machine.read(MFP_PF_HIGH)
    assert (pins >> 12 & 0xF, pins >> 16 & 0xF) == (1, 1)  # PF11 and PF12


@pytest.mark.parametrize("mib", [32, 64, 128])
def test_dram_is_what_its_controller_says(console: Callable[..., Console], mib: int) -> None:
    assert f"DRAM:  {mib} MiB" in console("-m", f"{mib}M").banner


def test_environment_is_the_factorys(console: Callable[..., Console]) -> None:
    environment = console().environment()
    assert {name: environment.get(name) for name in FACTORY} == FACTORY
    assert not {"ethaddr", "ipaddr", "serverip", "bootargs", "fdt_high"} & set(environment)


def test_commands_are_there(console: Callable[..., Console]) -> None:
    at = console()
    assert [name for name in COMMANDS.split() if "Unknown command" in at.run(f"help {name}")] == []
    assert "Unknown command" in at.run("nothing")


def test_time_is_right_beyond_the_counters_24_bits(console: Callable[..., Console]) -> None:
    at = console()
    start = time.monotonic()
    at.run("sleep 3")  # the counter wraps every 1.4 s
    assert time.monotonic() - start >= 3  # how much more is the host's affair


def test_reset_starts_anew(console: Callable[..., Console]) -> None:
    at = console()
    at.run("setenv forgotten yes")
    assert "U-Boot 2023.01" in at.reset()
    assert "forgotten" not in at.environment()


# ---- network


@pytest.mark.parametrize("port", [0, 1])
def test_file_comes_through_either_port(with_network: Console, tmp_path: Path, port: int) -> None:
    data = os.urandom(1_000_003)
    (tmp_path / f"port{port}/file").write_bytes(data)
    configure(with_network, port)
    answer = with_network.run("tftpboot 0x100000 file")
    assert f"Using emac{port} device" in answer
    assert "Bytes transferred = 1000003 (f4243 hex)" in answer
    assert crc_of(with_network.run("crc32 0x100000 ${filesize}")) == zlib.crc32(data)


def test_without_an_address_it_says_so(with_network: Console) -> None:
    with_network.run("setenv ipaddr 10.0.0.15; setenv serverip 10.0.0.2")
    answer = with_network.run("tftpboot 0x100000 file")
    assert "Error: emac0 address not set." in answer
    assert "No ethernet found." in answer


def test_missing_file_is_the_servers_error(with_network: Console) -> None:
    configure(with_network, 0)
    assert "TFTP error: " in with_network.run("tftp 0x100000 nothing")


def refused(console: Console, server: socket.socket) -> tuple[bytes, str]:
    """What the board asks this server for, and what it says to a refusal."""
    console.type("tftpboot 0x100000 wanted")
    request, client = server.recvfrom(2048)
    server.sendto(struct.pack(">HH", 5, 2) + b"not for you\0", client)
    return request, text(console.line.wait_for(PROMPT))


@contextmanager
def server_for(console: Console) -> Iterator[socket.socket]:
    """Of this host, which the board asks at its port 0."""
    configure(console, 0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        server.settimeout(30)
        console.run(f"setenv tftpdstp {server.getsockname()[1]}")
        yield server


def test_server_on_another_udp_port(with_network: Console) -> None:
    with server_for(with_network) as server:
        request, answer = refused(with_network, server)
    assert request.startswith(b"\0\1wanted\0octet\0")
    assert "TFTP error: 'not for you' (2)" in answer


def usual_seconds(work: Callable[[], object]) -> float:
    """The median of some times: that a busy host delays some of them changes little."""
    taken = []
    for _ in range(8):
        start = time.monotonic()
        work()
        taken.append(time.monotonic() - start)
    return statistics.median(taken)


def test_answer_of_the_host_is_not_held_back(console: Callable[..., Console]) -> None:
    """QEMU itself answers a ping. For this host's answer it has to wake, and no character's time wakes it."""
    at = console("-nic", "user,net=10.0.0.0/24", options="pace=off")
    with server_for(at) as server:
        ping = usual_seconds(lambda: at.run("ping 10.0.0.2"))
        assert usual_seconds(lambda: refused(at, server)) < ping + 0.25


def test_prompt_leaves_the_host_its_processor(console: Callable[..., Console]) -> None:
    """Between polls of an idle line the processor rests. One that does not gives nothing up by itself."""
    machine = console().machine
    thread = Path("/proc") / str(machine.command("query-cpus-fast")[0]["thread-id"])

    def rests() -> int:
        found = re.search(r"^voluntary_ctxt_switches:\s+(\d+)", (thread / "status").read_text(), re.MULTILINE)
        assert found
        return int(found[1])

    def worked_s() -> float:
        return int((thread / "schedstat").read_text().split()[0]) / 1e9

    enough, start = rests() + 200, worked_s()
    while rests() < enough:
        assert worked_s() < start + 1.0
        time.sleep(0.01)


def test_phy_is_found(with_network: Console) -> None:
    configure(with_network, 0)
    assert "is alive" in with_network.run("ping 10.0.0.2")
    assert re.search(r"PHY 0x[0-9A-F]+: OUI = 0x90C3, .* 100baseT, FDX", with_network.run("mii info"))


# ---- flash


def test_page_comes_back_as_written(with_nand: Console) -> None:
    with_nand.run("mw.b 0x100000 0xa5 0x40000; mw.l 0x100800 0x01234567 0x123; mw.b 0x200000 0 0x40000")
    assert "OK" in with_nand.run("nand erase.part spare")
    assert "262144 bytes written: OK" in with_nand.run("nand write 0x100000 spare 0x40000")
    with_nand.reset()
    assert "262144 bytes read: OK" in with_nand.run("nand read 0x200000 spare 0x40000")
    with_nand.run("mw.b 0x100000 0xa5 0x40000; mw.l 0x100800 0x01234567 0x123")
    assert "262144 byte(s) were the same" in with_nand.run("cmp.b 0x100000 0x200000 0x40000")


@pytest.mark.parametrize(
    ("wrong", "answer"),
    [
        ([], "2048 bytes read: OK"),
        ([0], "2048 bytes read: OK"),
        ([7 * 8, 511 * 8 + 7, 512 * 8, 1500 * 8 + 3, 2047 * 8 + 7], "2048 bytes read: OK"),
        ([40 * bit for bit in range(8)], "2048 bytes read: OK"),
        (range(8), "2048 bytes read: OK"),
        ([2052 * 8, 2111 * 8 + 7], "2048 bytes read: OK"),  # in the parity of the first and the last field
        ([40 * bit for bit in range(9)], "NAND read from offset 800000 failed -74"),
    ],
    ids=[
        "none",
        "one",
        "in three fields",
        "eight in a field",
        "eight in a byte",
        "in the parity",
        "too many",
    ],
)
def test_wrong_bits_are_corrected(
    console: Callable[..., Console], erased_nand: Path, tmp_path: Path, wrong: Sequence[int], answer: str
) -> None:
    image = tmp_path / "nand"
    shutil.copyfile(erased_nand, image)
    drive = ("-drive", f"if=mtd,format=raw,file={image}")
    data = os.urandom(2048)

    writer = console(*drive)
    writer.machine.write_memory(0x100000, data)
    assert "2048 bytes written: OK" in writer.run("nand write 0x100000 0x800000 0x800")
    writer.machine.close()

    flip(image, 0x800000 // 2048 * NAND_PAGE, wrong)
    reader = console(*drive)
    assert answer in reader.run("nand read 0x200000 0x800000 0x800")
    if answer.endswith("OK"):
        assert reader.machine.read_memory(0x200000, 2048) == data


def test_erased_page_is_all_ones(with_nand: Console) -> None:
    with_nand.run("mw.b 0x100000 0xff 0x800; mw.b 0x200000 0 0x800")
    assert "2048 bytes read: OK" in with_nand.run("nand read 0x200000 spare 0x800")
    assert "2048 byte(s) were the same" in with_nand.run("cmp.b 0x100000 0x200000 0x800")


def test_environment_survives_a_reset(with_nand: Console) -> None:
    assert "using default environment" in with_nand.banner
    with_nand.run("setenv kept 'a value; with more'")
    assert "Writing to NAND... OK" in with_nand.run("saveenv")
    assert "Loading Environment from NAND... OK" in with_nand.reset()
    assert with_nand.environment()["kept"] == "a value; with more"


def test_factorys_environment_does_no_harm(with_nand: Console) -> None:
    """It names devices as the vendor's U-Boot calls them."""
    with_nand.run("setenv stdin serial; setenv stdout serial; setenv stderr serial; setenv ethact emac")
    with_nand.run("setenv ethaddr 02:00:00:00:00:01; saveenv")
    banner = with_nand.reset()
    assert "Loading Environment from NAND... OK" in banner
    assert "eth0: emac0" in banner


@pytest.mark.soak
def test_no_timer_is_lost_while_the_flash_is_written(
    console: Callable[..., Console], erased_nand: Path
) -> None:
    """What tells the main loop of a timer must reach it, though the guest's thread has polled meanwhile.

    Without the patch, U-Boot waits forever for the end of a character once in some 200 saveenv.
    """
    with busy_processes(8):
        for _ in range(60):
            at = console("-drive", f"if=mtd,format=raw,snapshot=on,file={erased_nand}")
            for _ in range(6):
                assert "Writing to NAND... OK" in at.run("saveenv")
            at.machine.close()


@contextmanager
def starved(machine: Machine, seconds: float = 0.12) -> Iterator[Callable[[], int]]:
    """The host has no time for the machine for so long again and again, while the machine's clock runs on.

    Yields how often that was. The driver gives the DMA 0.1 s.
    """
    over = threading.Event()
    stops = 0

    def starve() -> None:
        nonlocal stops
        moments = random.Random(980)
        while not over.wait(moments.uniform(0.005, 0.05)):
            machine.process.send_signal(signal.SIGSTOP)
            over.wait(seconds)
            machine.process.send_signal(signal.SIGCONT)
            stops += 1

    thread = threading.Thread(target=starve)
    thread.start()
    try:
        yield lambda: stops
    finally:
        over.set()
        thread.join()


@pytest.mark.parametrize(
    ("size", "stops", "reads"),
    [(0x200000, 25, 1), pytest.param(0x20000, 1, 10_000, marks=pytest.mark.soak)],
    ids=["25 stops", "10 000 blocks"],
)
def test_starved_reader_loses_nothing(with_nand: Console, size: int, stops: int, reads: int) -> None:
    with_nand.run(f"mw.b 0x100000 0x5a {size:#x}; nand write 0x100000 spare {size:#x}")
    done = 0
    with starved(with_nand.machine) as stopped:
        while done < reads or stopped() < stops:
            assert with_nand.run(f"nand read 0x400000 spare {size:#x}").endswith(" bytes read: OK"), done
            done += 1
    assert "were the same" in with_nand.run(f"cmp.b 0x100000 0x400000 {size:#x}")


def test_bad_block_stays_bad_and_is_skipped(with_nand: Console) -> None:
    assert "successfully marked as bad" in with_nand.run("nand markbad 0x820000")
    with_nand.reset()
    assert "  00820000" in with_nand.run("nand bad").splitlines()
    with_nand.run("mw.b 0x100000 0x5a 0x40000")
    with_nand.run("nand write 0x100000 spare 0x40000")
    assert with_nand.run("nand read 0x200000 0x840000 0x20000").endswith("OK")
    assert "131072 byte(s) were the same" in with_nand.run("cmp.b 0x100000 0x200000 0x20000")


def test_bad_block_tables_are_used_where_linux_has_them(with_nand: Console) -> None:
    """A block that only they know is bad; who marks another adds it to them."""
    chip = Nand(128 << 20, 128 << 10, 2048, (0x820000,))
    with_nand.machine.write_memory(0x100000, tables_content(chip))
    with_nand.run(f"nand write 0x100000 {tables_slot(chip).offset:#x} 0x80000")
    with_nand.reset()
    reserved = ["07f80000", "07fa0000", "07fc0000", "07fe0000"]
    assert with_nand.run("nand bad").split()[-5:] == ["00820000", *reserved]
    with_nand.run("nand markbad 0x840000; nand read.raw 0x100000 0x7fe0000 1")
    table = with_nand.machine.read_memory(0x100000, 32)
    assert table[:5] == b"Bbt0\x02"
    assert table[5 + 64 // 4] == 0b11_10_00_11  # blocks 64 to 67, from the lowest bits on


def test_no_bad_block_tables_are_made(with_nand: Console) -> None:
    """Not at its start, when it looks for its environment, and not when it writes that."""
    with_nand.run("saveenv; nand bad; nand read.raw 0x100000 0x7fe0000 1; nand read.raw 0x200000 0x7fc0000 1")
    last = [with_nand.machine.read_memory(page, 2048) for page in (0x100000, 0x200000)]
    assert last == [b"\xff" * 2048] * 2


def test_ubi_volume_keeps_its_data(with_nand: Console) -> None:
    assert "attached mtd" in with_nand.run("ubi part rootfs")
    with_nand.run("mw.b 0x100000 0x42 0x20000")
    assert "Creating dynamic volume" in with_nand.run("ubi create data 0x100000")
    assert "131072 bytes written" in with_nand.run("ubi write 0x100000 data 0x20000")
    with_nand.reset()
    with_nand.run("mw.b 0x100000 0x42 0x20000")
    with_nand.run("ubi part rootfs; ubi read 0x200000 data 0x20000")
    assert "131072 byte(s) were the same" in with_nand.run("cmp.b 0x100000 0x200000 0x20000")


def test_partitions_are_the_device_trees(with_nand: Console) -> None:
    node = r'partition@\w+ \{\s+label = "([\w-]+)";\s+reg = <(0x[0-9a-f]+|0) (0x[0-9a-f]+)>'
    wanted = [
        (name, int(start, 0), int(size, 0)) for name, start, size in re.findall(node, BOARD.read_text())
    ]
    line = r"^ \d+: (\S+)\s+0x([0-9a-f]+)\s+0x([0-9a-f]+)"
    shown = re.findall(line, with_nand.run("mtdparts"), re.MULTILINE)
    assert len(wanted) == 5
    assert [(name, int(start, 16), int(size, 16)) for name, size, start in shown] == wanted


# ---- Linux


def legacy_image(payload: bytes, load: int) -> bytes:
    """A uImage of an ARM Linux kernel, not compressed; the head has its own CRC, made with the field 0."""

    def head(crc: int) -> bytes:
        fields = (0x27051956, crc, 0, len(payload), load, load, zlib.crc32(payload))
        return struct.pack(">7I4B32s", *fields, 5, 2, 2, 0, b"loop")

    return head(zlib.crc32(head(0))) + payload


def test_linux_gets_no_pins_and_a_tree_out_of_its_way(console: Callable[..., Console], uboot: Path) -> None:
    tree = uboot.with_suffix(".dtb").read_bytes()
    # mov r1, #0x100000; str r2, [r1]; b .
    keeps_r2 = legacy_image(struct.pack("<III", 0xE3A01601, 0xE5812000, 0xEAFFFFFE), load=0x8000)
    at = console()
    at.machine.write_memory(0x7FC0, keeps_r2)
    at.machine.write_memory(0xA00000, tree)
    at.machine.write(0x100000, 0)
    assert any(at.machine.read(register) for register in SYS_MFP)
    at.type("bootm 0x7FC0 - 0xA00000")
    assert "XIP Kernel Image" in text(at.line.wait_for(b"Starting kernel ...\r\n"))
    deadline = time.monotonic() + ANSWER_SECONDS
    while not (where := at.machine.read(0x100000)):
        assert time.monotonic() < deadline
    assert [at.machine.read(register) for register in SYS_MFP] == [0] * len(SYS_MFP)
    assert where > 0x3000000
    assert at.machine.read_memory(where, 4) == tree[:4]


def test_factorys_boot_command_starts_what_is_in_the_flash(with_nand: Console, uboot: Path) -> None:
    forever = legacy_image(struct.pack("<I", 0xEAFFFFFE), load=0x8000)  # b .
    with_nand.machine.write_memory(0x100000, forever)
    with_nand.machine.write_memory(0x200000, uboot.with_suffix(".dtb").read_bytes())
    with_nand.run("nand write 0x100000 kernel 0x800; nand write 0x200000 device-tree 0x4000")
    with_nand.type("reset")
    started = text(with_nand.line.wait_for(b"Starting kernel ...\r\n"))
    assert re.search(r"stop autoboot:  3 .* 0 ", started)
    assert "5242880 bytes read: OK" in started
    assert "1048576 bytes read: OK" in started


# ---- the files


def test_spl_can_read_all_of_it(uboot: Path) -> None:
    assert uboot.stat().st_size <= SPL_READS
