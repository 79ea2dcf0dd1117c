# SPDX-License-Identifier: GPL-3.0-or-later
"""The two Ethernet MACs and their PHYs: frames on a wire whose far ends the test holds."""

import fcntl
import socket
import struct
import termios
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from nuc980.twin.machine import Machine

CAMCMR, CAMEN, CAM0M, CAM0L, CAM13M = 0x00, 0x04, 0x08, 0x0C, 0x70
TXDLSA, RXDLSA, MCMDR, MIID, MIIDA, FFTCR, TSDR, RSDR, DMARFC = range(0x88, 0xAC, 4)
MIEN, MISTA, MGSTA, MPCNT, MRPC, MRPCC, MREPC, DMARFS, CTXDSA, CTXBSA, CRXDSA, CRXBSA = range(0xAC, 0xDC, 4)
TSCTL, TSADDEND = 0x100, 0x11C

AUP, AMP, ABP, CCAM, ECMP = 1, 2, 4, 8, 16
RXON, ALP, ARP, ACP, SPCRC, TXON = 1, 2, 4, 8, 0x20, 0x100
SDPZ, FDUP, OPMOD, LBK, SWR = 1 << 16, 1 << 18, 1 << 20, 1 << 21, 1 << 24
RXINTR, CRCE, RXOV, PTLE, RXGD, RP, MMP, DFO, DEN, RDU, RXBERR, CFR = (
    1 << bit for bit in (0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 14)
)
TXINTR, TXCP, TDU, TXBERR = (1 << bit for bit in (16, 18, 23, 24))
MGSTA_CFR, MGSTA_RXHA, MGSTA_TXHA = 1, 2, 1 << 11

OWNER = 1 << 31
RXDS_RXINTR, RXDS_PTLE, RXDS_RXGD, RXDS_RP = (1 << bit for bit in (16, 19, 20, 22))
PADEN, CRCAPP, INTEN = 1, 2, 4
TXDS_TXINTR, TXDS_TXCP = 1 << 16, 1 << 19

BMCR, BMSR, PHYID1, PHYID2, ANAR, ANLPAR, ANER = range(7)
LINK, NEGOTIATED = 1 << 2, 1 << 5

AIC_RAW = 0xB0042100
RAM_SIZE = 0x04000000
SECONDS = 60.0  # of patience

STATION = bytes.fromhex("020000aabb01")
OTHER = bytes.fromhex("020000ccdd02")
GROUP = bytes.fromhex("01005e000001")
BROADCAST = b"\xff" * 6
PAUSE = bytes.fromhex("0180c2000001")


def frame(to: bytes, size: int = 60, kind: int = 0x0800, mark: int = 0) -> bytes:
    """A frame of that many bytes without its check sequence."""
    body = bytes((mark + n) & 0xFF for n in range(size))
    return (to + OTHER + kind.to_bytes(2, "big") + body)[:size]


def check_sequence(data: bytes) -> bytes:
    return zlib.crc32(data).to_bytes(4, "little")


def until(condition: Callable[[], object]) -> None:
    """The wire is not in step with the bus: asks until it is so."""
    deadline = time.monotonic() + SECONDS
    while not condition():
        assert time.monotonic() < deadline, "it never came so"


class Port:
    """One EMAC, its part of memory and the far end of its cable."""

    def __init__(self, machine: Machine, number: int, far: socket.socket, near: str) -> None:
        self.machine = machine
        self.base = 0xB0012000 + number * 0x10000
        self.mfp = 0xB0000090 + number * 8  # ports E and F
        self.irqs = {"tx": 21 + number, "rx": 19 + number}
        self.memory = 0x100000 * (number + 1)
        self.name = f"nuc980-emac.{number}"
        self._far, self._near = far, near

    def read(self, register: int) -> int:
        return self.machine.read(self.base + register)

    def write(self, register: int, value: int) -> None:
        self.machine.write(self.base + register, value)

    def irq(self, direction: str) -> bool:
        number = self.irqs[direction]
        return bool(self.machine.read(AIC_RAW + number // 32 * 4) >> number % 32 & 1)

    # ---- board

    def route(self, low: int = 0x11111111, high: int = 0x11) -> None:
        """Selects RMII's data, control and clock, then MDIO and MDC."""
        self.machine.write(self.mfp, low)
        self.machine.write(self.mfp + 4, high)

    def cable(self, up: bool) -> None:
        self.machine.command("set_link", name=self.name, up=up)

    def phy(self, register: int, address: int = 1) -> int:
        self.write(MIIDA, 1 << 17 | address << 8 | register)
        assert not self.read(MIIDA) >> 17 & 1
        return self.read(MIID)

    def phy_write(self, register: int, value: int, address: int = 1) -> None:
        self.write(MIID, value)
        self.write(MIIDA, 1 << 17 | 1 << 16 | address << 8 | register)
        assert not self.read(MIIDA) >> 17 & 1

    # ---- wire

    def arrives(self, data: bytes) -> None:
        self._far.sendto(data, self._near)

    def taken(self) -> None:
        """Waits until all that has been sent to the port is out of the socket, hence with the MAC."""
        unread = bytearray(4)
        until(lambda: fcntl.ioctl(self._far, termios.TIOCOUTQ, unread) == 0 and not any(unread))

    def sent(self) -> bytes:
        """The next frame that left the port, but a restored QEMU's RARP."""
        while (data := self._far.recv(65536))[12:14] == b"\x80\x35":
            pass
        return data

    # ---- descriptors

    def rx_desc(self, n: int) -> int:
        return self.memory + 16 * n

    def rx_buffer(self, n: int) -> int:
        return self.memory + 0x10000 + 0x1000 * n + 2  # as the vendor's driver has them

    def tx_desc(self, n: int) -> int:
        return self.memory + 0x4000 + 16 * n

    def tx_buffer(self, n: int) -> int:
        return self.memory + 0x80000 + 0x400 * n + 2

    def descriptor(self, address: int, *words: int) -> None:
        self.machine.write_memory(address, struct.pack("<4I", *words))

    def words(self, address: int) -> tuple[int, ...]:
        return struct.unpack("<4I", self.machine.read_memory(address, 16))

    def listen(self, count: int = 4, flags: int = SPCRC, camcmr: int = AUP | AMP | ABP) -> None:
        """A ring of receive buffers, and reception on."""
        for n in range(count):
            self.descriptor(self.rx_desc(n), OWNER, self.rx_buffer(n), 0, self.rx_desc((n + 1) % count))
        self.write(RXDLSA, self.rx_desc(0))
        self.write(CAMCMR, camcmr)
        self.write(MCMDR, self.read(MCMDR) & ~RXON | OPMOD | FDUP | flags)
        self.write(MCMDR, self.read(MCMDR) | RXON)

    def heard(self, n: int) -> tuple[int, bytes]:
        """Descriptor n's first word and its frame, once the MAC gave it back."""
        until(lambda: not self.machine.read(self.rx_desc(n)) & OWNER)
        word = self.machine.read(self.rx_desc(n))
        return word, self.machine.read_memory(self.rx_buffer(n), word & 0xFFFF)

    def talk(self, flags: int = 0) -> None:
        """Transmission on, from descriptor 0, which is the processor's."""
        self.descriptor(self.tx_desc(0), 0, 0, 0, 0)
        self.write(TXDLSA, self.tx_desc(0))
        self.write(MCMDR, self.read(MCMDR) & ~TXON | OPMOD | FDUP | flags)
        self.write(MCMDR, self.read(MCMDR) | TXON)

    def give(self, n: int, data: bytes, control: int = PADEN | CRCAPP) -> None:
        """Descriptor n, the MAC's; the one after it is the processor's."""
        self.machine.write_memory(self.tx_buffer(n), data)
        self.descriptor(self.tx_desc(n + 1), 0, 0, 0, 0)
        self.descriptor(self.tx_desc(n), OWNER | control, self.tx_buffer(n), len(data), self.tx_desc(n + 1))

    def send(self, n: int, data: bytes, control: int = PADEN | CRCAPP) -> tuple[int, ...]:
        """Sends by descriptor n; returns its words after that."""
        self.give(n, data, control)
        self.write(TSDR, 0)
        return self.words(self.tx_desc(n))


@pytest.fixture
def plug(board: Callable[..., Machine], tmp_path: Path) -> Iterator[Callable[..., list[Port]]]:
    """Starts a machine with a cable in each port, as the boot loader leaves it with the pins routed."""
    far_ends: list[socket.socket] = []

    def start(*arguments: str | Path, routed: bool = True) -> list[Port]:
        nets: list[str | Path] = []
        for n in range(2):
            far_ends.append(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            far_ends[-1].settimeout(SECONDS)
            far = tmp_path / f"far{len(far_ends)}"
            far_ends[-1].bind(str(far))
            nets += [
                "-netdev",
                f"dgram,id=net{n},local.type=unix,local.path={far}-near,remote.type=unix,remote.path={far}",
                "-net",
                f"nic,netdev=net{n}",
            ]
        machine = board(*nets, *arguments, registers=True)
        ends = far_ends[-2:]
        ports = [Port(machine, n, end, f"{end.getsockname()}-near") for n, end in enumerate(ends)]
        if routed:
            for port in ports:
                port.route()
        return ports

    yield start
    for end in far_ends:
        end.close()


@pytest.fixture
def port(plug: Callable[..., list[Port]]) -> Port:
    return plug()[0]


# ---- registers


def test_reset_values(plug: Callable[..., list[Port]]) -> None:
    for port in plug():
        values = {r: value for r in range(0, 0xDC, 4) if r not in (TSDR, RSDR) and (value := port.read(r))}
        expected = {TXDLSA: 0xFFFFFFFC, RXDLSA: 0xFFFFFFFC, MIIDA: 0x00900000, FFTCR: 0x0101, DMARFC: 0x0800}
        assert values == expected | {MPCNT: 0x7FFF}


def test_software_reset_keeps_the_mode(port: Port) -> None:
    port.write(CAM0M, 0x12345678)
    port.write(MIEN, RXINTR | RXGD)
    port.listen(flags=SPCRC | LBK)
    port.talk()
    port.write(MCMDR, port.read(MCMDR) | SWR)
    assert port.read(MCMDR) == OPMOD | LBK
    assert [port.read(r) for r in (CAM0M, MIEN, MISTA, CAMCMR)] == [0, 0, 0, 0]
    assert port.read(MPCNT) == 0x7FFF


def test_status_bits_clear_one_by_one_and_the_summaries_follow(port: Port) -> None:
    port.talk()  # TDU
    port.listen(count=1)
    port.arrives(frame(BROADCAST))
    port.heard(0)
    port.arrives(frame(BROADCAST))
    until(lambda: port.read(MISTA) & RDU)
    port.send(0, frame(OTHER), PADEN | CRCAPP | INTEN)
    everything = RXGD | DEN | RDU | TXCP | TDU
    assert port.read(MISTA) == everything
    assert not port.irq("rx") and not port.irq("tx")
    port.write(MIEN, everything)
    assert port.read(MISTA) == everything | RXINTR | TXINTR
    assert not port.irq("rx") and not port.irq("tx")
    port.write(MIEN, everything | RXINTR)
    assert port.irq("rx") and not port.irq("tx")
    port.write(MIEN, everything | RXINTR | TXINTR)
    assert port.irq("rx") and port.irq("tx")
    port.write(MISTA, RXINTR | TXINTR)
    assert port.read(MISTA) == everything | RXINTR | TXINTR
    left = everything
    for bit in (RXGD, DEN, RDU, TXCP, TDU):
        port.write(MISTA, bit)
        left &= ~bit
        summary = (RXINTR if left & 0xFFFF else 0) | (TXINTR if left >> 16 else 0)
        assert port.read(MISTA) == left | summary
    assert not port.irq("rx") and not port.irq("tx")


def test_status_bits_not_enabled_do_not_interrupt(port: Port) -> None:
    port.write(MIEN, RXINTR | TXINTR | RXGD)
    port.talk()
    assert port.read(MISTA) == TDU
    assert not port.irq("tx")


def test_unmodelled_registers_are_said_once(port: Port) -> None:
    for _ in range(3):
        port.write(TSADDEND, 0x1234)
        port.read(0xE0)
    assert port.read(TSADDEND) == 0x1234
    port.write(TSCTL, 0xF)
    assert port.read(TSCTL) == 0x5  # what a driver waits for is over
    for register in ("0x11c", "0xe0", "0x100"):
        assert port.machine.complaints.count(f"{port.name}: register {register} is not modelled") == 1


def test_read_only_and_write_only_registers(port: Port) -> None:
    for register in (MRPC, MRPCC, MREPC, DMARFS, CTXDSA, CTXBSA, CRXDSA, CRXBSA):
        port.write(register, 0xFFFFFFFF)
        assert port.read(register) == 0
    assert port.machine.complaints.count("write to read-only register") == 8
    assert port.read(TSDR) == 0 and port.read(RSDR) == 0
    assert port.machine.complaints.count("read of write-only register") == 2


# ---- PHY and link


def test_phy_is_an_ip101g_at_its_address_only(plug: Callable[..., list[Port]]) -> None:
    for port in plug():
        assert (port.phy(PHYID1), port.phy(PHYID2)) == (0x0243, 0x0C54)
        assert {port.phy(PHYID1, address) for address in range(32) if address != 1} == {0xFFFF}
        port.phy_write(BMCR, 0x0800, address=2)
        assert port.phy(BMCR) == 0x3100


def test_phy_address_is_a_property(plug: Callable[..., list[Port]]) -> None:
    port = plug("-global", "nuc980-emac.phy-addr=7")[1]
    assert (port.phy(PHYID1), port.phy(PHYID1, 7)) == (0xFFFF, 0x0243)


def test_phy_is_silent_without_its_management_pins(port: Port) -> None:
    for high in (0x01, 0x10, 0x00, 0x21):
        port.route(high=high)
        assert port.phy(PHYID1) == 0xFFFF
        port.phy_write(BMCR, 0x0800)
    port.route()
    assert (port.phy(PHYID1), port.phy(BMCR)) == (0x0243, 0x3100)


def test_link_is_up_and_negotiated(port: Port) -> None:
    assert port.phy(BMSR) & ~LINK == 0x7849 | NEGOTIATED
    assert port.phy(BMSR) == 0x7849 | NEGOTIATED | LINK
    assert (port.phy(ANLPAR), port.phy(ANER)) == (0x41E1, 1)


def test_no_backend_is_no_cable(bus: Machine) -> None:
    port = Port(bus, 0, None, "")
    port.route()
    port.phy(BMSR)
    assert port.phy(BMSR) == 0x7849
    assert (port.phy(ANLPAR), port.phy(ANER)) == (0, 0)


def test_link_loss_is_latched_until_read(port: Port) -> None:
    port.phy(BMSR)
    port.cable(False)
    port.cable(True)
    assert not port.phy(BMSR) & LINK
    assert port.phy(BMSR) & LINK
    port.cable(False)
    assert [port.phy(BMSR) & (LINK | NEGOTIATED) for _ in range(2)] == [0, 0]


def test_link_needs_each_rmii_pin(port: Port) -> None:
    for pin in range(8):
        port.route()
        port.phy(BMSR)
        assert port.phy(BMSR) & LINK
        port.route(low=0x11111111 & ~(0xF << 4 * pin))
        assert not port.phy(BMSR) & LINK


def test_phy_power_down_reset_and_forced_modes(port: Port) -> None:
    port.phy_write(BMCR, 0x3900)
    assert not port.phy(BMSR) & LINK
    port.phy_write(BMCR, 0x8000)
    assert port.phy(BMCR) == 0x3100
    port.phy_write(BMCR, 0x3300)  # restart is over at once
    assert port.phy(BMCR) == 0x3100
    port.phy(BMSR)
    port.phy_write(BMCR, 0x2100)
    assert port.phy(BMSR) & (LINK | NEGOTIATED) == LINK
    port.phy_write(BMCR, 0x3100)
    port.phy_write(ANAR, 0x0001)  # nothing in common
    assert not port.phy(BMSR) & LINK
    port.phy_write(PHYID1, 0)
    assert port.phy(PHYID1) == 0x0243


# ---- transmit


def test_frame_is_padded_and_given_back(port: Port) -> None:
    port.talk()
    assert port.read(MISTA) == TDU
    short = frame(BROADCAST, 20)
    words = port.send(0, short)
    assert port.sent() == short + bytes(40)
    assert words == (PADEN | CRCAPP, port.tx_buffer(0), TXDS_TXCP | 20, port.tx_desc(1))
    assert (port.read(CTXDSA), port.read(CTXBSA)) == (port.tx_desc(1), port.tx_buffer(0))
    long = frame(BROADCAST, 1514)
    port.send(1, long)
    assert port.sent() == long
    port.send(2, short, CRCAPP)
    assert port.sent() == short


def test_completion_interrupts_only_if_the_descriptor_asks(port: Port) -> None:
    port.write(MIEN, TXINTR | TXCP)
    port.talk()
    assert port.send(0, frame(OTHER))[2] == TXDS_TXCP | 60
    assert not port.irq("tx")
    assert port.send(1, frame(OTHER), PADEN | CRCAPP | INTEN)[2] == TXDS_TXCP | TXDS_TXINTR | 60
    assert port.read(MISTA) & TXCP
    assert port.irq("tx")


def test_halted_transmission_waits_for_its_demand(port: Port) -> None:
    port.talk()
    port.write(MISTA, TDU)
    port.give(0, frame(OTHER, mark=1))
    assert port.machine.read(port.tx_desc(0)) & OWNER
    port.write(MCMDR, port.read(MCMDR))
    assert port.machine.read(port.tx_desc(0)) & OWNER
    port.write(TSDR, 0)
    assert port.sent() == frame(OTHER, mark=1)
    assert port.read(MISTA) == TDU


def test_transmission_off_ignores_the_demand_and_on_starts_over(port: Port) -> None:
    port.talk()
    port.send(0, frame(OTHER, mark=1))
    port.write(MCMDR, port.read(MCMDR) & ~TXON)
    assert port.read(MGSTA) == MGSTA_TXHA
    port.write(MGSTA, MGSTA_TXHA)
    assert port.read(MGSTA) == 0
    port.give(0, frame(OTHER, mark=2))
    port.write(TSDR, 0)
    assert port.machine.read(port.tx_desc(0)) & OWNER
    port.write(MCMDR, port.read(MCMDR) | TXON)  # takes the first descriptor at once
    assert [port.sent() for _ in range(2)] == [frame(OTHER, mark=1), frame(OTHER, mark=2)]


def test_own_check_sequence_is_checked_by_the_wire(port: Port) -> None:
    good = frame(OTHER, mark=1)
    port.talk()
    assert port.send(0, good + b"nope", 0)[2] & TXDS_TXCP
    port.send(1, good + check_sequence(good), 0)
    assert port.sent() == good


def test_long_chain_goes_out_in_bursts(port: Port) -> None:
    port.talk()
    for n in range(100):
        port.give(n, frame(OTHER, mark=n))
    port.write(TSDR, 0)
    assert not port.machine.read(port.tx_desc(63)) & OWNER
    assert port.machine.read(port.tx_desc(64)) & OWNER
    assert [port.sent() for _ in range(64)] == [frame(OTHER, mark=n) for n in range(64)]
    port.machine.step(1_000_000)
    assert [port.sent() for _ in range(36)] == [frame(OTHER, mark=n) for n in range(64, 100)]
    assert port.read(MISTA) & TDU


@pytest.mark.parametrize("cause", ["cable", "pins", "isolated", "power-down", "speed"])
def test_no_link_no_frames(port: Port, cause: str) -> None:
    port.listen()
    port.talk()
    if cause == "cable":
        port.cable(False)
    elif cause == "pins":
        port.route(low=0x01111111)
    elif cause == "speed":
        port.write(MCMDR, port.read(MCMDR) & ~OPMOD)
    else:
        port.phy_write(BMCR, {"isolated": 0x3500, "power-down": 0x3900}[cause])
    assert port.send(0, frame(OTHER, mark=1))[2] & TXDS_TXCP
    port.arrives(frame(BROADCAST, mark=1))
    port.taken()
    assert port.read(MISTA) & ~TDU == (CRCE if cause == "speed" else 0)
    assert port.read(MPCNT) == (0x8000 if cause == "speed" else 0x7FFF)
    port.cable(True)
    port.route()
    port.phy_write(BMCR, 0x3100)
    port.write(MCMDR, port.read(MCMDR) | OPMOD)
    port.arrives(frame(BROADCAST, mark=2))
    assert port.heard(0)[1] == frame(BROADCAST, mark=2)
    port.send(1, frame(OTHER, mark=3))
    assert port.sent() == frame(OTHER, mark=3)


# ---- receive


def test_frame_is_received_at_an_unaligned_address(port: Port) -> None:
    port.write(MIEN, RXINTR | RXGD)
    port.listen()
    data = frame(BROADCAST, 61, kind=0x86DD)
    port.machine.write_memory(port.rx_buffer(0) - 2, b"\xaa" * 80)
    port.arrives(data)
    word, got = port.heard(0)
    assert (word, got) == (RXDS_RXGD | RXDS_RXINTR | 61, data)
    assert port.machine.read_memory(port.rx_buffer(0) - 2, 2) == b"\xaa\xaa"
    assert port.machine.read_memory(port.rx_buffer(0) + 61, 4) == b"\xaa" * 4  # stripped
    assert port.words(port.rx_desc(0))[1:] == (port.rx_buffer(0), 0, port.rx_desc(1))
    assert (port.read(CRXDSA), port.read(CRXBSA)) == (port.rx_desc(1), port.rx_buffer(0))
    assert port.read(DMARFS) == 0x86DD
    assert port.read(MISTA) == RXGD | DEN | RXINTR
    assert port.irq("rx")


def test_check_sequence_is_kept_and_counted(port: Port) -> None:
    port.listen(flags=0)
    data = frame(BROADCAST, 100)
    port.arrives(data)
    assert port.heard(0) == (RXDS_RXGD | 104, data + check_sequence(data))


def test_ring_goes_round(port: Port) -> None:
    port.listen(count=2)
    for mark in range(6):
        port.arrives(frame(BROADCAST, mark=mark))
        assert port.heard(mark % 2)[1] == frame(BROADCAST, mark=mark)
        port.machine.write(port.rx_desc(mark % 2), OWNER)
    assert not port.read(MISTA) & RDU


HEARD = {
    "nobody": (0, 0, set()),
    "unicast": (AUP, 0, {STATION, OTHER}),
    "multicast": (AMP, 0, {GROUP}),
    "broadcast": (ABP, 0, {BROADCAST}),
    "station": (ECMP, 1, {STATION}),
    "station and broadcast": (ECMP | ABP, 1, {STATION, BROADCAST}),
    "not compared": (ABP, 1, {BROADCAST}),
    "entry off": (ECMP, 2, set()),
    "complement": (ECMP | CCAM, 1, {OTHER, GROUP, BROADCAST}),
    "complement not compared": (CCAM, 1, set()),
}


@pytest.mark.parametrize("mode", HEARD)
def test_address_recognition(port: Port, mode: str) -> None:
    camcmr, camen, wanted = HEARD[mode]
    port.write(CAM0M, int.from_bytes(STATION[:4], "big"))
    port.write(CAM0L, int.from_bytes(STATION[4:], "big") << 16)
    port.write(CAMEN, camen)
    port.listen(count=8, camcmr=camcmr)
    for to in (STATION, OTHER, GROUP, BROADCAST):
        port.arrives(frame(to))
    port.taken()
    got = {port.heard(n)[1][:6] for n in range(len(wanted))}
    assert got == wanted
    assert port.machine.read(port.rx_desc(len(wanted))) == OWNER


def test_thirteen_entries_hold_addresses_and_three_a_pause_frame(port: Port) -> None:
    addresses = [bytes((2, 0, 0, 0, n, 16 - n)) for n in range(16)]
    for n, address in enumerate(addresses):
        port.write(CAM0M + 8 * n, int.from_bytes(address[:4], "big"))
        port.write(CAM0L + 8 * n, int.from_bytes(address[4:], "big") << 16 | 0xFFFF)
        assert port.read(CAM0L + 8 * n) & 0xFFFF == 0
    port.write(CAMEN, 0xFFFF)
    port.listen(count=16, camcmr=ECMP | ABP)
    for address in [*reversed(addresses), BROADCAST]:
        port.arrives(frame(address))
    got = [port.heard(n)[1][:6] for n in range(14)]
    assert got == [*reversed(addresses[:13]), BROADCAST]


@pytest.mark.parametrize(
    ("size", "flags", "limit", "word", "status"),
    [
        (1514, 0, 0x800, RXDS_RXGD | 1514, RXGD),
        (1515, 0, 0x800, None, PTLE),
        (1515, ALP, 0x800, RXDS_RXGD | RXDS_PTLE | 1515, RXGD),
        (1532, ALP, 1536, RXDS_RXGD | RXDS_PTLE | 1532, RXGD),
        (1533, ALP, 1536, None, DFO),
        (60, 0, 0x800, RXDS_RXGD | 60, RXGD),
        (59, 0, 0x800, None, RP),
        (59, ARP, 0x800, RXDS_RXGD | RXDS_RP | 59, RXGD),
        (14, ARP, 0x800, RXDS_RXGD | RXDS_RP | 14, RXGD),
        (13, ARP, 0x800, None, RP),
    ],
)
def test_length_limits(port: Port, size: int, flags: int, limit: int, word: int | None, status: int) -> None:
    port.write(DMARFC, limit)
    port.listen(flags=SPCRC | flags)
    data = frame(BROADCAST, size)
    port.arrives(data)
    until(lambda: port.read(MISTA) & ~DEN)
    assert port.read(MISTA) & ~DEN == status
    if word is None:
        assert port.machine.read(port.rx_desc(0)) == OWNER
    else:
        assert port.heard(0) == (word, data)


def test_control_frames(port: Port) -> None:
    pause = PAUSE + OTHER + bytes.fromhex("880800010123") + bytes(42)
    port.listen()
    port.arrives(pause)
    until(lambda: port.read(MISTA) & CFR)
    assert (port.read(MGSTA), port.read(MRPC)) == (MGSTA_CFR, 0x0123)
    port.write(MISTA, CFR)
    port.write(MCMDR, port.read(MCMDR) & ~FDUP | ACP)
    port.arrives(pause)
    assert port.heard(0)[1] == pause  # the one before was not for memory
    assert not port.read(MISTA) & CFR  # half duplex knows no pause


def test_pause_frame_is_sent_from_the_cam(port: Port) -> None:
    for n, value in enumerate((0x0180C200, 0x00010000, 0x020000AA, 0xBB010000, 0x88080001, 0x0FF00000)):
        port.write(CAM13M + 4 * n, value)
    port.write(CAMEN, 0x6000)
    port.write(MCMDR, OPMOD | FDUP | SDPZ)
    assert "CAM entries 13 to 15 are not enabled" in port.machine.complaints
    port.write(CAMEN, 0xE000)
    port.write(MCMDR, OPMOD | FDUP | SDPZ)
    assert port.read(MCMDR) == OPMOD | FDUP
    assert port.sent() == PAUSE + STATION + bytes.fromhex("880800010ff0") + bytes(42)


def test_out_of_descriptors_frames_wait_for_the_demand(port: Port) -> None:
    port.listen(count=1)
    for mark in range(3):
        port.arrives(frame(BROADCAST, mark=mark))
    assert port.heard(0)[1] == frame(BROADCAST, mark=0)
    until(lambda: port.read(MISTA) & RDU)
    port.write(MISTA, RDU)
    port.machine.write(port.rx_desc(0), OWNER)
    port.write(MCMDR, port.read(MCMDR))  # no demand
    assert port.machine.read(port.rx_desc(0)) == OWNER
    port.write(RSDR, 0)
    assert port.heard(0)[1] == frame(BROADCAST, mark=1)
    until(lambda: port.read(MISTA) & RDU)
    port.machine.write(port.rx_desc(0), OWNER)
    port.write(RSDR, 0)
    assert port.heard(0)[1] == frame(BROADCAST, mark=2)
    assert port.read(MPCNT) == 0x7FFF


def test_reception_off_counts_what_it_misses(port: Port) -> None:
    port.listen(count=1)
    port.arrives(frame(BROADCAST, mark=0))
    port.heard(0)
    port.arrives(frame(BROADCAST, mark=1))
    until(lambda: port.read(MISTA) & RDU)
    assert port.read(MPCNT) == 0x7FFF
    assert port.read(MPCNT) == 0  # reading clears
    port.write(MCMDR, port.read(MCMDR) & ~RXON)  # the one that waits is lost, too
    assert port.read(MGSTA) == MGSTA_RXHA
    port.write(MPCNT, 0xFFFE)
    port.arrives(frame(BROADCAST, mark=2))
    port.arrives(frame(BROADCAST, mark=3))
    until(lambda: port.read(MISTA) & MMP)
    assert port.read(MPCNT) == 0
    port.listen()
    port.arrives(frame(BROADCAST, mark=4))
    assert port.heard(0)[1] == frame(BROADCAST, mark=4)


@pytest.mark.parametrize("where", ["mac", "phy"])
def test_loop_back(port: Port, where: str) -> None:
    port.listen(camcmr=ABP, flags=SPCRC | (LBK if where == "mac" else 0))
    port.talk()
    if where == "mac":
        port.route(low=0)  # inside the MAC, no pin matters
    else:
        port.phy_write(BMCR, 0x6100)
    port.arrives(frame(BROADCAST, mark=9))  # the wire is not heard
    port.send(0, frame(OTHER, mark=1))  # nor an address that is not ours
    port.send(1, frame(BROADCAST, mark=2))
    assert port.heard(0) == (RXDS_RXGD | 60, frame(BROADCAST, mark=2))
    port.route()
    port.phy_write(BMCR, 0x3100)
    port.write(MCMDR, port.read(MCMDR) & ~LBK)
    port.send(2, frame(BROADCAST, mark=3))
    assert port.sent() == frame(BROADCAST, mark=3)


# ---- what a wrong driver does

NOT_MEMORY = [RAM_SIZE, 0xFFFFFFF0, 0xB0012000 + TSDR, 0xB0022000 + CAM0M]


@pytest.mark.parametrize("address", NOT_MEMORY)
@pytest.mark.parametrize("what", ["descriptor", "buffer"])
def test_receive_bus_error(port: Port, what: str, address: int) -> None:
    port.write(MIEN, RXINTR | RXBERR)
    port.listen()
    if what == "buffer":
        port.machine.write(port.rx_desc(0) + 4, address)
    else:
        port.write(MCMDR, port.read(MCMDR) & ~RXON)
        port.write(RXDLSA, address)
        port.write(MCMDR, port.read(MCMDR) | RXON)
    port.arrives(frame(BROADCAST))
    until(lambda: port.read(MISTA) & RXBERR)
    assert port.irq("rx")
    assert port.machine.read(port.rx_desc(0)) == OWNER
    assert "bus error in receive" in port.machine.complaints
    port.read(MPCNT)
    port.write(RSDR, 0)  # no way out
    port.arrives(frame(BROADCAST))
    until(lambda: port.read(MISTA) & RXOV)
    assert port.read(MPCNT) == 1
    port.write(MCMDR, SWR)
    port.listen()
    port.arrives(frame(BROADCAST, mark=5))
    assert port.heard(0)[1] == frame(BROADCAST, mark=5)


@pytest.mark.parametrize("address", NOT_MEMORY)
@pytest.mark.parametrize("what", ["descriptor", "buffer"])
def test_transmit_bus_error(port: Port, what: str, address: int) -> None:
    port.write(MIEN, TXINTR | TXBERR)
    port.talk()
    port.give(0, frame(OTHER))
    if what == "buffer":
        port.machine.write(port.tx_desc(0) + 4, address)
    else:
        port.write(MCMDR, port.read(MCMDR) & ~TXON)
        port.write(TXDLSA, address)
        port.write(MCMDR, port.read(MCMDR) | TXON)
    port.write(TSDR, 0)
    assert port.read(MISTA) & TXBERR
    assert port.irq("tx")
    assert port.machine.read(port.tx_desc(0)) & OWNER
    port.machine.write(port.tx_desc(0) + 4, port.tx_buffer(0))
    port.write(MISTA, TXBERR)
    port.write(TSDR, 0)  # no way out
    assert port.machine.read(port.tx_desc(0)) & OWNER
    port.write(MCMDR, SWR)
    port.talk()
    port.send(0, frame(OTHER, mark=5))
    assert port.sent() == frame(OTHER, mark=5)


def test_descriptors_that_make_no_sense(port: Port) -> None:
    port.talk()
    here, buffer = port.tx_desc(0), port.tx_buffer(0)
    port.descriptor(here, OWNER | CRCAPP, buffer, 60, here)  # points to itself
    port.machine.write_memory(buffer, frame(OTHER, mark=1))
    port.write(TSDR, 0)
    assert port.sent() == frame(OTHER, mark=1)
    assert port.read(CTXDSA) == here
    for length in (0, 13):
        port.descriptor(here, OWNER | CRCAPP, buffer, length, here)
        port.write(TSDR, 0)
        assert f"frame of {length} bytes to send" in port.machine.complaints
    port.descriptor(here, OWNER, buffer, 3, here)  # shorter than its check sequence
    port.write(TSDR, 0)
    port.descriptor(here, OWNER | CRCAPP, RAM_SIZE - 0xFFFE, 0xFFFF, here)  # one byte beyond memory
    port.write(TSDR, 0)
    assert port.read(MISTA) & TXBERR
    port.write(MCMDR, SWR)
    port.talk()
    port.descriptor(here, OWNER | CRCAPP, buffer, 0xFFFF, here + 3)  # the low bits do not count
    port.write(TSDR, 0)
    assert len(port.sent()) == 0xFFFF
    assert port.read(CTXDSA) == here


def test_receive_descriptor_to_itself_and_misaligned(port: Port) -> None:
    port.listen(count=1)
    port.write(MCMDR, port.read(MCMDR) & ~RXON)
    port.write(RXDLSA, port.rx_desc(0) + 2)
    port.write(MCMDR, port.read(MCMDR) | RXON)
    assert port.read(CRXDSA) == port.rx_desc(0)
    for mark in range(3):
        port.arrives(frame(BROADCAST, mark=mark))
        assert port.heard(0)[1] == frame(BROADCAST, mark=mark)
        port.descriptor(port.rx_desc(0), OWNER, port.rx_buffer(0), 0, port.rx_desc(0) + 1)
        port.write(RSDR, 0)


# ---- two of them


def test_ports_are_independent(plug: Callable[..., list[Port]]) -> None:
    ports = plug()
    for n, port in enumerate(ports):
        port.write(MIEN, RXINTR | RXGD | TXINTR | TXCP)
        port.listen()
        port.talk()
        port.send(0, frame(OTHER, mark=10 + n))
        port.arrives(frame(BROADCAST, mark=20 + n))
    for n, port in enumerate(ports):
        assert port.sent() == frame(OTHER, mark=10 + n)
        assert port.heard(0)[1] == frame(BROADCAST, mark=20 + n)
        assert port.machine.read(port.rx_desc(1)) == OWNER
    ports[0].cable(False)
    assert [port.phy(BMSR) & LINK for port in ports] == [0, LINK]
    ports[0].write(MISTA, 0xFFFFFFFF)
    assert [port.irq("rx") for port in ports] == [False, True]
    ports[0].write(MCMDR, SWR)
    ports[1].arrives(frame(BROADCAST, mark=30))
    assert ports[1].heard(1)[1] == frame(BROADCAST, mark=30)


def test_saved_and_restored_in_the_middle_of_a_burst(
    plug: Callable[..., list[Port]], reborn: Callable[[Machine], Machine]
) -> None:
    port, other = plug()
    port.write(MIEN, RXINTR | RXGD | TXINTR | TDU)
    port.listen(count=2)
    port.arrives(frame(BROADCAST, mark=1))
    port.heard(0)
    port.talk()
    port.write(MISTA, TDU)
    for n in range(70):
        port.give(n, frame(OTHER, mark=n))
    port.write(TSDR, 0)
    assert [port.sent() for _ in range(64)] == [frame(OTHER, mark=n) for n in range(64)]
    other.listen(count=1)
    other.arrives(frame(BROADCAST, mark=2))
    other.heard(0)
    other.arrives(frame(BROADCAST, mark=3))
    until(lambda: other.read(MISTA) & RDU)
    other.phy_write(BMCR, 0x2100)
    other.cable(False)
    registers = [r for r in range(0, 0xDC, 4) if r not in (TSDR, RSDR, MPCNT)]
    before = [[p.read(r) for r in registers] for p in (port, other)]

    port.machine = other.machine = reborn(port.machine)
    assert [[p.read(r) for r in registers] for p in (port, other)] == before
    assert port.irq("rx") and not port.irq("tx")
    assert port.read(MPCNT) == 0x7FFF
    port.machine.step(1_000_000)
    assert [port.sent() for _ in range(6)] == [frame(OTHER, mark=n) for n in range(64, 70)]
    assert port.irq("tx")
    port.arrives(frame(BROADCAST, mark=4))
    assert port.heard(1)[1] == frame(BROADCAST, mark=4)
    # The other was out of descriptors, its PHY forced, and its cable is this machine's: plugged in.
    assert [other.phy(BMSR) & (LINK | NEGOTIATED) for _ in range(2)] == [0, LINK]
    other.arrives(frame(BROADCAST, mark=5))
    other.taken()
    assert not other.machine.read(other.rx_desc(0)) & OWNER
    other.machine.write(other.rx_desc(0), OWNER)
    other.write(RSDR, 0)
    assert other.heard(0)[1] == frame(BROADCAST, mark=5)
