# SPDX-License-Identifier: GPL-3.0-or-later
"""make centre: a control centre with 20 RTUs: 18 vehicles on roads of the world, two gateways with devices.

Exit code 0: every step succeeded; 1: one did not, with the reason.
"""

from __future__ import annotations

import argparse
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
from lab.fleet import CA, Vehicle, driving, vehicle
from lab.gateway import REPOSITORY, Gateway, default_build, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from lab.process import Plant, named
from lab.roads import WAYS
from lab.show import DEADLINE_S, configuration, say, start_gateway, start_lines, tcp_port
from lab.verdict import Verdict, run
from openrtu_tools.centre.codes import INVALID

PORT = 8104
USER = "operator"
TUNNELS, ABSENT = "Torino-Milano", "Cape Town-Paarl"
UNSURE = {TUNNELS, "Oslo-Hamar", ABSENT}  # their places are not good all the time
# What the gateways of some receivers count of their clocks.
COUNTED = {
    "Kraków-Katowice": "clock_steps",
    "Barcelona-Girona": "dates_refused",
    "Mumbai-Pune": "era_corrected",
}
TIMELY_S = 60.0  # a busy host is late
PLANTS = {
    "substation Beograd": (44.79, 20.52, "Srbija"),
    "pumping station Niš": (43.34, 21.87, "Srbija"),
}
PICTURES = REPOSITORY / "docs" / "examples" / "pictures"
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


@contextlib.contextmanager
def vehicles(verdict: Verdict) -> Iterator[dict[str, Vehicle]]:
    """They drive, by name; all but the absent one."""
    present = {name: number for number, name in enumerate(WAYS) if name != ABSENT}
    with contextlib.ExitStack() as stack:
        fleet = {name: stack.enter_context(vehicle(name, number)) for name, number in present.items()}
        for name, each in fleet.items():
            verdict.sources[name] = each.gateway.log
        stack.enter_context(driving(list(fleet.values())))
        yield fleet


@contextlib.contextmanager
def unheard_port() -> Iterator[int]:
    """Nobody listens on it, and nobody else gets it."""
    with socket.socket() as absent:
        absent.bind(("127.0.0.1", 0))
        yield absent.getsockname()[1]


# ---- gateways ------------------------------------------------------------------------------------


@contextlib.contextmanager
def plant(directory: Path, verdict: Verdict) -> Iterator[tuple[LineSim, Gateway]]:
    """The gateway of chapter 5 with its devices, some of which change."""
    directory.mkdir(mode=0o755)
    config = listening_on(named(configuration()), free_port())
    with contextlib.ExitStack() as stack:
        file = directory / "linesim.json"
        file.write_text(json.dumps(config))
        lines = start_lines(stack, directory, file, verdict)
        yield lines, start_gateway(stack, directory, config, verdict)


# ---- the centre ----------------------------------------------------------------------------------


@dataclass
class Show:
    """What the steps work on."""

    client: Client
    lines: LineSim
    fleet: dict[str, Vehicle]

    def until(self, path: str, found: Callable[[Any], Any], what: str) -> Any:
        end = time.monotonic() + DEADLINE_S
        while not (something := found(self.client.get(path))):
            if time.monotonic() > end:
                raise NotSeenError(f"not within {DEADLINE_S:.0f} s: {what}", expected=what, late=True)
            time.sleep(0.2)
        return something

    def point(self, name: str) -> dict[str, Any]:
        return next(each for each in self.client.get("/api/points") if each["name"] == name)

    def places(self, found: Any) -> dict[str, dict[str, Any]]:
        """Of a list of points, the position of each vehicle that has told one, by its name."""
        names = {station["id"]: station["name"] for station in self.client.get("/api/stations")}
        return {names[point["station"]]: point for point in found if "fix" in point}

    def until_place(self, name: str, fits: Callable[[dict[str, Any]], bool], what: str) -> dict[str, Any]:
        """A vehicle's place, as soon as it is so."""

        def look(found: Any) -> dict[str, Any] | None:
            place = self.places(found).get(name)
            return place if place and fits(place) else None

        place: dict[str, Any] = self.until("/api/points", look, what)
        return place


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
    """Each vehicle has a place, and moves, whatever its receiver's whim"""
    sure = set(WAYS) - UNSURE

    def all_good(found: Any) -> dict[str, dict[str, Any]]:
        places = show.places(found)
        good = {name for name, place in places.items() if place["quality"] == 0}
        return places if good >= sure else {}

    first = show.until("/api/points", all_good, "a good position of each vehicle that can have one")
    for name in sorted(sure):
        before = first[name]["longitude"]
        moved = show.until_place(
            name, lambda place, before=before: place["longitude"] != before, f"{name} moves"
        )
        whim = show.fleet[name].whim.name.lower().replace("_", " ")
        say(f"     {name:20}  {moved['latitude']:10.5f}, {moved['longitude']:10.5f}  {whim}")


def tunnel(show: Show) -> None:
    """A vehicle loses its fix in a tunnel: its last place stays, invalid; then it comes back"""
    show.until_place(TUNNELS, lambda place: place["quality"] == 0, f"{TUNNELS} knows its place")
    show.fleet[TUNNELS].tunnel.set()
    lost = show.until_place(
        TUNNELS, lambda place: bool(place["quality"] & INVALID) and place["fix"] == 0, "it has lost its fix"
    )
    say(f"     lost         {lost['latitude']:.5f}, {lost['longitude']:.5f} is invalid")
    show.fleet[TUNNELS].tunnel.clear()
    found = show.until_place(TUNNELS, lambda place: place["quality"] == 0, "it has found a fix")
    say(f"     found        {found['latitude']:.5f}, {found['longitude']:.5f}")
    if abs(lost["latitude"] - found["latitude"]) + abs(lost["longitude"] - found["longitude"]) > 0.1:
        raise NotSeenError("the place that is invalid is not the last one", expected="its last place")
    path = f"/api/tracks?point={found['id']}"
    ways = show.until(path, lambda found: found["features"][1:] and found["features"], "a track with a gap")
    say(f"     track        {len(ways)} segments")


def clocks(show: Show) -> None:
    """Receivers with a wrong clock or date: their vehicles go on, at the right time"""
    for name, counter in COUNTED.items():
        gateway = show.fleet[name].gateway
        gateway.wait_for(lambda of=gateway, what=counter: of.query("gps")[0][what] > 0, DEADLINE_S, counter)
        before = show.until_place(name, lambda place: place["quality"] == 0, f"the place of {name}")
        after = show.until_place(
            name, lambda place, at=before["at"]: place["quality"] == 0 and place["at"] > at, f"{name} goes on"
        )
        late_s = time.time() - after["at"] / 1000
        if abs(late_s) > TIMELY_S:
            raise NotSeenError(f"{name} is {late_s:.0f} s late", expected="the time of its fix")
        say(f"     {name:20}  {counter.replace('_', ' ')}: {gateway.query('gps')[0][counter]}")


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


STEPS = (stations_are_up, vehicle_moves, tunnel, clocks, command, unplugged)


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
        fleet = stack.enter_context(vehicles(verdict))
        stations = [
            described(
                name, each.port, [CA], group="vehicles", clock_s=3600, points=f"{each.gateway.config_file}"
            )
            for name, each in fleet.items()
        ]
        unheard = stack.enter_context(unheard_port())
        stations.append(described(ABSENT, unheard, [CA], group="vehicles"))
        ended = threading.Event()
        first = None
        for number, (name, (latitude, longitude, group)) in enumerate(PLANTS.items()):
            lines, gateway = stack.enter_context(plant(directory / f"plant{number}", verdict))
            cas = [1010, 2020, 3035, 3067, 3155, 3201, 4040]
            keys = {"points": f"{gateway.config_file}", "alarms": ALARMS, "location": [latitude, longitude]}
            stations.append(described(name, gateway.address[1], cas, group=group, **keys))
            threading.Thread(target=Plant(lines).run, args=(ended,), daemon=True).start()
            first = first or lines
        stack.callback(ended.set)
        file = directory / "centre.json"
        centre = {"port": port, "areas": AREAS, "pictures": f"{PICTURES}"}
        file.write_text(json.dumps({"stations": stations, "retry_ms": 500, "centre": centre}))
        client = start_centre(stack, file, directory, port, verdict)
        assert first
        for number, step in enumerate(STEPS, 1):
            verdict.expected = f"step {number}: {step.__doc__}"
            say()
            say(f"{number:2d}. {step.__doc__}")
            step(Show(client, first, fleet))
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
