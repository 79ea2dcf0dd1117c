# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of commands, and those of them that are about memory, the environment and U-Boot itself."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from . import environment, flash, network, uimage
from .faults import Reset

if TYPE_CHECKING:
    from .board import Board

SIZES = {"b": 1, "w": 2, "l": 4, "": 4}
DUMPED_AT_ONCE = 1024  # bytes, before it looks for Ctrl-C
PRINTABLE = bytes(byte if 0x20 <= byte < 0x7F else ord(".") for byte in range(256))
NAMES = {1: "byte", 2: "halfword", 4: "word"}


@dataclass(frozen=True)
class Command:
    """run: None is a command that the double only has in its list."""

    usage: str
    help: str = ""
    run: Callable[[Board, list[str], bool], int] | None = None
    most: int = 16
    repeats: bool = False


def version(board: Board, words: list[str], repeat: bool) -> int:
    board.puts(board.variant.version_text)
    return 0


def help_(board: Board, words: list[str], repeat: bool) -> int:
    if len(words) == 1:
        for name in board.commands:
            board.puts(f"{name:<10}- {COMMANDS[name].usage}\n")
        return 0
    status = 0
    for word in words[1:]:
        if name := board.named(word):
            status |= board.usage(name)
        else:
            board.puts(
                f"Unknown command '{word}' - try 'help' without arguments for list of all known commands\n\n"
            )
            status = 1
    return status


def echo(board: Board, words: list[str], repeat: bool) -> int:
    text = " ".join(words[1:])
    board.puts(text.replace("\\c", "") if "\\c" in text else text + "\n")
    return 0


def bdinfo(board: Board, words: list[str], repeat: bool) -> int:
    no_ip = "<NULL>" if board.variant.name == "ours" else "0.0.0.0"
    board.puts(
        board.variant.bdinfo.format(
            port=network.current_port(board),
            ethaddr=board.variables.get("ethaddr", "(not set)"),
            ipaddr=board.variables.get("ipaddr", no_ip),
        )
    )
    return 0


def reset(board: Board, words: list[str], repeat: bool) -> int:
    board.puts("resetting ...\n")
    raise Reset


def sleep(board: Board, words: list[str], repeat: bool) -> int:
    if len(words) != 2:
        return board.usage("sleep")
    left = float(words[1])
    while left > 0:
        if board.wire.tstc(min(left, 1) * board.second) and board.wire.getc() == 3:
            return -1
        left -= 1
    return 0


def boot(board: Board, words: list[str], repeat: bool) -> int:
    return board.run_line(board.variables.get("bootcmd", ""))


def run(board: Board, words: list[str], repeat: bool) -> int:
    for name in words[1:]:
        if name not in board.variables:
            board.puts(f'## Error: "{name}" not defined\n')
            return 1
        if board.run_line(board.variables[name]):
            return 1
    return 0 if len(words) > 1 else board.usage("run")


def true(board: Board, words: list[str], repeat: bool) -> int:
    return 0


def false(board: Board, words: list[str], repeat: bool) -> int:
    return 1


# ---- the environment


def printenv(board: Board, words: list[str], repeat: bool) -> int:
    names = [word for word in words[1:] if word != "-a"]
    if not names:
        text = environment.listed(board.variables)
        size = len(text) + 1 + (2 * len(board.variables) if board.variant.name == "factory" else 0)
        board.puts(text)
        board.puts(f"\nEnvironment size: {size}/{board.variant.env_size - 4} bytes\n")
        return 0
    missing = 0
    for name in names:
        if name in board.variables:
            board.puts(f"{name}={board.variables[name]}\n")
        else:
            board.puts(f'## Error: "{name}" not defined\n')
            missing += 1
    return missing


def setenv(board: Board, words: list[str], repeat: bool) -> int:
    words = [word for word in words if word != "-f"]
    if len(words) < 2:
        return board.usage("setenv")
    name = words[1]
    if "=" in name:
        board.puts(f"## Error: illegal character '='in variable name \"{name}\"\n")
        return 1
    value = " ".join(words[2:])
    if value:
        board.variables[name] = value
    elif name in board.variables:
        del board.variables[name]
    else:
        return board.variant.unset_status
    return 0


def env(board: Board, words: list[str], repeat: bool) -> int:
    match words[1:]:
        case ["print", *names]:
            return printenv(board, ["printenv", *names], repeat)
        case ["set", *rest]:
            return setenv(board, ["setenv", *rest], repeat)
        case ["save"]:
            return flash.saveenv(board, ["saveenv"], repeat)
        case ["default", *options]:
            board.puts("## Resetting to default environment\n")
            board.variables.clear()
            board.variables |= board.variant.environment
            return 0 if options else board.usage("env")
        case ["export", "-t", address, *names]:
            chosen = {
                name: board.variables[name] for name in names or board.variables if name in board.variables
            }
            text = environment.listed(chosen).encode() + b"\0"
            board.store(board.number(address), text)
            board.variables["filesize"] = f"{len(text):x}"
            return 0
        case ["import", "-t", address, size, *_]:
            text = board.memory(board.number(address), board.number(size)).split(b"\0")[0].decode()
            pairs = (line.partition("=") for line in text.splitlines() if "=" in line)
            board.variables |= {name: value.replace("\\\\", "\\") for name, _, value in pairs}
            return 0
    return board.usage("env")


# ---- memory


def md(board: Board, words: list[str], repeat: bool) -> int:
    if not repeat:
        if len(words) < 2:
            return board.usage("md")
        board.dump_size = _size(words[0])
        board.dump_at = board.number(words[1])
        board.dump_count = board.number(words[2]) if len(words) > 2 else 64
    end = board.dump_at + board.dump_count * board.dump_size
    while board.dump_at < end:
        if board.wire.tstc() and board.wire.getc() == 3:
            return 1
        some = range(board.dump_at, min(end, board.dump_at + DUMPED_AT_ONCE), 16)
        board.puts("".join(_dumped(board, address, min(16, end - address)) for address in some))
        board.dump_at = min(end, some.stop)
    return 0


def _dumped(board: Board, address: int, length: int) -> str:
    """A line of lib/display_options.c's print_buffer."""
    size, data = board.dump_size, board.memory(address, length)
    cells = struct.unpack(f"<{length // size}{' BH I'[size]}", data)
    numbers = "".join(f" {cell:0{2 * size}x}" for cell in cells)
    gap = "  " if board.variant.name == "ours" else "    "
    shown = data.translate(PRINTABLE).decode("latin-1")
    return f"{address:08x}:{numbers:<{16 // size * (2 * size + 1)}}{gap}{shown}\n"


def mw(board: Board, words: list[str], repeat: bool) -> int:
    if not 3 <= len(words) <= 4:
        return board.usage("mw")
    size = _size(words[0])
    value = (board.number(words[2]) & (1 << 8 * size) - 1).to_bytes(size, "little")
    board.store(board.number(words[1]), value * (board.number(words[3]) if len(words) > 3 else 1))
    return 0


def cp(board: Board, words: list[str], repeat: bool) -> int:
    if len(words) != 4:
        return board.usage("cp")
    count = board.number(words[3])
    if not count:
        board.puts("Zero length ???\n")
        return 1
    board.store(board.number(words[2]), board.memory(board.number(words[1]), count * _size(words[0])))
    return 0


def cmp(board: Board, words: list[str], repeat: bool) -> int:
    if len(words) != 4:
        return board.usage("cmp")
    size = _size(words[0])
    name, count = NAMES[size], board.number(words[3])
    one, other = (board.number(word) for word in words[1:3])
    left, right = board.memory(one, count * size), board.memory(other, count * size)
    same = next((at for at in range(count) if _cell(left, at, size) != _cell(right, at, size)), count)
    if same < count:
        sides = [
            f"{name} at 0x{start + same * size:08x} ({_cell(data, same, size):#0{size}x})"
            for start, data in ((one, left), (other, right))
        ]
        board.puts(" != ".join(sides) + "\n")
    board.puts(f"Total of {same} {name}(s) were the same\n")
    return 0 if same == count else 1


def crc32(board: Board, words: list[str], repeat: bool) -> int:
    if len(words) < 3:
        return board.usage("crc32")
    address, size = board.number(words[1]), board.number(words[2])
    crc = zlib.crc32(board.memory(address, size))
    end = address + size - 1 & 0xFFFFFFFF
    board.puts(f"CRC32 for {address:08x} ... {end:08x} ==> {crc:08x}\n")
    if len(words) > 3:
        board.store(board.number(words[3]), crc.to_bytes(4, "little"))
    return 0


def _size(word: str) -> int:
    return SIZES[word.partition(".")[2]]


def _cell(data: bytes, at: int, size: int) -> int:
    return int.from_bytes(data[at * size : (at + 1) * size], "little")


# ---- the table, with the texts of cmd/*.c

NAND_HELP = """info - show available NAND devices
nand device [dev] - show or set current device
nand read - addr off|partition size
nand write - addr off|partition size
    read/write 'size' bytes starting at offset 'off'
    to/from memory address 'addr', skipping bad blocks.
nand write.trimffs - addr off|partition size
    write 'size' bytes starting at offset 'off' from memory address
    'addr', skipping bad blocks and dropping any pages at the end
    of eraseblocks that contain only 0xFF
nand erase[.spread] [clean] off size - erase 'size' bytes from offset 'off'
    With '.spread', erase enough for given file size, otherwise,
    'size' includes skipped bad blocks.
nand erase.part [clean] partition - erase entire mtd partition'
nand erase.chip [clean] - erase entire chip'
nand bad - show bad blocks
nand markbad off [...] - mark bad block(s) at offset (UNSAFE)"""
SETENV_HELP = """[-f] name value ...
    - [forcibly] set environment variable 'name' to 'value ...'
setenv [-f] name
    - [forcibly] delete environment variable 'name'"""
MII_HELP = """device                            - list available devices
mii device <devname>                  - set current device
mii info   <addr>                     - display MII PHY info
mii read   <addr> <reg>               - read  MII PHY <addr> register <reg>"""

COMMANDS = {
    "?": Command("alias for 'help'", run=help_),
    "base": Command("print or set address offset"),
    "bdinfo": Command("print Board Info structure", run=bdinfo, most=1, repeats=True),
    "boot": Command("boot default, i.e., run 'bootcmd'", run=boot, most=1, repeats=True),
    "bootd": Command("boot default, i.e., run 'bootcmd'", run=boot, most=1, repeats=True),
    "bootm": Command("boot application image from memory", "[addr [arg ...]]", uimage.bootm, repeats=True),
    "bootp": Command("boot image via network using BOOTP/TFTP protocol"),
    "chpart": Command("change active partition of a MTD device"),
    "cmp": Command("memory compare", "[.b, .w, .l] addr1 addr2 count", cmp, 4, True),
    "coninfo": Command("print console devices and information"),
    "cp": Command("memory copy", "[.b, .w, .l] source target count", cp, 4, True),
    "crc32": Command(
        "checksum calculation",
        "address count [addr]\n    - compute CRC32 checksum [save at addr]",
        crc32,
        4,
        True,
    ),
    "dm": Command("Driver model low level access"),
    "echo": Command(
        "echo args to console",
        "[args..]\n    - echo args to console; \\c suppresses newline",
        echo,
        repeats=True,
    ),
    "editenv": Command("edit environment variable"),
    "env": Command("environment handling commands", "default [-f] -a\nenv save", env),
    "exit": Command("exit script"),
    "false": Command("do nothing, unsuccessfully", run=false),
    "fdt": Command("flattened device tree utility commands"),
    "go": Command("start application at address 'addr'"),
    "help": Command(
        "print command description/usage",
        "\n\t- print brief description of all commands",
        help_,
        repeats=True,
    ),
    "iminfo": Command("print header information for application image", "addr [addr ...]", uimage.iminfo),
    "imxtract": Command("extract a part of a multi-image"),
    "itest": Command("return true/false on integer compare"),
    "loadb": Command("load binary file over serial line (kermit mode)"),
    "loads": Command("load S-Record file over serial line"),
    "loadx": Command("load binary file over serial line (xmodem mode)"),
    "loady": Command("load binary file over serial line (ymodem mode)"),
    "loop": Command("infinite loop on address range"),
    "md": Command("memory display", "[.b, .w, .l] address [# of objects]", md, 3, True),
    "mdio": Command("MDIO utility commands"),
    "mii": Command("MII utility commands", MII_HELP, network.mii),
    "mm": Command("memory modify (auto-incrementing address)"),
    "mtdparts": Command("define flash/nand partitions", "\n    - list partition table", flash.mtdparts),
    "mw": Command("memory write (fill)", "[.b, .w, .l] address value [count]", mw, 4, True),
    "nand": Command("NAND sub-system", NAND_HELP, flash.nand, repeats=True),
    "nboot": Command("boot from NAND device"),
    "net": Command("NET sub-system", "list - list available devices\n", network.net),
    "nfs": Command("boot image via network using NFS protocol"),
    "nm": Command("memory modify (constant address)"),
    "panic": Command("Panic with optional message"),
    "ping": Command("send ICMP ECHO_REQUEST to network host", "pingAddress", network.ping, 2, True),
    "pinmux": Command("show pin-controller muxing"),
    "printenv": Command(
        "print environment variables",
        "[-a]\n    - print [all] values of all environment variables\n"
        "printenv name ...\n    - print value of environment variable 'name'",
        printenv,
        repeats=True,
    ),
    "reset": Command("Perform RESET of the CPU", run=reset, most=1),
    "run": Command("run commands in an environment variable", "var [...]", run, repeats=True),
    "saveenv": Command("save environment variables to persistent storage", run=flash.saveenv, most=1),
    "setenv": Command("set environment variables", SETENV_HELP, setenv),
    "setexpr": Command("set environment variable as the result of eval expression"),
    "sf": Command("SPI flash sub-system"),
    "showvar": Command("print local hushshell variables"),
    "sleep": Command(
        "delay execution for some time",
        "N\n    - delay execution for N seconds (N is _decimal_ and can be\n      fractional)",
        sleep,
        2,
        True,
    ),
    "source": Command("run script from memory"),
    "sspi": Command("SPI utility command"),
    "test": Command("minimal test like /bin/sh"),
    "tftp": Command(
        "tftpboot by its short name", "[loadAddress] [[hostIPaddr:]bootfilename]", network.tftpboot, 3, True
    ),
    "tftpboot": Command(
        "load file via network using TFTP protocol",
        "[loadAddress] [[hostIPaddr:]bootfilename]",
        network.tftpboot,
        3,
        True,
    ),
    "tftpput": Command(
        "TFTP put command, for uploading files to a server",
        "Address Size [[hostIPaddr:]filename]",
        network.tftpput,
        4,
        True,
    ),
    "timer": Command("access the system timer"),
    "true": Command("do nothing, successfully", run=true),
    "ubi": Command("ubi commands"),
    "ubifsload": Command("load file from an UBIFS filesystem"),
    "ubifsls": Command("list files in a directory"),
    "ubifsmount": Command("mount UBIFS volume"),
    "ubifsumount": Command("unmount UBIFS volume"),
    "version": Command("print monitor, compiler and linker version", run=version, most=1, repeats=True),
}
