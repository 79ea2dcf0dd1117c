# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of `boot`: kernel and device tree into RAM by TFTP, and started. The flash is not touched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from nuc980.netboot.linux import Goal, watch_linux
from nuc980.netboot.plan import Plan, SetVariable, Step
from nuc980.netboot.probe import BoardReport
from nuc980.netboot.session import Network, Session
from nuc980.netboot.steps import Load, Slice


@dataclass(frozen=True)
class Addresses:
    """Where things go in RAM; those of the factory's environment (facts: report 003, old_uboot_env.txt)."""

    uimage: int = 0x7FC0  # 64 bytes of header before 0x8000, where the kernel runs: nothing is moved
    dtb: int = 0xA00000


@dataclass(frozen=True)
class StartLinux(Step):
    """Starts what is loaded, and watches it come up."""

    addresses: Addresses
    goal: Goal
    phase: ClassVar[str] = "Linux"

    def title(self) -> str:
        return f"Start Linux, until {self.goal.pattern!r}."

    def commands(self) -> tuple[str, ...]:
        return (f"bootm {self.addresses.uimage:#x} - {self.addresses.dtb:#x}",)

    def run(self, session: Session) -> None:
        (command,) = self.commands()
        marker = session.console.start(command)
        watch_linux(session, self.goal, marker)


def plan_network(board: BoardReport, network: Network, macs: Sequence[str]) -> tuple[SetVariable, ...]:
    """What U-Boot must know to load files: addresses of its own, the server's, and the port to use."""
    wanted = {
        "ethaddr": macs[0],
        "eth1addr": macs[1],
        "ipaddr": str(network.board.ip),
        "netmask": str(network.board.netmask),
        "serverip": str(network.server),
        "ethact": network.device,
        "tftpdstp": str(network.port) if network.port != 69 else None,
    }
    return tuple(
        SetVariable(name, value)
        for name, value in wanted.items()
        if value is not None and board.environment.get(name) != value
    )


def plan_boot(
    board: BoardReport,
    network: Network,
    macs: Sequence[str],
    uimage: Slice,
    dtb: Slice,
    bootargs: str | None,
    goal: Goal,
    addresses: Addresses = Addresses(),
) -> Plan:
    """Kernel and device tree to where the factory's environment has them, then bootm."""
    return Plan(
        (
            *plan_network(board, network, macs),
            *([SetVariable("bootargs", bootargs)] if bootargs is not None else []),
            Load("uImage", uimage, addresses.uimage),
            Load("nuc980.dtb", dtb, addresses.dtb),
            StartLinux(addresses, goal),
        )
    )
