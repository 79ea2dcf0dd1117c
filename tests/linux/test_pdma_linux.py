# SPDX-License-Identifier: GPL-3.0-or-later
"""The DMA controllers under Linux: a UART's ring that nothing stops, and what ends it."""

import re
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from nuc980.twin.linux import Kernel, Linux

HERE = Path(__file__).parent

NEAR, FAR = "/dev/ttyS1", "/dev/ttyS3"  # the ends of one line
NEAR_RX = 7  # its request
BYTES = 10_000
HOGS = 4

CONTROLLERS = (0xB0008000, 0xB0009000)
CHANNELS = 10
TARGET, CHCTL, REQSEL = 0x08, 0x400, 0x480
NOWHERE = 0x40000000  # no RAM, no device


@pytest.fixture(scope="session")
def gaps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """programs/gaps.c for the board."""
    program = tmp_path_factory.mktemp("gaps") / "gaps"
    subprocess.run(
        ["arm-linux-gnueabi-gcc", "-std=c11", "-D_GNU_SOURCE", "-O2", "-static", "-march=armv5te", "-marm",
         "-Wall", "-Wextra", "-Werror", "-o", program, HERE / "programs/gaps.c"], check=True
    )  # fmt: skip
    return program


@pytest.fixture(scope="module")
def linux(
    boot: Callable[..., Linux], kernel_with_pdma: Kernel, gaps: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Linux]:
    """A board whose UART1 and UART3 have one line between them, and PDMA."""
    kernel = kernel_with_pdma.without_services()  # no gateway opens the lines
    wire = f"socket,path={tmp_path_factory.mktemp('wire')}/wire"
    with boot(
        kernel=kernel, chardevs={1: f"{wire},server=on,wait=off", 3: wire}, files={"/bin/gaps": gaps}
    ) as linux:
        linux.run("mkdir -p /tmp && mount -t tmpfs tmp /tmp")
        yield linux


@contextmanager
def busy_host() -> Iterator[None]:
    """More programs that want this machine than it has cores."""
    hogs = [subprocess.Popen(["sh", "-c", "while :; do :; done"]) for _ in range(HOGS)]
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def both_ways(linux: Linux, shortest: int, longest: int) -> str:
    return linux.run(f"gaps {FAR} {NEAR} 115200 {BYTES} {shortest} {longest}", seconds=300)


@contextmanager
def hearing(linux: Linux) -> Iterator[None]:
    """NEAR open, and what it hears in /tmp/heard; /tmp/pid ends it."""
    linux.run(
        f"for tty in {NEAR} {FAR}; do stty -F $tty 115200 raw -echo; done\n"
        f"cat {NEAR} > /tmp/heard & echo $! > /tmp/pid\n"
        "until [ $(cat /sys/class/dma/*/in_use | grep -c 1) = 2 ]; do sleep 0.1; done"
    )
    try:
        yield
    finally:
        linux.run("kill $(cat /tmp/pid)")


def wait_for_heard(linux: Linux, text: str) -> None:
    linux.run(f"until [ \"$(cat /tmp/heard)\" = '{text}' ]; do sleep 0.1; done", seconds=30)


def interrupts(linux: Linux) -> int:
    counts = re.findall(r": +(\d+) .*b0008000\.dma", linux.run("cat /proc/interrupts"))
    assert len(counts) == len(CONTROLLERS)
    return sum(map(int, counts))


def channels_in_use(linux: Linux) -> int:
    return linux.run("cat /sys/class/dma/*/in_use").split().count("1")


def ring_of_near(linux: Linux) -> tuple[int, int]:
    """The controller's address and the channel that UART1's receiver has."""
    machine = linux.machine
    for controller in CONTROLLERS:
        enabled = machine.read(controller + CHCTL)
        for channel in range(CHANNELS):
            selected = machine.read(controller + REQSEL + channel // 4 * 4) >> channel % 4 * 8 & 0x7F
            if enabled >> channel & 1 and selected == NEAR_RX:
                return controller, channel
    raise AssertionError("no channel serves UART1's receiver")


@pytest.mark.parametrize(
    ("shortest", "longest"), [(0, 50), (150, 200), (1, 3000)], ids=["below", "around", "above"]
)
def test_gaps_around_the_time_out_lose_no_byte(linux: Linux, shortest: int, longest: int) -> None:
    """Two characters at 115200 are 174 us; where the vendor's driver stops its ring, this one reads on."""
    assert both_ways(linux, shortest, longest).count(f"{BYTES} bytes") == 2


def test_a_busy_host_loses_no_byte(linux: Linux) -> None:
    with busy_host():
        assert both_ways(linux, 1, 400).count(f"{BYTES} bytes") == 2


def test_an_idle_line_does_not_interrupt(linux: Linux) -> None:
    with hearing(linux):
        linux.run(f"printf first > {FAR}")
        wait_for_heard(linux, "first")
        linux.run("sleep 0.1")
        before = interrupts(linux)
        linux.run("sleep 2")
        assert interrupts(linux) == before


def test_a_lone_byte_is_heard(linux: Linux) -> None:
    """By its time-out alone: no period ends, and none follows."""
    with hearing(linux):
        for heard in ("a", "ab", "abc"):
            linux.run(f"printf {heard[-1]} > {FAR}")
            wait_for_heard(linux, heard)


def test_the_time_out_follows_the_speed_while_the_ring_runs(linux: Linux) -> None:
    heard = ""
    with hearing(linux):
        for speed in (9600, 115200, 1200, 38400):
            linux.run(f"for tty in {NEAR} {FAR}; do stty -F $tty {speed}; done; printf {speed} > {FAR}")
            heard += str(speed)
            wait_for_heard(linux, heard)


def test_channels_come_and_go_while_the_far_end_sends(linux: Linux) -> None:
    assert channels_in_use(linux) == 0
    linux.run(
        f"stty -F {FAR} 115200 raw -echo\n"
        f"(while :; do printf 0123456789abcdef; done) > {FAR} & far=$!\n"
        f"n=0; while [ $n -lt 40 ]; do stty -F {NEAR} $((n % 2 ? 115200 : 38400)) raw; n=$((n + 1)); done\n"
        f"kill $far; wait $far 2> /dev/null; true",
        seconds=300,
    )
    assert channels_in_use(linux) == 0


def test_a_bus_error_ends_the_transfer_and_only_it(linux: Linux) -> None:
    with hearing(linux):
        controller, channel = ring_of_near(linux)
        linux.run(f"printf x > {FAR}")
        wait_for_heard(linux, "x")
        linux.machine.write(controller + 16 * channel + TARGET, NOWHERE)
        linux.run(f"printf lost > {FAR}; until dmesg | grep 'bus error, channels'; do sleep 0.1; done")
        before = interrupts(linux)
        linux.run("sleep 1")
        assert interrupts(linux) == before
    assert channels_in_use(linux) == 0
    with hearing(linux):
        linux.run(f"printf again > {FAR}")
        wait_for_heard(linux, "again")
