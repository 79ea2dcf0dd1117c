# SPDX-License-Identifier: GPL-3.0-or-later
"""Pins: the routing, the warnings, and the view of both."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from nuc980.boards import board_names, pin_table
from nuc980.pins.board import load_board
from nuc980.pins.chip import load_chip
from nuc980.twin.machine import Machine, MachineError

ROOT = Path(__file__).resolve().parents[2]
CHIP = load_chip()
BOARD = load_board(ROOT / "board/nuc980/boards/gateway/pins.yml", CHIP)
SETTLED = 200_000_000  # ns: longer than a driver takes to switch its pins
UART1 = 0xB0071000
THR, LCR, BAUD = 0x00, 0x0C, 0x24
MACHINE_SECONDS = 0.3  # in which a silent line says nothing


def switch(machine: Machine, pin: str, signal: str | int) -> None:
    """As pinctrl does: reads the register, changes one pin's field, writes it."""
    value = signal if isinstance(signal, int) else CHIP.value(pin, signal)
    assert value is not None
    register, shift = CHIP.register_of(pin)
    machine.write(register, machine.read(register) & ~(0xF << shift) | value << shift)


def switch_device(machine: Machine, label: str) -> None:
    for signal, pin in BOARD.devices[label].pins.items():
        switch(machine, pin, signal)


def view(machine: Machine) -> dict[str, Any]:
    return machine.command("qom-get", path="/machine/soc/pins", property="view")


def pin_of(machine: Machine, name: str) -> dict[str, Any]:
    return next(pin for pin in view(machine)["pins"] if pin["pin"] == name)


def device_of(machine: Machine, label: str) -> dict[str, Any]:
    return next(device for device in view(machine)["devices"] if device["device"] == label)


def conflicts(machine: Machine) -> dict[str, str]:
    return {pin["pin"]: pin["conflict"] for pin in view(machine)["pins"] if "conflict" in pin}


def warnings(machine: Machine) -> list[str]:
    return [line.partition("warning: ")[2] for line in machine.output.splitlines() if "warning: " in line]


@pytest.fixture
def traced(board: Callable[..., Machine]) -> Machine:
    return board("-trace", "nuc980_pins*", registers=True)


def lines(machine: Machine) -> dict[str, bool]:
    """The last level of each line that has changed, by what its signals begin with."""
    events = map(str.split, machine.complaints.splitlines())
    return {words[1].rstrip("*"): words[2] == "1" for words in events if words[0] == "nuc980_pins_line"}


def line_of(signal: str) -> str:
    """The line that a signal belongs to."""
    if signal.startswith("NAND_"):
        return "NAND_"
    if signal.startswith("RMII"):
        return signal[:8] if signal.endswith(("MDC", "MDIO")) else signal[:6]
    return signal


# ---- routing


def test_after_reset_all_is_gpio(bus: Machine) -> None:
    assert {pin["function"] for pin in view(bus)["pins"]} == {"GPIO"}
    assert {device["state"] for device in view(bus)["devices"]} == {"off"}


def test_every_device_of_the_board_can_be_connected(traced: Machine) -> None:
    for label in BOARD.devices:
        switch_device(traced, label)
    traced.step(SETTLED)
    assert {line_of(signal) for device in BOARD.devices.values() for signal in device.pins} == {
        line for line, level in lines(traced).items() if level
    }
    assert {device["device"]: device["connected"] for device in view(traced)["devices"]} == {
        label: len(device.pins) for label, device in BOARD.devices.items()
    }
    assert {device["state"] for device in view(traced)["devices"]} == {"connected"}
    assert conflicts(traced) == {}
    assert warnings(traced) == []


@pytest.mark.parametrize("label", BOARD.devices)
def test_each_pin_taken_away_disconnects(traced: Machine, label: str) -> None:
    for signal, pin in BOARD.devices[label].pins.items():
        switch_device(traced, label)
        assert lines(traced)[line_of(signal)]
        switch(traced, pin, "GPIO")
        assert [line for line, level in lines(traced).items() if not level] == [line_of(signal)]
        device = device_of(traced, label)
        assert device["connected"] == len(BOARD.devices[label].pins) - 1
        assert device["lacks"] == f"{signal} ({pin})"


def test_signal_on_another_pin_does_not_reach_the_device(traced: Machine) -> None:
    """PF9 can be UART1_RXD, but no wire of the RS-485 port leads there."""
    switch(traced, "PF9", "UART1_RXD")
    assert lines(traced) == {}


def test_reset_clears(bus: Machine) -> None:
    switch_device(bus, "uart1")
    switch(bus, "PD2", "QSPI0_SS0")
    bus.command("system_reset")
    assert {pin["function"] for pin in view(bus)["pins"]} == {"GPIO"}
    assert device_of(bus, "uart1")["connected"] == 0


# ---- a UART on a wrong pin says nothing


def send_byte(machine: Machine, byte: int) -> None:
    machine.write(UART1 + LCR, 3)
    machine.write(UART1 + BAUD, 0x30000066)
    machine.write(UART1 + THR, byte)
    machine.step(2_000_000)


def test_uart_is_silent_on_a_wrong_pin(board: Callable[..., Machine]) -> None:
    machine = board(registers=True, uarts=(1,))
    switch(machine, "PA0", "UART1_RXD")
    switch(machine, "PA1", "UART1_TXD")  # what the vendor's group for UART1 says; the board has PF10
    send_byte(machine, 0x55)
    assert machine.uarts[1].receive(MACHINE_SECONDS) == b""
    assert pin_of(machine, "PA1")["state"] == "not wired"
    switch(machine, "PF10", "UART1_TXD")
    send_byte(machine, 0xAA)
    assert machine.uarts[1].receive(5) == b"\xaa"


# ---- conflicts


def test_sd_takes_the_pins_of_an_emac(traced: Machine) -> None:
    """The report's device tree has sdh on, whose group in the vendor's dtsi is on EMAC1's PF0 to PF6."""
    switch_device(traced, "emac1")
    assert lines(traced) == {"RMII1_": True, "RMII1_MD": True}
    sd = ["SD1_CMD", "SD1_CLK", "SD1_DATA0", "SD1_DATA1", "SD1_DATA2", "SD1_DATA3", "SD1_nCD"]
    pins = [f"PF{number}" for number in range(7)]
    for pin, signal in zip(pins, sd, strict=True):
        switch(traced, pin, signal)
    assert lines(traced) == {"RMII1_": False, "RMII1_MD": True}
    rmii = {pin: signal for signal, pin in BOARD.devices["emac1"].pins.items()}
    assert conflicts(traced) == {
        pin: f"taken from {rmii[pin]}; the board wires it to {rmii[pin]}" for pin in pins
    }
    assert pin_of(traced, "PF6") | {"conflict": ""} == {
        "pin": "PF6", "value": 2, "function": "SD1_nCD", "owner": "sdh",
        "wired-to": "RMII1_TXD1", "state": "conflict", "conflict": "",
    }  # fmt: skip
    traced.step(SETTLED)
    assert len(warnings(traced)) == len(pins) + 1
    assert "pin PF6 is SD1_nCD: taken from RMII1_TXD1; the board wires it to RMII1_TXD1" in warnings(traced)
    assert warnings(traced)[-1].startswith("emac1 has 3 of its 10 pins, it lacks RMII1_RXERR (PF0), ")
    assert "nuc980_pins_conflict PF6 is SD1_nCD: taken from RMII1_TXD1; " in traced.complaints


def test_sd_before_the_emac(bus: Machine) -> None:
    """The kernel's pin control then refuses emac1's group: only the wiring tells."""
    switch(bus, "PF6", "SD1_nCD")
    assert conflicts(bus) == {"PF6": "the board wires it to RMII1_TXD1"}


def test_taken_lasts_until_the_pin_is_given_back(bus: Machine) -> None:
    switch(bus, "PA2", "UART6_CTS")
    switch(bus, "PA2", "I2S_LRCK")
    assert conflicts(bus) == {"PA2": "taken from UART6_CTS"}
    switch(bus, "PA2", "GPIO")
    switch(bus, "PA2", "I2S_LRCK")
    assert conflicts(bus) == {}


def test_taken_is_only_from_another(bus: Machine) -> None:
    switch(bus, "PA1", "EBI_nCS2")
    switch(bus, "PA1", "EBI_MCLK")
    switch(bus, "PC5", "NAND_nWE")
    switch(bus, "PC5", "SD0_CMD")
    assert conflicts(bus) == {"PC5": "the board wires it to NAND_nWE"}


def test_one_signal_on_two_pins(bus: Machine) -> None:
    switch(bus, "PA9", "UART2_RXD")
    switch(bus, "PD7", "UART2_RXD")
    assert conflicts(bus) == {"PA9": "PD7 is the same", "PD7": "PA9 is the same"}
    assert warnings(bus) == ["pin PD7 is UART2_RXD: PA9 is the same"]
    switch(bus, "PA9", "GPIO")
    assert conflicts(bus) == {}


def test_external_interrupt_may_have_several_pins(bus: Machine) -> None:
    """As the BSP's sample GPIO_EINTAndDebounce has it: INTSRC tells them apart."""
    switch(bus, "PB3", "EINT2")
    switch(bus, "PE10", "EINT2")
    assert conflicts(bus) == {}


@pytest.mark.parametrize(
    ("pin", "value", "reason"),
    [
        ("PF11", 7, "it has no function 7; the board wires it to UART0_RXD"),
        ("PA2", 15, "it has no function 15"),
        ("PB14", 1, "the chip has no such pin"),
        ("PA13", 6, f"not brought out by {BOARD.package.name}"),
        ("PG1", 2, "reserved: boot strap"),
    ],
)
def test_pin_that_cannot_be(bus: Machine, pin: str, value: int, reason: str) -> None:
    switch(bus, pin, value)
    assert conflicts(bus) == {pin: reason}
    assert [text.partition(": ")[2] for text in warnings(bus)] == [reason]
    switch(bus, pin, "GPIO" if pin in CHIP.pins else 0)
    assert conflicts(bus) == {}


def test_part_of_a_device(bus: Machine) -> None:
    """Told once, and only after a driver has had the time to switch the other pins."""
    for signal, pin in BOARD.devices["emac0"].pins.items():
        if signal != "RMII0_TXD0":
            switch(bus, pin, signal)
    bus.step(SETTLED // 100)
    assert warnings(bus) == []
    bus.step(SETTLED)
    assert warnings(bus) == ["emac0 has 9 of its 10 pins, it lacks RMII0_TXD0 (PE7)"]
    switch(bus, "PA2", "UART6_CTS")
    bus.step(SETTLED)
    assert len(warnings(bus)) == 1
    switch(bus, "PE7", "RMII0_TXD0")
    switch(bus, "PE0", "GPIO")
    bus.step(SETTLED)
    assert warnings(bus)[1:] == ["emac0 has 9 of its 10 pins, it lacks RMII0_RXERR (PE0)"]


def test_pin_switched_to_and_fro_warns_once(traced: Machine) -> None:
    for _ in range(3):
        switch(traced, "PD2", "QSPI0_SS0")
        switch(traced, "PD2", "GPIO")
    assert warnings(traced) == ["pin PD2 is QSPI0_SS0: the board wires it to UART3_TXD"]
    assert traced.complaints.count("nuc980_pins_conflict") == 3


# ---- view


def test_view_of_the_human_monitor(bus: Machine) -> None:
    switch_device(bus, "uart0")
    switch(bus, "PF6", "SD1_nCD")
    rows = rows_of(bus.info("nuc980-pins"))
    assert rows["PF11"] == ["PF11", "1", "UART0_RXD", "uart0", "UART0_RXD", "connected"]
    assert rows["PF10"] == ["PF10", "0", "GPIO", "-", "UART1_TXD", "off"]
    assert rows["PF6"][:6] == ["PF6", "2", "SD1_nCD", "sdh", "RMII1_TXD1", "conflict:"]
    assert rows["uart0"] == ["uart0", "2", "of", "2", "connected"]
    assert rows["emac1"] == ["emac1", "0", "of", "10", "off"]
    assert "PB0" not in rows
    assert set(CHIP.pins) - set(rows) == {pin["pin"] for pin in view(bus)["pins"] if pin["state"] == "gpio"}


def test_view_of_all_pins(bus: Machine) -> None:
    rows = rows_of(bus.info("nuc980-pins -a"))
    assert set(CHIP.pins) <= set(rows)
    assert rows["PB0"] == ["PB0", "0", "GPIO", "-", "-", "gpio"]


def rows_of(text: str) -> dict[str, list[str]]:
    return {words[0]: words for words in map(str.split, text.splitlines()) if words}


def test_view_has_the_owner_of_each_function(bus: Machine) -> None:
    for value in range(1, 9):
        for pin, functions in CHIP.pins.items():
            switch(bus, pin, value if value in functions else 0)
        for pin in view(bus)["pins"]:
            signal = CHIP.pins[pin["pin"]].get(value, "GPIO")
            owners = " or ".join(owner.label for owner in CHIP.owners(signal))
            assert (pin["function"], pin.get("owner", "")) == (signal, owners)


# ---- snapshot


def test_state_is_saved(board: Callable[..., Machine], reborn: Callable[[Machine], Machine]) -> None:
    old = board("-trace", "nuc980_pins*", registers=True, uarts=(1,))
    switch_device(old, "uart1")
    switch_device(old, "emac1")
    switch(old, "PF6", "SD1_nCD")
    before = view(old)
    new = reborn(old)
    assert view(new) == before
    assert conflicts(new) == {"PF6": "taken from RMII1_TXD1; the board wires it to RMII1_TXD1"}
    assert lines(new) == {}  # nothing moves meanwhile
    send_byte(new, 0x42)
    assert new.uarts[1].receive(5) == b"\x42"
    switch(new, "PF10", "GPIO")
    assert lines(new) == {"UART1_TXD": False}


# ---- another board


def test_each_board_has_the_wiring_of_its_pin_table(qemu: Path) -> None:
    for name in board_names():
        table = load_board(pin_table(name), CHIP)
        with Machine(qemu, options=f"board={name}", registers=True) as machine:
            assert {device["device"] for device in view(machine)["devices"]} == set(table.devices)
            for device in table.devices.values():
                for signal, pin in device.pins.items():
                    switch(machine, pin, signal)
            machine.step(SETTLED)
            assert {device["state"] for device in view(machine)["devices"]} == {"connected"}
            assert (conflicts(machine), warnings(machine)) == ({}, [])


def test_a_line_that_only_the_gateway_wires_is_refused_on_another_board(qemu: Path) -> None:
    with pytest.raises(MachineError, match=r"no pins to UART1 \(pins\.yml of board numaker\)"):
        Machine(qemu, options="board=numaker", registers=True, uarts=(1,))


def test_an_unknown_board_is_refused(qemu: Path) -> None:
    with pytest.raises(MachineError, match="there is no board nope"):
        Machine(qemu, options="board=nope", registers=True)
