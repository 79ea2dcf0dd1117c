# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m openrtu_tools.centre: the control centre. docs/control-centre.md.

Exit codes: 0 done, 1 the centre could not do it, 2 wrong usage.
"""

from __future__ import annotations

import argparse
import asyncio
import getpass
import json
import logging
import signal
import sys
from pathlib import Path

from aiohttp import web

from openrtu_tools.centre import higher, settings, users
from openrtu_tools.centre.api import ROUTES
from openrtu_tools.centre.centre import Centre
from openrtu_tools.centre.certificate import renew, tls_context
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.push import Pusher
from openrtu_tools.centre.web import Server

PAGE = Path(__file__).resolve().parent.parent / "build" / "centre" / "page"


async def serve(what: settings.Settings, page: Path) -> None:
    """Until it is told to end."""
    ended = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, ended.set)
    centre = Centre(what)
    try:
        secured = tls_context(what.tls) if what.tls else None
        runner = web.AppRunner(Server(centre, ROUTES, page).application, access_log=None)
        await runner.setup()
        try:
            await web.TCPSite(
                runner, what.address, what.port, shutdown_timeout=1, ssl_context=secured
            ).start()
        except OSError as error:
            raise CentreError(f"{what.address} port {what.port}: {error.strerror}") from error
        logging.getLogger("centre").info(
            "serves http%s://%s:%s", "s" if secured else "", what.address, what.port
        )
        working = [asyncio.create_task(centre.keep())]
        if what.tls and secured:
            working.append(asyncio.create_task(renew(what.tls, secured)))
        if what.mqtt:
            from openrtu_tools.centre.bus import Bus  # who has no broker needs no paho

            working.append(asyncio.create_task(Bus(centre, what.mqtt).run()))
        if what.push:
            working.append(asyncio.create_task(Pusher(centre, what.push).run()))
        collecting = asyncio.create_task(centre.collect())
        ending = asyncio.create_task(ended.wait())
        await asyncio.wait((collecting, ending), return_when=asyncio.FIRST_COMPLETED)
        if collecting.done():
            collecting.result()
        centre.ending = True
        for task in (collecting, *working):
            task.cancel()
        await asyncio.gather(collecting, *working, return_exceptions=True)
        await runner.cleanup()
    finally:
        centre.close()


def add_user(what: settings.Settings, name: str, role: str, groups: list[str]) -> None:
    """Asks for the password at a terminal; takes a line of stdin otherwise."""
    password = getpass.getpass() if sys.stdin.isatty() else sys.stdin.readline().rstrip("\n")
    store = open_store(what.database, alone=False)
    try:
        store.transaction(lambda database: users.put(database, name, role, password, "command line", groups))
    finally:
        store.close()


def give_token(what: settings.Settings, name: str, label: str, days: float) -> None:
    """Prints it."""
    store = open_store(what.database, alone=False)
    try:
        if not store.transaction(lambda database: users.exists(database, name)):
            raise CentreError(
                f"there is no user {name}: `python -m openrtu_tools.centre FILE user {name}` adds one"
            )
        print(store.transaction(lambda database: users.begin(database, name, label, days * 86400)))
    finally:
        store.close()


def give_station(what: settings.Settings) -> None:
    """Prints it; what is left out is said beside it."""
    configuration, left_out = higher.gateway(what)
    for each in left_out:
        print(f"centre: not for the higher centre: {each}", file=sys.stderr)
    print(json.dumps(configuration, indent=1))


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m openrtu_tools.centre", description=__doc__.partition("\n\n")[0]
    )
    parser.add_argument(
        "file", type=Path, help="the centre's file: stations, and what the centre knows of them"
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    serving = verbs.add_parser("serve", help="store, serve and command")
    serving.add_argument("--page", type=Path, default=PAGE, help="the built page [build/centre/page]")
    verbs.add_parser("collector", help="print the file for rtu-centre")
    user = verbs.add_parser("user", help="add a user, or give a new role and password")
    user.add_argument("name")
    user.add_argument("--role", choices=users.ROLES, default="viewer")
    user.add_argument(
        "--group", action="append", default=[], help="only stations of this group; may be repeated [all]"
    )
    token = verbs.add_parser("token", help="print a new token, with the rights of a user, for a program")
    token.add_argument("name")
    token.add_argument("--label", default="command line", help="what it is for [command line]")
    token.add_argument("--days", type=float, default=365, help="how long it is good [365]")
    verbs.add_parser("station", help="print the gateway's configuration that a higher centre is served by")
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
    try:
        what = settings.load(arguments.file)
        if arguments.verb == "serve":
            asyncio.run(serve(what, arguments.page))
        elif arguments.verb == "user":
            add_user(what, arguments.name, arguments.role, arguments.group)
        elif arguments.verb == "token":
            give_token(what, arguments.name, arguments.label, arguments.days)
        elif arguments.verb == "station":
            give_station(what)
        else:
            print(json.dumps({**what.collector, "socket": str(what.socket)}, indent=1))
    except CentreError as error:
        print(f"centre: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
