# SPDX-License-Identifier: GPL-3.0-or-later
"""The gateway on the emulated board: its networks, the devices at its lines, the ways to it."""

from __future__ import annotations

import copy
import json
import shlex
import subprocess
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

from lab import show
from lab.gateway import GatewayError, Rtu
from lab.patience import slowness
from nuc980.netboot.errors import StuckConsole
from nuc980.netboot.linux import Goal
from nuc980.netboot.progress import Progress
from nuc980.netboot.target import Target, UBoot
from nuc980.twin.linux import LinuxError
from nuc980.twin.machine import Machine
from nuc980.twin.network import free_udp_port

ANSWER_SECONDS = 180.0
START_SECONDS = 60.0  # of rtud
BOOT = Goal(seconds=600.0, bootm_seconds=300.0)  # on a busy host
# The UARTs of the ports 1 to 6.
PORTS = (1, 2, 3, 4, 6, 8)
# Bytes pass QEMU with the pauses of a busy host: less silence ends no request, a device may take so long.
SILENCE_US = 30_000
STATION_PORT = 2404
SSH_PORT = 22


@dataclass(frozen=True)
class Network:
    """One of the board's Ethernet ports, on a network of QEMU's own: the board's and the host's address."""

    name: str  # QEMU's for it, as `set_link` takes it
    board: str  # ADDRESS/PREFIX
    host: str

    @property
    def address(self) -> str:
        return self.board.partition("/")[0]

    def arguments(
        self, forwards: Mapping[int, int], datagrams: Mapping[int, int] = MappingProxyType({})
    ) -> list[str]:
        """QEMU's, with ports of this machine's 127.0.0.1 that lead to ports of the board."""
        ways = [f"hostfwd=tcp:127.0.0.1:{here}-{self.address}:{there}" for here, there in forwards.items()]
        ways += [f"hostfwd=udp:127.0.0.1:{here}-{self.address}:{there}" for here, there in datagrams.items()]
        prefix = self.board.partition("/")[2]
        return [
            "-nic",
            ",".join((f"user,id={self.name},net={self.address}/{prefix},host={self.host}", *ways)),
        ]


# The report: the two ports' addresses.
ETHERNET = (
    Network("net0", "172.16.0.50/12", "172.16.0.1"),
    Network("net1", "192.168.21.100/24", "192.168.21.1"),
)


def configuration() -> dict[str, Any]:
    """The show's, for the board: its station listens on all addresses."""
    config = show.configuration()
    del config["iec104"]["address"]
    return config


def stations() -> list[int]:
    """The common addresses that can be read: 0 on a line is the broadcast, which is only written."""
    return [
        1000 * port["value"] + slave["id"]
        for port in configuration()["port"]
        for slave in port["slaves"]
        if slave["id"]
    ]


def lines_at(directory: Path) -> dict[int, str]:
    """What is at the six ports' wires: linesim's lines in this folder, as Machine's chardevs."""
    return {number: f"serial,path={directory}/ttyS{number}" for number in PORTS}


MACS = ("02:00:00:00:00:01", "02:00:00:00:00:02")


def macs_file() -> str:
    """The board's MAC addresses, as a site and nuc980-netboot have them."""
    return "".join(f"eth{number} {mac}\n" for number, mac in enumerate(MACS))


def netboot(machine: Machine, directory: Path, uimage: Path, dtb: Path, progress: Progress) -> None:
    """From U-Boot on emac0 to the log-in, as nuc980-netboot boots a board, with its lines.

    QEMU's own network answers at port 69 itself, so that the server has another: our U-Boot takes it.
    """
    site = directory / "site"
    site.mkdir()
    (site / "macs").write_text(macs_file())
    target = Target(
        machine.pty(0),
        board_ip=ETHERNET[0].board,
        server_ip=ETHERNET[0].host,
        tftp_port=free_udp_port(),
        listen="127.0.0.1",
        seen_as="127.0.0.1",
        site=site,
    )
    with ExitStack() as stack:
        uboot = _at_prompt(stack, target, progress)
        progress.note(f"TFTP at UDP port {target.tftp_port} instead of 69 (tftpdstp), behind QEMU's network.")
        uboot.boot(uimage, dtb, goal=BOOT)


def _at_prompt(stack: ExitStack, target: Target, progress: Progress) -> UBoot:
    """Once more, where a busy host has let too many keys wait for the board."""
    try:
        return stack.enter_context(target.uboot(progress))
    except StuckConsole as error:
        progress.note(f"{error.what} Once more.")
        return stack.enter_context(target.uboot(progress))


class Ssh:
    """The way into a board that an engineer has. One connection, which the first command opens."""

    def __init__(self, port: int, key: Path, directory: Path) -> None:
        self.port = port
        self.key = key
        options = {
            "BatchMode": "yes",
            "StrictHostKeyChecking": "no",  # a board without a flash makes its key at each start
            "UserKnownHostsFile": "/dev/null",
            "LogLevel": "ERROR",
            "ConnectTimeout": "20",  # QEMU's network takes a connection before the board does
            "ControlMaster": "auto",
            "ControlPath": f"{directory}/ssh",
            "ControlPersist": "yes",
        }
        words = [word for name, value in options.items() for word in ("-o", f"{name}={value}")]
        self.command = ["ssh", "-F", "none", "-i", str(key), "-p", str(port), *words, "root@127.0.0.1"]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the connection; the next command opens another."""
        subprocess.run([*self.command, "-O", "exit"], capture_output=True, check=False)

    def answers(self) -> bool:
        """Whether the board lets its engineer in."""
        try:
            self.run("true")
        except GatewayError:
            return False
        return True

    def run(self, command: str, seconds: float = ANSWER_SECONDS, send: str = "") -> str:
        """What a command on the board writes; send is its input. Raises GatewayError.

        seconds: on an idle machine (lab.patience).
        """
        patience = seconds * slowness()
        try:
            done = subprocess.run(
                [*self.command, command],
                input=send,
                capture_output=True,
                text=True,
                timeout=patience,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise GatewayError(
                f"on the board, '{command}' did not end within {patience:.0f} s", late=True
            ) from None
        if done.returncode:
            output = done.stderr.strip() or done.stdout.strip()
            raise GatewayError(f"on the board, '{command}' ended with {done.returncode}: {output}")
        return done.stdout


class Board(Rtu):
    """A gateway on the board, whose shell is reached by ssh or at the debug UART: `inside` runs a command."""

    by_shell = True

    def __init__(self, machine: Machine, inside: Callable[[str], str], address: tuple[str, int]) -> None:
        self.machine = machine
        self.inside = inside
        self.address = address
        self.config = configuration()

    def processes(self) -> list[int]:
        """QEMU listens for the board."""
        return [self.machine.process.pid]

    def ctl(self, *arguments: str) -> str:
        return self._run(shlex.join(["rtuctl", *arguments]))

    def configuration(self) -> dict[str, Any]:
        return copy.deepcopy(self.config)

    def put(self, config: dict[str, Any], path: str = "/run/other.json") -> str:
        self._run(
            f"mkdir -p {path.rpartition('/')[0]} && printf %s {shlex.quote(json.dumps(config))} > {path}"
        )
        return path

    def place(self, path: str, content: bytes) -> None:
        """A small file on the board, of any octets; its folder is made."""
        escaped = "".join(f"\\{octet:03o}" for octet in content)
        self._run(f"mkdir -p {path.rpartition('/')[0]} && printf '{escaped}' > {path}")

    def start_again(self, config: dict[str, Any]) -> None:
        """The gateway, with another configuration as its own: in the place of the image's, as at a start."""
        self.config = config
        path = self.put(config, "/data/site/config.json")
        self._run(f"mount -o bind {path} /etc/openrtu/gateway.json && /etc/init.d/S80rtud restart")
        self.wait_for(self._answers, START_SECONDS, "rtud runs again")

    def _answers(self) -> bool:
        try:
            return bool(self.modules())
        except GatewayError:
            return False  # there is no map yet

    def log(self, lines: int = 40) -> str:
        return self._run(f"tail -n {lines} /var/log/messages")

    def kill(self, module: str) -> None:
        self._run(f"kill -9 {self.modules()[module]['pid']}")
        self.killed += (module,)

    def check_up(self) -> None:
        if self.machine.process.poll() is not None:
            raise GatewayError(f"QEMU ended with {self.machine.process.returncode}: {self.machine.output}")

    def _run(self, command: str) -> str:
        try:
            return self.inside(command)
        except LinuxError as error:
            raise GatewayError(str(error)) from error
