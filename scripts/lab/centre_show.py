# SPDX-License-Identifier: GPL-3.0-or-later
"""make centre: a control centre with 20 simulated RTUs: 18 vehicles on roads of the world, two gateways.

Exit code 0: every step succeeded; 1: one did not, with the reason.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import secrets
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lab import ports
from lab.centre_client import AnswerError, Client
from lab.errors import LabError
from lab.gateway import REPOSITORY, Gateway, default_build, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from lab.roads import WAYS, Road
from lab.show import DEADLINE_S, configuration, say, start_gateway, start_lines, tcp_port
from lab.vehicles import POSITION, Station, position
from lab.verdict import Verdict, run

PORT = 8104
USER = "operator"
HISTORY_S, EVERY_S = 2400, 10  # what a vehicle has in its queue when the centre comes
REPORT_S = 2.0
SPEED_M_S = 22.0
NO_FIX_S, PERIOD_S = 240, 1500  # of the one in the mountains
TUNNELS, SILENT, ABSENT = "Torino-Milano", "Oslo-Hamar", "Cape Town-Paarl"
PLANTS = {"substation Beograd": (44.79, 20.52, "Srbija"), "substation Niš": (43.34, 21.87, "Srbija")}
ALARMS = {
    "feeder10.protection-trip": {"state": 1, "priority": 1},
    "meter.door-open": {"state": 1, "priority": 3},
    "meter.voltage-l1": {"low": 220, "high": 240, "priority": 2},
}
AREAS = [
    {"name": "Milano", "circle": {"middle": [45.464, 9.19], "radius_m": 20000}, "alarm": "inside"},
    {"name": "Vojvodina", "polygon": [[44.8, 20.0], [45.2, 19.1], [46.1, 19.0], [46.1, 20.3], [44.8, 21.4]]},
]


class NotSeenError(LabError):
    """Something of the show did not happen as it should."""


# ---- vehicles ------------------------------------------------------------------------------------


def fix(road: Road, number: int, name: str, at_s: float) -> bytes:
    """Where the vehicle is at that time; no fix where the mountains are."""
    latitude, longitude = road.at(at_s * SPEED_M_S + number * 7000)
    lost = name == TUNNELS and at_s % PERIOD_S < NO_FIX_S
    return position(int(at_s * 1000), latitude, longitude, 120 + 11 * number, 0 if lost else 1)


async def parked(name: str, number: int) -> Station:
    """A vehicle that has driven for a while; it listens."""
    road, station = Road(WAYS[name]), Station()
    begun = int(time.time())
    for at_s in range(begun - HISTORY_S, begun, EVERY_S):
        station.say(1, POSITION, fix(road, number, name, at_s))
    await station.listen()
    return station


async def drive(name: str, number: int, station: Station) -> None:
    road = Road(WAYS[name])
    while name != SILENT:
        station.say(1, POSITION, fix(road, number, name, time.time()))
        await asyncio.sleep(REPORT_S)


@contextlib.contextmanager
def vehicles() -> Iterator[dict[str, int]]:
    """They drive in a thread of their own; their ports. Of the absent one, nobody listens on it."""
    loop = asyncio.new_event_loop()
    numbers = {name: number for number, name in enumerate(WAYS) if name != ABSENT}
    stations = {name: loop.run_until_complete(parked(name, number)) for name, number in numbers.items()}

    async def all_of_them() -> None:
        await asyncio.gather(*(drive(name, numbers[name], stations[name]) for name in stations))

    task = loop.create_task(all_of_them())

    def work() -> None:
        with contextlib.suppress(asyncio.CancelledError):
            loop.run_until_complete(task)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        with socket.socket() as absent:
            absent.bind(("127.0.0.1", 0))
            ports_of = {name: station.port for name, station in stations.items()}
            yield ports_of | {ABSENT: absent.getsockname()[1]}
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join()


# ---- gateways ------------------------------------------------------------------------------------


@contextlib.contextmanager
def plant(directory: Path, verdict: Verdict) -> Iterator[tuple[LineSim, Gateway]]:
    """The gateway of chapter 5 with its devices, some of which change."""
    directory.mkdir(mode=0o755)
    config = listening_on(configuration(), free_port())
    with contextlib.ExitStack() as stack:
        file = directory / "linesim.json"
        file.write_text(json.dumps(config))
        lines = start_lines(stack, directory, file, verdict)
        yield lines, start_gateway(stack, directory, config, verdict)


def live(lines: LineSim, ended: threading.Event) -> None:
    """The devices measure."""
    number = 0
    while not ended.wait(3.0):
        number += 1
        swing = (number * 37) % 23 - 11
        with contextlib.suppress(LabError):
            lines.set("3.67", "input_registers", 0, 1495 + swing)
            lines.set("3.35", "input_registers", 0, 215 + swing // 3)


# ---- the centre ----------------------------------------------------------------------------------


@dataclass
class Show:
    """What the steps work on."""

    client: Client
    lines: LineSim

    def until(self, path: str, found: Callable[[Any], Any], what: str) -> Any:
        end = time.monotonic() + DEADLINE_S
        while not (something := found(self.client.get(path))):
            if time.monotonic() > end:
                raise NotSeenError(f"not within {DEADLINE_S:.0f} s: {what}", expected=what, late=True)
            time.sleep(0.2)
        return something

    def point(self, name: str) -> dict[str, Any]:
        return next(each for each in self.client.get("/api/points") if each["name"] == name)


def environment() -> dict[str, str]:
    rtud = os.environ.get("OPENRTU_RTUD", f"{default_build() / 'rtud' / 'rtud'}")
    return {**os.environ, "PYTHONPATH": f"{REPOSITORY}/scripts", "OPENRTU_RTUD": rtud}


def centre_command(file: Path, *words: str) -> list[str]:
    return [sys.executable, "-m", "openrtu_tools", "centre", f"{file}", *words]


def told(file: Path, *words: str, stdin: str = "") -> str:
    done = subprocess.run(
        centre_command(file, *words),
        input=stdin,
        capture_output=True,
        text=True,
        env=environment(),
        check=False,
    )
    if done.returncode:
        raise NotSeenError(done.stderr.strip())
    return done.stdout


@contextlib.contextmanager
def started(command: list[str], log_file: Path, verdict: Verdict) -> Iterator[None]:
    """A process that must not end."""
    name = log_file.stem
    with log_file.open("ab") as log:
        process = subprocess.Popen(
            ["setpriv", "--pdeathsig", "TERM", *command], stderr=log, env=environment()
        )
    verdict.sources[name] = lambda: log_file.read_text(errors="replace")[-4000:]
    verdict.causes.append(lambda: f"{name} has ended" if process.poll() is not None else "")
    try:
        yield
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()


def start_centre(
    stack: contextlib.ExitStack, file: Path, folder: Path, port: int, verdict: Verdict
) -> Client:
    """Both processes and a user; prints how to get in."""
    password = secrets.token_urlsafe(9)
    told(file, "user", USER, "--role", "engineer", stdin=password)
    collector = folder / "rtu-centre.json"
    collector.write_text(told(file, "collector"))
    program = f"{default_build() / 'centre' / 'rtu-centre'}"
    stack.enter_context(started([program, f"{collector}"], folder / "rtu-centre.log", verdict))
    stack.enter_context(started(centre_command(file, "serve"), folder / "centre.log", verdict))
    client = Client(port)
    end = time.monotonic() + DEADLINE_S
    while True:
        try:
            client.login(USER, password)
            break
        except (OSError, AnswerError) as error:
            if time.monotonic() > end:
                raise NotSeenError(f"the centre does not answer: {error}", late=True) from error
            time.sleep(0.1)
    say()
    say(f"   The control centre:  http://127.0.0.1:{port}")
    say(f"   user {USER}, password {password} (of this run only)")
    return client


# ---- the steps -----------------------------------------------------------------------------------


def stations_are_up(show: Show) -> None:
    """19 of 20 stations are connected; one does not answer"""
    up = show.until(
        "/api/stations",
        lambda found: [each["name"] for each in found if each["link"] == 3][19 - 1 :] and found,
        "19 stations are connected",
    )
    lost = [station["name"] for station in up if station["link"] != 3]
    say(f"     connected    {len(up) - len(lost)}; not: {', '.join(lost)}")


def vehicle_moves(show: Show) -> None:
    """A vehicle is where it was, and moves; its track has a gap in the tunnel"""
    names = {station["id"]: station["name"] for station in show.client.get("/api/stations")}
    places = show.until(
        "/api/points",
        lambda found: (
            places if len(places := [point for point in found if "fix" in point]) >= len(WAYS) - 1 else None
        ),
        "a position of each vehicle that is there",
    )
    first = next(place for place in places if names[place["station"]] == "Beograd-Novi Sad")
    moved = show.until(
        "/api/points",
        lambda found: next(
            (each for each in found if each["id"] == first["id"] and each["longitude"] != first["longitude"]),
            None,
        ),
        "it moves",
    )
    say(f"     {names[first['station']]}  {moved['latitude']:.5f}, {moved['longitude']:.5f}")
    mountains = next(place for place in places if names[place["station"]] == TUNNELS)
    path = f"/api/tracks?point={mountains['id']}"
    ways = show.until(path, lambda found: found["features"][1:] and found["features"], "a track with a gap")
    say(f"     {TUNNELS}  {len(ways)} segments")


def command(show: Show) -> None:
    """A command: selected, executed, confirmed by the device"""
    point = show.point("feeder10.breaker-command")
    sent = show.client.post("/api/commands", {"point": point["id"], "value": 2})
    path = f"/api/commands/{sent['id']}"
    show.until(path, lambda now: now["state"] == 2, "the selection is accepted")
    say("     selected     the station has accepted")
    show.client.post(f"{path}/execute")
    show.until(path, lambda now: now["state"] == 9, "the command is executed")
    say("     executed     the device has confirmed")


def unplugged(show: Show) -> None:
    """A device is unplugged: one alarm, acknowledged; it ends with its cause"""
    show.lines.fault("3.67", "mute")
    alarms = show.until(
        "/api/alarms",
        lambda found: [each for each in found if each["kind"] == "quality" and each["ca"] == 3067],
        "an alarm",
    )
    say(f"     alarm        points of CA 3067 are invalid, {alarms[0]['value']:.0f} at first")
    show.client.post(f"/api/alarms/{alarms[0]['id']}/acknowledge")
    show.lines.fault("3.67", "clear")
    show.until(
        "/api/alarms", lambda found: all(each["id"] != alarms[0]["id"] for each in found), "the alarm ends"
    )
    say("     ended        the device answers again")


STEPS = (stations_are_up, vehicle_moves, command, unplugged)


# ---- the whole -----------------------------------------------------------------------------------


def stay() -> None:
    say("Ctrl-C ends it.")
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    stopped.wait()


def described(name: str, port: int, ca: list[int], **keys: Any) -> dict[str, Any]:
    return {"name": name, "address": "127.0.0.1", "port": port, "common_addresses": ca, **keys}


def show(port: int, keep: bool, verdict: Verdict) -> None:
    """The simulated world. Raises what went wrong."""
    ports.check_free(port, "make centre")
    directory = run_directory()
    say("OpenRTU: a control centre with 18 vehicles and two gateways")
    with contextlib.ExitStack() as stack, verdict.watched():
        stack.callback(remove, directory)
        taken = stack.enter_context(vehicles())
        stations = [described(name, taken[name], [1], group="vehicles", clock_s=3600) for name in WAYS]
        ended = threading.Event()
        first = None
        for number, (name, (latitude, longitude, group)) in enumerate(PLANTS.items()):
            lines, gateway = stack.enter_context(plant(directory / f"plant{number}", verdict))
            cas = [1010, 2020, 3035, 3067, 3155, 3201, 4040]
            keys = {"points": f"{gateway.config_file}", "alarms": ALARMS, "location": [latitude, longitude]}
            stations.append(described(name, gateway.address[1], cas, group=group, **keys))
            threading.Thread(target=live, args=(lines, ended), daemon=True).start()
            first = first or lines
        stack.callback(ended.set)
        file = directory / "centre.json"
        file.write_text(
            json.dumps({"stations": stations, "retry_ms": 500, "centre": {"port": port, "areas": AREAS}})
        )
        client = start_centre(stack, file, directory, port, verdict)
        assert first
        for number, step in enumerate(STEPS, 1):
            verdict.expected = f"step {number}: {step.__doc__}"
            say()
            say(f"{number:2d}. {step.__doc__}")
            step(Show(client, first))
        say()
        say(f"All {len(STEPS)} steps succeeded.")
        if keep:
            stay()


def own_stations(file: Path, port: int, verdict: Verdict) -> None:
    """The stations of the user's own file; what they say stays where the file says."""
    ports.check_free(port, "make centre")
    folder = REPOSITORY / "build" / "centre" / "run"
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as stack:
        start_centre(stack, file, folder, port, verdict)
        stay()


def main() -> int:
    parser = argparse.ArgumentParser(prog="make centre", description=__doc__.partition("\n\n")[0])
    parser.add_argument("--port", type=tcp_port, default=PORT, help=f"TCP port of the page [{PORT}]")
    parser.add_argument("--keep", action="store_true", help="stay up afterwards")
    parser.add_argument("--stations", type=Path, help="the centre's file, instead of simulated stations")
    arguments = parser.parse_args()
    verdict = Verdict("make centre", "centre")
    if not arguments.stations:
        return run(verdict, lambda: show(arguments.port, arguments.keep, verdict))
    try:
        port = json.loads(arguments.stations.read_text()).get("centre", {}).get("port", PORT)
    except (OSError, ValueError) as error:
        print(f"make centre: {arguments.stations}: {error}", file=sys.stderr)
        return 2
    return run(verdict, lambda: own_stations(arguments.stations, port, verdict))


if __name__ == "__main__":
    sys.exit(main())
