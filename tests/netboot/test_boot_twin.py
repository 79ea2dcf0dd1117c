# SPDX-License-Identifier: GPL-3.0-or-later
"""`nuc980-netboot boot` on the emulated board, with our U-Boot: what comes up, and what does not."""

import re
import socket
import subprocess
import time
from ast import literal_eval
from collections.abc import Callable
from functools import partial
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path

import pytest

from netboot.emulated import Emulated
from nuc980.netboot.boot import Addresses, StartKernel, plan_network
from nuc980.netboot.console import Console
from nuc980.netboot.errors import BootmFailed
from nuc980.netboot.linux import Goal
from nuc980.netboot.probe import probe
from nuc980.netboot.progress import Progress
from nuc980.netboot.session import Network, Session
from nuc980.netboot.steps import Load, Slice
from nuc980.netboot.transport import Line

pytestmark = pytest.mark.slow

MACS = ("02:00:00:00:00:0a", "02:00:00:00:00:0b")
Boot = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def site(tmp_path: Path) -> Path:
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "macs").write_text("".join(f"eth{port} {mac}\n" for port, mac in enumerate(MACS)))
    return folder


@pytest.fixture
def boot(twin: Emulated, booted: Callable[[Emulated], Boot]) -> Boot:
    """Boots the payload; port: the Ethernet port that is used."""
    return booted(twin)


@pytest.fixture
def hasty_boot(hasty_twin: Emulated, booted: Callable[[Emulated], Boot]) -> Boot:
    """The same with a U-Boot whose last words are cut off."""
    return booted(hasty_twin)


@pytest.fixture
def booted(payload: Path, dtb: Path, site: Path, udp_port: int) -> Callable[[Emulated], Boot]:
    """What boots the payload on a board."""

    def of(twin: Emulated) -> Boot:
        return partial(run, twin)

    def run(
        twin: Emulated,
        *arguments: str | Path,
        port: int = 0,
        kernel: Path | None = None,
    ) -> subprocess.CompletedProcess[str]:
        network = ["--board-ip", f"10.0.{port}.15/24", "--server-ip", f"10.0.{port}.2"]
        nat = ["--listen", "127.0.0.1", "--seen-as", "127.0.0.1", "--tftp-port", str(udp_port)]
        return twin.netboot(
            *("boot", kernel or payload / "uImage", dtb, "--power-cycle", twin.power_cycle),
            *(*network, *nat, "--site", site, *arguments),
        )

    return of


def kernel_lines(output: str) -> list[str]:
    """The kernel's lines, without their times."""
    return re.findall(r"^  \| \[ +[\d.]+\] (.*)$", output, re.MULTILINE)


@pytest.mark.parametrize("port", [0, 1])
def test_kernel_comes_up_through_either_port(boot: Boot, port: int) -> None:
    done = boot("--ethact", f"emac{port}", port=port)
    assert done.returncode == 0, done.stdout
    lines = kernel_lines(done.stdout)
    assert lines[0] == "Booting Linux on physical CPU 0x0"
    assert "OF: fdt: Machine model: BLIIoT gateway (OpenRTU)" in lines
    assert f"Kernel command line: ethaddr0={MACS[0]} ethaddr1={MACS[1]}" in lines
    assert [f"eth{number}: {mac}" for number, mac in enumerate(MACS)] == [
        line for line in lines if "eth" in line
    ][1:]
    for phase in ("reach U-Boot", "probe", "set-up", "load kernel", "load device tree", "bootm", "Linux"):
        assert re.search(rf"^ *\d+\.\d\d s  {phase}$", done.stdout, re.MULTILINE), phase


def test_arguments_are_those_given(boot: Boot) -> None:
    done = boot("--bootargs", "console=ttyS0 ethaddr1=02:00:00:00:00:77")
    wanted = f"Kernel command line: console=ttyS0 ethaddr1=02:00:00:00:00:77 ethaddr0={MACS[0]}"
    assert wanted in kernel_lines(done.stdout)


def test_goal_may_be_another_line(boot: Boot) -> None:
    done = boot("--until", "Kernel command line", "--bootargs", "payload=hang")
    assert done.returncode == 0
    assert "login" not in done.stdout.split("until")[-1]


def test_slow_login_is_awaited(boot: Boot) -> None:
    start = time.monotonic()
    assert boot("--bootargs", "payload=slow").returncode == 0
    assert time.monotonic() - start > 4


@pytest.mark.parametrize(
    ("ending", "words"),
    [
        (
            "panic",
            ["The kernel panicked:", "Attempted to kill init!", "show_stack+0x10/0x14", "end Kernel panic"],
        ),
        ("noroot", ["found no root file system:", "unknown-block(0,0)", "likely cause: root= or ubi.mtd="]),
        ("oops", ["The kernel reported an error:", "NULL pointer dereference", "end trace"]),
        ("reset", ["The board restarted while Linux came up", "eth1:", "watchdog"]),
        ("hang", ["No line with", "within 3 s", "eth1:", "--timeout"]),
        ("mute", ["The kernel printed nothing within 3 s", "console=ttyS0,115200n8"]),
    ],
)
def test_other_endings_say_what_they_are(boot: Boot, ending: str, words: list[str]) -> None:
    done = boot("--timeout", "3", "--bootargs", f"payload={ending}")
    assert done.returncode == 1, done.stdout
    error = done.stdout[done.stdout.index("nuc980-netboot: ") :]
    assert [word for word in words if word not in error] == []


CUT = re.compile(r"^  \| (S[a-z. ]*)\[ +0\.0+\] ", re.MULTILINE)


@pytest.mark.parametrize("ending", ["login", "panic"])
def test_boot_behind_a_cut_line(hasty_boot: Boot, ending: str) -> None:
    """The UART's FIFO is full when the pins go: what it has is lost."""
    done = hasty_boot("--bootargs", f"payload={ending}")
    cut = CUT.search(done.stdout)
    assert cut and "Starting kernel ...".startswith(cut[1]), done.stdout
    assert done.returncode == (ending == "panic"), done.stdout
    assert ("The kernel panicked:" in done.stdout) == (ending == "panic")


def test_line_cut_at_each_character(boot: Boot, tmp_path: Path) -> None:
    """As the emulated board sends it while its pins come and go."""
    log = tmp_path / "log"
    assert boot("--bootargs", "payload=cuts", "--until", "<end of cuts>", "--log", log).returncode == 0
    heard = b"".join(
        literal_eval(f"b{text}") for text in re.findall(r"^ *[\d.]+ < (.*)$", log.read_text(), re.MULTILINE)
    )
    kernel = b"[    0.000000] Booting Linux on physical CPU 0x0\r\n"
    _, *starts = heard.split(b"<end of cuts>")[0].split(b"<cut>")
    words = b"\n\rStarting kernel ...\n\r\n\r"
    assert starts == [words[:kept] + kernel for kept in range(len(words) + 1)]


def test_wrong_kernel_is_refused_before_anything_is_typed(boot: Boot, payload: Path, tmp_path: Path) -> None:
    harmed = bytearray((payload / "uImage").read_bytes())
    harmed[-1] ^= 1
    (tmp_path / "harmed").write_bytes(harmed)
    done = boot("--log", tmp_path / "log", kernel=tmp_path / "harmed")
    assert done.returncode == 2
    assert "does not match its CRC" in done.stdout
    assert not (tmp_path / "log").exists()


def test_kernel_as_large_as_the_room(boot: Boot, payload: Path, wrapped: Callable[..., Path]) -> None:
    room = 10_453_056
    body = (payload / "nuc980.bin").read_bytes().ljust(room - 64 + 1, b"\xa5")
    assert boot(kernel=wrapped(body[:-1])).returncode == 0
    refused = boot(kernel=wrapped(body))
    assert refused.returncode == 2
    assert "1 more than fit before the device tree at 0xa00000" in refused.stdout


def test_what_bootm_says_is_understood(
    twin: Emulated, payload: Path, dtb: Path, udp_port: int, wrapped: Callable[..., Path]
) -> None:
    network = Network(
        IPv4Interface("10.0.0.15/24"),
        IPv4Address("10.0.0.2"),
        udp_port,
        listen=IPv4Address("127.0.0.1"),
        seen_as=IPv4Address("127.0.0.1"),
    )
    addresses = Addresses()
    with Line(twin.port) as line:
        console = Console(line)
        console.reach(lambda: subprocess.run(twin.power_cycle, shell=True, check=True))
        session = Session(console, Progress())
        start = StartKernel(addresses, Goal())
        with pytest.raises(BootmFailed, match="no uImage at the address"):
            start.run(session)

        for step in plan_network(probe(console, session.progress, flash=False), network, MACS):
            step.run(session)
        with session.serving(network):
            Load("uImage", Slice.of(payload / "uImage"), addresses.uimage).run(session)
        with pytest.raises(BootmFailed, match="no device tree at the address"):
            start.run(session)

        console.run(f"mw.b {addresses.uimage + 1000:#x} 0xff 4")
        with pytest.raises(BootmFailed, match="changed since it was checked"):
            start.run(session)


# ---- the network


def test_port_without_link_leaves_the_other(twin: Emulated, boot: Boot) -> None:
    """U-Boot goes on to its other port by itself."""
    twin.monitor("set_link net0 off")
    assert boot(port=1).returncode == 0


def test_no_link_at_all(twin: Emulated, boot: Boot) -> None:
    twin.monitor("set_link net0 off", "set_link net1 off")
    done = boot()
    assert done.returncode == 1
    assert done.stdout.count("Once more.") == 2
    error = done.stdout[done.stdout.index("nuc980-netboot: ") :]
    assert "auto negotiation" in error
    assert "plug the cable into the other port, or choose the port with --ethact" in error


def test_nobody_has_the_servers_address(boot: Boot) -> None:
    done = boot("--server-ip", "10.0.0.77")
    assert done.returncode == 1
    error = done.stdout[done.stdout.index("nuc980-netboot: ") :]
    assert "ARP Retry count exceeded" in error
    assert "No address of this host is in the network of 10.0.0.15" in error


def test_request_from_another_address_is_named(boot: Boot) -> None:
    done = boot("--seen-as", "127.0.0.9")
    assert done.returncode == 1
    assert "The server refused the request: 127.0.0.1, 'uImage': the board is 127.0.0.9" in done.stdout
    assert "--seen-as" in done.stdout


def test_unanswered_requests_do_not_take_minutes(boot: Boot, udp_port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mute:
        mute.bind(("127.0.0.1", udp_port))
        done = boot("--listen", "127.0.0.2")  # the NAT of the emulated network leads to 127.0.0.1
    assert done.returncode == 1
    assert re.findall(r"(?:T )+", done.stdout) == ["T T T T "]  # of 2 s each
    assert "does not know tftpdstp" in done.stdout[done.stdout.index("nuc980-netboot: ") :]


def test_closed_port_is_the_same(boot: Boot) -> None:
    done = boot("--listen", "127.0.0.2")
    assert done.returncode == 1
    assert "TFTP server died" in done.stdout
    assert "does not know tftpdstp" in done.stdout[done.stdout.index("nuc980-netboot: ") :]


# ---- again and again


def boots_in_a_row(boot: Boot, number: int) -> None:
    for at in range(number):
        done = boot("--ethact", f"emac{at % 2}", port=at % 2)
        assert done.returncode == 0, f"boot {at}: {done.stdout}"
        assert "Once more." not in done.stdout, f"boot {at}: {done.stdout}"


def test_five_boots_in_a_row(boot: Boot) -> None:
    boots_in_a_row(boot, 5)


@pytest.mark.soak
def test_two_hundred_boots_in_a_row(boot: Boot) -> None:
    boots_in_a_row(boot, 200)
