# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of `boot`: kernel and device tree into RAM by TFTP, and started.

Linux gets no flash unless told so: the vendor's driver erases the last blocks for its tables of bad blocks
when there are none, and UBI writes by itself as soon as it is attached.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import libfdt

from nuc980.netboot.board import BoardReport
from nuc980.netboot.errors import DoesNotFit, UnusableInput
from nuc980.netboot.limits import DEVICE_TREE_AT, UIMAGE_AT
from nuc980.netboot.linux import Goal, LinuxWatch
from nuc980.netboot.plan import Plan, SetVariable, Step
from nuc980.netboot.session import TFTP_PORT, Network, Session
from nuc980.netboot.steps import Load, Slice
from nuc980.netboot.uimage import UImage, check_place, flash_nodes, read_tree, read_uimage

HEADER = UImage.LAYOUT.size
COMMAND_LINE_SIZE = 1024  # of a kernel for ARM, with the closing zero
# One is put over the device tree's arguments, the other keeps the tree where it could be overwritten.
IN_THE_WAY = ("bootargs", "fdt_high")
# Four time-outs of 2 s instead of ten of 5 s, and no beginning anew for ever: Load does that better.
IMPATIENCE = {"netretry": "no", "tftptimeout": "2000", "tftptimeoutcountmax": "4"}


@dataclass(frozen=True)
class Addresses:
    """Where things go in RAM: as the factory's boot command has it, so that U-Boot moves nothing."""

    uimage: int = UIMAGE_AT
    dtb: int = DEVICE_TREE_AT

    @classmethod
    def of(cls, board: BoardReport) -> Addresses:
        """The same, counted from where the board's RAM starts. Raises UnusableInput."""
        if not board.ram:
            raise UnusableInput("U-Boot does not report where the board's RAM is (bdinfo).")
        start = board.ram[0][0]
        return cls(start + cls.uimage, start + cls.dtb)

    @property
    def runs_at(self) -> int:
        """Where the kernel runs."""
        return self.uimage + HEADER

    @property
    def kernel_room(self) -> int:
        """Bytes from the uImage up to the device tree."""
        return self.dtb - self.uimage


# ---- what is loaded


@dataclass(frozen=True)
class Images:
    """A kernel and a device tree that were looked at, from their files."""

    kernel: Path
    header: UImage
    tree: libfdt.Fdt

    @classmethod
    def read(cls, kernel: Path, tree: Path) -> Images:
        """Raises UnusableImage."""
        return cls(kernel, read_uimage(kernel), read_tree(tree))

    def check(self, board: BoardReport, addresses: Addresses) -> None:
        """That they can run there, and fit. Raises UnusableImage, DoesNotFit."""
        check_place(self.kernel, self.header, addresses.runs_at)
        if self.header.size > addresses.kernel_room:
            raise DoesNotFit(
                f"{self.kernel} has {self.header.size} bytes, {self.header.size - addresses.kernel_room} more"
                f" than fit before the device tree at {addresses.dtb:#x}.",
                next_step="a smaller kernel, or its root file system outside (docs/image-buildroot.md)",
            )
        start, size = board.ram[0]
        end = min(start + size, board.ram_end or start + size)
        if addresses.dtb + self.tree.totalsize() + TREE_GROWTH > end:
            raise DoesNotFit(
                f"The device tree, {self.tree.totalsize()} bytes, goes to {addresses.dtb:#x}; the"
                f" board's RAM is free up to {end:#x}.",
                next_step="nuc980-netboot probe shows the RAM; a board of this kind has 64 MiB",
            )


def arguments_for(
    tree: libfdt.Fdt, environment: Mapping[str, str], given: str | None, macs: Sequence[str]
) -> str:
    """The kernel's arguments: as given, else U-Boot's bootargs, else the device tree's; and the MACs.

    The vendor's drivers take those from ethaddr0= and ethaddr1= alone; without, all boards have the same
    pair. Those in a tree may be another board's: post-image.sh takes them out too. Raises UnusableInput.
    """
    words = (environment.get("bootargs") or _without_macs(own_arguments(tree))) if given is None else given
    missing = (f"ethaddr{port}={mac}" for port, mac in enumerate(macs) if f"ethaddr{port}=" not in words)
    arguments = " ".join(filter(None, (words, *missing)))
    if len(arguments) >= COMMAND_LINE_SIZE or not arguments.isascii() or not arguments.isprintable():
        raise UnusableInput(
            f"The kernel's arguments must be printable ASCII, less than {COMMAND_LINE_SIZE}: {arguments!r}"
        )
    return arguments


def own_arguments(tree: libfdt.Fdt) -> str:
    """The kernel's, as the tree has them."""
    chosen = tree.path_offset("/chosen", libfdt.QUIET_NOTFOUND)
    if chosen < 0 or not tree.hasprop(chosen, "bootargs"):
        return ""
    return tree.getprop(chosen, "bootargs").as_str()


def _without_macs(arguments: str) -> str:
    return " ".join(word for word in arguments.split() if not word.startswith(("ethaddr0=", "ethaddr1=")))


TREE_GROWTH = 4096  # what the arguments and addresses add


def tree_for(tree: libfdt.Fdt, arguments: str, macs: Sequence[str], *, flash: bool = False) -> bytes:
    """The device tree with the kernel's arguments and the ports' addresses; flash: Linux gets the flash.

    Into the tree, not into U-Boot's variables: a long line need not be typed, and what the host has put
    there is checked by the CRC of the whole.
    """
    own = libfdt.Fdt(tree.as_bytearray())
    own.resize(own.totalsize() + TREE_GROWTH)
    chosen = own.path_offset("/chosen", libfdt.QUIET_NOTFOUND)
    own.setprop_str(chosen if chosen >= 0 else own.add_subnode(0, "chosen"), "bootargs", arguments)
    for port, mac in enumerate(macs):
        path = own.get_alias(f"ethernet{port}")
        if path is not None:
            own.setprop(own.path_offset(path), "local-mac-address", bytes.fromhex(mac.replace(":", "")))
    if not flash:
        for node in flash_nodes(own):
            own.setprop_str(node, "status", "disabled")
    own.pack()
    return bytes(own.as_bytearray())


# ---- the plan


@dataclass(frozen=True)
class StartKernel(Step):
    """Starts what is loaded."""

    addresses: Addresses
    goal: Goal
    phase: ClassVar[str] = "bootm"

    def title(self) -> str:
        return "Start the kernel."

    def commands(self) -> tuple[str, ...]:
        return (f"bootm {self.addresses.uimage:#x} - {self.addresses.dtb:#x}",)

    def run(self, session: Session) -> None:
        (command,) = self.commands()
        marker = session.console.start(command)
        session.linux = LinuxWatch(
            session.console.line, marker, lambda line: session.progress.note(f"  | {line}")
        )
        session.linux.until_kernel(self.goal)


@dataclass(frozen=True)
class WatchLinux(Step):
    """Types nothing: looks on."""

    goal: Goal
    phase: ClassVar[str] = "Linux"

    def title(self) -> str:
        return f"Watch Linux come up, until a line has '{self.goal.pattern}'."

    def commands(self) -> tuple[str, ...]:
        return ()

    def run(self, session: Session) -> None:
        assert session.linux is not None
        session.linux.until(self.goal)


def plan_network(board: BoardReport, network: Network, macs: Sequence[str]) -> tuple[SetVariable, ...]:
    """What U-Boot must know to load files: addresses of its own, the server's, and the port to use.

    Raises UnusableInput for a port that this U-Boot has not.
    """
    names = [port.name for port in board.ports]
    if network.device and names and network.device not in names:
        raise UnusableInput(f"U-Boot has no Ethernet port {network.device!r}; it has {', '.join(names)}.")
    wanted = {
        "ethaddr": macs[0],
        "eth1addr": macs[1],
        "ipaddr": str(network.board.ip),
        "netmask": str(network.board.netmask),
        "serverip": str(network.server),
        "ethact": network.device,
        # also back from what a run before has set
        "tftpdstp": str(network.port)
        if network.port != TFTP_PORT or "tftpdstp" in board.environment
        else None,
        # or a load would start what it loaded
        "autostart": "no" if "autostart" in board.environment else None,
        **IMPATIENCE,
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
    goal: Goal,
    addresses: Addresses,
) -> Plan:
    """Kernel and device tree to their addresses, then bootm. The tree has the kernel's arguments."""
    return Plan(
        (
            *plan_network(board, network, macs),
            *(SetVariable(name, "") for name in IN_THE_WAY if name in board.environment),
            Load("uImage", uimage, addresses.uimage, "load kernel"),
            Load("nuc980.dtb", dtb, addresses.dtb, "load device tree"),
            StartKernel(addresses, goal),
            WatchLinux(goal),
        )
    )
