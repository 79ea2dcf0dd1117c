# SPDX-License-Identifier: GPL-3.0-or-later
"""A UART of the emulated board as its registers are: what is on its wires, and when."""

from dataclasses import dataclass

from nuc980.twin.machine import Machine

HZ = 12_000_000  # the crystal, which the timers count as well
LINE, MODEM, FIFOSTS, BAUD, FUNCSEL = 0x0C, 0x10, 0x18, 0x24, 0x30
TWO_STOPS, PARITY, EVEN = 1 << 2, 1 << 3, 1 << 4
RTS_HIGH = 1 << 13
ALL_SENT = 1 << 28
RS485 = 3  # of FUNCSEL: RTS follows the transmitter
CLOCK_SOURCE, CLOCK_SPAN = 0xB0052114, 1 << 24  # the timer that the kernel reads the time from


@dataclass(frozen=True)
class Moment:
    """RTS and the transmitter of a UART, seen between two times of the board in milliseconds."""

    begin: float
    end: float
    rts_high: bool
    sending: bool


class Uart:
    """One of ten."""

    def __init__(self, machine: Machine, number: int) -> None:
        self._machine = machine
        self._base = 0xB0070000 + 0x1000 * number

    def register(self, offset: int) -> int:
        return self._machine.read(self._base + offset)

    @property
    def speed(self) -> int:
        """In bit/s, from the divider."""
        value = self.register(BAUD)
        divider = (value & 0xFFFF) + 2
        return round(HZ / divider if value >> 28 == 3 else HZ / divider / 16)

    @property
    def format(self) -> str:
        """As "8E1"."""
        value = self.register(LINE)
        parity = "N" if not value & PARITY else "E" if value & EVEN else "O"
        return f"{5 + (value & 3)}{parity}{2 if value & TWO_STOPS else 1}"

    def watch(self, seconds: float) -> list[Moment]:
        """One moment after the other, for so long of the board's time."""
        moments: list[Moment] = []
        ticks, last = 0, self._machine.read(CLOCK_SOURCE)
        while ticks < seconds * HZ:
            rts_high, sending = bool(self.register(MODEM) & RTS_HIGH), not self.register(FIFOSTS) & ALL_SENT
            now = self._machine.read(CLOCK_SOURCE)
            end = ticks + (now - last) % CLOCK_SPAN
            moments.append(Moment(ticks * 1000 / HZ, end * 1000 / HZ, rts_high, sending))
            ticks, last = end, now
        return moments
