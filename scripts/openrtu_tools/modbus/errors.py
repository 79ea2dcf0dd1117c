# SPDX-License-Identifier: GPL-3.0-or-later
"""What can go wrong between this machine and a Modbus device: a class each, with cause and next step."""

from __future__ import annotations

from nuc980.errors import ToolError, UnusableInput


class ModbusError(ToolError):
    """A request that brought nothing."""


class NoAnswer(ModbusError):
    """Silence."""


class OnlyEcho(NoAnswer):
    """The adapter hears what it sends, and nobody else."""

    cause = "the adapter hears itself, and no device answers"
    next_step = "check unit, speed and parity, and the wires A and B"


class Damaged(ModbusError):
    """Octets that are no frame."""

    cause = "noise, another speed or parity, or two devices with one unit"
    next_step = "check speed and parity; stop any other master of the line"


class NotAsked(ModbusError):
    """An answer, but to another request."""

    cause = "another master is on the line, or a device that answers late or wrongly"
    next_step = "stop the other master, or give the device a longer --timeout"


class OtherUnit(NotAsked):
    """Another unit answers."""

    def __init__(self, what: str, unit: int, **more: str) -> None:
        super().__init__(what, **more)
        self.unit = unit


class Exceptional(ModbusError):
    """The device's exception: it is there, and refuses."""

    def __init__(self, what: str, code: int, **more: str) -> None:
        super().__init__(what, **more)
        self.code = code


class LinkLost(ModbusError):
    """The port or the connection went away, or a host said that it serves nothing by UDP."""


class HungUp(LinkLost):
    """A TCP peer closed the connection."""

    cause = "it takes no more connections, as the gateway has one, or it does not know this unit or function"
    next_step = "try again when the gateway's port is not active, or with another --unit"


class Unreachable(UnusableInput):
    """No connection of TCP, or no way to the host by UDP."""


class PortUnusable(UnusableInput):
    """A serial port that does not open to us."""


class PortHeld(PortUnusable):
    """Another process has it."""


class ForeignTraffic(ModbusError):
    """Somebody else speaks on the line."""

    cause = "another master is on the line"
    next_step = "stop it: two masters spoil each other's answers"


# MODBUS Application Protocol V1.1b3, 7: its word, and what to do.
EXCEPTIONS = {
    1: ("illegal function", "try the object in another table: the device does not know the function"),
    2: (
        "illegal data address",
        "check the address, which is one less than a manual's number, or ask for fewer",
    ),
    3: ("illegal data value", "look up what values the device takes, or ask for fewer"),
    4: ("server device failure", "look at the device itself: it failed while it did this"),
    5: ("acknowledge", "ask again in a moment: the device needs longer"),
    6: ("server device busy", "ask again in a moment"),
    8: ("memory parity error", "look at the device itself: its memory is damaged"),
    10: (
        "gateway path unavailable",
        "look at the gateway before the device: it has no path to this unit, or does not allow this",
    ),
    11: ("gateway target device failed to respond", "check the unit, and the line behind the gateway"),
}


def exceptional(whose: str, what: str, code: int) -> Exceptional:
    word, next_step = EXCEPTIONS.get(code, ("not in the standard", "look it up in the device's manual"))
    return Exceptional(f"{whose} refuses {what}: exception {code}, {word}", code, next_step=next_step)
