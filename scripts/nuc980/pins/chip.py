# SPDX-License-Identifier: GPL-3.0-or-later
"""The NUC980 as nuc980.yml describes it: pins and their functions, packages, peripherals."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass, field
from pathlib import Path

import yaml

CHIP_FILE = Path(__file__).parent / "nuc980.yml"
PIN_NAME = re.compile(r"P([A-G])(\d|1[0-5])")
BANKS = "ABCDEFG"
PINS_A_BANK = 16
GPIOS_A_BANK = 32  # the GPIO number of a pin is 32 * bank + pin
GPIO = "GPIO"
AIC = "aic"  # the interrupt controller's label
# libyaml's loader, ten times faster, where PyYAML was built with it.
YamlLoader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def pin_name(bank: int, pin: int) -> str:
    """ "PA0" for bank 0, pin 0; what is beyond the banks as the numbers say it, "P7.0"."""
    if 0 <= bank < len(BANKS) and 0 <= pin < PINS_A_BANK:
        return f"P{BANKS[bank]}{pin}"
    return f"P{bank}.{pin}"


def pin_order(name: str) -> tuple[int, int]:
    """Bank and pin of "PA0": for sorting and for device-tree cells. The name must be one of PIN_NAME."""
    found = PIN_NAME.fullmatch(name)
    if found is None:
        raise ValueError(f"{name} is not the name of a pin")
    return BANKS.index(found[1]), int(found[2])


def gpio_number(pin: str) -> int:
    """The number that device trees give a pin's GPIO line: PA0 is 0, PB0 is 32."""
    bank, index = pin_order(pin)
    return GPIOS_A_BANK * bank + index


def pin_of_gpio(number: int) -> str:
    """The pin of a GPIO number; "P7.0" or "PA20" (as numbers, "P0.20") for one that no bank has."""
    return pin_name(*divmod(number, GPIOS_A_BANK))


@dataclass(frozen=True)
class SignalSet:
    """Which signals a device needs to be of use; names without the peripheral's prefix."""

    required: tuple[str, ...] = ()
    together: tuple[tuple[str, ...], ...] = ()  # all or none of each
    some: tuple[str, ...] = ()  # at least one of them


@dataclass(frozen=True)
class Peripheral:
    """One block of the chip."""

    label: str  # uart1
    bus: str  # apb or ahb
    node: str  # serial
    compatible: tuple[str, ...]
    compatible_66: tuple[str, ...]  # what the vendor's 6.6 kernel calls it; empty: the same
    compatible_other: tuple[str, ...]  # what further drivers of the vendor's call it
    address: int | None
    size: int | None
    interrupts: tuple[str, ...]  # names of Chip.interrupts
    signals: dict[str, SignalSet]  # prefix of its signals: what they must be
    properties: dict[str, int | list[int]]  # the vendor's own
    has_driver: bool

    @property
    def full_node(self) -> str:
        """The node's name with its unit address."""
        return self.node if self.address is None else f"{self.node}@{self.address:x}"

    @property
    def path(self) -> str:
        """As in dts/nuvoton/nuc980.dtsi: what has no registers is on no bus."""
        return f"/{self.full_node}" if self.address is None else f"/{self.bus}/{self.full_node}"

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """All compatible strings by which a vendor kernel may know its own driver."""
        return self.compatible[0], *self.compatible_66, *self.compatible_other

    def owns(self, signal: str) -> bool:
        """Whether a signal is one of this peripheral's."""
        return any(signal.startswith(prefix) for prefix in self.signals)

    @property
    def needs_pins(self) -> bool:
        """Whether it is of no use without pins."""
        return any(needed.required or needed.some for needed in self.signals.values())


@dataclass(frozen=True)
class Package:
    """A case of the chip."""

    name: str
    names: tuple[str, ...]  # of its pins, from pin 1 on: port pins, supplies, USB

    @property
    def pins(self) -> int:
        return len(self.names)

    @functools.cached_property
    def bonded(self) -> dict[str, int]:
        """Port pin: the pin of the case that it is brought out to."""
        return {name: number for number, name in enumerate(self.names, 1) if PIN_NAME.fullmatch(name)}


@dataclass(frozen=True)
class Chip:
    """All that is known of it."""

    name: str
    mfp_register: int
    pins: dict[str, dict[int, str]]  # pin: value of its field: signal
    packages: dict[str, Package]
    parts: dict[str, str]  # part number: package
    interrupts: dict[str, int]  # name: source number of the AIC
    eint: dict[str, tuple[str, ...]]  # eint0: its pins, in the order of the device tree's second cell
    peripherals: dict[str, Peripheral]
    _by_signal: dict[str, list[tuple[str, int]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for pin, functions in self.pins.items():
            for value, signal in functions.items():
                if signal != GPIO:
                    self._by_signal.setdefault(signal, []).append((pin, value))

    @property
    def signals(self) -> dict[str, list[tuple[str, int]]]:
        """Signal: the pins it can be on, with the value of their field."""
        return self._by_signal

    def signal(self, pin: str, value: int) -> str | None:
        """What a pin is with this value of its field; None: the pin or the value does not exist."""
        return self.pins.get(pin, {}).get(value)

    def value(self, pin: str, signal: str) -> int | None:
        """The value that makes a pin this signal (GPIO: 0); None: it cannot be."""
        return next((value for value, name in self.pins.get(pin, {}).items() if name == signal), None)

    def owners(self, signal: str) -> list[Peripheral]:
        """The peripherals a signal belongs to: two for the smart card's, which is also a UART."""
        return [peripheral for peripheral in self.peripherals.values() if peripheral.owns(signal)]

    def at(self, address: int) -> list[Peripheral]:
        """The peripherals at an address: several share one block, as the USB host's."""
        return [peripheral for peripheral in self.peripherals.values() if peripheral.address == address]

    def register_of(self, pin: str) -> tuple[int, int]:
        """Address of a pin's multi-function register, and the shift of its field of 4 bits."""
        bank, index = pin_order(pin)
        return self.mfp_register + 8 * bank + 4 * (index // 8), 4 * (index % 8)


@functools.cache
def load_chip() -> Chip:
    """The chip of nuc980.yml, which comes with this package: not checked for a user's mistakes."""
    data = yaml.load(CHIP_FILE.read_text(encoding="utf-8"), Loader=YamlLoader)
    sets = {
        name: SignalSet(
            tuple(parts.get("required", ())),
            tuple(tuple(group) for group in parts.get("together", ())),
            tuple(parts.get("some", ())),
        )
        for name, parts in data["sets"].items()
    }
    return Chip(
        name=data["chip"],
        mfp_register=data["mfp"]["register"],
        pins=data["pins"],
        packages={name: Package(name, tuple(names)) for name, names in data["packages"].items()},
        parts=data["parts"],
        interrupts=data["interrupts"],
        eint={name: tuple(pins) for name, pins in data["eint"].items()},
        peripherals={label: _peripheral(label, entry, sets) for label, entry in data["peripherals"].items()},
    )


def _peripheral(label: str, entry: dict, sets: dict[str, SignalSet]) -> Peripheral:
    address, size = entry.get("reg", (None, None))
    return Peripheral(
        label=label,
        bus=entry["bus"],
        node=entry["node"],
        compatible=tuple(entry["compatible"]),
        compatible_66=tuple(entry.get("compatible-6.6", ())),
        compatible_other=tuple(entry.get("compatible-other", ())),
        address=address,
        size=size,
        interrupts=tuple(entry.get("interrupts", ())),
        signals={prefix: sets[name] for prefix, name in entry.get("signals", {}).items()},
        properties=entry.get("properties", {}),
        has_driver=entry.get("driver", "") is not None,
    )
