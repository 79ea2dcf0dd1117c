# SPDX-License-Identifier: GPL-3.0-or-later
"""The two Ethernet ports under Linux, with hosts of the test's own at the far ends of their cables."""

import json
import random
import re
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import libfdt
import pytest

from lab.patience import Deadline
from linux.wire import BROADCAST, GOOSE, IPV4, SECONDS, Wire, cable, vlan_tag
from nuc980.netboot.boot import tree_for
from nuc980.twin.linux import Kernel, Linux
from nuc980.twin.machine import INSTRUCTION_TIME
from peers import mms
from rig.capture import PCAP_HEAD, record_of

HERE = Path(__file__).parent
START_SCRIPT = HERE.parents[1] / "board/nuc980/rootfs-overlay/etc/init.d/S41macs"
MACS = ("02:00:00:aa:bb:01", "02:00:00:aa:bb:02")
BOARD = ("10.1.0.2", "10.2.0.2")
HOST = ("10.1.0.1", "10.2.0.1")
LARGEST = 1472  # bytes of a ping in a frame of 1514
EMAC = (0xB0012000, 0xB0022000)
MCMDR, CTXDSA, CRXDSA = 0x90, 0xCC, 0xD4
TXON = 1 << 8
NO_MEMORY = 0xFFFFFFF0
GOOSE_GROUP = "01:0c:cd:01:00:02"
GOOSE_SECONDS = 120.0  # from the start of rtud; for a hang only
LINKTYPE_ETHERNET = 1

Boot = Callable[..., Linux]


def bytes_of(mac: str) -> bytes:
    return bytes.fromhex(mac.replace(":", ""))


def with_macs(kernel: Kernel, folder: Path, macs: tuple[str, ...]) -> Kernel:
    """The kernel with a device tree that has the addresses, as nuc980-netboot writes them into it."""
    tree = folder / "macs.dtb"
    tree.write_bytes(tree_for(libfdt.Fdt(kernel.dtb.read_bytes()), kernel.arguments, macs))
    return Kernel(kernel.image, tree, kernel.root, kernel.arguments)


def until(condition: Callable[[], object], what: str, seconds: float = SECONDS) -> None:
    """seconds: on an idle host. The guest's clock goes slower where others want the processor too."""
    deadline = Deadline(seconds)
    while not condition():
        assert not deadline.over, f"not within {deadline.waited:.0f} s: {what}"


@pytest.fixture(scope="module")
def kernel(kernel: Kernel, tmp_path_factory: pytest.TempPathFactory) -> Kernel:
    return with_macs(kernel, tmp_path_factory.mktemp("tree"), MACS).without_services()


@pytest.fixture(scope="module")
def wires(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Wire, Wire]]:
    folder = tmp_path_factory.mktemp("wires")
    first, second = (Wire(folder, n, HOST[n], BOARD[n]) for n in (0, 1))
    yield first, second
    first.close()
    second.close()


@pytest.fixture(scope="module")
def board_arguments(wires: tuple[Wire, Wire]) -> tuple[str, ...]:
    return (*INSTRUCTION_TIME, *wires[0].arguments, *wires[1].arguments)


@pytest.fixture(scope="module")
def board_uarts() -> tuple[int, ...]:
    return (0, 1, 2, 3, 4, 6, 8)


def gateway(port: int) -> str:
    """What a relay says by GOOSE is a point, and is published on the same port."""
    control = "RELAYLD0/LLN0$GO$trip"
    relay = {"name": "relay", "control_block": control, "destination": GOOSE_GROUP, "app_id": 2, "ca": 904}
    relay["data"] = [{"name": "relay.trip", "type": "single", "ioa": 1}]
    own = {"name": "own", "control_block": "GW1LD0/LLN0$GO$own", "data_set": "GW1LD0/LLN0$own", "app_id": 1}
    goose = {"publish": [own | {"points": ["relay.trip"]}], "subscribe": [relay]}
    return json.dumps({"port": [], "goose": {"interface": f"eth{port}"} | goose})


@pytest.fixture(scope="module")
def extra_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path | str]:
    program = tmp_path_factory.mktemp("network") / "network"
    subprocess.run(
        ["arm-linux-gnueabi-gcc", "-std=c11", "-D_GNU_SOURCE", "-O2", "-static", "-march=armv5te", "-marm",
         "-Wall", "-Wextra", "-Werror", "-o", program, HERE / "programs" / "network.c"], check=True
    )  # fmt: skip
    return {"/bin/network": program} | {f"/etc/goose{port}.json": gateway(port) for port in (0, 1)}


@pytest.fixture(scope="module")
def ports(linux: Linux, wires: tuple[Wire, Wire]) -> tuple[Wire, Wire]:
    """Both ports up, each with its address and its host's."""
    for n in (0, 1):
        linux.run(
            f"ip link set eth{n} up; ip addr flush dev eth{n}; ip addr add {BOARD[n]}/24 dev eth{n};"
            " echo 1 > /proc/sys/net/ipv4/icmp_ratelimit"
        )
    for wire in wires:
        wire.ask_mac()
    return wires


def counter(linux: Linux, port: int, name: str) -> int:
    return int(linux.run(f"cat /sys/class/net/eth{port}/statistics/{name}"))


def has_carrier(linux: Linux, port: int) -> bool:
    return linux.run(f"cat /sys/class/net/eth{port}/carrier") == "1"


def reachable(wire: Wire) -> None:
    """Until it answers: a port whose link came just now drops what it is to send for up to a second."""
    until(lambda: wire.answers(1.0), f"{wire.board} answers to a ping")


def plug(linux: Linux, wire: Wire, plugged: bool) -> None:
    linux.machine.command("set_link", name=wire.name, up=plugged)


# ---- addresses and names


def test_ports_have_the_trees_addresses_in_the_nodes_order(linux: Linux, ports: tuple[Wire, Wire]) -> None:
    for n, wire in enumerate(ports):
        assert linux.run(f"cat /sys/class/net/eth{n}/address") == MACS[n]
        assert linux.run(f"readlink -f /sys/class/net/eth{n}/device").endswith(f".emac{n}")
        assert wire.ask_mac() == bytes_of(MACS[n])


def test_address_changes_while_it_runs(linux: Linux, ports: tuple[Wire, Wire]) -> None:
    wire = ports[0]
    linux.run("ip link set eth0 address 02:00:00:cc:dd:03")
    assert wire.ask_mac() == bytes_of("02:00:00:cc:dd:03")
    assert wire.answers()
    wire.ping(2, b"to the old address", bytes_of(MACS[0]))
    assert wire.pong(2, 0.5) is None
    linux.run(f"ip link set eth0 address {MACS[0]}")
    assert wire.ask_mac() == bytes_of(MACS[0])
    assert wire.answers()


# ---- traffic


def test_pings_of_all_sizes_from_outside(ports: tuple[Wire, Wire]) -> None:
    """Both ports at once, some on their way at any time."""
    content = random.Random(980).randbytes(LARGEST)
    ahead = 8
    for size in range(LARGEST + ahead + 1):
        for wire in ports:
            if size <= LARGEST:
                wire.ping(size, content[:size])
            if size >= ahead:
                assert wire.pong(size - ahead) == content[: size - ahead], f"{size - ahead} bytes"


@pytest.mark.parametrize("port", [0, 1])
def test_pings_from_inside(linux: Linux, ports: tuple[Wire, Wire], port: int) -> None:
    sizes = "1 17 18 19 63 64 214 215 255 256 257 511 1023 1471 1472"
    output = linux.run(
        f"for size in {sizes}; do ping -c 2 -i 0.1 -W 5 -s $size {HOST[port]} || exit 1; done", seconds=120
    )
    assert output.count("2 packets received") == len(sizes.split())


@pytest.mark.parametrize("port", [0, 1])
def test_vlan_frames_of_full_length(linux: Linux, ports: tuple[Wire, Wire], port: int) -> None:
    linux.run(f"ip link add link eth{port} name v{port} type vlan id 7; ip link set v{port} up")
    linux.run(f"ip addr flush dev eth{port}; ip addr add {BOARD[port]}/24 dev v{port}")
    wire, content = ports[port], random.Random(7).randbytes(LARGEST)
    for number in range(4):
        wire.ping(number, content, tag=vlan_tag(7))
        assert wire.pong(number) == content
    assert "2 packets received" in linux.run(f"ping -c 2 -i 0.1 -W 5 -s {LARGEST} {HOST[port]}")
    linux.run(f"ip link del v{port}; ip addr add {BOARD[port]}/24 dev eth{port}")
    assert wire.answers()


def test_counters_are_those_of_the_wire(linux: Linux, ports: tuple[Wire, Wire]) -> None:
    names = ("rx_packets", "rx_bytes", "tx_packets", "tx_bytes")
    ports[1].ask_mac()
    before = [counter(linux, 1, name) for name in names]
    for number in range(100):
        ports[1].ping(number, bytes(958))
        assert ports[1].pong(number) is not None
    after = [counter(linux, 1, name) for name in names]
    grown = [new - old for new, old in zip(after, before, strict=True)]
    for got, least in zip(grown, (100, 100_000, 100, 100_000), strict=True):
        assert least <= got <= least * 1.05, grown  # beside them an ARP or two
    assert [counter(linux, 1, name) for name in ("rx_errors", "tx_errors", "tx_dropped")] == [0, 0, 0]


# ---- who is heard


def frames_heard(linux: Linux, wire: Wire, port: int, to: bytes) -> int:
    """How many of ten frames to an address the port takes; a ping after them is not counted."""
    before = counter(linux, port, "rx_packets")
    for _ in range(10):
        wire.send(wire.frame(0x88B5, bytes(46), to))  # the type is for experiments
    assert wire.answers()
    return counter(linux, port, "rx_packets") - before - 1


@pytest.fixture
def quiet(linux: Linux, ports: tuple[Wire, Wire]) -> Wire:
    """Port 0, to which nothing goes but what a test sends: the board does not ask for its host again."""
    linux.run("echo 3600 > /proc/sys/net/ipv4/neigh/eth0/delay_first_probe_time")
    assert ports[0].answers()
    return ports[0]


OTHER = bytes_of("02:00:00:12:34:56")
GROUP = bytes_of("01:00:5e:01:00:01")  # of 239.1.0.1
OTHER_GROUP = bytes_of("01:00:5e:7f:ff:fa")
UP, PROMISC, ALLMULTI = 0x1003, 0x100, 0x200


def test_only_its_own_frames_are_heard(linux: Linux, quiet: Wire) -> None:
    assert frames_heard(linux, quiet, 0, bytes_of(MACS[0])) == 10
    assert frames_heard(linux, quiet, 0, BROADCAST) == 10
    assert frames_heard(linux, quiet, 0, OTHER) == 0
    assert frames_heard(linux, quiet, 0, OTHER_GROUP) == 0
    assert frames_heard(linux, quiet, 0, bytes_of("01:00:5e:00:00:01")) == 10  # all hosts


@pytest.mark.parametrize(("flag", "others"), [(PROMISC, 10), (ALLMULTI, 0)])
def test_promiscuous_and_all_groups(linux: Linux, quiet: Wire, flag: int, others: int) -> None:
    linux.run(f"echo {UP | flag:#x} > /sys/class/net/eth0/flags")
    assert frames_heard(linux, quiet, 0, OTHER) == others
    assert frames_heard(linux, quiet, 0, OTHER_GROUP) == 10
    linux.run(f"echo {UP:#x} > /sys/class/net/eth0/flags")
    assert frames_heard(linux, quiet, 0, OTHER) == 0
    assert frames_heard(linux, quiet, 0, OTHER_GROUP) == 0


@pytest.mark.parametrize(("count", "others"), [(3, 0), (16, 10)], ids=["some groups", "too many"])
def test_joined_groups_are_heard(linux: Linux, quiet: Wire, count: int, others: int) -> None:
    """As many as the MAC compares with; of more than those, all groups."""
    linux.run(f"network join eth0 {count} > /tmp/joined & echo $! > /tmp/join")
    until(lambda: linux.run("cat /tmp/joined") == "joined", "the groups are joined")
    assert frames_heard(linux, quiet, 0, GROUP) == 10
    assert frames_heard(linux, quiet, 0, OTHER_GROUP) == others
    assert frames_heard(linux, quiet, 0, OTHER) == 0
    linux.run("kill $(cat /tmp/join)")
    until(lambda: "239.1.0.1" not in linux.run("cat /proc/net/igmp"), "the groups are left")
    assert frames_heard(linux, quiet, 0, GROUP) == 0


# ---- the link


def test_settings(linux: Linux, ports: tuple[Wire, Wire]) -> None:
    assert linux.run("network settings eth1") == "100 full auto nuc980-emac"
    assert linux.run("cat /sys/class/net/eth1/speed") == "100"


def test_cable_out_and_in(linux: Linux, ports: tuple[Wire, Wire]) -> None:
    wire, other = ports
    plug(linux, wire, False)
    until(lambda: not has_carrier(linux, 0), "the port sees that its cable is out")
    assert other.answers()
    assert linux.try_to(f"ping -c 3 -i 0.1 -W 1 {HOST[0]}")[0] == 1
    plug(linux, wire, True)
    until(lambda: has_carrier(linux, 0), "the port sees its cable")
    reachable(wire)
    assert "Link is Down" in linux.run("dmesg | grep eth0")


@pytest.mark.parametrize("duplex", ["half", "full"])
def test_ten_megabit(linux: Linux, ports: tuple[Wire, Wire], duplex: str) -> None:
    """The twin hears and sends nothing when the MAC's speed is not the PHY's."""
    linux.run(f"network force eth0 10 {duplex}")
    until(
        lambda: (
            linux.run("network settings eth0") == f"10 {duplex} forced nuc980-emac" and has_carrier(linux, 0)
        ),
        "the link at 10 Mbit/s",
    )
    reachable(ports[0])
    linux.run("network negotiate eth0")
    # A PHY loses its link while it negotiates; the twin's does so in no time, and unseen.
    plug(linux, ports[0], False)
    until(lambda: not has_carrier(linux, 0), "the loss of the link")
    plug(linux, ports[0], True)
    until(
        lambda: linux.run("network settings eth0") == "100 full auto nuc980-emac" and has_carrier(linux, 0),
        "the link at 100 Mbit/s",
    )
    reachable(ports[0])


def test_down_and_up_again_under_traffic(linux: Linux, ports: tuple[Wire, Wire]) -> None:
    wire = ports[0]
    flood = Flood(wire)
    linux.run("for n in $(seq 20); do ip link set eth0 down; ip link set eth0 up; done", seconds=120)
    flood.end()
    until(lambda: has_carrier(linux, 0), "the link")
    wire.ask_mac()
    reachable(wire)


# ---- what should not come


class Flood:
    """Datagrams from a thread, until its end: bursts as fast as they are taken, and a pause after each."""

    def __init__(self, wire: Wire, size: int = 18, pause: float = 0.0) -> None:
        self.frames = 0
        self._pause = pause
        self._wire, self._frame = wire, wire.udp(bytes(size))
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._send, daemon=True)
        self._thread.start()

    def _send(self) -> None:
        while not self._over.wait(self._pause):
            for _ in range(50):
                self._wire.send(self._frame)
                self.frames += 1

    def end(self) -> int:
        """How many frames it was."""
        self._over.set()
        self._thread.join(SECONDS)
        assert not self._thread.is_alive(), "the port takes nothing"
        self._wire.taken()
        return self.frames


def test_malformed_frames_do_no_harm(linux: Linux, ports: tuple[Wire, Wire]) -> None:
    chance = random.Random(980)
    for n, wire in enumerate(ports):
        to = bytes_of(MACS[n])
        for size in (1, 13, 14, 15, 59, 60, 1515, 1518, 1519, 1532, 1533, 1536, 1537, 2048, 9000, 65535):
            for address in (to, BROADCAST):
                wire.send((address + wire.mac + b"\x08\x00" + bytes(65536))[:size])
        for _ in range(2000):
            wire.send(to + chance.randbytes(chance.randrange(1600)))
        for _ in range(2000):  # the kinds that the kernel looks into
            kind = chance.choice([IPV4, 0x0806, 0x86DD, 0x8100, 0x88A8, 0x8808, chance.randrange(1536)])
            wire.send(to + wire.mac + kind.to_bytes(2, "big") + chance.randbytes(chance.randrange(1600)))
        wire.taken()
        assert wire.answers()
    linux.run("ip link set eth0 down; ip link set eth0 up")  # what a random IPv6 frame may have set
    reachable(ports[0])


@pytest.mark.parametrize("size", [18, 1400])
def test_flood_leaves_the_board_alive(linux: Linux, ports: tuple[Wire, Wire], size: int) -> None:
    flood = Flood(ports[0], size)
    for _ in range(5):
        assert ports[1].answers(), "the other port"
        linux.run("cat /proc/loadavg")
    assert flood.end() > 1000
    assert ports[0].answers()


LINES = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}
BAUD = 4800  # a receiver's 16 characters are 33 ms; at 19200 bytes were lost when the host had other work


def test_flood_takes_no_byte_from_a_line(linux: Linux, ports: tuple[Wire, Wire]) -> None:
    """Six lines get and give back a text while both ports are flooded."""
    uarts = {number: linux.machine.uarts[number] for number in LINES.values()}
    text = {number: random.Random(number).randbytes(1500) for number in uarts}
    for descriptor, number in enumerate(uarts, start=4):  # opened by the shell itself: before the bytes come
        linux.run(
            f"exec {descriptor}<>/dev/ttyS{number}; stty raw -echo {BAUD} <&{descriptor};"
            f" cat <&{descriptor} >&{descriptor} & echo $! >> /tmp/cats"
        )
    # Pauses for the host's sake: the same thread of QEMU serves ports and lines.
    floods = [Flood(wire, pause=0.01) for wire in ports]
    back = dict.fromkeys(uarts, b"")
    for number, line in uarts.items():
        line.send(text[number])
    deadline = time.monotonic() + 120
    while any(len(back[number]) < len(text[number]) for number in uarts) and time.monotonic() < deadline:
        for number, line in uarts.items():
            back[number] += line.receive(0.01)
    frames = [flood.end() for flood in floods]
    linux.run("kill $(cat /tmp/cats); exec 4>&- 5>&- 6>&- 7>&- 8>&- 9>&-")
    assert back == text
    assert min(frames) > 1000
    for line in linux.run("cat /proc/tty/driver/*").splitlines():
        assert not re.search(r"\b(oe|fe|pe|brk):", line), line


# ---- what a chip should not do


def after_recovery(linux: Linux, wire: Wire, port: int, meanwhile: Callable[[], None] = lambda: None) -> None:
    def restarted() -> bool:
        meanwhile()
        return "the MAC starts anew" in linux.run(f"dmesg -c | grep eth{port} || true")

    until(restarted, "the MAC starts anew")
    reachable(wire)
    assert has_carrier(linux, port)


@pytest.mark.parametrize("port", [0, 1])
def test_receive_bus_error_is_recovered_from(linux: Linux, ports: tuple[Wire, Wire], port: int) -> None:
    """The buffer of the next descriptor is where no memory is."""
    machine, wire = linux.machine, ports[port]
    linux.run("dmesg -c")
    machine.write(machine.read(EMAC[port] + CRXDSA) + 4, NO_MEMORY)
    wire.ping(0, b"lost")
    after_recovery(linux, wire, port)
    assert "bus error in receive" in machine.complaints


@pytest.mark.parametrize("port", [0, 1])
def test_transmit_bus_error_is_recovered_from(linux: Linux, ports: tuple[Wire, Wire], port: int) -> None:
    """The descriptor after the next is where no memory is."""
    machine, wire = linux.machine, ports[port]
    linux.run("dmesg -c")
    machine.write(machine.read(EMAC[port] + CTXDSA) + 12, NO_MEMORY)
    wire.ping(0, b"lost")
    after_recovery(linux, wire, port)
    assert "bus error in transmit" in machine.complaints


def test_stuck_transmitter_is_recovered_from(linux: Linux, ports: tuple[Wire, Wire]) -> None:
    machine, wire = linux.machine, ports[1]
    linux.run("dmesg -c")
    machine.write(EMAC[1] + MCMDR, machine.read(EMAC[1] + MCMDR) & ~TXON)

    def fill_the_ring() -> None:
        """With more answers than it holds, and again: a busy host may lose some of the pings."""
        for number in range(100):
            wire.ping(number, bytes(1400))

    after_recovery(linux, wire, 1, fill_the_ring)
    expected = [trouble for trouble in linux.troubles if "net/sched/sch_generic.c" in trouble]
    assert len(expected) <= 1  # the kernel's own word on it, once
    for trouble in expected:
        linux.troubles.remove(trouble)


def of_the_relay(state: int, on: bool) -> bytes:
    """A GOOSE message, from its APPID on. It holds for as long as the test may take on a busy host."""
    words = ((0x80, b"RELAYLD0/LLN0$GO$trip"), (0x81, b"\x0a\x00\x00"), (0x82, b"RELAYLD0/LLN0$trip"))
    numbers = ((0x85, state), (0x86, 0), (0x87, 0), (0x88, 1), (0x89, 0), (0x8A, 1))
    fields = [mms.element(tag, text) for tag, text in words] + [mms.element(0x84, bytes(8))]
    fields += [mms.element(tag, bytes([number])) for tag, number in numbers]
    pdu = mms.element(0x61, *fields, mms.element(0xAB, mms.element(0x83, b"\xff" if on else b"\0")))
    return struct.pack("!HHI", 2, 8 + len(pdu), 0) + pdu


def dissected(frames: list[bytes], pcap: Path, *fields: str) -> list[list[str]]:
    """As tshark reads them."""
    head = PCAP_HEAD[:20] + struct.pack("<I", LINKTYPE_ETHERNET)
    pcap.write_bytes(head + b"".join(record_of(frame, second) for second, frame in enumerate(frames)))
    wanted = [word for field in fields for word in ("-e", field)]
    command = ["tshark", "-r", pcap, "-T", "fields", *wanted]
    rows = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return [row.split("\t") for row in rows.splitlines()]


@pytest.mark.parametrize("port", [0, 1])
def test_goose_on_either_port(linux: Linux, ports: tuple[Wire, Wire], port: int, tmp_path: Path) -> None:
    """The image's rtu-goose hears a relay, and publishes what it said: tshark reads each frame."""
    wire, other = ports[port], ports[1 - port]
    for each in ports:
        each.goose.clear()
    linux.run(
        f"rtud --map /tmp/goose{port} /etc/goose{port}.json > /tmp/goose{port}.log 2>&1 & echo $! > /tmp/pid"
    )
    try:
        assert wire.hears_goose(b"", 0, GOOSE_SECONDS)
        for state, on in ((1, True), (2, False)):
            heard = len(wire.goose)
            wire.send(wire.frame(GOOSE, of_the_relay(state, on), bytes_of(GOOSE_GROUP)))
            value = mms.element(0x83, b"\xff" if on else b"\0")
            assert wire.hears_goose(value, heard, GOOSE_SECONDS), on
    finally:
        linux.run("kill $(cat /tmp/pid); while kill -0 $(cat /tmp/pid); do sleep 0.1; done")
    rows = dissected(
        wire.goose,
        tmp_path / "goose.pcap",
        "goose.gocbRef",
        "goose.stNum",
        "_ws.malformed",
        "_ws.expert.message",
    )
    assert {(name, *wrong) for name, _, *wrong in rows} == {("GW1LD0/LLN0$GO$own", "", "")}
    states = [int(state) for _, state, *_ in rows]
    assert states == sorted(states)
    assert states[-1] >= states[0] + 2
    assert other.goose == []


def test_chip_was_used_as_it_should(linux: Linux, ports: tuple[Wire, Wire]) -> None:
    """The twin has nothing else to say of what the driver did to the MACs."""
    complaints = [line for line in linux.machine.complaints.splitlines() if line.startswith("nuc980-emac")]
    unexpected = [line for line in complaints if "bus error" not in line and "PHY register" not in line]
    assert not unexpected


# ---- other boards


def test_port_without_a_phy_keeps_its_name(boot: Boot, kernel: Kernel, tmp_path: Path) -> None:
    """A device tree that does not route emac0's pins: the other port is eth1 as ever."""
    tree = libfdt.Fdt(kernel.dtb.read_bytes())
    tree.delprop(tree.path_offset(tree.get_alias("ethernet0")), "pinctrl-0")
    (tmp_path / "no-pins.dtb").write_bytes(tree.as_bytearray())
    wire = Wire(tmp_path, 1, HOST[1], BOARD[1])
    other = Kernel(kernel.image, tmp_path / "no-pins.dtb", kernel.root, kernel.arguments)
    linux = boot("-nic", "user", *wire.arguments, kernel=other)
    linux.run(f"ip link set eth1 up; ip addr flush dev eth1; ip addr add {BOARD[1]}/24 dev eth1")
    assert wire.ask_mac() == bytes_of(MACS[1])
    assert linux.try_to("ip link set eth0 up")[0]
    assert "eth0: no PHY answers on the MDIO bus" in linux.run("dmesg")
    wire.close()


def test_two_boards_on_one_network(boot: Boot, kernel: Kernel, tmp_path: Path) -> None:
    """One with a tree's addresses; one without, which makes up its own and says so."""
    tree = libfdt.Fdt(kernel.dtb.read_bytes())
    for alias in ("ethernet0", "ethernet1"):
        tree.delprop(tree.path_offset(tree.get_alias(alias)), "local-mac-address")
    (tmp_path / "bare.dtb").write_bytes(tree.as_bytearray())
    bare = Kernel(kernel.image, tmp_path / "bare.dtb", kernel.root, kernel.arguments)

    ends = [f"{tmp_path}/a", f"{tmp_path}/b"]
    boards = []
    for address, (local, remote), booted in zip((1, 2), (ends, ends[::-1]), (kernel, bare), strict=True):
        boards.append(boot(*cable(0, local, remote), kernel=booted, files={"/bin/macs": START_SCRIPT}))
        boards[-1].run(
            f"ip link set eth0 up; ip addr flush dev eth0; ip addr add 10.9.0.{address}/24 dev eth0"
        )
    first, second = boards
    until(lambda: has_carrier(first, 0) and has_carrier(second, 0), "both links")
    assert "3 packets received" in first.run("ping -c 3 -i 0.2 -W 5 10.9.0.2")
    assert "3 packets received" in second.run("ping -c 3 -i 0.2 -W 5 -s 1472 10.9.0.1")

    made_up = [second.run(f"cat /sys/class/net/eth{n}/address") for n in (0, 1)]
    assert len({*made_up, *MACS}) == 4
    assert all(int(mac[:2], 16) & 3 == 2 for mac in made_up), "of one board, locally administered"
    assert second.run("dmesg | grep -c 'no local-mac-address in the device tree'") == "2"
    assert first.try_to("dmesg | grep 'no local-mac-address'")[0] == 1

    assert first.run("macs start 2>&1") == ""
    warned = second.run("macs start 2>&1").splitlines()
    assert [f"eth{n} has made up its address {made_up[n]}" in warned[n] for n in (0, 1)] == [True, True]
    first.run("ip link set eth1 address 08:00:27:00:01:93")
    assert "eth1 has 08:00:27:00:01:93, as all boards with the vendor's kernel" in first.run(
        "macs start 2>&1"
    )
