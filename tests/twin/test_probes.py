# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs on the bare processor (tests/twin/probes): what registers alone cannot show."""

import random
import re
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from nuc980.twin.machine import Machine, MachineError, SerialLine
from nuc980.twin.nand import NandImage

Start = Callable[..., Machine]

# Instructions are the clock, 32 ns each, with no waiting when the processor does: a busy host is harmless.
EXACT = ("-icount", "shift=5,sleep=off")


@pytest.fixture
def run(board: Start, probes: Path) -> Callable[..., str]:
    """Runs a probe to its end and returns what it has said."""

    def to_the_end(name: str, *arguments: str | Path) -> str:
        return rest_of(board("-bios", probes / f"{name}.bin", *EXACT, *arguments))

    return to_the_end


def rest_of(machine: Machine) -> str:
    return machine.uarts[0].wait_for(b"end\n").decode("ascii", "replace")


def line_after(line: SerialLine, start: str) -> str:
    """The line that begins so, without its start."""
    line.wait_for(start.encode())
    return line.wait_for(b"\n").decode().strip()


# ---- processor, interrupt controller, timers -----------------------------------------------------


def test_interrupts_come_in_the_order_of_their_levels(run: Callable[..., str]) -> None:
    output = run("interrupts")
    for order, first in (("0 1 2", 16), ("2 0 1", 30), ("1 2 0", 17)):
        assert f"first of {order.replace(' ', '')}: {first}\nserved: {order}\n" in output


def test_a_masked_interrupt_waits(run: Callable[..., str]) -> None:
    assert "raw while masked: 1\nmasked 1: 0\nunmasked 1: 1\n" in run("interrupts")


def test_a_higher_level_interrupts_a_handler_that_lets_it(run: Callable[..., str]) -> None:
    assert "nested: 2 1 9\n" in run("interrupts")


def test_level_0_is_the_fast_interrupt(run: Callable[..., str]) -> None:
    output = run("interrupts")
    assert f"fast: 2 3 {0x11} 9\n" in output  # it came inside the other, in the FIQ's processor mode
    assert "none left: 0\n" in output


@pytest.mark.parametrize("timer", range(5))
def test_timer_keeps_time_beside_another(run: Callable[..., str], timer: int) -> None:
    output = run("timers")
    found = re.search(rf"timer {timer}: 49 interrupts in (\d+) us", output)
    assert found and abs(int(found[1]) - 49_000) <= 2
    found = re.search(rf"timer {timer}: 1 one-shot after (\d+) us, then off 0 at 0", output)
    assert found and abs(int(found[1]) - 1000) <= 2


# ---- resets, memory, pins ------------------------------------------------------------------------


def test_the_watchdog_bites(run: Callable[..., str]) -> None:
    output = run("watchdog")
    assert output.startswith("up, dog's mark 0\ncause 1\nlocked: 0\nfed, warned 0\nwarned after ")
    found = re.search(r"warned after (\d+) us", output)
    assert found and abs(int(found[1]) - 31_250) < 100  # 2^10 of 32768 Hz
    assert "\nup, dog's mark 1\n" in output
    assert output.endswith("cleared: 0\nend\n")


def test_software_resets_the_chip(run: Callable[..., str]) -> None:
    lines = run("restart").splitlines()
    assert lines[0] == "up, cause 1, select of UART1's pin 0"
    assert lines[1] == "locked, still here"
    assert re.fullmatch(r"up, cause [1-9a-f]\w*, select of UART1's pin 0", lines[2])


@pytest.mark.parametrize("mib", [16, 64, 128])
def test_memory_ends_where_its_controller_says(run: Callable[..., str], mib: int) -> None:
    assert f"controller {mib} MiB\nmemory {mib} MiB\n" in run("memory", "-m", f"{mib}M")


def test_a_kernel_starts_at_its_entry(board: Start, probes: Path) -> None:
    assert "controller 64 MiB\n" in rest_of(board("-kernel", probes / "memory.elf", *EXACT))


def test_a_wrong_pin_is_silent(board: Start, probes: Path) -> None:
    machine = board("-bios", probes / "pins.bin", *EXACT, uarts=(0, 3))
    console, line = machine.uarts[0], machine.uarts[3]
    console.wait_for(b"wrong pins, type\n")
    line.send(b"abc")
    console.send(b"1\n")
    assert line_after(console, "heard ") == "0"
    console.wait_for(b"right pins, type\n")
    line.send(b"de")
    console.send(b"1\n")
    assert line_after(console, "heard ") == "2"
    console.wait_for(b"end\n")
    assert line.wait_for(b"right") == b"right"
    assert line.receive(0.05) == b""


def test_edges_on_pins(run: Callable[..., str]) -> None:
    assert run("gpio").splitlines() == [
        "up: pins 3c, interrupts 1, source 14",
        "same: pins 3c, interrupts 0, source 0",
        "down: pins 0, interrupts 1, source 18",
        "end",
    ]


# ---- serial lines --------------------------------------------------------------------------------


@pytest.mark.parametrize("baud", [9600, 115200])
def test_echo_by_interrupts_at_the_speed_of_the_line(board: Start, probes: Path, baud: int) -> None:
    console = board("-bios", probes / "echo.bin", *EXACT).uarts[0]
    text = bytes(random.Random(baud).choices(b"abcdefghijklmnop", k=159)) + b"."
    console.wait_for(b"speed?\n")
    console.send(b"%d\n" % baud)
    console.wait_for(b"at %d\n" % baud)
    console.send(text)
    assert console.wait_for(b".") == text
    found = re.match(r"(\d+) in (\d+) us, full (\d+), rests (\d+), overruns 0", line_after(console, "bytes "))
    assert found
    count, time, full, rests = map(int, found.groups())
    assert count == len(text)
    assert full >= len(text) // 8 // 2 and rests >= 1
    # ten bits a character, and what the last interrupt adds: the time-out of 64 bits
    assert (count - 16) * 10 <= time * baud / 1_000_000 <= (count + 16) * 10 + 64


def test_six_ports_at_once(board: Start, probes: Path) -> None:
    ports = (1, 2, 3, 4, 6, 8)
    machine = board("-bios", probes / "ports.bin", *EXACT, uarts=(0, *ports))
    chance = random.Random(485)
    texts = {port: bytes(chance.choices(range(200), k=200)) for port in ports}
    machine.uarts[0].wait_for(b"ready\n")
    machine.uarts[0].send(b"1200\n")
    for port in ports:
        machine.uarts[port].send(texts[port])
    for port in ports:
        wanted = bytes(byte + port for byte in texts[port])
        assert machine.uarts[port].wait_for(wanted) == wanted
    assert line_after(machine.uarts[0], "bytes ") == "1200, overruns 0"


@pytest.mark.parametrize(("size", "full"), [(5, 0), (128, 1), (300, 2), (1000, 7)])
def test_dma_ring_with_its_time_out(board: Start, probes: Path, size: int, full: int) -> None:
    machine = board("-bios", probes / "dma.bin", *EXACT, uarts=(0, 1))
    text = random.Random(size).randbytes(size)
    machine.uarts[0].wait_for(b"ready\n")
    machine.uarts[1].send(text)
    machine.uarts[0].send(b"%d\n" % size)
    assert machine.uarts[1].wait_for(text) == text
    line = line_after(machine.uarts[0], "bytes ")
    found = re.fullmatch(rf"{size}, full (\d+), time-outs (\d+), transmits (\d+)", line)
    assert found
    assert int(found[1]) <= full
    assert int(found[2]) >= (1 if size % 128 else 0)


# ---- Ethernet ------------------------------------------------------------------------------------


class Cable:
    """The far end of an Ethernet port: a frame a datagram."""

    def __init__(self, folder: Path, port: int) -> None:
        near, far = folder / f"near{port}", folder / f"far{port}"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(far))
        self._socket.settimeout(20)
        self._near = str(near)
        self.arguments = (
            "-netdev",
            f"dgram,id=port{port},local.type=unix,local.path={near},remote.type=unix,remote.path={far}",
            "-net",
            f"nic,netdev=port{port}",
        )

    def send(self, frame: bytes) -> None:
        self._socket.sendto(frame, self._near)

    def receive(self) -> bytes:
        return self._socket.recv(2048)

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def cables(tmp_path: Path) -> Iterator[list[Cable]]:
    cables = [Cable(tmp_path, port) for port in range(2)]
    yield cables
    for cable in cables:
        cable.close()


def station(port: int) -> bytes:
    return bytes((2, 0, 0, 9, 0x80, port))


def test_both_ethernet_ports_echo_frames(board: Start, probes: Path, cables: list[Cable]) -> None:
    machine = board("-bios", probes / "ethernet.bin", *(text for cable in cables for text in cable.arguments))
    console = machine.uarts[0]
    assert line_after(console, "no pins: ") == "phy ffff"
    for port in range(2):
        assert line_after(console, f"port {port}: ") == "phy 243 c54, link 1"
    console.wait_for(b"ready\n")
    errors: list[str] = []

    def talk(port: int) -> None:
        me = bytes((2, 0, 0, 0, 0, 0x10 + port))
        chance = random.Random(port)
        hello = cables[port].receive()
        if hello[:19] != b"\xff" * 6 + station(port) + b"\x88\xb5hello" or len(hello) != 60:
            errors.append(f"port {port}: hello is {hello.hex()}")
        for kind in [*[b"\x88\xb5"] * 50, b"\x88\xb6"]:
            body = chance.randbytes(chance.choice((46, 47, 48, 49, 300, 1500)))
            cables[port].send(station(port) + me + kind + body)
            back = cables[port].receive()
            if back != me + station(port) + kind + body:
                errors.append(f"port {port}: {len(body)} bytes came back as {back.hex()}")
        cables[port].send(station(1 - port) + me + b"\x88\xb5" + bytes(46))  # another's: not taken

    talks = [threading.Thread(target=talk, args=(port,)) for port in range(2)]
    for thread in talks:
        thread.start()
    for thread in talks:
        thread.join()
    assert errors == []
    for port in range(2):
        assert line_after(console, f"port {port}: ") == "received 51, transmitted 52, interrupts of both"


# ---- NAND ----------------------------------------------------------------------------------------


@pytest.fixture
def flash(tmp_path: Path) -> tuple[str, str]:
    """The arguments for a new flash."""
    return "-drive", f"if=mtd,format=raw,file={NandImage.blank(tmp_path / 'nand.img').path}"


def test_nand_page_with_parity(run: Callable[..., str], flash: tuple[str, str]) -> None:
    lines = run("nand", *flash).splitlines()
    assert lines[0].startswith("id ef f1 ")
    assert lines[1:3] == ["erased, status c0", "written, status c0"]
    assert lines[3] == "read, wrong bytes 0, ecc events 0, fields 0"
    found = re.fullmatch(r"read, wrong bytes (\d+), ecc events 1, fields (\w+)", lines[4])
    assert found
    assert int(found[2], 16) >> 8 & 0x7F == 0b101  # second field: correctable, one error
    assert lines[5:] == ["erased, status c0", "end"]


def test_without_probe_silence(board: Start) -> None:
    """The tests above can fail: what they wait for comes from the probe alone."""
    console = board("-bios", "/dev/null").uarts[0]
    with pytest.raises(MachineError, match="no b'end"):
        console.wait_for(b"end\n", seconds=0.3)
