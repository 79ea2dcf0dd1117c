# SPDX-License-Identifier: GPL-3.0-or-later
"""openrtu: one command for engineers; a subcommand is a module and a row of TOOLS.

Exit codes: 0 done, 1 found mistakes or could not do it, 2 wrong usage or an unusable file.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Sequence
from importlib import import_module
from typing import NamedTuple, Protocol

from nuc980 import VERSION
from nuc980.errors import ToolError
from openrtu_tools.missing import what_to_type

UNUSABLE = 2
SHELLS = ("bash", "zsh")


class Plugin(Protocol):
    """What a subcommand's module has. What is large or may be missing it imports in `run` alone."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None: ...

    def run(self, parsed: argparse.Namespace) -> int:
        """Returns the exit code. Raises ToolError or OSError, which `main` tells the user."""
        ...


class Tool(NamedTuple):
    """A subcommand: its module, what it does, the extra of pyproject.toml that brings what it imports."""

    module: str
    does: str
    extra: str = ""

    def plugin(self) -> Plugin:
        return import_module(self.module)


TOOLS = {
    "points": Tool("openrtu_tools.points", "make a configuration of a list of points"),
    "scl": Tool("openrtu_tools.scl", "take a CID of an engineer's tool into a configuration"),
    "logic": Tool("openrtu_tools.logic.cli", "check, compile and try Structured Text (IEC 61131-3)", "logic"),
    "read": Tool(
        "openrtu_tools.modbus.read", "read registers and bits of a Modbus device that is in no file"
    ),
    "write": Tool(
        "openrtu_tools.modbus.write", "write registers or coils of such a device, and read them back"
    ),
    "poll": Tool("openrtu_tools.modbus.poll", "read again and again, and print what changes"),
    "scan": Tool("openrtu_tools.modbus.scan", "find Modbus devices on serial ports or at TCP addresses"),
    "devices": Tool("openrtu_tools.devices", "list, search and show the templates of devices"),
    "snmp-keys": Tool("openrtu_tools.snmp_keys", "make the keys of rtu-snmp"),
    "web-users": Tool("openrtu_tools.web_users", "add, change or remove a user of rtu-web"),
    "centre": Tool("openrtu_tools.centre.cli", "run the control centre, and what belongs to it", "centre"),
}


def main(words: Sequence[str] | None = None) -> int:
    """Runs one subcommand; returns the exit code."""
    words = sys.argv[1:] if words is None else words
    parsed = command_line(words[:1]).parse_args(words)
    tool = TOOLS[parsed.tool]
    try:
        return tool.plugin().run(parsed)
    except BrokenPipeError:  # `| head` has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        return 130
    except EOFError:
        text, code = "the input ended before all was answered", UNUSABLE
    except ToolError as error:
        text, code = str(error), error.exit_code
    except OSError as error:
        text, code = f"{error.filename}: {error.strerror}" if error.filename else str(error), UNUSABLE
    except ModuleNotFoundError as error:
        text, code = what_to_type(error, tool.extra), UNUSABLE
    print(f"openrtu {parsed.tool}: {text}", file=sys.stderr)
    return code


def command_line(used: Iterable[str] = TOOLS) -> argparse.ArgumentParser:
    """The parser; of the subcommands only those used know their arguments, and are imported for it."""
    parser = argparse.ArgumentParser(prog="openrtu", description="OpenRTU's tools for engineers.")
    parser.add_argument("--version", action="version", version=f"%(prog)s (OpenRTU) {VERSION}")
    parser.add_argument(
        "--completion", choices=SHELLS, action=_Completion, help="print what this shell completes, and exit"
    )
    commands = parser.add_subparsers(dest="tool", required=True, metavar="COMMAND")
    for name, tool in TOOLS.items():
        command = commands.add_parser(
            name, help=tool.does, description=f"{tool.does[0].upper()}{tool.does[1:]}."
        )
        if name in used:
            tool.plugin().add_arguments(command)
    return parser


class _Completion(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, _: object, shell: str, __: object = None) -> None:
        from openrtu_tools.completion import completion

        print(completion(command_line(), shell))
        parser.exit()
