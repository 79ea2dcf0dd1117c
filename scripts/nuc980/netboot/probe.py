# SPDX-License-Identifier: GPL-3.0-or-later
"""What is this board? Asked at U-Boot's prompt; nothing is changed."""

from __future__ import annotations

import re
from collections.abc import Iterator

from nuc980.netboot.board import BoardReport, Nand, Partition, Port
from nuc980.netboot.console import Console
from nuc980.netboot.environment import read_environment
from nuc980.netboot.progress import Progress
from nuc980.netboot.slots.script import is_installed, missing_commands

FLASH_SECONDS = 30.0  # the first access may look for bad blocks in the whole chip
STACK = 0x4000  # U-Boot's own check keeps so much below its stack pointer free (2023.01, lib/lmb.c)
SMALLEST_NAND = 16 << 20
LARGEST_NAND = 4 << 30
USE_FLASH_TABLE = 0x00020000  # NAND_BBT_USE_FLASH of the "bbt options"
WORN = 20 / 1024  # of a NAND's blocks may be bad (data sheets)
SEEN = (
    *("tftpboot", "tftpput", "ping", "bootm", "crc32", "md", "nand", "nand markbad", "ubi", "mtdparts"),
    *("saveenv", "mii"),
)


# ---- asked


def probe(console: Console, progress: Progress, *, flash: bool) -> BoardReport:
    """Asks the board. flash: also its NAND, at which U-Boot may look for the first time."""
    with progress.phase("probe"):
        version = console.run("version").required()
        names = set(re.findall(r"^(\S+?) *- ", console.run("help").required(), re.MULTILINE))
        if "nand" in names:
            subcommands = re.findall(r"^nand (\w+)", console.run("help nand").output, re.MULTILINE)
            names |= {f"nand {name}" for name in subcommands}
        board = console.run_twice("bdinfo").required()
        ports = _ports(console.run("net list").output) if "net" in names else _ports_of_bdinfo(board)
        in_use = re.search(r"^current eth += (.+)$", board, re.MULTILINE)
        environment = read_environment(console)
        phy, link = (
            _link(console) if "mii" in names and environment.variables.get("ethaddr") else (None, None)
        )
        return BoardReport(
            version=version.strip().splitlines()[0],
            commands=frozenset(names),
            environment=dict(environment.variables),
            environment_room=environment.room,
            ram=_banks(board),
            ram_end=_below_uboot(board),
            nand=probe_nand(console, mtdparts="mtdparts" in names) if flash and "nand" in names else None,
            ports=ports,
            port_in_use=in_use[1] if in_use and in_use[1] in [port.name for port in ports] else None,
            phy=phy,
            link=link,
            flash_asked=flash,
        )


def questions(board: BoardReport, *, flash: bool) -> Iterator[str]:
    """What probe() types when the board is this one and nothing goes wrong."""
    yield from ("version", "help")
    if board.knows("nand"):
        yield "help nand"
    yield from ("bdinfo", "bdinfo")
    if board.knows("net"):
        yield "net list"
    yield from ("printenv", "printenv")
    if board.knows("mii") and board.environment.get("ethaddr"):
        yield "mii info"
        if board.phy is not None:
            yield from _link_questions(board.phy)
    if flash and board.knows("nand"):
        yield from ("nand info", "nand info")
        if board.nand:
            yield from ("nand bad", "nand bad")
            size = SMALLEST_NAND
            while size <= min(board.nand.size, LARGEST_NAND):
                yield _is_inside(size)
                size *= 2
            if board.knows("mtdparts"):
                yield from ("mtdparts", "mtdparts")


def _banks(board: str) -> tuple[tuple[int, int], ...]:
    found = re.findall(r"^-> start +=\s*(0x[0-9a-fA-F]+)\n-> size +=\s*(0x[0-9a-fA-F]+)", board, re.MULTILINE)
    return tuple((int(start, 16), int(size, 16)) for start, size in found if int(size, 16))


def _below_uboot(board: str) -> int:
    """Below the lowest of what bdinfo says U-Boot itself uses: its code, its stack, what it reserves."""
    own = re.findall(r"^(?:relocaddr|irq_sp|sp start) +=\s*(0x[0-9a-fA-F]+)", board, re.MULTILINE)
    return max(min((int(number, 16) for number in own), default=0) - STACK, 0) & ~0xFFF


def _ports(listed: str) -> tuple[Port, ...]:
    """Of `net list`: eth0 : emac0 02:00:00:00:00:01 active"""
    found = re.findall(r"^eth\d+ *: (.+?) ([0-9a-fA-F:]{17})(?: |$)", listed, re.MULTILINE)
    return tuple(Port(name, None if mac == "00:00:00:00:00:00" else mac) for name, mac in found)


def _ports_of_bdinfo(board: str) -> tuple[Port, ...]:
    """Of 2016.11's bdinfo: eth0name    = emac, then ethaddr     = (not set)"""
    found = re.findall(r"^eth\d+name *= (.+)\neth\d*addr *= (.+)$", board, re.MULTILINE)
    return tuple(Port(name, None if mac == "(not set)" else mac) for name, mac in found)


def _link_questions(phy: int) -> tuple[str, str]:
    """Twice: the bit keeps a lost link until it is read (IEEE 802.3, 22.2.4.2.13)."""
    return (f"mii read {phy:#x} 1", f"mii read {phy:#x} 1")


def _link(console: Console) -> tuple[int | None, bool | None]:
    """Address and link of the PHY at the port in use: bit 2 of its status register."""
    found = re.search(r"^PHY (0x[0-9a-fA-F]+):", console.run("mii info").output, re.MULTILINE)
    if not found:
        return None, None
    phy = int(found[1], 16)
    _, status = (console.run(question).output for question in _link_questions(phy))
    return phy, bool(int(status, 16) & 1 << 2) if re.fullmatch(r"[0-9a-fA-F]{4}\s*", status) else None


def probe_nand(console: Console, *, mtdparts: bool = False) -> Nand | None:
    """Geometry, bad blocks and partitions, or None when U-Boot finds no flash."""
    info = console.run_twice("nand info", FLASH_SECONDS).output
    numbers = {
        name: re.search(rf"^  {name} +(0x *)?([0-9a-f]+)", info, re.MULTILINE)
        for name in ("Page size", "OOB size", "Erase size", "bbt options")
    }
    page, oob, block, options = (
        int(found[2], 16 if found[1] else 10) if found else 0 for found in numbers.values()
    )
    if not page or not block:
        return None
    listed = console.run_twice("nand bad", FLASH_SECONDS).required()
    bad = re.findall(r"^ +([0-9a-f]{8,})", listed, re.MULTILINE)
    return Nand(
        size=_size_of_nand(console),
        block=block,
        page=page,
        bad=tuple(int(offset, 16) for offset in bad),
        oob=oob,
        keeps_table=bool(options & USE_FLASH_TABLE),
        partitions=_partitions(console.run_twice("mtdparts").output) if mtdparts else (),
    )


def _is_inside(offset: int) -> str:
    """Reads nothing: U-Boot says whether the offset is inside of the chip."""
    return f"nand read 0 {offset:#x} 0"


def _size_of_nand(console: Console) -> int:
    """U-Boot prints it at its start only."""
    size = SMALLEST_NAND
    while size < LARGEST_NAND and console.run(_is_inside(size), FLASH_SECONDS).status == 0:
        size *= 2
    return size


def _partitions(listed: str) -> tuple[Partition, ...]:
    found = re.findall(r"^ *\d+: (\S+)\s+0x([0-9a-f]+)\s+0x([0-9a-f]+)", listed, re.MULTILINE)
    return tuple(Partition(name, int(offset, 16), int(size, 16)) for name, size, offset in found)


# ---- told


def described(board: BoardReport) -> str:
    """The report as a person reads it, remarks last."""
    rows = [
        ("U-Boot", board.version),
        ("RAM", ", ".join(f"{_mib(size)} at {start:#x}" for start, size in board.ram)),
        ("", f"free for files below {board.ram_end:#x}"),
        *_flash_rows(board),
        *_network_rows(board),
        ("autoboot", _autoboot(board)),
        ("has", ", ".join(name for name in SEEN if board.knows(name))),
        ("has not", ", ".join(name for name in SEEN if not board.knows(name)) or "-"),
    ]
    lines = [f"{name:<11} {text}" for name, text in rows]
    return "\n".join([*lines, "", *(f"- {remark}" for remark in remarks(board))])


def _flash_rows(board: BoardReport) -> Iterator[tuple[str, str]]:
    if not board.flash_asked:
        yield "NAND", "not asked"
    elif not (nand := board.nand):
        yield "NAND", "none found"
    else:
        yield (
            "NAND",
            f"{_mib(nand.size)}: {nand.size // nand.block} blocks of {nand.block >> 10} KiB, "
            f"pages of {nand.page} + {nand.oob} bytes",
        )
        bad = [f"{offset:#x}" for offset in nand.bad if offset not in nand.tables]
        yield "bad blocks", ", ".join(bad) or "none"
        if nand.tables:
            yield "", f"{len(nand.tables)} more, from {nand.tables[0]:#x} on, hold the bad-block tables"
        for number, part in enumerate(nand.partitions):
            yield (
                "partitions" if number == 0 else "",
                f"{part.name:<12} {part.offset:#010x}  {part.size / 2**20:7.2f} MiB",
            )


def _network_rows(board: BoardReport) -> Iterator[tuple[str, str]]:
    ports = [f"{port.name} ({port.mac or 'no address'})" for port in board.ports]
    yield "Ethernet", ", ".join(ports) or "no port"
    link = {True: "up", False: "down", None: "U-Boot does not say"}[board.link]
    yield "", f"in use: {board.port_in_use or 'none'}; link: {link}"
    names = ("ethaddr", "eth1addr", "ipaddr", "netmask", "serverip")
    known = [f"{name}={board.environment[name]}" for name in names if name in board.environment]
    yield "", ", ".join(known) or "no address in the environment"


def _autoboot(board: BoardReport) -> str:
    command, delay = board.environment.get("bootcmd"), board.environment.get("bootdelay")
    if command is None or delay == "-1":
        return "off"
    return f"after {delay} s: {command}"


def remarks(board: BoardReport) -> Iterator[str]:
    """What a service engineer should know of it."""
    yield from _autoboot_remarks(board)
    yield from _network_remarks(board)
    yield from _flash_remarks(board)
    if not board.knows("crc32"):
        yield "No crc32: nothing that is loaded can be checked, so this tool refuses to work with it."


def _autoboot_remarks(board: BoardReport) -> Iterator[str]:
    delay = board.environment.get("bootdelay")
    if "bootcmd" not in board.environment:
        yield "No bootcmd: it does not boot by itself, the prompt comes at once."
    elif delay == "-1":
        yield "bootdelay=-1: autoboot is off, the board waits at the prompt after each start."
    elif delay in ("0", "-2"):
        yield f"bootdelay={delay}: a start leaves hardly a chance to reach the prompt."
    reads = r"nand read(?:\.\w+)? (0x\w+|\w+) (0x\w+|\w+) (0x[0-9a-fA-F]+)"
    for address, offset, size in re.findall(reads, board.environment.get("bootcmd", "")):
        yield (
            f"bootcmd reads {int(size, 16)} bytes of the NAND from {offset} on to {address}: "
            "what is larger boots from the network only."
        )


def _network_remarks(board: BoardReport) -> Iterator[str]:
    if not board.knows("tftpboot"):
        yield "No tftpboot: a U-Boot without network (CONFIG_CMD_NET); this tool cannot load anything."
    elif not board.ports:
        yield (
            "tftpboot is there, but no Ethernet port: built without a driver (CONFIG_NUC980_ETH), "
            "or its port does not start."
        )
    elif not board.environment.get("ethaddr"):
        yield "No ethaddr: `boot` and `flash` set one from the site's file `macs`, in RAM only."
    if board.link is False:
        yield f"{board.port_in_use} has no link: no cable, or it is in the other port."
    if board.knows("tftpboot"):
        yield "It does not tell whether it takes a server on another UDP port than 69 (CONFIG_TFTP_PORT)."
    if not board.knows("tftpput"):
        yield "No tftpput: a backup of the flash goes over the serial line, some 6 minutes for each MiB."


def _flash_remarks(board: BoardReport) -> Iterator[str]:
    if not board.knows("nand"):
        yield "No nand command (CONFIG_CMD_NAND): it cannot be flashed from this U-Boot, only booted."
    elif not board.flash_asked:
        yield "The flash was left out, and so were bad blocks and partitions."
    elif not board.nand:
        yield (
            "The nand command finds no flash: a U-Boot built for SPI NAND (CONFIG_SPI_NAND) does not look "
            "for the board's raw NAND. It cannot be flashed from this U-Boot, only booted."
        )
    else:
        if board.nand.keeps_table:
            yield (
                "This U-Boot uses bad-block tables in the last blocks of the flash. One that is built to "
                "make them has done so at its first access."
            )
        yield _slots_remark(board)
        worn = len(board.nand.bad) - len(board.nand.tables)
        if worn > WORN * board.nand.size / board.nand.block:
            yield f"{worn} bad blocks: more than a NAND may have; the flash is worn out."


def _slots_remark(board: BoardReport) -> str:
    if is_installed(board.environment):
        return "It has two slots: nuc980-netboot slots shows them."
    if missing := missing_commands(board):
        return f"No {', '.join(missing)}: it cannot have two slots."
    return "Its U-Boot has the commands for two slots (nuc980-netboot install)."


def _mib(size: int) -> str:
    return f"{size >> 20} MiB" if size % (1 << 20) == 0 else f"{size} bytes"
