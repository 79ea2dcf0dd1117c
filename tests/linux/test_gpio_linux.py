# SPDX-License-Identifier: GPL-3.0-or-later
"""GPIO under Linux: lines and their names, levels, pulls, edges and levels as interrupts, refused lines."""

import re
import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from gateway_trees import gateway_dtb

from nuc980.pins.chip import gpio_number, load_chip, pin_order
from nuc980.twin.linux import Kernel, Linux

CHIP = load_chip()
PROGRAM = Path(__file__).parent / "programs" / "gpio-lines.c"
# A UART whose interrupt is a line of the GPIO controller: what a driver does with a level.
LEVEL_UART = """
&uart8 { interrupt-parent = <&gpio>; interrupts = <34 4>; };
"""
LEVEL_LINE = "PB2"
INTSRC = 0xB0004060  # of bank B

Boot = Callable[..., Linux]


@pytest.fixture(scope="module")
def extra_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path | str]:
    program = tmp_path_factory.mktemp("gpio") / "gpio-lines"
    subprocess.run(
        ["arm-linux-gnueabi-gcc", "-std=c11", "-D_GNU_SOURCE", "-O2", "-static", "-march=armv5te", "-marm",
         "-Wall", "-Wextra", "-Werror", "-o", program, PROGRAM], check=True
    )  # fmt: skip
    return {"/gpio-lines": program}


def press(linux: Linux, pin: str, level: bool) -> None:
    linux.machine.command("qom-set", path="/machine/soc/gpio", property=pin, value=level)


def level(linux: Linux, pin: str) -> bool:
    return linux.machine.command("qom-get", path="/machine/soc/gpio", property=pin)


def lines(*pins: str) -> str:
    return " ".join(str(gpio_number(pin)) for pin in pins)


def quiet(command: str) -> str:
    """A command whose lines the kernel's do not come between."""
    return f"dmesg -n 1; dmesg -c > /dev/null; {command}; dmesg -n 5"


def watch(linux: Linux, edges: str, count: int, *pins: str) -> None:
    linux.run(
        f"rm -f /tmp/edges; /gpio-lines watch {edges} {count} {lines(*pins)} > /tmp/edges &\n"
        "until grep -q ready /tmp/edges; do sleep 0.01; done"
    )


def seen(linux: Linux, count: int) -> list[str]:
    """The first events since watch(), when there are so many."""
    output = linux.run(f"until [ $(wc -l < /tmp/edges) -gt {count} ]; do sleep 0.01; done; cat /tmp/edges")
    return output.splitlines()[1:]


def test_every_pin_is_a_line_with_its_name(linux: Linux) -> None:
    output = linux.run(quiet("/gpio-lines names"))
    named = re.findall(r"^(\d+) (\S+)$", output, re.M)
    assert named == [(str(gpio_number(pin)), pin) for pin in sorted(CHIP.pins, key=gpio_number)]


def test_outputs_are_seen_outside(linux: Linux) -> None:
    for one, other in ((1, 0), (0, 1), (1, 1)):
        linux.run(f"/gpio-lines set 34={one} 197={other}")
        assert (level(linux, "PB2"), level(linux, "PG5")) == (bool(one), bool(other))


def test_inputs_are_read(linux: Linux) -> None:
    for high in (True, False):
        press(linux, "PB4", high)
        press(linux, "PE10", not high)
        assert linux.run(f"/gpio-lines get none {lines('PB4', 'PE10')}").split() == [
            f"36={high:d}",
            f"138={not high:d}",
        ]


def test_an_output_becomes_an_input_again(linux: Linux) -> None:
    linux.run("/gpio-lines set 37=1")
    press(linux, "PB5", False)
    assert level(linux, "PB5") is True, "an output is stronger than what comes from outside"
    linux.run("/gpio-lines get none 37")
    assert level(linux, "PB5") is False


def test_pulls(linux: Linux) -> None:
    assert [linux.run(f"/gpio-lines get {pull} 38") for pull in ("up", "down", "up", "none")] == [
        "38=1", "38=0", "38=1", "38=0",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("edges", "expected"),
    [("rising", ["rising", "rising"]), ("falling", ["falling", "falling"]),
     ("both", ["rising", "falling", "rising", "falling"])],
)  # fmt: skip
def test_edges_from_outside_are_events(linux: Linux, edges: str, expected: list[str]) -> None:
    press(linux, "PB3", False)
    watch(linux, edges, len(expected), "PB3")
    count = 0
    for high in (True, False, True, False):
        press(linux, "PB3", high)
        count += edges in ("both", "rising" if high else "falling")
        seen(linux, count)  # two edges before the interrupt is served would be one
    assert seen(linux, count) == [f"35 {edge} {number}" for number, edge in enumerate(expected, 1)]


def test_lines_of_the_banks_interrupt_each_by_itself(linux: Linux) -> None:
    pins = ("PA6", "PB0", "PC0", "PD6", "PE10", "PG5")  # the board leaves none of bank F
    for pin in pins:
        press(linux, pin, False)
    watch(linux, "rising", len(pins), *pins)
    for count, pin in enumerate(pins, 1):
        press(linux, pin, True)
        assert seen(linux, count)[-1] == f"{gpio_number(pin)} rising {count}"


def test_a_pin_of_a_device_is_refused_by_name(linux: Linux) -> None:
    output = linux.run(quiet(f"/gpio-lines set {gpio_number('PA9')}=1; dmesg"))
    assert "request: Invalid argument" in output
    assert re.search(
        r"pin PA9 already requested by b0072000\.serial; cannot claim for b0004000\.gpio:\d+", output
    )
    assert "UART2_RXD" in linux.machine.info("nuc980-pins").split("PA9", 1)[1].splitlines()[0]


@pytest.mark.parametrize("pin", ["PB14 (46)", "beyond bank A (26)", "beyond all (224)"])
def test_a_line_without_a_pin_is_refused(linux: Linux, pin: str) -> None:
    number = re.search(r"\((\d+)\)", pin)[1]
    status, output = linux.try_to(f"/gpio-lines get none {number}")
    assert (status, output) == (1, "request: Invalid argument")


def test_a_level_interrupts_without_an_edge(boot: Boot, kernel: Kernel, tmp_path: Path) -> None:
    linux = boot(kernel=replace(kernel, dtb=gateway_dtb(tmp_path, LEVEL_UART)))
    press(linux, LEVEL_LINE, True)
    linux.run("sleep 0.2 && cat /dev/ttyS8 > /dev/null 2>&1 &")  # the shell is out of the way by then
    deadline = time.monotonic() + 30
    while not linux.machine.read(INTSRC) >> pin_order(LEVEL_LINE)[1] & 1:
        assert time.monotonic() < deadline, "no interrupt, though the line is high and the port open"
    press(linux, LEVEL_LINE, False)
    count = r"awk '/nuc980-gpio +34 /{ print $2, $5 }' /proc/interrupts"
    number, how = linux.run(count).split()
    assert (int(number) > 0, how) == (True, "Level")
    assert linux.run(count).split()[0] == number, "it goes on without its level"
