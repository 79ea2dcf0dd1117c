# SPDX-License-Identifier: GPL-3.0-or-later
"""The double itself: that it is the board it stands for, and that its faults are faults."""

from __future__ import annotations

import os
import re
import select
import socket
import struct
import subprocess
import termios
import threading
import time
import tty
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from netboot.double import BLOCK, FACTORY_ENVIRONMENT, PAGE, Double, Operation, faults
from nuc980.netboot.board import Nand
from nuc980.netboot.flash.tables import tables_content, tables_slot
from nuc980.twin.machine import INSTRUCTION_TIME, Machine, SerialLine
from nuc980.twin.nand import NandImage
from nuc980.twin.uboot import Console

PROMPT = b"\n=> "
SECONDS = 10.0


class Talker(ABC):
    """Somebody at a console, who sees no carriage returns."""

    def __init__(self) -> None:
        self.seen = b""

    @abstractmethod
    def send(self, data: bytes) -> None: ...

    @abstractmethod
    def receive(self, seconds: float) -> bytes: ...

    def wait_for(self, text: bytes, seconds: float = SECONDS) -> bytes:
        deadline = time.monotonic() + seconds
        while text not in self.seen:
            left = deadline - time.monotonic()
            new = self.receive(left) if left > 0 else b""
            if not new:
                raise TimeoutError(f"no {text!r}, but {self.seen[-500:]!r}")
            self.seen += new.replace(b"\r", b"")
        end = self.seen.index(text) + len(text)
        before, self.seen = self.seen[:end], self.seen[end:]
        return before

    def stop_autoboot(self) -> str:
        banner = self.wait_for(b"stop autoboot")
        self.send(b" ")
        return plain(banner + self.wait_for(PROMPT))

    def run(self, command: str) -> str:
        """What a command prints, without its echo."""
        typed = command.encode()
        for at in range(0, len(typed), 16):
            self.send(typed[at : at + 16])
            self.wait_for(typed[at : at + 16])
        self.send(b"\r")
        return plain(self.wait_for(PROMPT)).removesuffix("\n=> ").removeprefix("\n")


def plain(data: bytes) -> str:
    return data.decode("latin-1")


class Terminal(Talker):
    """With a terminal program at a serial port."""

    def __init__(self, port: str, speed: int = termios.B115200) -> None:
        super().__init__()
        self.fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd)
        settings = termios.tcgetattr(self.fd)
        settings[4] = settings[5] = speed
        termios.tcsetattr(self.fd, termios.TCSANOW, settings)

    def send(self, data: bytes) -> None:
        os.write(self.fd, data)

    def receive(self, seconds: float) -> bytes:
        ready, _, _ = select.select([self.fd], [], [], seconds)
        return os.read(self.fd, 65536) if ready else b""


class AtTheTwin(Talker):
    """At the debug UART of the emulated board."""

    def __init__(self, line: SerialLine) -> None:
        super().__init__()
        self.line = line

    def send(self, data: bytes) -> None:
        self.line.send(data)

    def receive(self, seconds: float) -> bytes:
        return self.line.receive(seconds)


class FileServer:
    """The least that is a TFTP server, and what was asked of it."""

    def __init__(self, files: dict[str, bytes]) -> None:
        self.files, self.uploads, self.datagrams = files, {}, []
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.address = self.socket.getsockname()
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.thread.start()

    def close(self) -> None:
        self.socket.sendto(b"", self.address)
        self.thread.join(SECONDS)
        self.socket.close()

    def _serve(self) -> None:
        name, block_size, upload = "", 512, False
        while True:
            data, client = self.socket.recvfrom(65536)
            if not data:
                return
            self.datagrams.append(data)
            (kind,) = struct.unpack(">H", data[:2])
            if kind in (1, 2):
                strings = data[2:].decode().split("\0")
                name, upload = strings[0], kind == 2
                block_size = int(strings[strings.index("blksize") + 1])
                if not upload and name not in self.files:
                    self.socket.sendto(struct.pack(">HH", 5, 1) + b"File not found\0", client)
                    continue
                self.uploads[name] = b"" if upload else self.uploads.get(name, b"")
                self.socket.sendto(b"\0\6blksize\0%d\0" % block_size, client)
            elif kind == 4:
                (block,) = struct.unpack(">H", data[2:4])
                part = self.files[name][block * block_size : (block + 1) * block_size]
                if block * block_size <= len(self.files[name]):
                    self.socket.sendto(struct.pack(">HH", 3, block + 1) + part, client)
            elif kind == 3:
                self.uploads[name] += data[4:]
                self.socket.sendto(b"\0\4" + data[2:4], client)


@contextmanager
def serving(**files: bytes) -> Iterator[FileServer]:
    server = FileServer(files)
    try:
        yield server
    finally:
        server.close()


@contextmanager
def at_prompt(**settings: object) -> Iterator[tuple[Double, Terminal]]:
    with Double(state="prompt", **settings) as double:
        terminal = Terminal(double.port)
        terminal.send(b"\3")
        terminal.wait_for(PROMPT)
        yield double, terminal


NETWORK = "setenv ethaddr 02:00:00:00:00:01; setenv ipaddr 127.0.0.5; setenv serverip 127.0.0.1"


# ---- from power-up to the prompt


def test_from_power_up_to_the_prompt() -> None:
    with Double() as double:
        banner = Terminal(double.port).stop_autoboot()
    assert masked(banner) == (
        "\n\nU-Boot 2016.11 (Nov 20 2019 - 10:32:17 +0800)\n\nCPU: NUC980\nBoard: NUC980\n"
        "DRAM:  64 MiB\nNAND:  128 MiB\nIn:    serial\nOut:   serial\nErr:   serial\n"
        "Net:   emac\nError: emac address not set.\n\n"
        "Hit any key to stop autoboot:  3 \b\b\b 0 \n=> "
    )


def test_boots_by_itself_what_is_in_its_flash(uimage: bytes, tree: bytes) -> None:
    with Double(countdown_second=0.01, cuts=0) as double:
        double.nand.load(0x200000, uimage)
        double.nand.load(0x700000, tree)
        began = time.monotonic()
        output = plain(Terminal(double.port).wait_for(b"login: "))
        assert time.monotonic() - began < 3  # what the countdown takes, if nobody makes it shorter
    assert (
        "autoboot:  3 \b\b\b 2 \b\b\b 1 \b\b\b 0 \n\nNAND read: device 0 offset 0x200000, size 0x500000\n"
        in output
    )
    assert " 5242880 bytes read: OK\n" in output
    assert "   XIP Kernel Image ... OK\n" in output
    assert output.index("Starting kernel ...\n\n") < output.index("Linux version")
    assert double.kernels_started == 1


def test_without_a_boot_command_the_prompt_comes_at_once() -> None:
    with Double(environment=None) as double:
        output = plain(Terminal(double.port).wait_for(PROMPT))
    assert "bad CRC, using default environment" in output
    assert "Hit any key" not in output


def test_supply_goes_off_and_on_by_a_command() -> None:
    with Double(state="off") as double:
        terminal = Terminal(double.port)
        assert terminal.receive(0.05) == b""
        subprocess.run(double.power_hook, shell=True, check=True)
        terminal.stop_autoboot()
        terminal.run("mw.b 0x100000 0x5a 4; setenv forgotten yes")
        double.power_cycle()
        terminal.stop_autoboot()
        assert "not defined" in terminal.run("printenv forgotten")
        assert double.ram[0x100000:0x100004] == bytes(4)
    assert double.power_ups == 2


def test_exception_in_it_fails_the_test() -> None:
    with pytest.raises(NotImplementedError, match="ubi part user"), at_prompt() as (double, terminal):
        terminal.send(b"ubi part user\r")
        deadline = time.monotonic() + SECONDS
        while not double.lines and time.monotonic() < deadline:
            time.sleep(0.01)


# ---- the command line


def test_lines_are_recorded_as_they_were_entered() -> None:
    with at_prompt() as (double, terminal):
        terminal.run("echo one; echo two")
        terminal.send(b"ecxx\b\bho three\r")
        terminal.wait_for(PROMPT)
    assert double.lines == ["echo one; echo two", "echo three"]


def test_interrupt_and_repetition() -> None:
    with at_prompt() as (_, terminal):
        terminal.send(b"echo a\3")
        assert plain(terminal.wait_for(PROMPT)) == "echo a<INTERRUPT>\n=> "
        assert terminal.run("echo hi") == "hi"
        terminal.send(b"\r")
        assert plain(terminal.wait_for(PROMPT)) == "\nhi\n=> "
        terminal.send(b"setenv a b\r")
        terminal.wait_for(PROMPT)
        terminal.send(b"\r")
        assert plain(terminal.wait_for(PROMPT)) == "\n=> "


@pytest.mark.parametrize(("variant", "ends"), [("factory", b"one\n\rtwo\n\r"), ("ours", b"one\r\ntwo\r\n")])
def test_line_ends_as_its_uart_driver_sends_them(variant: str, ends: bytes) -> None:
    with at_prompt(variant=variant) as (_, terminal):
        terminal.send(b"echo one; echo two\r")
        received = b""
        while not received.endswith(b"=> "):
            received += terminal.receive(SECONDS)
        assert ends in received


def test_line_that_is_too_long_rings_the_bell() -> None:
    with at_prompt() as (double, terminal):
        terminal.send(b"echo " + b"x" * 251 + b"yz")
        terminal.wait_for(b"x\a\a")
        terminal.send(b"\r")
        terminal.wait_for(PROMPT)
    assert double.lines == ["echo " + "x" * 251]


def test_what_is_typed_while_it_works_is_lost_beyond_its_fifo() -> None:
    with at_prompt(faults=[faults.SlowPrompt(0.1, at=3)]) as (double, terminal):
        terminal.send(b"true\r")
        terminal.wait_for(b"\n")
        terminal.send(b"echo 0123456789abcdef\r")
        terminal.wait_for(b"=> ")
        terminal.send(b"\r")
        terminal.wait_for(PROMPT)
    assert double.lines == ["true", "echo 0123456789a"]


@pytest.mark.parametrize(("speed", "heard"), [(termios.B115200, True), (termios.B57600, False)])
def test_speed_must_be_its_own(speed: int, heard: bool) -> None:
    with Double() as double:
        terminal = Terminal(double.port, speed)
        received = b""
        while len(received) < 100 and (new := terminal.receive(SECONDS)):  # the banner is longer
            received += new
        assert len(received) >= 100
        assert (b"U-Boot 2016" in received) == heard


# ---- the flash


def test_page_programmed_twice_is_unreadable() -> None:
    with at_prompt() as (double, terminal):
        terminal.run("mw.b 0x100000 0x5a 0x800; mw.b 0x200000 0xa5 0x800")
        assert "2048 bytes written: OK" in terminal.run("nand write 0x100000 0x800000 0x800")
        assert "failed -5\n 0 bytes written: ERROR" in terminal.run("nand write 0x200000 0x800000 0x800")
        assert "failed -74" in terminal.run("nand read 0x300000 0x800000 0x800")
        assert "OK" in terminal.run("nand erase 0x800000 0x20000")
        assert "2048 bytes read: OK" in terminal.run("nand read 0x300000 0x800000 0x800")
    assert double.nand.journal == [
        Operation("program", 0x800000, PAGE, True),
        Operation("program", 0x800000, PAGE, True),
        Operation("erase", 0x800000, BLOCK, True),
    ]
    assert double.block(0x800000 // BLOCK) == b"\xff" * BLOCK


def test_failing_blocks() -> None:
    wrong = [faults.CannotErase(0x40), faults.CannotProgram(0x42)]
    with at_prompt(faults=wrong) as (double, terminal):
        answer = terminal.run("nand erase 0x800000 0x60000")
        assert "nand0: MTD Erase failure: -5\n" in answer
        assert answer.endswith("OK")
        answer = terminal.run("nand write 0x0 0x800000 0x60000")
        assert answer.endswith("NAND write to offset 800000 failed -5\n 0 bytes written: ERROR")
        double.nand.bad.add(0x41)
        terminal.run("nand erase 0x840000 0x20000")
        answer = terminal.run("nand write 0x0 0x820000 0x40000")
        assert "Skip bad block 0x00820000\nNAND write to offset 840000 failed -5\n 0 bytes written" in answer


def test_environment_is_saved_and_found_again() -> None:
    with at_prompt() as (double, terminal):
        terminal.run("setenv kept 'a; b'")
        assert terminal.run("saveenv").endswith("Writing to NAND... OK")
        terminal.send(b"reset\r")
        terminal.stop_autoboot()
        assert terminal.run("printenv kept") == "kept=a; b"
    assert double.stored_environment() == FACTORY_ENVIRONMENT | {"kept": "a; b"}


@pytest.mark.parametrize("moment", ["command", "echo", "erase", "program"])
def test_reset_in_the_middle(moment: str) -> None:
    with at_prompt(faults=[faults.ResetsAt(moment, 3)]) as (double, terminal):
        terminal.send(b"nand erase 0x800000 0x60000; nand write 0 0x800000 0x60000; echo done\r")
        banner = terminal.stop_autoboot()
        assert "done\n=>" not in banner
        assert terminal.run("echo again") == "again"
    assert len(double.nand.journal) == {"command": 6, "echo": 0, "erase": 3, "program": 6}[moment]


# ---- the network


@pytest.mark.parametrize("size", [0, 1, 1468, 1468 * 100 + 7])
def test_file_comes(size: int) -> None:
    data = os.urandom(size)
    with serving(file=data) as server, at_prompt(tftp=server.address) as (double, terminal):
        terminal.run(NETWORK)
        answer = terminal.run("tftpboot 0x7fc0 file")
        assert "Using emac device\nTFTP from server 127.0.0.1; our IP address is 127.0.0.5\n" in answer
        assert double.ram[0x7FC0 : 0x7FC0 + size] == data
        if size:
            assert answer.endswith(f"Bytes transferred = {size} ({size:x} hex)")
            assert f"==> {zlib.crc32(data):08x}" in terminal.run("crc32 0x7fc0 ${filesize}")


@pytest.mark.parametrize(
    ("fault", "seen"),
    [
        (faults.LosesAcks(at=5, times=3), "T T T "),
        (faults.DuplicatesAcks(times=0), "Bytes transferred = 100000"),
        (faults.EndsEarly(at=10), "Bytes transferred = 13946"),
        (faults.StopsHearing(block=10), "Retry count exceeded; starting again"),
        (faults.AsksFor("other"), "TFTP error: 'File not found' (1)\nNot retrying..."),
        (faults.NetworkSays(faults.NO_ETHERNET), "No ethernet found."),
        (faults.ArpFails(), "ARP Retry count exceeded; starting again"),
        (faults.ResetsAt("tftp", 20), "U-Boot 2016.11"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_network_faults(fault: faults.Fault, seen: str) -> None:
    with serving(file=bytes(100_000)) as server:
        settings = {"faults": [fault], "tftp": server.address, "environment": None, "second": 0.004}
        with at_prompt(**settings) as (_, terminal):
            terminal.run(NETWORK)
            terminal.send(b"tftpboot 0x7fc0 file\r")
            terminal.wait_for(b"file\n")
            assert seen in plain(terminal.wait_for(PROMPT))


def test_transfer_is_aborted_by_ctrl_c() -> None:
    with serving(file=bytes(100_000)) as server:
        settings = {"faults": [faults.StopsHearing(3)], "tftp": server.address, "second": 1.0}
        with at_prompt(**settings) as (_, terminal):
            terminal.run(NETWORK)
            terminal.send(b"tftpboot 0x7fc0 file\r")
            terminal.wait_for(b"Loading")
            terminal.send(b"\3")
            assert plain(terminal.wait_for(PROMPT)).endswith("\nAbort\n=> ")


def test_upload() -> None:
    with serving() as server, at_prompt(variant="ours", tftp=server.address) as (double, terminal):
        double.ram[0x1000:0x2388] = data = os.urandom(5000)
        terminal.run(NETWORK)
        answer = terminal.run("tftpput 0x1000 0x1388 up")
        assert "Save address: 0x1000\nSave size:    0x1388\nSaving: *" in answer
        assert server.uploads == {"up": data}


def test_factory_has_no_upload_no_ping_and_no_port() -> None:
    with at_prompt() as (_, terminal):
        for name in ("tftpput", "ping", "mii"):
            assert f"Unknown command '{name}'" in terminal.run(f"help {name}")


# ---- its commands against the real ones

ALIKE = r"""
version
help version
help nothing
help
printenv
printenv nothing
printenv bootcmd
net list
mii device
mii info
bdinfo
setenv ipaddr 10.0.0.15; setenv serverip 10.0.0.2
tftpboot 0x7fc0 file
setenv ethaddr 02:00:00:00:00:01
tftpboot 0x7fc0 file
printenv filesize fileaddr ethact
crc32 0x7fc0 ${filesize}
ping 10.0.0.2
net list
mii device
mii info
mii read 0x1 1
mii read 5 1
bdinfo
setenv serverip; tftpboot 0x7fc0 file; setenv serverip 10.0.0.2
setenv ipaddr; tftpboot 0x7fc0 file; setenv ipaddr 10.0.0.15
tftpboot 0x3c00000 file
md.b 0x7fc0 0x23
md.l 0x7fc0 4
md 0x7fc0 1
md.w 0x7fc0 9
mw.b 0x100000 0x5a 0x40000; cmp.b 0x100000 0x7fc0 10
cmp.b 0x100000 0x110000 0x1000
cmp.l 0x100000 0x7fc0 10
cp.b 0x7fc0 0x300000 0x100; cmp.b 0x7fc0 0x300000 0x100
nand device 0
nand device
nand info
printenv nand_erasesize
nand bad
nand erase 0x800000 0x20001
nand erase 0x800100 0x20000
nand write 0x100000 0x800000 0x20000
nand write 0x100000 0x800100 0x20000
nand read 0x200000 0x800100 0x800
nand read 0x200000 0x800000 0x123
nand erase 0x7f80000 0x100000
nand erase 0x8000000 0x20000
nand markbad 0x820000
nand bad
nand erase 0x800000 0x60000
nand write 0x100000 0x800000 0x40000
nand read 0x200000 0x800000 0x40000
nand read 0x200000 0x7f40000
nand read 0x200000 0x7f60000 0x40000
nand erase 0xa00000 0x40000; mw.b 0x100800 0xff 0x800; nand write.trimffs 0x100000 0xa00000 0x40000
nand write.trimffs 0x100000 0xa3f000 0x1000
nand read 0x200000 nothing
nand read 0x200000 0x800000 zz
nand erase.spread 0x800000 0x40000
nand erase.part spare
mw.b 0x110000 0x0f 0x800; nand write 0x100000 0x900000 0x800; nand write 0x110000 0x900000 0x800
nand read 0x200000 0x900000 0x800; echo $?
mtdparts
nonsense; echo $?
false; echo $?
true && echo yes; false && echo no; echo after
false || echo or; true || echo not
echo "a  b" 'c  d' \; e
echo 'a\b' "a\b" a\b
echo @1:$?
if true; then echo @1:ok; else echo @1:failed; fi
if nand read 0 0x100 1; then echo @1:ok; else echo @1:failed; fi
if false; then echo a; elif true; then echo b; else echo c; fi; echo $?
if false; then echo a; fi; echo $?
if true; then false; else true; fi && echo no
if false || true; then if false; then echo 1; else echo 2; fi; fi; echo 3
if echo "if"; true; then echo then; fi
then echo a
a1='x y'; echo $a1
b1='it'; setenv c ${a1}${b1}; printenv c; setenv c
d='a"b'; echo "$d" $d
m=1 n=2
echo $m$n
e="1 2"; echo $e; setenv e env; echo $e; setenv e
echo x=1 y
q=''\''it is a;b $x '\''\\'\'''\'' \\\\ end'\'''; setenv r ${q}; printenv r; setenv r
nand read 0 0x1000000 0
nand read 0 0x8000000 0
true & echo b
false; echo @2:$?
echo a;echo b
echo # nothing
setenv x 'a;b $ipaddr'; printenv x; echo $x; echo "${x}"
setenv y 'c  d'; echo $y "$y"
setenv w a\\b; printenv w; printenv
setenv w; printenv w
echo $undefined. ${undefined}.
setenv a=b c
setenv
setenv nothing; echo $?
sleep 0
crc32
crc32 0x7fc0
crc32 0x7fc0 0
mw 1
bootm 0x7fc0 - 0xa00000
iminfo 0x7fc0
saveenv
nand
echo 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15
echo 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16
""".strip().splitlines()
KEYS = (
    b"echo a\3",
    b"echo x\x7fy\r",
    b"\r",
    b"ec\tz\r",
    b"echo ab\x02\x02c\r",
    b"echo \x1b[Dq\r",
    b"echo 12\x01\x05\x01\x06\x04\x05\x0b3\x01\x0b\x15echo 4\r",
    b"\x10\x10\x0e5\r",
    b'setenv z "it\'s"\rx\r\3',
    b"if true; then echo a\recho b\rfi\r",
    b"if true; then\recho 'c\rd'\relse\r\rfi; echo e\r",
    b"if true; then echo f\r\3",
)
LOADED = bytes(range(256)) * 400 + b"x"


def masked(answer: str) -> str:
    """Without what depends on the server, and without the help, of which the double has a part."""
    answer = re.sub(r"[\d.]+ [KM]iB/s", "SPEED", answer).replace("\b\b\b 0\n", "\b\b\b 0 \n")
    answer = re.sub(r"#+", "#", answer)
    return re.sub(r"(?<=Usage:\n)(\w+)[^\0]*", r"\1", answer)


@pytest.fixture(scope="module")
def real(qemu: Path, uboot: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What our U-Boot answers on the emulated board, with a flash that has its tables of bad blocks."""
    folder = tmp_path_factory.mktemp("real")
    (folder / "file").write_bytes(LOADED)
    flash = NandImage.blank(folder / "flash").path
    drive = ("-drive", f"if=mtd,format=raw,file={flash}")
    chip = Nand(128 << 20, 128 << 10, 2048, ())
    with Machine(qemu, "-bios", uboot, *drive, options="pace=off") as machine:
        machine.write_memory(0x1000000, tables_content(chip))
        Console(machine).run(f"nand write 0x1000000 {tables_slot(chip).offset:#x} 0x80000")
    network = ("-nic", f"user,net=10.0.0.0/24,tftp={folder}", "-nic", "user,net=10.0.1.0/24")
    with Machine(qemu, *INSTRUCTION_TIME, "-bios", uboot, *drive, *network) as machine:
        return answers(AtTheTwin(machine.uarts[0]))


def answers(line: Talker) -> dict[str, str]:
    """What a console says to the list, from power-up on."""
    output = {"power-up": masked(line.stop_autoboot())}
    for command in ALIKE:
        output[command] = masked(line.run(command))
    for keys in KEYS:
        output[str(keys)] = ""
        for part in re.findall(rb"[^\r\3]*[\r\3]", keys):  # what comes while a command runs may be lost
            line.send(part)
            output[str(keys)] += plain(line.wait_for(b"> "))
    line.send(b"reset\r")
    output["reset"] = masked(line.stop_autoboot())
    return output


@pytest.fixture(scope="module")
def alike() -> dict[str, str]:
    with (
        serving(file=LOADED) as server,
        Double(variant="ours", environment=None, tftp=server.address) as double,
    ):
        return answers(Terminal(double.port))


@pytest.mark.slow
@pytest.mark.parametrize("command", ["power-up", "reset", *ALIKE, *map(str, KEYS)])
def test_says_what_our_uboot_says(real: dict[str, str], alike: dict[str, str], command: str) -> None:
    assert alike[command] == real[command]


# ---- files


def legacy_image(payload: bytes, load: int) -> bytes:
    def head(crc: int) -> bytes:
        fields = (0x27051956, crc, 0, len(payload), load, load, zlib.crc32(payload))
        return struct.pack(">7I4B32s", *fields, 5, 2, 2, 0, b"Linux")

    return head(zlib.crc32(head(0))) + payload


@pytest.fixture
def uimage() -> bytes:
    return legacy_image(os.urandom(70_000), 0x8000)


@pytest.fixture
def tree() -> bytes:
    return struct.pack(">10I", 0xD00DFEED, 72, 56, 64, 40, 17, 16, 0, 8, 8) + bytes(32)
