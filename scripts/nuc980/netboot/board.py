# SPDX-License-Identifier: GPL-3.0-or-later
"""What there is to know of a board, as values; and what a board from the factory is taken to be."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from nuc980.netboot import limits
from nuc980.netboot.errors import UnusableInput

SCHEMA = 1
TABLE_BLOCKS = 4  # of bad-block tables, at the end of the chip (NAND_BBT_SCAN_MAXBLOCKS)


@dataclass(frozen=True)
class Partition:
    """Of mtdparts; bytes."""

    name: str
    offset: int
    size: int


@dataclass(frozen=True)
class Nand:
    """The flash as U-Boot sees it; sizes and offsets in bytes."""

    size: int
    block: int
    page: int
    bad: tuple[int, ...]  # offsets of the blocks that U-Boot calls bad, those of its tables among them
    oob: int = 64
    keeps_table: bool = False  # of bad blocks, in the flash
    partitions: tuple[Partition, ...] = ()

    @property
    def tables(self) -> tuple[int, ...]:
        """Those of `bad` that hold the bad-block tables."""
        first = self.size - TABLE_BLOCKS * self.block
        return tuple(offset for offset in self.bad if self.keeps_table and offset >= first)


@dataclass(frozen=True)
class Port:
    """An Ethernet port by U-Boot's name."""

    name: str
    mac: str | None


@dataclass(frozen=True)
class BoardReport:
    """What a board's U-Boot said of it."""

    version: str
    commands: frozenset[str]  # with subcommands of nand, as "nand markbad"
    environment: dict[str, str] = field(hash=False)
    ram: tuple[tuple[int, int], ...]  # banks: start, size
    ram_end: int  # below here nothing of U-Boot's own lies
    nand: Nand | None = None
    environment_room: int = 0  # bytes that the variables may have; 0: not known
    ports: tuple[Port, ...] = ()
    port_in_use: str | None = None
    phy: int | None = None  # its address on the MDIO bus of the port in use; None: not known
    link: bool | None = None  # None: U-Boot does not tell
    flash_asked: bool = False

    def knows(self, command: str) -> bool:
        """Whether this U-Boot has a command."""
        return command in self.commands

    def as_json(self) -> dict[str, Any]:
        """For json.dumps; docs/netboot.md describes it."""
        return {"schema": SCHEMA, **asdict(self), "commands": sorted(self.commands)}

    @classmethod
    def from_json(cls, value: Any) -> BoardReport:
        """The report of which as_json() made this. Raises UnusableInput."""
        try:
            fields = dict(value)
            if fields.pop("schema") != SCHEMA:
                raise UnusableInput(f"a report of another version than {SCHEMA}")
            if fields["nand"]:
                nand = dict(fields["nand"])
                nand["bad"] = tuple(nand["bad"])
                nand["partitions"] = tuple(Partition(**each) for each in nand["partitions"])
                fields["nand"] = Nand(**nand)
            fields["commands"] = frozenset(fields["commands"])
            fields["ram"] = tuple((start, size) for start, size in fields["ram"])
            fields["ports"] = tuple(Port(**port) for port in fields["ports"])
            return cls(**fields)
        except (KeyError, TypeError, ValueError) as error:
            raise UnusableInput(f"no report of probe --json: {error}") from error


# ---- the factory's

# The binary is not public: the environment is the board's own (old_uboot_env.txt of the report's repository),
# the rest is what the vendor's source builds for it, and the flash that the environment's commands imply.
FACTORY_COMMANDS = (
    "bdinfo", "boot", "bootd", "bootm", "bootp", "cmp", "cp", "crc32", "echo", "editenv", "env", "fdt", "go",
    "help", "iminfo", "imxtract", "itest", "loadb", "loads", "md", "mm", "mtdparts", "mw", "nand", "nfs",
    "printenv", "reset", "run", "saveenv", "setenv", "sf", "sleep", "source", "sspi", "tftpboot", "timer",
    "ubi", "ubifsload", "version",
    "nand info", "nand device", "nand read", "nand write", "nand erase", "nand bad", "nand markbad",
)  # fmt: skip
FACTORY = BoardReport(
    version="U-Boot 2016.11",
    commands=frozenset(FACTORY_COMMANDS),
    environment={
        "baudrate": "115200",
        "bootcmd": "nand read 0x7FC0 0x200000 0x500000; nand read 0xA00000 0x700000 0x100000; "
        "bootm 0x7Fc0 - 0xA00000",
        "bootdelay": "3",
        "ethact": "emac",
        "stderr": "serial",
        "stdin": "serial",
        "stdout": "serial",
    },
    ram=((0, limits.MEMORY),),
    ram_end=0x3E00000,
    nand=Nand(
        size=limits.FLASH,
        block=limits.BLOCK,
        page=limits.PAGE,
        bad=(),
        partitions=(
            Partition("u-boot", 0, 0x200000),
            Partition("kernel", 0x200000, 0x1400000),
            Partition("user", 0x1600000, 0x6A00000),
        ),
    ),
    environment_room=0x10000 - 4,
    ports=(Port("emac", None),),
    port_in_use="emac",
    flash_asked=True,
)
