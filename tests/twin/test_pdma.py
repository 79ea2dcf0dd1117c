# SPDX-License-Identifier: GPL-3.0-or-later
"""The DMA controllers: between memories, with a UART as the vendor's driver does it, and misused."""

import struct
import time
from collections.abc import Callable

import pytest

from nuc980.twin.machine import ANSWER_SECONDS, Machine

HCLKEN, PCLKEN0, DIVCTL0, GPF_MFPH = 0xB0000210, 0xB0000218, 0xB0000220, 0xB000009C
AIC_RAW_0_31 = 0xB0042100
UART0 = 0xB0070000
UART_INTEN, UART_LINE, UART_FIFOSTS, UART_BAUD = (UART0 + n for n in (4, 0x0C, 0x18, 0x24))
TXPDMAEN, RXPDMAEN = 1 << 14, 1 << 15
UART0_TX, UART0_RX = 4, 5

CHCTL, PAUSE, SWREQ, TRGSTS, PRISET, PRICLR, INTEN, INTSTS = range(0x400, 0x420, 4)
ABTSTS, TDSTS, ALIGN, TACTSTS, TOUTPSC, TOUTEN, TOUTIEN, SCATBA = range(0x420, 0x440, 4)
TOC, CHRST, TOUTPSC2, REQSEL, STRIDE = 0x440, 0x460, 0x470, 0x480, 0x500
CURSCAT = 0x100

IDLE, BASIC, SCATTER = 0, 1, 2
SINGLE, NO_INTERRUPT = 1 << 2, 1 << 7
FROM_FIXED, TO_FIXED = 3 << 8, 3 << 10
BYTES, HALVES, WORDS = 0 << 12, 1 << 12, 2 << 12
ABTIF, TDIF, ALIGNF = 1, 2, 4

SOURCE, TARGET, TABLE = 0x100000, 0x200000, 0x300000
NOWHERE = 0x40000000  # no RAM, no device
CHAR = (10 * 104 * ((10**9 << 32) // 12_000_000)) >> 32  # 115200 8N1 from XIN


def hclk_ns(cycles: int) -> int:
    """So many cycles of HCLK, half of XIN here; QEMU's clocks have periods of 2^-32 ns."""
    return cycles * ((10**9 << 32) // 6_000_000) >> 32


def count(transfers: int) -> int:
    return transfers - 1 << 16


class Pdma:
    """A controller's registers by their offsets, and its channels."""

    def __init__(self, machine: Machine, number: int = 0) -> None:
        self.machine = machine
        self.number = number

    def __getitem__(self, offset: int) -> int:
        return self.machine.read(0xB0008000 + 0x1000 * self.number + offset)

    def __setitem__(self, offset: int, value: int) -> None:
        self.machine.write(0xB0008000 + 0x1000 * self.number + offset, value)

    def task(self, channel: int) -> list[int]:
        return [self[16 * channel + offset] for offset in (0, 4, 8, 12)]

    def set_task(
        self, channel: int, control: int, source: int = 0, target: int = 0, following: int = 0
    ) -> None:
        self[16 * channel + 4] = source
        self[16 * channel + 8] = target
        self[16 * channel + 12] = following
        self[16 * channel] = control

    def select(self, channel: int, request: int) -> None:
        register, shift = REQSEL + channel // 4 * 4, 8 * (channel % 4)
        self[register] = self[register] & ~(0xFF << shift) | request << shift

    def start(self, channel: int = 0) -> None:
        """A software request, and time to serve it."""
        self[SWREQ] = 1 << channel
        self.run()

    def run(self) -> None:
        self.machine.step(5_000_000)

    @property
    def interrupt(self) -> bool:
        return bool(self.machine.read(AIC_RAW_0_31) & 1 << 25 + self.number)


def table(machine: Machine, address: int, *words: int) -> None:
    machine.write_memory(address, struct.pack("<4I", *words))


@pytest.fixture
def pdma(bus: Machine) -> Pdma:
    bus.write(HCLKEN, bus.read(HCLKEN) | 0x3000)
    bus.write(DIVCTL0, 0)
    pdma = Pdma(bus)
    pdma[CHCTL] = 0x3FF
    pdma[INTEN] = 0x3FF
    return pdma


def test_reset_is_idle(bus: Machine) -> None:
    for number in (0, 1):
        pdma = Pdma(bus, number)
        assert pdma.task(9) == [0, 0, 0, 0]
        assert [pdma[reg] for reg in (CHCTL, INTEN, INTSTS, ABTSTS, TDSTS, TOUTEN, SCATBA)] == [0] * 7


# ---- between memories


@pytest.mark.parametrize(("width", "size"), [(BYTES, 1), (HALVES, 2), (WORDS, 4)])
def test_basic_task(pdma: Pdma, width: int, size: int) -> None:
    data = bytes(range(1, 241))
    pdma.machine.write_memory(SOURCE, data)
    pdma.set_task(0, BASIC | width | count(240 // size), SOURCE, TARGET)
    pdma.run()
    assert pdma[TDSTS] == 0  # memory does not ask
    pdma.start()
    assert pdma.machine.read_memory(TARGET, 241) == data + b"\0"
    assert pdma.task(0)[:3] == [IDLE | width, SOURCE + 240, TARGET + 240]
    assert (pdma[TDSTS], pdma[INTSTS], pdma.interrupt) == (1, TDIF, True)
    pdma[TDSTS] = 2
    assert pdma[TDSTS] == 1
    pdma[TDSTS] = 1
    assert (pdma[TDSTS], pdma[INTSTS], pdma.interrupt) == (0, 0, False)


@pytest.mark.parametrize(
    ("fixed", "left"), [(FROM_FIXED, b"AAAA"), (TO_FIXED, b"D\0\0\0"), (FROM_FIXED | TO_FIXED, b"A\0\0\0")]
)
def test_fixed_addresses(pdma: Pdma, fixed: int, left: bytes) -> None:
    pdma.machine.write_memory(SOURCE, b"ABCD")
    pdma.set_task(0, BASIC | fixed | count(4), SOURCE, TARGET)
    pdma.start()
    assert pdma.machine.read_memory(TARGET, 4) == left


def test_largest_count(pdma: Pdma) -> None:
    data = bytes(n * n >> 3 & 0xFF for n in range(65536))
    pdma.machine.write_memory(SOURCE, data)
    pdma.set_task(0, BASIC | count(65536), SOURCE, TARGET)
    pdma.start()
    assert pdma.machine.read_memory(TARGET, 65536) == data
    assert pdma[TDSTS] == 1


def test_single_transfers_need_a_request_each(pdma: Pdma) -> None:
    pdma.machine.write_memory(SOURCE, b"ABC")
    pdma.set_task(0, BASIC | SINGLE | count(3), SOURCE, TARGET)
    for left in (b"A\0\0", b"AB\0", b"ABC"):
        assert pdma[TDSTS] == 0
        pdma.start()
        assert pdma.machine.read_memory(TARGET, 3) == left
    assert pdma[TDSTS] == 1


def test_every_channel_of_both(pdma: Pdma) -> None:
    for number in (0, 1):
        one = Pdma(pdma.machine, number)
        one[CHCTL] = one[INTEN] = 0x3FF
        for channel in range(10):
            where = 64 * (10 * number + channel)
            one.machine.write_memory(SOURCE + where, bytes([number, channel, 1]))
            one.set_task(channel, BASIC | count(3), SOURCE + where, TARGET + where)
            one.start(channel)
            assert one.machine.read_memory(TARGET + where, 3) == bytes([number, channel, 1])
            assert one[TDSTS] == 1 << channel
            assert one.interrupt
            assert not Pdma(pdma.machine, 1 - number).interrupt
            one[TDSTS] = 1 << channel


def test_interrupt_needs_its_channels_enable(pdma: Pdma) -> None:
    pdma[INTEN] = 0x3FE
    pdma.set_task(0, BASIC, SOURCE, TARGET)
    pdma.start()
    assert (pdma[TDSTS], pdma.interrupt) == (1, False)
    pdma[INTEN] = 1
    assert pdma.interrupt


def test_chain(pdma: Pdma) -> None:
    """As BSP's sample: one request, tasks of bursts, the last one basic."""
    machine = pdma.machine
    machine.write_memory(SOURCE, b"onetwothree")
    pdma[SCATBA] = TABLE & 0xFFFF0000
    table(machine, TABLE + 0x40, SCATTER | NO_INTERRUPT | count(3), SOURCE, TARGET, 0x80)
    table(machine, TABLE + 0x80, SCATTER | NO_INTERRUPT | count(3), SOURCE + 3, TARGET + 16, 0xC0)
    table(machine, TABLE + 0xC0, BASIC | count(5), SOURCE + 6, TARGET + 32, 0)
    pdma.set_task(3, SCATTER, following=0x40)
    pdma.start(3)
    assert machine.read_memory(TARGET, 37) == b"one" + bytes(13) + b"two" + bytes(13) + b"three"
    assert pdma[TDSTS] == 1 << 3
    assert pdma[CURSCAT + 4 * 3] == TABLE + 0xC0
    assert pdma.task(3)[0] & 3 == IDLE
    assert pdma[TRGSTS] == 0


def test_task_without_interrupt(pdma: Pdma) -> None:
    pdma.machine.write_memory(SOURCE, b"A")
    pdma.set_task(0, BASIC | NO_INTERRUPT, SOURCE, TARGET)
    pdma.start()
    assert pdma.machine.read_memory(TARGET, 1) == b"A"
    assert (pdma[TDSTS], pdma.interrupt) == (0, False)


def test_chain_ends_at_an_idle_task(pdma: Pdma) -> None:
    """As BSP's ping-pong sample ends its ring."""
    table(pdma.machine, TABLE, SCATTER, SOURCE, TARGET, TABLE + 16)
    table(pdma.machine, TABLE + 16, IDLE, SOURCE, TARGET, TABLE)
    pdma.set_task(0, SCATTER, following=TABLE)
    pdma.start()
    assert (pdma[TDSTS], pdma[TRGSTS], pdma[TACTSTS], pdma[ABTSTS]) == (1, 0, 0, 0)


def test_pause_and_go_on(pdma: Pdma) -> None:
    pdma.machine.write_memory(SOURCE, b"\x5a" * 4096)
    pdma.set_task(0, BASIC | count(4096), SOURCE, TARGET)
    pdma[SWREQ] = 1
    pdma.machine.step(20_000)
    assert pdma[TACTSTS] == 1
    left = pdma.task(0)[0] >> 16
    assert 0 < left < 4095
    pdma[PAUSE] = 1
    assert (pdma[CHCTL], pdma[TACTSTS], pdma[TRGSTS]) == (0x3FE, 0, 0)
    pdma.run()
    assert pdma.task(0)[0] >> 16 == left
    pdma[CHCTL] = 1
    pdma.start()
    assert pdma.machine.read_memory(TARGET, 4097) == b"\x5a" * 4096 + b"\0"
    assert pdma[TDSTS] == 1


def test_priorities_are_kept(pdma: Pdma) -> None:
    pdma[PRISET] = 0x21
    pdma[PRISET] = 0x100
    pdma[PRICLR] = 0x20
    assert pdma[PRISET] == 0x101


# ---- with a UART


@pytest.fixture
def uart(pdma: Pdma) -> Pdma:
    """... and UART0 at 115200 8N1 on its pins."""
    pdma.machine.write(PCLKEN0, 0x03FF0000)
    pdma.machine.write(GPF_MFPH, 0x11000)
    pdma.machine.write(UART_BAUD, 0x30000066)
    pdma.machine.write(UART_LINE, 3)
    return pdma


def until(condition: Callable[[], object]) -> None:
    """Waits for QEMU to take bytes from a socket."""
    deadline = time.monotonic() + ANSWER_SECONDS
    while not condition():
        assert time.monotonic() < deadline


def hear(pdma: Pdma, data: bytes) -> None:
    """The far end sends; back when the first start bit is on the line."""
    pdma.machine.uarts[0].send(data)
    until(lambda: not pdma.machine.read(UART_FIFOSTS) & 1 << 29)


def receive_as_the_vendor(pdma: Pdma, channel: int, time_out: int = 0xCC) -> None:
    """nuc980_prepare_RX_dma(): a ring of two tasks of 128 bytes, a time-out for what does not fill one."""
    control = SCATTER | SINGLE | FROM_FIXED | count(128)
    table(pdma.machine, TABLE, control, UART0, TARGET, TABLE + 16)
    table(pdma.machine, TABLE + 16, control, UART0, TARGET + 128, TABLE)
    pdma[16 * channel] = 0
    pdma[CHCTL] |= 1 << channel
    pdma.select(channel, UART0_RX)
    pdma[INTEN] |= 1 << channel
    pdma[TOUTPSC if channel < 8 else TOUTPSC2] &= ~(7 << 4 * (channel % 8))
    pdma[TOC + channel // 2 * 4] = time_out << 16 * (channel % 2)
    pdma[TOUTEN] |= 1 << channel
    pdma[TOUTIEN] |= 1 << channel
    pdma[16 * channel + 12] = TABLE
    pdma[16 * channel] = SCATTER
    pdma.machine.write(UART_INTEN, RXPDMAEN | 0x24)


@pytest.mark.parametrize(("number", "channel"), [(0, 0), (1, 9)])
def test_receive_ring_with_timeout(uart: Pdma, number: int, channel: int) -> None:
    pdma = Pdma(uart.machine, number)
    receive_as_the_vendor(pdma, channel)
    pdma.machine.step(2 * hclk_ns(0xCC * 256))
    assert (pdma[INTSTS], pdma.interrupt) == (0, False)  # nothing heard: no time-out
    data = bytes(n ^ 0x5A for n in range(150))
    hear(pdma, data)
    pdma.machine.step(128 * CHAR + 1000)
    assert (pdma[TDSTS], pdma[INTSTS]) == (1 << channel, TDIF)
    assert pdma.interrupt
    assert pdma.machine.read_memory(TARGET, 128) == data[:128]
    pdma[TDSTS] = 1 << channel
    pdma.machine.step(22 * CHAR + 1000)
    # What the driver's handler takes: the second half's task, and how much of it is left
    assert pdma.task(channel)[0] >> 16 == 128 - 22 - 1
    assert pdma.task(channel)[2] == TARGET + 150
    assert pdma[CURSCAT + 4 * channel] == TABLE + 16
    assert pdma.machine.read_memory(TARGET, 150) == data
    late = 1 << 8 + channel
    assert pdma[INTSTS] == 0
    pdma.machine.step(hclk_ns(0xCC * 256))
    assert (pdma[INTSTS], pdma.interrupt) == (late, True)
    pdma[TOUTEN] &= ~(1 << channel)
    pdma[INTSTS] = late
    assert (pdma[INTSTS], pdma.interrupt) == (0, False)
    pdma.machine.step(2 * hclk_ns(0xCC * 256))
    assert pdma[INTSTS] == 0


@pytest.mark.parametrize("prescale", [0, 3, 7])
def test_timeout_is_exact(uart: Pdma, prescale: int) -> None:
    receive_as_the_vendor(uart, 2, 100)
    uart[TOUTPSC] = prescale << 8
    hear(uart, b"x")
    uart.machine.step(CHAR)
    served = 0
    while uart.machine.read_memory(TARGET, 1) != b"x":
        uart.machine.step(1)
        served += 1
    assert 0 < served < 1000
    uart.machine.step(hclk_ns(100 << 8 + prescale) - 1)
    assert uart[INTSTS] == 0
    uart.machine.step(1)
    assert uart[INTSTS] == 1 << 10


def test_gap_shorter_than_the_timeout(uart: Pdma) -> None:
    receive_as_the_vendor(uart, 0, 300)
    for _ in range(3):
        hear(uart, b"x")
        uart.machine.step(2 * CHAR)
        assert uart[INTSTS] == 0
    uart.machine.step(hclk_ns(300 * 256))
    assert uart[INTSTS] == 1 << 8


def test_timeout_without_interrupt_enable(uart: Pdma) -> None:
    receive_as_the_vendor(uart, 0)
    uart[TOUTIEN] = 0
    hear(uart, b"x")
    uart.machine.step(CHAR + hclk_ns(0xCC * 256) + 1000)
    assert (uart[INTSTS], uart.interrupt) == (1 << 8, False)


def test_transmit(uart: Pdma) -> None:
    """nuc980_prepare_TX_dma(): one basic task; the transmitter asks while its FIFO has room."""
    data = bytes(range(100))
    uart.machine.write_memory(SOURCE, data)
    uart.select(7, UART0_TX)
    uart.set_task(7, SINGLE | TO_FIXED | count(100) | BASIC, SOURCE, UART0)
    uart.machine.step(1000)
    assert uart.task(7)[0] >> 16 == 99  # the UART does not ask yet
    uart.machine.write(UART_INTEN, TXPDMAEN)
    uart.machine.step(1000)
    assert uart.task(7)[0] >> 16 == 99 - 17  # FIFO and shifter
    uart.machine.step(82 * CHAR)
    assert uart.machine.uarts[0].receive(0) == data[:82]
    assert uart[TDSTS] == 0
    uart.machine.step(CHAR)
    assert (uart[TDSTS], uart.interrupt) == (1 << 7, True)
    uart.machine.step(18 * CHAR)
    assert uart.machine.uarts[0].receive(0) == data[82:]


def test_both_ways_at_once_on_both_controllers(uart: Pdma) -> None:
    other = Pdma(uart.machine, 1)
    other[CHCTL] = 1
    uart.machine.write_memory(SOURCE, b"there")
    receive_as_the_vendor(uart, 1)
    other.select(0, UART0_TX)
    other.set_task(0, SINGLE | TO_FIXED | count(5) | BASIC, SOURCE, UART0)
    uart.machine.write(UART_INTEN, TXPDMAEN | RXPDMAEN)
    hear(uart, b"back again")
    uart.machine.step(11 * CHAR)
    assert uart.machine.uarts[0].receive(0) == b"there"
    assert uart.machine.read_memory(TARGET, 10) == b"back again"
    assert not uart.machine.read(UART_FIFOSTS) & (1 << 0 | 1 << 24)


def test_far_end_that_does_not_read_stops_only_the_uart(board: Callable[..., Machine]) -> None:
    """More than a socket holds of single bytes, without the line's time."""
    machine = board(options="pace=off", registers=True)
    pdma = Pdma(machine)
    pdma[CHCTL] = 1
    machine.write(PCLKEN0, 0x03FF0000)
    machine.write(GPF_MFPH, 0x11000)
    machine.write(UART_LINE, 3)
    machine.write(UART_INTEN, TXPDMAEN)
    data = bytes(n * 37 + (n >> 8) & 0xFF for n in range(4000))
    machine.write_memory(SOURCE, data)
    pdma.select(0, UART0_TX)
    pdma.set_task(0, SINGLE | TO_FIXED | count(len(data)) | BASIC, SOURCE, UART0)
    machine.step(1_000_000)
    assert machine.read(UART_FIFOSTS) & 1 << 23  # full, and the machine answers
    assert pdma[TDSTS] == 0
    line = machine.uarts[0]

    def all_is_read() -> bool:
        line.receive(0)
        machine.step(1_000_000)
        return len(line.seen) == len(data)

    until(all_is_read)
    assert line.seen == data
    assert pdma[TDSTS] == 1


# ---- programmed by an enemy


@pytest.mark.parametrize(
    ("control", "source", "target", "following"),
    [
        (BASIC | WORDS | count(9), NOWHERE, TARGET, 0),
        (BASIC | WORDS | count(9), SOURCE, NOWHERE, 0),
        (BASIC | WORDS | count(9), SOURCE, 0xFFFFFFFC, 0),
        (BASIC | count(9), SOURCE, 0xB0009000, 0),  # a register by bytes
        (SCATTER, SOURCE, TARGET, NOWHERE),
        (SCATTER, SOURCE, TARGET, 0xFFFFFFFC),
    ],
)
def test_bus_error_aborts(pdma: Pdma, control: int, source: int, target: int, following: int) -> None:
    pdma.set_task(5, control, source, target, following)
    pdma.start(5)
    assert (pdma[ABTSTS], pdma[TDSTS], pdma[INTSTS], pdma.interrupt) == (1 << 5, 0, ABTIF, True)
    assert pdma.task(5)[0] & 3 == IDLE
    assert "pdma[0]: channel 5: " in pdma.machine.complaints
    pdma[ABTSTS] = 1 << 5
    assert (pdma[ABTSTS], pdma[INTSTS], pdma.interrupt) == (0, 0, False)
    pdma.set_task(5, BASIC, SOURCE, TARGET)
    pdma.start(5)
    assert pdma[TDSTS] == 1 << 5


@pytest.mark.parametrize(("width", "offset"), [(HALVES, 1), (WORDS, 2)])
@pytest.mark.parametrize("side", [0, 1])
def test_unaligned_task(pdma: Pdma, width: int, offset: int, side: int) -> None:
    pdma.set_task(0, BASIC | width, SOURCE + offset * side, TARGET + offset * (1 - side))
    pdma.start()
    assert (pdma[ALIGN], pdma[TDSTS], pdma[INTSTS], pdma.interrupt) == (1, 0, ALIGNF, True)
    pdma[ALIGN] = 1
    assert (pdma[ALIGN], pdma.interrupt) == (0, False)


@pytest.mark.parametrize("control", [3, BASIC | 3 << 12])
def test_reserved_values(pdma: Pdma, control: int) -> None:
    pdma.set_task(0, control | count(4), SOURCE, TARGET)
    pdma.start()
    assert (pdma[TDSTS], pdma[ABTSTS], pdma[ALIGN], pdma.task(0)[0] & 3) == (0, 0, 0, IDLE)
    assert "is reserved" in pdma.machine.complaints


def test_endless_ring_leaves_time_for_all_else(pdma: Pdma) -> None:
    table(pdma.machine, TABLE, SCATTER | NO_INTERRUPT | count(4), SOURCE, TARGET, TABLE)
    pdma.set_task(0, SCATTER, following=TABLE)
    pdma.set_task(1, BASIC | count(1000), SOURCE, TARGET + 4096)
    pdma[SWREQ] = 3
    pdma.machine.step(1_000_000)
    assert pdma[TACTSTS] == 1
    assert pdma[TDSTS] == 2
    pdma[CHRST] = 1
    assert (pdma[CHCTL], pdma[TACTSTS], pdma.task(0)[0] & 3) == (0x3FE, 0, IDLE)
    pdma.machine.step(1_000_000)
    assert pdma[TACTSTS] == 0


def test_task_that_points_at_itself(pdma: Pdma) -> None:
    """... through a chain whose tasks write the controller's own request register."""
    pdma.machine.write_memory(SOURCE, struct.pack("<I", 0x3FF))
    for channel in range(10):
        own = SCATTER | WORDS | SINGLE | FROM_FIXED | TO_FIXED | count(65536)
        table(pdma.machine, TABLE + 16 * channel, own, SOURCE, 0xB0008000 + SWREQ, TABLE + 16 * channel)
        pdma.set_task(channel, SCATTER, following=TABLE + 16 * channel)
    pdma[SWREQ] = 1
    pdma.machine.step(1_000_000)
    assert pdma[TACTSTS] == 0x3FF
    pdma[CHRST] = 0x3FF
    pdma.machine.step(1_000_000)
    assert pdma[TACTSTS] == 0


def test_two_controllers_that_trigger_each_other(pdma: Pdma) -> None:
    pdma.machine.write_memory(SOURCE, struct.pack("<I", 1))
    for number in (0, 1):
        one = Pdma(pdma.machine, number)
        one[CHCTL] = 1
        there = 0xB0008000 + 0x1000 * (1 - number) + SWREQ
        one.set_task(0, BASIC | SINGLE | WORDS | FROM_FIXED | TO_FIXED | count(65536), SOURCE, there)
    pdma[SWREQ] = 1
    pdma.machine.step(1_000_000)
    assert 0 < pdma.task(0)[0] >> 16 < 65535
    pdma[CHCTL] = 0
    left = pdma.task(0)[0]
    pdma.machine.step(1_000_000)
    assert pdma.task(0)[0] == left


def test_request_to_a_disabled_channel_is_ignored(pdma: Pdma) -> None:
    pdma[CHCTL] = 0
    pdma.set_task(0, BASIC, SOURCE, TARGET)
    pdma[SWREQ] = 1
    pdma[CHCTL] = 1
    pdma.run()
    assert (pdma[TDSTS], pdma[TRGSTS]) == (0, 0)


def test_request_that_no_peripheral_has(pdma: Pdma) -> None:
    for request in (1, 63, 64, 127):
        pdma.select(0, request)
        pdma.set_task(0, BASIC, SOURCE, TARGET)
        pdma.run()
        assert (pdma[TDSTS], pdma[TRGSTS]) == (0, 0)


def test_reset_while_busy(pdma: Pdma) -> None:
    table(pdma.machine, TABLE, SCATTER | count(4), SOURCE, TARGET, TABLE)
    pdma.set_task(0, SCATTER, following=TABLE)
    pdma[SWREQ] = 1
    pdma.machine.step(50_000)
    pdma.machine.command("system_reset")
    until(lambda: pdma[CHCTL] == 0)
    pdma.run()
    assert (pdma[TDSTS], pdma[INTSTS], pdma.interrupt) == (0, 0, False)


def test_what_is_not_there_is_logged(pdma: Pdma) -> None:
    pdma[STRIDE] = 1
    pdma[STRIDE] = 2
    assert pdma.machine.complaints.count("pdma[0]: register 0x500 is not modelled") == 1
    pdma[16 * 10] = 1
    assert pdma[PAUSE] == 0
    assert "write of 0x1 to 0xa0, no register" in pdma.machine.complaints
    assert "read of 0x404, no register" in pdma.machine.complaints


# ---- state


def test_ring_and_timeout_survive_a_move(uart: Pdma, reborn: Callable[[Machine], Machine]) -> None:
    receive_as_the_vendor(uart, 8)
    hear(uart, b"0123456789")
    uart.machine.step(4 * CHAR + 1000)
    there = Pdma(reborn(uart.machine))
    assert there.machine.read_memory(TARGET, 10) == b"0123" + bytes(6)
    there.machine.step(6 * CHAR)
    assert there.machine.read_memory(TARGET, 10) == b"0123456789"
    assert there[INTSTS] == 0
    again = Pdma(reborn(there.machine))
    again.machine.step(hclk_ns(0xCC * 256))
    assert (again[INTSTS], again.interrupt) == (1 << 16, True)


def test_long_task_survives_a_move(pdma: Pdma, reborn: Callable[[Machine], Machine]) -> None:
    data = bytes(n * 11 & 0xFF for n in range(4096))
    pdma.machine.write_memory(SOURCE, data)
    pdma.set_task(0, BASIC | count(4096), SOURCE, TARGET)
    pdma[SWREQ] = 1
    pdma.machine.step(20_000)
    there = Pdma(reborn(pdma.machine))
    assert there[TDSTS] == 0
    there.run()
    assert (there[TDSTS], there.interrupt) == (1, True)
    assert there.machine.read_memory(TARGET, 4096) == data
