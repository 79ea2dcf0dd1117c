# SPDX-License-Identifier: GPL-3.0-or-later
"""What `openrtu centre` does: serve, and what belongs to it."""

from __future__ import annotations

import argparse
import asyncio
import getpass
import json
import logging
import os
import signal
import sys
from pathlib import Path
from typing import NoReturn

from aiohttp import web

from nuc980.errors import UnusableInput
from openrtu_tools.centre import higher, second, settings, users, web_users
from openrtu_tools.centre.api import ROUTES
from openrtu_tools.centre.centre import Centre
from openrtu_tools.centre.certificate import renew, tls_context
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.entrance import Entrance
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.notify import Notifier
from openrtu_tools.centre.pictures import check_links, check_names, load
from openrtu_tools.centre.push import Pusher
from openrtu_tools.centre.store import Database
from openrtu_tools.centre.web import Server
from openrtu_tools.programs import command

log = logging.getLogger("centre")

BY = "command line"


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
            await Entrance(runner, what.address, what.port, secured, what.proxies).start()
        except OSError as error:
            raise CentreError(f"{what.address} port {what.port}: {error.strerror}") from error
        log.info("serves http%s://%s:%s", "s" if secured else "", what.address, what.port)
        if not (page / "index.html").is_file():
            log.warning("the page is not built, programs alone are served: `make centre-page` builds it")
        always = centre.keep(), centre.roll_up(), centre.raise_due()
        working = [asyncio.create_task(work) for work in always]
        if what.tls and secured:
            working.append(asyncio.create_task(renew(what.tls, secured)))
        if what.mqtt:
            from openrtu_tools.centre.bus import Bus  # who has no broker needs no paho

            working.append(asyncio.create_task(Bus(centre, what.mqtt).run()))
        if what.push:
            working.append(asyncio.create_task(Pusher(centre, what.push).run()))
        if what.notify:
            working.append(asyncio.create_task(Notifier(centre, what.notify).run()))
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
        await centre.makers.close()
    finally:
        centre.close()


def add_user(what: settings.Settings, parsed: argparse.Namespace) -> None:
    """Asks for the password at a terminal; takes a line of stdin otherwise."""
    password = getpass.getpass() if sys.stdin.isatty() else sys.stdin.readline().rstrip("\n")
    store = open_store(what.database, alone=False)
    try:
        store.transaction(lambda database: put_user(database, parsed, password))
    finally:
        store.close()


def put_user(database: Database, parsed: argparse.Namespace, password: str) -> None:
    users.put(database, parsed.name, parsed.role, password, BY, parsed.group)
    if parsed.no_second_factor:
        second.end(database, parsed.name, BY)


def give_token(what: settings.Settings, name: str, wanted: users.Wanted) -> None:
    """Prints it."""
    store = open_store(what.database, alone=False)
    try:
        if not store.transaction(lambda database: users.row_of(database, name)):
            raise CentreError(f"there is no user {name}: `openrtu centre FILE user {name}` adds one")
        print(store.transaction(lambda database: users.begin(database, name, wanted)))
    finally:
        store.close()


def give_web_users(what: settings.Settings, station: str) -> None:
    """Prints them; who is left out is said beside it."""
    store = open_store(what.database, alone=False)
    try:
        lines, left_out = store.transaction(lambda database: web_users.users_of(database, what, station))
    finally:
        store.close()
    for each in left_out:
        print(f"openrtu centre: left out: {each}", file=sys.stderr)
    print("\n".join(lines))


def check_pictures(what: settings.Settings, files: list[Path]) -> int:
    """Prints each mistake with its file and line. Returns the exit code."""
    if not files and not what.pictures:
        raise UnusableInput("there is no picture: name one, or their folder in the centre's file")
    found = 0
    for file in files or sorted(what.pictures.glob("*.svg") if what.pictures else ()):
        drawing = load(file)
        named = check_names(drawing, what) + check_links(drawing, file.parent)
        for mistake in sorted([*drawing.mistakes, *named], key=lambda each: each.line):
            found += 1
            print(f"{file}:{mistake.line}: {mistake.text}")
        if drawing.is_refused:
            print(f"{file}: it is not shown")
    return 1 if found else 0


def give_station(what: settings.Settings) -> None:
    """Prints it; what is left out is said beside it."""
    configuration, left_out = higher.gateway(what)
    for each in left_out:
        print(f"openrtu centre: not for the higher centre: {each}", file=sys.stderr)
    print(json.dumps(configuration, indent=1))


def collector(what: settings.Settings) -> str:
    """The file for rtu-centre."""
    return json.dumps({**what.collector, "socket": str(what.socket)}, indent=1)


def start_collector(what: settings.Settings) -> NoReturn:
    """Becomes rtu-centre."""
    file = what.socket.with_name("rtu-centre.json")
    file.write_text(f"{collector(what)}\n")
    words = [*command("rtu-centre", "centre"), str(file)]
    os.execvp(words[0], words)


def run(parsed: argparse.Namespace) -> int:
    """What `openrtu centre` was asked for."""
    logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
    try:
        what = settings.load(parsed.file)
    except CentreError as error:
        raise UnusableInput(str(error)) from error
    if parsed.verb == "serve":
        asyncio.run(serve(what, parsed.page))
    elif parsed.verb == "user":
        add_user(what, parsed)
    elif parsed.verb == "token":
        wanted = users.Wanted(parsed.days * 86400, "", parsed.label, parsed.scope)
        give_token(what, parsed.name, wanted)
    elif parsed.verb == "web-users":
        give_web_users(what, parsed.station)
    elif parsed.verb == "station":
        give_station(what)
    elif parsed.verb == "check":
        return check_pictures(what, parsed.pictures)
    elif parsed.start:
        start_collector(what)
    else:
        print(collector(what))
    return 0
