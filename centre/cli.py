# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line of `openrtu centre`. docs/control-centre.md. Its verbs import what the extra brings."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from openrtu_tools.centre.roles import ROLES, SCOPES

PAGE = Path(__file__).resolve().parent / "built"


class _CentreFile(argparse.Action):
    """Whoever begins with the command is told what comes first."""

    def __call__(
        self, parser: argparse.ArgumentParser, parsed: argparse.Namespace, file: Any, _: object = None
    ) -> None:
        verbs = next(each.choices for each in parser._actions if each.dest == "verb")
        if str(file) in (verbs or ()) and not file.exists():
            parser.error(f"the centre's file comes first: {parser.prog} FILE {file} ...")
        parsed.file = file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file",
        type=Path,
        action=_CentreFile,
        help="the centre's file: stations, and what the centre knows of them",
    )
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="COMMAND")
    serving = verbs.add_parser("serve", help="store, serve and command")
    serving.add_argument("--page", type=Path, default=PAGE, help="the built page [its own]")
    collector = verbs.add_parser("collector", help="print the file for rtu-centre")
    collector.add_argument("--start", action="store_true", help="start rtu-centre with it instead")
    user = verbs.add_parser("user", help="add a user, or give a new role and password")
    user.add_argument("name")
    user.add_argument("--role", choices=ROLES, default="viewer")
    user.add_argument(
        "--group", action="append", default=[], help="only stations of this group; may be repeated [all]"
    )
    user.add_argument(
        "--no-second-factor", action="store_true", help="ask for no second factor any more: it is lost"
    )
    token = verbs.add_parser("token", help="print a new token, with the rights of a user, for a program")
    token.add_argument("name")
    token.add_argument("--label", default="command line", help="what it is for [command line]")
    token.add_argument(
        "--scope", choices=SCOPES, default="read", help="what it may at most: read, command, or all [read]"
    )
    token.add_argument("--days", type=float, default=365, help="how long it is good [365]")
    gateway = verbs.add_parser("web-users", help="print the users for the page of a station's gateway")
    gateway.add_argument("station", help="only those who see it")
    checking = verbs.add_parser("check", help="say what is wrong with process pictures")
    checking.add_argument("pictures", nargs="*", type=Path, help="SVG files [those of the folder]")
    verbs.add_parser("station", help="print the gateway's configuration that a higher centre is served by")


def run(parsed: argparse.Namespace) -> int:
    from openrtu_tools.centre import verbs

    return verbs.run(parsed)
