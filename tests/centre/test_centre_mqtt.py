# SPDX-License-Identifier: GPL-3.0-or-later
"""What the centre says on MQTT, by TLS and a password, as mosquitto's own programs see it."""

import json
import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from control_room import Site, Stations, described, free_port, until
from lab.centre_client import LIMIT_S
from lab.vehicles import M_ME_TF_1, M_SP_TB_1, Station, measured, single
from openrtu_tools.centre.codes import State
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.settings import load

NORTH = "station/north%2Fone"
LEVEL = f"openrtu/{NORTH}/point/1/4"


class Broker:
    """Debian's mosquitto, and its programs that publish and subscribe."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self.folder = folder
        request = [
            "openssl",
            "req",
            "-x509",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:P-256",
            "-nodes",
        ]
        request += ["-keyout", "key.pem", "-out", "ca.pem", "-days", "2", "-subj", "/CN=a broker"]
        request += ["-addext", "subjectAltName=IP:127.0.0.1"]
        subprocess.run(request, cwd=folder, check=True, capture_output=True)
        for user, new in (("centre", ["-c"]), ("tests", [])):
            subprocess.run(["mosquitto_passwd", *new, "-b", "users", user, "secret"], cwd=folder, check=True)
        (folder / "mosquitto.conf").write_text(
            f"listener {self.port} 127.0.0.1\ncertfile {folder}/ca.pem\nkeyfile {folder}/key.pem\n"
            f"password_file {folder}/users\nallow_anonymous false\nuser {os.environ.get('USER', 'root')}\n"
        )
        self.process: subprocess.Popen[bytes] | None = None
        self.listening: subprocess.Popen[str] | None = None
        self.heard: list[tuple[str, Any]] = []
        self.start()

    def words(self) -> list[str]:
        where = ["-h", "127.0.0.1", "-p", str(self.port), "--cafile", f"{self.folder}/ca.pem"]
        return [*where, "-u", "tests", "-P", "secret"]

    def start(self) -> None:
        log = (self.folder / "mosquitto.log").open("a")
        self.process = subprocess.Popen(["mosquitto", "-c", self.folder / "mosquitto.conf"], stderr=log)
        until(lambda: self.say("begin", "{}", check=False), "the broker answers")
        self.listening = subprocess.Popen(
            ["mosquitto_sub", *self.words(), "-v", "-t", "openrtu/#"], stdout=subprocess.PIPE, text=True
        )
        threading.Thread(target=self._listen, args=[self.listening], daemon=True).start()

    def _listen(self, listening: subprocess.Popen[str]) -> None:
        assert listening.stdout
        for line in listening.stdout:
            topic, _, text = line.rstrip("\n").partition(" ")
            if topic != "openrtu/do":
                self.heard.append((topic, json.loads(text) if text and text != "(null)" else None))

    def stop(self) -> None:
        for process in (self.listening, self.process):
            assert process
            process.terminate()
            process.wait(LIMIT_S)

    def say(self, topic: str, text: str, *words: str, check: bool = True) -> bool:
        command = ["mosquitto_pub", *self.words(), "-t", f"openrtu/{topic}", "-m", text, *words]
        return subprocess.run(command, check=check, capture_output=True, timeout=LIMIT_S).returncode == 0

    def kept(self, topic: str) -> Any:
        """What somebody is told who comes now."""
        command = ["mosquitto_sub", *self.words(), "-t", topic, "-C", "1", "-W", "60"]
        done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=LIMIT_S)
        return json.loads(done.stdout)

    def last(self, topic: str) -> Any:
        return next((content for each, content in reversed(self.heard) if each == topic), None)


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    made = Broker(tmp_path)
    yield made
    made.stop()


@pytest.fixture
def station(stations: Stations) -> Iterator[Station]:
    made = stations.station()
    yield made
    stations.do(made.stop())


def settings(broker: Broker, **keys: Any) -> dict[str, Any]:
    (broker.folder / "password").write_text("secret\n")
    (broker.folder / "password").chmod(0o600)
    plain = {"host": "127.0.0.1", "port": broker.port, "user": "centre", "password_file": "password"}
    return {**plain, "tls": {"ca": "ca.pem"}, **keys}


@pytest.mark.slow
def test_all_that_changes_and_birth_and_death(
    programs: Path, stations: Stations, station: Station, broker: Broker, tmp_path: Path
) -> None:
    here = [described(station, tmp_path, "north/one")]

    def retained(topic: str) -> dict[str, Any]:
        return broker.last(f"openrtu/{topic}") or {}

    def say(value: float) -> None:
        stations.say(station, 4, M_ME_TF_1, measured(time.time_ns() // 1_000_000, value))
        until(lambda: (broker.last(LEVEL) or {}).get("value") == value, f"{value} is on the bus")

    pump = {"station": "north/one", "ca": 1, "ioa": 2, "value": 1, "id": "first"}
    with Site(programs, tmp_path, here, users=(), centre={"mqtt": settings(broker)}) as site:
        until(lambda: retained("centre").get("online"), "birth")
        until(lambda: retained(NORTH).get("link") == 3, "its link")
        birth = until(
            lambda: retained(f"{NORTH}/birth").get("online") and retained(f"{NORTH}/birth"), "its birth"
        )
        assert {"level", "pump"} <= {point["name"] for point in birth["points"]}
        say(2.5)
        stations.say(station, 5, M_SP_TB_1, single(time.time_ns() // 1_000_000, True))
        fire = until(lambda: [each for each, _ in broker.heard if "/alarm/" in each], "an alarm")
        assert broker.kept(fire[0])["station"] == "north/one"
        assert broker.kept(LEVEL)["name"] == "level"

        stations.do(station.stop())
        until(lambda: retained(f"{NORTH}/birth") == {"online": False}, "its death")
        stations.do(station.listen())
        until(lambda: retained(f"{NORTH}/birth").get("online"), "its birth")
        broker.say("centre", '{"online": false}', "-r")  # as the will of an old connection says it
        until(lambda: retained("centre").get("online"), "it lives")

        broker.say("do", json.dumps(pump))  # commands are not configured
        say(2.75)
        assert not broker.last("openrtu/answer")
        assert not station.commanded

        broker.stop()  # the broker is gone for a time, and has forgotten all
        stations.say(station, 4, M_ME_TF_1, measured(time.time_ns() // 1_000_000, 3.5))
        broker.heard.clear()
        broker.start()
        until(lambda: (broker.last(LEVEL) or {}).get("value") == 3.5, "what changed meanwhile")

        site.kill(site.centre)
        until(lambda: broker.last("openrtu/centre") == {"online": False}, "its last will")
        # What nobody took back, and a command of another time.
        broker.say("alarm/4711", "{}", "-r")
        broker.say("station/gone", "{}", "-r")
        broker.say("do", json.dumps(pump), "-r")
        content = json.loads(site.file.read_text())
        content["centre"]["mqtt"]["commands"] = True
        site.file.write_text(json.dumps(content))
        site.start_centre()
        until(lambda: ("openrtu/alarm/4711", None) in broker.heard, "an alarm of nobody is forgotten")
        until(lambda: ("openrtu/station/gone", None) in broker.heard, "a station of nobody is forgotten")
        until(lambda: retained("station/north%2Fone").get("link") == 3, "its link")
        assert not station.commanded
        for text in ("nothing", "[]", '{"value": NaN}', '{"value": 1}', '{"execute": 4711}'):
            broker.heard.clear()
            broker.say("do", text)
            assert "error" in until(lambda: broker.last("openrtu/answer"), f"an answer to {text}")
        broker.say("do", json.dumps(pump))
        number = until(lambda: retained("answer").get("id") and retained("answer")["command"], "an answer")
        command = f"command/{number}"
        until(lambda: retained(command).get("state") == State.ACCEPTED_SELECTION, "selected")
        broker.say("do", json.dumps({"execute": number}))
        until(lambda: retained(command).get("state") == State.EXECUTED_COMMAND, "executed")
        assert retained(command)["user"] == "mqtt"
        broker.heard.clear()
        assert site.centre
        site.centre.send_signal(signal.SIGTERM)
        until(lambda: broker.last("openrtu/centre") == {"online": False}, "it says that it goes")


def test_password_that_others_may_read(tmp_path: Path) -> None:
    (tmp_path / "password").write_text("secret\n")
    (tmp_path / "password").chmod(0o644)
    file = tmp_path / "centre.json"
    mqtt = {"host": "broker", "user": "centre", "password_file": "password", "tls": {}}
    file.write_text(json.dumps({"stations": [], "centre": {"mqtt": mqtt}}))
    made = load(file).mqtt
    assert made
    assert made.port == 8883
    with pytest.raises(CentreError, match="password: others may read it: chmod 600"):
        made.password()
    file.write_text(json.dumps({"stations": [], "centre": {"mqtt": {**mqtt, "prefix": "a/#"}}}))
    with pytest.raises(CentreError, match=r"mqtt\.prefix"):
        load(file)
