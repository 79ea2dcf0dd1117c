# SPDX-License-Identifier: GPL-3.0-or-later
"""The UART at its registers, its line and its clock, to the bit and the nanosecond."""

import time
from collections.abc import Callable

import pytest

from nuc980.twin.machine import ANSWER_SECONDS, Machine, MachineError

PCLKEN0, DIVCTL4 = 0xB0000218, 0xB0000230
GPF_MFPH = 0xB000009C
UART0_ON_PF11_PF12 = 0x11000
AIC_RAW_32_UP = 0xB0042104

DAT, INTEN, FIFO, LINE, MODEM, MODEMSTS, FIFOSTS, INTSTS = range(0, 0x20, 4)
TOUT, BAUD, IRDA, ALTCTL, FUNCSEL = range(0x20, 0x34, 4)
BRCOMP = 0x3C

# INTEN, and the same in INTSTS
RDA, THRE, RLS, MODEMI, RXTO, BUFERR = (1 << n for n in range(6))
TOCNTEN, ATORTSEN, ATOCTSEN, TXPDMAEN, RXPDMAEN, TXENDI = (1 << n for n in (11, 12, 13, 14, 15, 22))
RXOVIF, ADDRDETF, PEF, FEF, BIF, TXOVIF = (1 << n for n in (0, 3, 4, 5, 6, 24))
RXEMPTY, RXFULL, TXEMPTY, TXFULL, TXEMPTYF, RXIDLE, TXRXACT = (1 << n for n in (14, 15, 22, 23, 28, 29, 31))
RXRST, TXRST, RXOFF = 2, 4, 0x100
PBE, EPE, SPE, BCB = 8, 0x10, 0x20, 0x40
RTS, RTSACTLV, RTSSTS = 2, 0x200, 0x2000
CTSDETF, CTSSTS, CTSACTLV = 1, 0x10, 0x100
NMM, AAD, AUD, ADDRDEN = 0x100, 0x200, 0x400, 0x8000
RS485, TXRXDIS = 3, 8

XIN = 12_000_000
MODE2 = 0x30000000
BRD_115200 = 102  # 12 MHz / (102 + 2) = 115 385
DIVIDER = BRD_115200 + 2


def ns(ticks: int, hertz: int = XIN) -> int:
    """So many ticks of a clock, as QEMU's clocks count: periods of 2^-32 ns."""
    return ticks * ((10**9 << 32) // hertz) >> 32


BIT = ns(DIVIDER)
CHAR = ns(10 * DIVIDER)


def until(condition: Callable[[], object]) -> None:
    """Waits for what QEMU does without a step: taking bytes from a socket, a reset."""
    deadline = time.monotonic() + ANSWER_SECONDS
    while not condition():
        assert time.monotonic() < deadline


class Uart:
    """UART0's registers, by their offsets, and its far end."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.line = machine.uarts[0]

    def __getitem__(self, offset: int) -> int:
        return self.machine.read(0xB0070000 + offset)

    def __setitem__(self, offset: int, value: int) -> None:
        self.machine.write(0xB0070000 + offset, value)

    def step(self, nanoseconds: int) -> None:
        self.machine.step(nanoseconds)

    def sent(self) -> bytes:
        """What has reached the far end: QEMU writes it before it answers the step."""
        return self.line.receive(0)

    def hear(self, data: bytes) -> None:
        """The far end sends; returns when QEMU has it, with the first start bit on the line."""
        self.line.send(data)
        until(lambda: not self[FIFOSTS] & RXIDLE)

    def hear_all(self, data: bytes) -> None:
        """... and the last stop bit is over."""
        self.hear(data)
        self.step(ns(10 * DIVIDER) * len(data) + len(data))

    def fill(self) -> int:
        status = self[FIFOSTS]
        return 16 if status & RXFULL else status >> 8 & 0x3F

    def read_all(self) -> bytes:
        data = b""
        while not self[FIFOSTS] & RXEMPTY:
            data += bytes([self[DAT]])
        return data

    def read_into(self, seen: bytearray) -> int:
        seen += self.read_all()
        return len(seen)

    def inject(self, what: str, count: int) -> None:
        self.machine.command("qom-set", path="/machine/soc/uart[0]", property=f"inject-{what}", value=count)

    @property
    def interrupt(self) -> bool:
        """As the interrupt controller has it: source 36."""
        return bool(self.machine.read(AIC_RAW_32_UP) & 1 << 36 - 32)


def routed(machine: Machine) -> Uart:
    """UART0 with its clock, its pins and 115200 8N1."""
    machine.write(PCLKEN0, 0x03FF0000)
    machine.write(GPF_MFPH, UART0_ON_PF11_PF12)
    uart = Uart(machine)
    uart[BAUD] = MODE2 | BRD_115200
    uart[LINE] = 3
    return uart


@pytest.fixture
def uart(bus: Machine) -> Uart:
    return routed(bus)


def test_reset_values(bus: Machine) -> None:
    uart = Uart(bus)
    assert uart[FIFOSTS] == TXRXACT | RXIDLE | TXEMPTYF | TXEMPTY | RXEMPTY
    assert [uart[offset] for offset in (INTEN, FIFO, LINE, MODEM, MODEMSTS)] == [0, 0, 0, 0x200, 0x110]
    assert [uart[offset] for offset in (TOUT, BAUD, ALTCTL, FUNCSEL)] == [0, 0x0F000000, 0x0C, 0]
    assert uart[INTSTS] == THRE | TXENDI


# ---- time on the line


@pytest.mark.parametrize(
    ("baud", "line", "ticks"),
    [
        (MODE2 | 102, 3, 10 * 104),  # 115200 8N1
        (MODE2 | 1248, 3, 10 * 1250),  # 9600 8N1
        (MODE2 | 1248, 3 | PBE | EPE, 11 * 1250),  # 9600 8E1
        (MODE2 | 1248, 2 | PBE | 4, 11 * 1250),  # 9600 7O2
        (MODE2 | 1248, 0 | 4, 15 * 1250 // 2),  # 9600 5N1.5
        (MODE2 | 0xFFFF, 3, 10 * 0x10001),  # 183 baud
        (76, 3, 10 * 16 * 78),  # mode 0: 9615 baud
        (0x10000000 | 76, 3, 10 * 16 * 78),  # BAUDM0 alone is mode 0
        (0x20000000 | 9 << 24 | 123, 3, 10 * 10 * 125),  # mode 1
    ],
)
def test_character_takes_its_time(uart: Uart, baud: int, line: int, ticks: int) -> None:
    uart[BAUD], uart[LINE] = baud, line
    uart[DAT] = ord("\r")
    assert uart[FIFOSTS] & (TXEMPTY | TXEMPTYF) == TXEMPTY
    uart.step(ns(ticks) - 1)
    assert (uart.sent(), uart[FIFOSTS] & TXEMPTYF) == (b"", 0)
    uart.step(1)
    assert (uart.sent(), uart[FIFOSTS] & TXEMPTYF) == (b"\r", TXEMPTYF)


def test_received_character_takes_its_time(uart: Uart) -> None:
    uart.hear(b"ab")
    uart.step(CHAR - 1)
    assert uart[FIFOSTS] & (RXEMPTY | RXIDLE) == RXEMPTY
    uart.step(1)
    assert (uart.fill(), uart[FIFOSTS] & RXIDLE) == (1, 0)
    uart.step(CHAR - 1)
    assert uart.fill() == 1
    uart.step(1)
    assert (uart.fill(), uart[FIFOSTS] & RXIDLE) == (2, RXIDLE)
    assert uart.read_all() == b"ab"


def test_divided_clock_slows_what_is_on_the_line(uart: Uart) -> None:
    uart[DAT] = 0x55
    uart.hear(b"x")
    uart.step(CHAR // 2)
    uart.machine.write(DIVCTL4, 1 << 5)  # XIN / 2: both characters begin again
    slow = ns(10 * DIVIDER, XIN // 2)
    uart.step(slow - 1)
    assert (uart.sent(), uart.fill()) == (b"", 0)
    uart.step(1)
    assert (uart.sent(), uart.fill()) == (b"U", 1)


def test_delay_between_characters(uart: Uart) -> None:
    uart[TOUT] = 20 << 8
    uart[DAT], uart[DAT] = ord("1"), ord("2")
    uart.step(CHAR)
    assert uart.sent() == b"1"
    uart.step(ns(20 * DIVIDER) + CHAR - 1)
    assert uart.sent() == b""
    uart.step(1)
    assert uart.sent() == b"2"


def test_word_length_masks_both_ways(uart: Uart) -> None:
    uart[LINE] = 0  # 5 bits
    uart[DAT] = 0xFF
    uart.hear(b"\xea")
    uart.step(ns(7 * DIVIDER))
    assert (uart.sent(), uart.read_all()) == (b"\x1f", b"\x0a")


# ---- FIFOs


def test_transmit_fifo_fills_and_overruns(uart: Uart) -> None:
    uart[INTEN] = BUFERR
    data = bytes(range(0x30, 0x30 + 17))  # one in the shifter, 16 in the FIFO
    for count, byte in enumerate(data):
        assert uart[FIFOSTS] >> 16 & 0x3F == max(count - 1, 0)
        uart[DAT] = byte
    assert uart[FIFOSTS] & (TXFULL | TXEMPTY | TXOVIF | 0x3F0000) == TXFULL  # the pointer wraps
    assert not uart.interrupt
    uart[DAT] = 0xFF
    assert uart[FIFOSTS] & TXOVIF
    assert uart[INTSTS] & (BUFERR | BUFERR << 8) == BUFERR | BUFERR << 8
    assert uart.interrupt
    uart[FIFOSTS] = TXOVIF
    assert not uart[FIFOSTS] & TXOVIF
    assert not uart.interrupt
    uart.step(17 * CHAR + 17)
    assert uart.sent() == data


def test_characters_follow_without_gaps(uart: Uart) -> None:
    for _ in range(10):
        uart[DAT] = 0
    uart.step(ns(100 * DIVIDER) - 20)
    assert len(uart.sent()) == 9
    uart.step(20)
    assert len(uart.sent()) == 1


def test_empty_transmitter_interrupts(uart: Uart) -> None:
    uart[INTEN] = THRE
    assert uart.interrupt
    uart[DAT] = 1  # straight into the shifter
    assert uart.interrupt
    uart[DAT] = 2
    assert not uart.interrupt
    uart[INTEN] = TXENDI
    uart.step(2 * CHAR - 1)
    assert (uart[INTSTS] & (TXENDI | TXENDI << 8), uart.interrupt) == (0, False)
    uart.step(2)
    assert uart[INTSTS] & (TXENDI | TXENDI << 8) == TXENDI | TXENDI << 8
    assert uart.interrupt


@pytest.mark.parametrize(("code", "level"), [(0, 1), (1, 4), (2, 8), (3, 14)])
def test_receive_trigger(uart: Uart, code: int, level: int) -> None:
    uart[FIFO] = code << 4
    uart[INTEN] = RDA
    if level > 1:
        uart.hear_all(bytes(level - 1))
    assert (uart[INTSTS] & (RDA | RDA << 8), uart.interrupt) == (0, False)
    uart.hear_all(b"x")
    assert (uart[INTSTS] & (RDA | RDA << 8), uart.interrupt) == (RDA | RDA << 8, True)
    assert uart[DAT] == (0 if level > 1 else ord("x"))
    assert not uart.interrupt


def test_what_is_not_read_overruns(uart: Uart) -> None:
    uart[INTEN] = BUFERR
    uart.hear(bytes(range(20)))
    uart.step(16 * CHAR + 16)
    assert uart[FIFOSTS] & (RXFULL | RXEMPTY | RXOVIF | 0x3F00) == RXFULL
    uart.step(CHAR)
    assert uart[FIFOSTS] & RXOVIF
    assert uart.interrupt
    uart[FIFOSTS] = RXOVIF
    assert not uart[FIFOSTS] & RXOVIF
    uart.step(3 * CHAR)
    assert uart[FIFOSTS] & RXOVIF
    assert uart.read_all() == bytes(range(16))


def test_long_stream_is_not_lost_by_a_guest_that_reads(uart: Uart) -> None:
    data = bytes(n * 7 & 0xFF for n in range(3000))  # more than QEMU holds for the line
    uart.hear(data)
    seen = bytearray()

    def hears_and_reads() -> bool:
        uart.step(8 * CHAR)
        return uart.read_into(seen) == len(data)

    until(hears_and_reads)
    assert seen == data
    assert not uart[FIFOSTS] & RXOVIF


def test_fifo_resets(uart: Uart) -> None:
    uart.hear_all(b"abc")
    for byte in b"xyz":
        uart[DAT] = byte
    uart[FIFO] = RXRST | TXRST
    assert uart[FIFO] == 0
    assert uart[FIFOSTS] & (RXEMPTY | TXEMPTY | TXEMPTYF) == RXEMPTY | TXEMPTY
    uart.step(3 * CHAR)
    assert uart.sent() == b"x"  # was on its way


# ---- receive time-out


def test_timeout_comes_after_exactly_so_many_bits(uart: Uart) -> None:
    uart[TOUT] = 0x40
    uart[INTEN] = RXTO | TOCNTEN
    uart.hear(b"ab")
    uart.step(2 * CHAR)
    uart.step(ns(0x40 * DIVIDER) - 1)
    assert (uart[INTSTS] & RXTO, uart.interrupt) == (0, False)
    uart.step(1)
    assert (uart[INTSTS] & (RXTO | RXTO << 8), uart.interrupt) == (RXTO | RXTO << 8, True)
    assert uart[DAT] == ord("a")  # clears it, and starts the count again
    assert not uart.interrupt
    uart.step(ns(0x40 * DIVIDER) - 1)
    assert not uart.interrupt
    uart.step(1)
    assert uart.interrupt
    assert uart[DAT] == ord("b")
    uart.step(ns(0x80 * DIVIDER))
    assert not uart.interrupt  # an empty FIFO has no time-out


def test_next_character_delays_the_timeout(uart: Uart) -> None:
    uart[TOUT] = 15
    uart[INTEN] = RXTO | TOCNTEN
    uart.hear(b"abcd")
    uart.step(4 * CHAR + ns(15 * DIVIDER) - 1)
    assert not uart.interrupt
    uart.step(1)
    assert uart.interrupt


def test_timeout_counts_only_while_enabled(uart: Uart) -> None:
    uart[TOUT] = 40
    uart.hear_all(b"a")
    uart.step(ns(100 * DIVIDER))
    assert not uart[INTSTS] & RXTO
    uart[INTEN] = TOCNTEN
    uart.step(ns(40 * DIVIDER) - 1)
    assert not uart[INTSTS] & RXTO
    uart.step(1)
    assert (uart[INTSTS] & RXTO, uart.interrupt) == (RXTO, False)


# ---- line errors


@pytest.mark.parametrize(
    ("what", "flag", "seen"),
    [("parity-errors", PEF, 0x41 ^ 1), ("framing-errors", FEF, 0x41 << 1), ("breaks", BIF, 0)],
)
def test_injected_error(uart: Uart, what: str, flag: int, seen: int) -> None:
    uart[LINE] = 3 | PBE | EPE
    uart[INTEN] = RLS
    uart.inject(what, 2)
    uart.hear_all(b"AAA")
    uart.step(3 * BIT)
    errors = PEF | FEF | BIF
    assert (uart[FIFOSTS] & errors, uart.interrupt) == (flag, True)
    assert uart[INTSTS] & (RLS | RLS << 8) == RLS | RLS << 8
    uart[FIFOSTS] = errors & ~flag
    assert uart[FIFOSTS] & errors == flag
    uart[FIFOSTS] = flag
    assert (uart[FIFOSTS] & errors, uart.interrupt) == (0, False)
    assert uart.read_all() == bytes([seen, seen, 0x41])


def test_without_parity_a_wrong_bit_goes_unseen(uart: Uart) -> None:
    uart.inject("parity-errors", 1)
    uart.hear_all(b"A")
    assert not uart[FIFOSTS] & PEF
    assert uart[DAT] == 0x40


def test_dma_mode_shows_errors_in_its_own_flags(uart: Uart) -> None:
    uart[INTEN] = RLS | RXPDMAEN
    uart.inject("framing-errors", 1)
    uart.hear_all(b"A")
    assert uart[INTSTS] & (1 << 18 | 1 << 26) == 1 << 18 | 1 << 26
    assert uart.interrupt


def test_break_holds_the_line(uart: Uart) -> None:
    uart[LINE] = 3 | BCB
    uart[DAT] = 0x55
    uart.step(CHAR)
    assert (uart.sent(), uart[FIFOSTS] & TXEMPTYF) == (b"", TXEMPTYF)
    uart[LINE] = 3
    uart[DAT] = 0x55
    uart.step(CHAR)
    assert uart.sent() == b"U"


# ---- pins


def test_nothing_passes_without_pins(uart: Uart) -> None:
    uart.machine.write(GPF_MFPH, 0)
    uart[DAT] = 0x55
    uart.hear_all(b"a")
    assert (uart.sent(), uart.fill()) == (b"", 0)
    assert uart[FIFOSTS] & TXEMPTYF
    uart.machine.write(GPF_MFPH, 0x01000)  # PF11: RXD alone
    uart[DAT] = 0x55
    uart.hear_all(b"b")
    assert (uart.sent(), uart.read_all()) == (b"", b"b")
    uart.machine.write(GPF_MFPH, 0x10000)  # PF12: TXD alone
    uart[DAT] = 0x55
    uart.hear_all(b"c")
    assert (uart.sent(), uart.fill()) == (b"U", 0)


def test_pin_that_goes_in_mid_character_costs_it(uart: Uart) -> None:
    uart.machine.write(GPF_MFPH, 0)
    uart[DAT] = 0x55
    uart.step(CHAR // 2)
    uart.machine.write(GPF_MFPH, UART0_ON_PF11_PF12)
    uart.step(CHAR)
    assert uart.sent() == b""


# ---- RTS and CTS


@pytest.mark.parametrize(("modem", "level"), [(0, 1), (RTS, 0), (RTSACTLV, 0), (RTSACTLV | RTS, 1)])
def test_rts_level(uart: Uart, modem: int, level: int) -> None:
    uart[MODEM] = modem
    assert uart[MODEM] == modem | level * RTSSTS


def test_auto_rts_holds_the_far_end(uart: Uart) -> None:
    uart.machine.set_line("uart[0]", "rts-pin", 1)
    uart[MODEM] = RTSACTLV
    uart[FIFO] = 1 << 16  # at 4 bytes
    uart[INTEN] = ATORTSEN
    assert not uart[MODEM] & RTSSTS
    data = bytes(range(30))
    uart.hear(data)
    uart.step(40 * CHAR)
    assert uart.fill() == 4
    assert uart[MODEM] & RTSSTS
    seen = bytearray()
    while uart.read_into(seen) < len(data):
        uart.step(CHAR)
        assert uart.fill() > 0
    assert seen == data


def test_auto_cts_waits_for_the_far_end(uart: Uart) -> None:
    uart.machine.set_line("uart[0]", "cts", 1)
    uart.machine.set_line("uart[0]", "cts-pin", 1)
    assert uart[MODEMSTS] == CTSACTLV | CTSSTS
    uart[INTEN] = ATOCTSEN | MODEMI
    uart[DAT] = 0x55
    uart.step(2 * CHAR)
    assert (uart.sent(), uart.interrupt) == (b"", False)
    uart.machine.set_line("uart[0]", "cts", 0)
    assert uart[MODEMSTS] == CTSACTLV | CTSDETF
    assert (uart[INTSTS] & (MODEMI | MODEMI << 8), uart.interrupt) == (MODEMI | MODEMI << 8, True)
    uart[MODEMSTS] = CTSACTLV | CTSDETF
    assert (uart[MODEMSTS], uart.interrupt) == (CTSACTLV, False)
    uart.step(CHAR)
    assert uart.sent() == b"U"


# ---- RS-485


@pytest.fixture
def transceiver(board: Callable[..., Machine]) -> Uart:
    """UART0 whose RS-485 driver is enabled by RTS, as no port of this board is."""
    uart = routed(board("-global", "nuc980-uart.de-on-rts=on", registers=True))
    uart.machine.set_line("uart[0]", "rts-pin", 1)
    return uart


@pytest.mark.parametrize(
    ("function", "control", "modem", "passes"),
    [
        (RS485, AUD, 0, True),  # TIOCSRS485 with RTS_ON_SEND
        (RS485, AUD, RTSACTLV, False),  # what the vendor driver's next tcsetattr makes of it
        (RS485, AUD, RTS, True),  # RTS has no say
        (0, AUD, RTS, False),  # no direction without the function
        (RS485, 0, RTS, False),
        (0, 0, 0, True),  # the guest's own hand
        (0, 0, RTSACTLV | RTS, True),
        (0, 0, RTSACTLV, False),
    ],
)
def test_direction(transceiver: Uart, function: int, control: int, modem: int, passes: bool) -> None:
    transceiver[FUNCSEL], transceiver[ALTCTL], transceiver[MODEM] = function, control, modem
    transceiver[DAT] = 0x55
    transceiver.step(CHAR)
    assert transceiver.sent() == (b"U" if passes else b"")
    assert transceiver[FIFOSTS] & TXEMPTYF


def test_direction_needs_its_pin(transceiver: Uart) -> None:
    transceiver.machine.set_line("uart[0]", "rts-pin", 0)
    transceiver[FUNCSEL], transceiver[ALTCTL], transceiver[MODEM] = RS485, AUD, 0
    transceiver[DAT] = 0x55
    transceiver.step(CHAR)
    assert transceiver.sent() == b""


def test_direction_dropped_too_early_costs_the_last_character(transceiver: Uart) -> None:
    transceiver[MODEM] = 0
    transceiver[DAT], transceiver[DAT] = 0x31, 0x32
    transceiver.step(2 * CHAR - 10)
    transceiver[MODEM] = RTS
    transceiver.step(100)
    assert transceiver.sent() == b"1"


@pytest.mark.parametrize("active_low", [0, RTSACTLV])
def test_auto_direction_lasts_to_the_last_stop_bit(uart: Uart, active_low: int) -> None:
    uart[FUNCSEL], uart[ALTCTL], uart[MODEM] = RS485, AUD, active_low
    idle = RTSSTS if active_low else 0
    assert uart[MODEM] & RTSSTS == idle
    uart[DAT], uart[DAT] = 1, 2
    uart.step(2 * CHAR - 1)
    assert uart[MODEM] & RTSSTS != idle
    uart.step(2)
    assert uart[MODEM] & RTSSTS == idle


def multidrop(uart: Uart, mode: int, address: int = 0) -> None:
    uart[FUNCSEL] = RS485
    uart[ALTCTL] = mode | ADDRDEN | address << 24
    uart[LINE] = 3 | PBE | EPE
    uart[INTEN] = RLS


def say(uart: Uart, data: bytes, address: bool = False) -> None:
    uart.inject("addresses", int(address))
    uart.hear(data)
    uart.step(ns(11 * DIVIDER) * len(data) + len(data))


def test_multidrop_of_the_guest(uart: Uart) -> None:
    uart[FIFO] = RXOFF
    multidrop(uart, NMM)
    say(uart, b"not for us")
    assert (uart.fill(), uart.interrupt) == (0, False)
    say(uart, b"\xc0", address=True)
    assert (uart[FIFOSTS] & ADDRDETF, uart[INTSTS] & RLS, uart.interrupt) == (ADDRDETF, RLS, True)
    assert uart[FIFO] & RXOFF == 0
    uart[FIFOSTS] = ADDRDETF
    assert not uart.interrupt
    say(uart, b"12")
    assert uart.read_all() == b"\xc012"
    uart[FIFO] = RXOFF  # the guest does not want what follows
    say(uart, b"34")
    assert uart.fill() == 0


def test_multidrop_of_the_chip(uart: Uart) -> None:
    multidrop(uart, AAD, 0xC0)
    say(uart, b"early")
    say(uart, b"\xc1", address=True)
    say(uart, b"others")
    assert uart.fill() == 0
    uart[FIFOSTS] = ADDRDETF
    say(uart, b"\xc0", address=True)
    assert uart[FIFOSTS] & ADDRDETF
    say(uart, b"ours")
    say(uart, b"\xc1", address=True)
    say(uart, b"theirs")
    assert uart.read_all() == b"\xc0ours"


def test_receiver_and_transmitter_off(uart: Uart) -> None:
    uart[FIFO] = RXOFF
    uart.hear_all(b"a")
    assert uart.fill() == 0
    uart[FIFO] = 0
    uart[FUNCSEL] = TXRXDIS
    assert not uart[FIFOSTS] & TXRXACT
    uart[DAT] = 0x55
    uart.hear_all(b"b")
    assert (uart.sent(), uart.fill()) == (b"", 0)
    uart[FUNCSEL] = 0
    uart.step(CHAR)
    assert uart.sent() == b"U"


# ---- without the line's time


@pytest.fixture
def fast(board: Callable[..., Machine]) -> Uart:
    return routed(board(options="pace=off", registers=True))


def test_without_pace_nothing_waits(fast: Uart) -> None:
    for byte in b"quick":
        fast[DAT] = byte
        assert fast[FIFOSTS] & TXEMPTYF
    assert fast.sent() == b"quick"


def test_without_pace_the_far_end_waits_for_the_guest(fast: Uart) -> None:
    data = bytes(range(100))
    fast.line.send(data)
    until(lambda: fast.fill() == 16)
    seen = bytearray()
    until(lambda: fast.read_into(seen) == len(data))
    assert seen == data
    assert not fast[FIFOSTS] & RXOVIF


def test_with_pace_of_the_lines_the_debug_uart_alone_does_not_wait(board: Callable[..., Machine]) -> None:
    machine = board(options="pace=lines", registers=True)
    uart = routed(machine)
    for byte in b"quick":
        uart[DAT] = byte
        assert uart[FIFOSTS] & TXEMPTYF
    paces = [machine.command("qom-get", path=f"/machine/soc/uart[{n}]", property="pace") for n in range(10)]
    assert paces == [False, *[True] * 9]


def test_an_unknown_pace_is_refused(board: Callable[..., Machine]) -> None:
    with pytest.raises(MachineError, match="pace is on, off or lines, not slow"):
        board(options="pace=slow", registers=True)


# ---- what is wrong, what is missing


def test_unmodelled_is_logged_once(uart: Uart) -> None:
    uart[BRCOMP] = 1
    uart[BRCOMP] = 2
    assert uart[BRCOMP] == 2
    uart[FUNCSEL] = 1  # LIN
    uart[FUNCSEL] = 2  # IrDA
    assert uart.machine.complaints.count("register 0x3c is not modelled") == 1
    assert uart.machine.complaints.count("register 0x30 is not modelled") == 1


def test_read_of_nothing_is_logged(uart: Uart) -> None:
    assert uart[DAT] == 0
    assert "uart[0]: read of an empty receive FIFO" in uart.machine.complaints


def test_bytes_of_a_register(uart: Uart) -> None:
    uart.machine.write_byte(0xB0070000, 0x55)
    uart.step(CHAR)
    assert uart.sent() == b"U"
    assert uart.machine.read_byte(0xB0070001) == 0
    assert "read of 0x1, no register" in uart.machine.complaints


def test_reset_in_mid_character(uart: Uart) -> None:
    for byte in b"abc":
        uart[DAT] = byte
    uart.hear(b"xyz")
    uart.step(CHAR // 2)
    uart.machine.command("system_reset")
    until(lambda: uart[LINE] == 0)
    assert uart[FIFOSTS] & (TXEMPTYF | RXEMPTY) == TXEMPTYF | RXEMPTY
    uart.step(10 * CHAR)
    assert uart.sent() == b""


# ---- state


def test_characters_survive_a_move(uart: Uart, reborn: Callable[[Machine], Machine]) -> None:
    uart[INTEN] = RXTO | TOCNTEN | RDA
    uart[TOUT] = 40
    uart[FIFO] = 2 << 4
    uart.inject("framing-errors", 2)
    for byte in b"send":
        uart[DAT] = byte
    uart.hear(b"AAAA")
    uart.step(CHAR + CHAR // 2)
    assert uart.sent() == b"s"
    there = Uart(reborn(uart.machine))
    assert there[FIFOSTS] & (FEF | 0x3F00 | 0x3F0000) == FEF | 1 << 8 | 2 << 16
    assert [there[reg] for reg in (INTEN, TOUT, FIFO, LINE, BAUD)] == [
        RXTO | TOCNTEN | RDA, 40, 2 << 4, 3, MODE2 | BRD_115200
    ]  # fmt: skip
    there.step(CHAR - CHAR // 2 + 1)
    assert (there.sent(), there.fill()) == (b"e", 2)
    there.step(2 * CHAR)
    assert there.sent() == b"nd"
    assert not there.interrupt
    there.step(ns(40 * DIVIDER))
    assert there.interrupt
    assert there.read_all() == b"\x82\x82AA"
