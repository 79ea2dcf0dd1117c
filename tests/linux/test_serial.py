# SPDX-License-Identifier: GPL-3.0-or-later
"""The six lines of the emulated board under Linux, by interrupts and by PDMA.

Every byte both ways, at each speed and format; errors, flow control, RS-485; the console when all is lost.
"""

import dataclasses
import random
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import cast

import pytest

from nuc980.twin.linux import Kernel, Linux, archive
from nuc980.twin.machine import INSTRUCTION_TIME, Machine, SerialLine

LINES = (1, 2, 3, 4, 6, 8)  # of the six the numbers of UART and tty
WITH_RTS = 3
UART_HZ = 12_000_000  # the crystal

# Registers of a UART, its bits; of the model as the driver set them
IER, LCR, MCR, FSR, BAUD = 0x04, 0x0C, 0x10, 0x18, 0x24
RTS_LEVEL = 1 << 13  # inactive is high
RX_OVERRUN, RX_LEVEL, TX_FULL, RX_IDLE = 1 << 0, 0x3F << 8, 1 << 23, 1 << 29


def wire_flow_control(machine: Machine) -> None:
    """Gives two UARTs the RTS and CTS pins that this board has not."""
    for number in (2, WITH_RTS):
        for pin in ("rts-pin", "cts-pin"):
            machine.set_line(f"uart[{number}]", pin, 1)


def uart(number: int) -> int:
    return 0xB0070000 + 0x1000 * number


@pytest.fixture(scope="module", params=["interrupts", "pdma"])
def mode(request: pytest.FixtureRequest) -> str:
    return cast(str, request.param)


@pytest.fixture(scope="module")
def kernel_of_mode(mode: str, kernel: Kernel, kernel_with_pdma: Kernel) -> Kernel:
    return kernel_with_pdma if mode == "pdma" else kernel


@pytest.fixture(scope="module")
def linux(boot: Callable[..., Linux], kernel_of_mode: Kernel, serial_line: Path) -> Iterator[Linux]:
    kernel = kernel_of_mode.without_services()  # no gateway opens the lines
    with boot(
        *INSTRUCTION_TIME, kernel=kernel, uarts=(0, *LINES), files={"/bin/serial-line": serial_line}
    ) as linux:
        wire_flow_control(linux.machine)
        linux.run("mount -t tmpfs tmpfs /tmp")
        yield linux


class Near:
    """A run of serial-line on the board, its words as they come."""

    _numbers = count()

    def __init__(self, linux: Linux, *arguments: object) -> None:
        self._linux = linux
        self._file = f"/tmp/near{next(self._numbers)}"
        words = " ".join(map(str, arguments))
        linux.run(
            f": > {self._file}; (serial-line {words} > {self._file} 2>&1 & echo $! > {self._file}.pid;"
            f" wait $!; echo status $? >> {self._file}) > /dev/null 2>&1 &"
        )

    def wait_for(self, pattern: str, seconds: float = 60.0) -> None:
        deadline = time.monotonic() + seconds
        while not re.search(pattern, self.words(), re.MULTILINE):
            assert time.monotonic() < deadline, f"no {pattern!r}: {self.words()}"
            time.sleep(0.1)

    def words(self) -> str:
        return self._linux.run(f"cat {self._file}")

    def signal(self, name: str) -> None:
        self._linux.run(f"kill -{name} $(cat {self._file}.pid)")

    def finish(self, seconds: float = 60.0) -> str:
        """All that it said; it must have ended well."""
        self.wait_for("^status", seconds)
        report, _, status = self.words().rpartition("status ")
        assert status.strip() == "0", report
        return report


def counts(report: str, line: int) -> dict[str, int]:
    """The last counters that it printed of a line."""
    found = re.findall(rf"^/dev/ttyS{line} (rx .*)$", report, re.MULTILINE)[-1]
    return {name: int(value) for name, value in re.findall(r"(\w+) (\d+)", found)}


def errors(report: str, line: int) -> dict[str, int]:
    return {name: value for name, value in counts(report, line).items() if name not in ("rx", "tx")}


def pattern(line: int, end: int, size: int, bits: int = 8) -> bytes:
    """serial-line's bytes, 0 from the board, 1 to it."""
    return bytes((n * 7 + (n >> 8) * 13 + line * 31 + end * 101) & ((1 << bits) - 1) for n in range(size))


def far_ends(
    ends: Mapping[int, SerialLine],
    to_send: Mapping[int, bytes],
    sizes: Mapping[int, int],
    bursts: random.Random | None = None,
    seconds: float = 60.0,
) -> dict[int, bytes]:
    """Sends on all lines at once, at once or in bursts, and receives until the sizes are there."""
    left, received = dict(to_send), {n: b"" for n in sizes}
    deadline = time.monotonic() + seconds
    while any(left.values()) or any(len(received[n]) < sizes[n] for n in sizes):
        assert time.monotonic() < deadline, {n: len(received[n]) for n in sizes}
        for n in left:
            size = bursts.randint(1, 300) if bursts else len(left[n])
            if left[n] and (not bursts or bursts.random() < 0.3):
                ends[n].send(left[n][:size])
                left[n] = left[n][size:]
        for n in sizes:
            received[n] += ends[n].receive(0.001)
    return received


def check_duplex(
    linux: Linux,
    form: str,
    speed: int,
    size: int,
    lines: Sequence[int] = LINES,
    bursts: random.Random | None = None,
) -> None:
    near = Near(linux, "duplex", form, speed, size, *(f"/dev/ttyS{n}" for n in lines))
    near.wait_for("^ready")
    before = near.words()
    bits = int(form[0])
    got = far_ends(
        linux.machine.uarts, {n: pattern(n, 1, size, bits) for n in lines}, dict.fromkeys(lines, size), bursts
    )
    report = near.finish()
    for n in lines:
        assert got[n] == pattern(n, 0, size, bits), f"from ttyS{n}"
        assert f"/dev/ttyS{n} sent {size} received {size} wrong 0 first 0" in report, report
        assert errors(report, n) == errors(before, n), report


def check_registers(linux: Linux, line: int, speed: int, form: str) -> None:
    brd = linux.machine.read(uart(line) + BAUD)
    divider = (brd & 0xFFFF) + 2
    real = UART_HZ / divider if brd >> 28 == 3 else UART_HZ / divider / 16
    assert abs(real - speed) / speed < 0.005, (hex(brd), real)
    parity = {"N": 0x10, "E": 0x18, "O": 0x08, "M": 0x28, "S": 0x38}[form[1]]
    assert linux.machine.read(uart(line) + LCR) == int(form[0]) - 5 | (form[2] == "2") << 2 | parity


@pytest.mark.parametrize("speed", [300, 1200, 9600, 19200, 38400, 57600, 115200, 230400])
def test_six_lines_at_once(linux: Linux, speed: int) -> None:
    check_duplex(linux, "8N1", speed, max(20, min(speed // 30, 5000)))
    for line in LINES:
        check_registers(linux, line, speed, "8N1")


@pytest.mark.parametrize("speed", [460800, 921600])
def test_one_fast_line(linux: Linux, speed: int) -> None:
    check_duplex(linux, "8N1", speed, 10000, (8,))
    check_registers(linux, 8, speed, "8N1")


@pytest.mark.parametrize("form", ["8E1", "8O1", "8M1", "8S1", "7E1", "7O2", "8N2", "6N1", "5E1"])
def test_formats(linux: Linux, form: str) -> None:
    check_duplex(linux, form, 19200, 300)
    for line in LINES:
        check_registers(linux, line, 19200, form)


def test_slow_speeds_divide_by_16(linux: Linux) -> None:
    check_duplex(linux, "8N1", 110, 12)
    check_registers(linux, 1, 110, "8N1")
    assert linux.machine.read(uart(1) + BAUD) >> 28 == 0


@pytest.mark.parametrize("speed", [9600, 115200])
def test_bursts_with_gaps_around_the_time_out(linux: Linux, speed: int) -> None:
    check_duplex(linux, "8N1", speed, speed // 10, bursts=random.Random(speed))


def test_real_speeds_are_reported(linux: Linux) -> None:
    report = Near(linux, "speeds", "/dev/ttyS1", 300, 9600, 115200, 921600, 5_000_000, 3).finish()
    speeds = [tuple(map(int, line.split())) for line in report.splitlines()]
    assert speeds[:4] == [(300, 300), (9600, 9600), (115200, 115385), (921600, 923077)]
    assert speeds[4:] == [(5_000_000, 923077), (3, 923077)]  # impossible ones leave it as it was


def test_speed_changes_while_open(linux: Linux) -> None:
    speeds = (300, 115200, 1200, 57600)
    near = Near(linux, "echo", "8E1", 24, "/dev/ttyS4", *speeds)
    for speed in speeds:
        near.wait_for(f"at {speed}")
        sent = pattern(4, 1, 24)
        assert far_ends(linux.machine.uarts, {4: sent}, {4: 24})[4] == sent
    near.finish()


INJECTED = {
    "parity": ("inject-parity-errors", "ff 00 59"),  # of X the lowest bit is wrong
    "frame": ("inject-framing-errors", "ff 00 b0"),  # X sampled one bit early
    "brk": ("inject-breaks", "ff 00 00"),
}


def wait_until(linux: Linux, register: int, mask: int, value: int) -> None:
    """Until a register's bits are so, as the model has them."""
    deadline = time.monotonic() + 60
    while (seen := linux.machine.read(register)) & mask != value:
        assert time.monotonic() < deadline, hex(seen)


@contextmanager
def nobody_reads(linux: Linux, line: int) -> Iterator[SerialLine]:
    """The line's far end, while what comes from it stays in the FIFO."""
    ier = linux.machine.read(uart(line) + IER)
    linux.machine.write(uart(line) + IER, 0)
    yield linux.machine.uarts[line]
    linux.machine.write(uart(line) + IER, ier)


@pytest.mark.parametrize("kind", list(INJECTED))
def test_errors_are_counted_and_flagged(linux: Linux, kind: str) -> None:
    what, flagged = INJECTED[kind]
    near = Near(linux, "receive", "8E1i", 19200, 8, f"/dev/ttyS{WITH_RTS}")
    near.wait_for("^ready")
    before = errors(near.words(), WITH_RTS)
    with nobody_reads(linux, WITH_RTS) as end:
        end.send(b"abc")
        wait_until(linux, uart(WITH_RTS) + FSR, RX_LEVEL, 3 << 8)
        linux.machine.monitor(f"qom-set /machine/soc/uart[{WITH_RTS}] {what} 1")
        end.send(b"X")
        wait_until(linux, uart(WITH_RTS) + FSR, RX_LEVEL, 4 << 8)
    near.wait_for(f"61 62 63 {flagged}")
    end.send(b"de")
    report = near.finish()
    assert f"61 62 63 {flagged} 64 65" in report
    assert errors(report, WITH_RTS) == before | {kind: before[kind] + 1}


def test_overrun_is_counted(linux: Linux) -> None:
    near = Near(linux, "receive", "8N1", 115200, 18, "/dev/ttyS6")
    near.wait_for("^ready")
    before = errors(near.words(), 6)
    sent = pattern(6, 1, 30)
    with nobody_reads(linux, 6) as end:
        end.send(sent)
        wait_until(linux, uart(6) + FSR, RX_OVERRUN, RX_OVERRUN)
        wait_until(linux, uart(6) + FSR, RX_IDLE, RX_IDLE)
    near.wait_for(f"{sent[15]:02x} 00")  # the zero is the mark of what is lost
    end.send(b"!")
    report = near.finish()
    assert sent[:16].hex(" ") + " 00 21" in report
    assert errors(report, 6) == before | {"overrun": before["overrun"] + 1}


def test_flow_control_by_cts(linux: Linux) -> None:
    linux.machine.set_line(f"uart[{WITH_RTS}]", "cts", 1)
    near = Near(linux, "duplex", "8N1h", 115200, 400, f"/dev/ttyS{WITH_RTS}")
    near.wait_for("^ready")
    end = linux.machine.uarts[WITH_RTS]
    end.send(pattern(WITH_RTS, 1, 400))
    wait_until(linux, uart(WITH_RTS) + FSR, TX_FULL, TX_FULL)
    assert end.receive(0.5) == b""
    linux.machine.set_line(f"uart[{WITH_RTS}]", "cts", 0)
    assert far_ends(linux.machine.uarts, {}, {WITH_RTS: 400})[WITH_RTS] == pattern(WITH_RTS, 0, 400)
    assert "received 400 wrong 0" in near.finish()


def test_flow_control_by_rts(linux: Linux) -> None:
    size = 12000
    near = Near(linux, "duplex", "8N1h", 921600, size, f"/dev/ttyS{WITH_RTS}")
    near.wait_for("^ready")
    near.signal("STOP")
    linux.machine.uarts[WITH_RTS].send(pattern(WITH_RTS, 1, size))
    wait_until(linux, uart(WITH_RTS) + FSR, RX_LEVEL, 8 << 8)  # no more is read, and the far end is held
    wait_until(linux, uart(WITH_RTS) + MCR, RTS_LEVEL, RTS_LEVEL)
    near.signal("CONT")
    assert far_ends(linux.machine.uarts, {}, {WITH_RTS: size})[WITH_RTS] == pattern(WITH_RTS, 0, size)
    assert f"received {size} wrong 0" in near.finish()


# ---- RS-485

ENABLED, RTS_ON_SEND, RTS_AFTER_SEND = 1, 2, 4
WORDS = ("after-setting.", "after-tcsetattr.", "with-crtscts.", "after-open.", "after-rts.")


# Milliseconds before and after sending: without any the UART moves RTS, with one the driver.
DELAYS = ((0, 0), (2, 0), (0, 3), (2, 3))


@pytest.mark.parametrize("delays", DELAYS, ids=str)
@pytest.mark.parametrize("polarity", [RTS_ON_SEND, RTS_AFTER_SEND])
def test_rs485_settings_stay(linux: Linux, polarity: int, delays: tuple[int, int]) -> None:
    report = Near(linux, "direction", ENABLED | polarity, *delays, "/dev/ttyS2").finish()
    settings = f"{ENABLED | polarity:#x} {delays[0]} {delays[1]}"
    assert report.split("\n") == [
        f"set {settings}",
        *(f"{word} {settings}" for word in WORDS),
        "without. 0 0 0",
        "",
    ]
    sent = "".join((*WORDS, "without.")).encode()
    assert linux.machine.uarts[2].wait_for(b"without.").endswith(sent)


@pytest.mark.parametrize("delays", [DELAYS[0], DELAYS[-1]], ids=str)
@pytest.mark.parametrize("polarity", [RTS_ON_SEND, RTS_AFTER_SEND])
def test_rs485_direction(
    qemu: Path,
    kernel_of_mode: Kernel,
    serial_line: Path,
    tmp_path: Path,
    polarity: int,
    delays: tuple[int, int],
) -> None:
    """On a board whose RTS drives the transceivers, where even the debug UART, without RTS, is not heard."""
    assert kernel_of_mode.root
    script = (
        "#!/bin/sh\nexport PATH=/sbin:/bin:/usr/bin\nmount -t devtmpfs devtmpfs /dev\n"
        f"serial-line direction {ENABLED | polarity} {delays[0]} {delays[1]} /dev/ttyS2\n"
        "serial-line direction 3 0 0 /dev/ttyS3\nwhile :; do sleep 1000; done\n"
    )
    initrd = tmp_path / "initrd"
    root = kernel_of_mode.root.read_bytes()
    files: dict[str, Path | str] = {"/sbin/direction": script, "/bin/serial-line": serial_line}
    initrd.write_bytes(root + bytes(-len(root) % 4) + archive(files))
    with Machine(
        qemu, *INSTRUCTION_TIME, "-global", "nuc980-uart.de-on-rts=on",
        "-kernel", kernel_of_mode.image, "-initrd", initrd,
        "-dtb", kernel_of_mode.dtb,
        "-append", "console=ttyS0,115200 rdinit=/sbin/direction", uarts=(0, 2, 3),
    ) as machine:  # fmt: skip
        wire_flow_control(machine)
        assert machine.uarts[3].wait_for(WORDS[-1].encode()) == "".join(WORDS).encode()
        expected = "".join(WORDS) if polarity == RTS_ON_SEND else ""
        assert machine.uarts[2].receive(0) == expected.encode()


# ---- the console


def test_panic_is_seen_and_ends_in_a_restart(boot: Callable[..., Linux], kernel_of_mode: Kernel) -> None:
    kernel = kernel_of_mode.without_services()
    kernel = dataclasses.replace(kernel, arguments=f"{kernel.arguments} panic=1")
    with boot(*INSTRUCTION_TIME, kernel=kernel) as linux:
        linux.type("echo c > /proc/sysrq-trigger\n<run 1>\n")
        linux.wait_for("Kernel panic - not syncing: sysrq triggered crash")
        linux.wait_for_shell()
        linux.troubles.clear()


def test_panic_at_the_earliest_is_seen(qemu: Path, kernel: Kernel, tmp_path: Path) -> None:
    """Without an interrupt controller, and with the pins as the vendor's U-Boot leaves them."""
    dtb = tmp_path / "broken.dtb"
    good = kernel.dtb.read_bytes()
    assert good.count(b"nuvoton,nuc980-aic\0") == 1
    dtb.write_bytes(good.replace(b"nuvoton,nuc980-aic\0", b"nuvoton,nuc980-no!\0"))
    with Machine(
        qemu, *INSTRUCTION_TIME, "-kernel", kernel.image, "-dtb", dtb, "-append", "earlycon"
    ) as machine:
        machine.uarts[0].wait_for(b"Kernel panic - not syncing")
