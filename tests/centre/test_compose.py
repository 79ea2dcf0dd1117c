# SPDX-License-Identifier: GPL-3.0-or-later
"""compose.yaml without an engine: its images and files, with Debian's PostgreSQL and mosquitto."""

import json
import os
import secrets
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

import postgres
from rig import containers
from rig.containers import MADE, Container, Network
from rig.rights import SUPERUSER, needed

pytestmark = [
    pytest.mark.slow,
    needed(SUPERUSER, "another root is entered, as a container does"),
]
SERVICES = containers.compose()["services"]
ADDRESS = SERVICES["gateway"]["networks"]["plant"]["ipv4_address"]
# A program of the network that asks the centre, since who tests is not in there.
ASK = """
import json, sys
from lab.centre_client import Client
path, name, password = sys.argv[1:]
print(json.dumps(Client(8104).login(name, password).get(path)))
"""


def container(service: str, folder: Path) -> Container:
    """With the mounts of its service; those that are volumes are its own folders here."""
    described = SERVICES[service]
    name = described["image"].removeprefix("localhost/openrtu-").partition(":")[0]
    files = [mount.split(":") for mount in described["volumes"]]
    mounts = {(MADE / source).resolve(): inside for source, inside, *_ in files}
    (tmpfs,) = described["tmpfs"]
    rights = described.get("cap_add", ())
    return Container(containers.image(name), folder / service, rights, mounts, tmpfs=tmpfs)


class Database(postgres.Server):
    """In the network of the containers."""

    def __init__(self, net: Network) -> None:
        super().__init__()
        self.before = [str(word) for word in net.inside(*self.before)]


@pytest.fixture
def net() -> Iterator[Network]:
    with containers.network(ADDRESS) as net:
        yield net


@pytest.fixture
def database(net: Network, monkeypatch: pytest.MonkeyPatch) -> Iterator[Database]:
    monkeypatch.setattr(
        postgres, "SETTINGS", postgres.SETTINGS.replace("listen_addresses=", "listen_addresses=127.0.0.1")
    )
    with Database(net) as server:
        server._run(
            "createdb",
            "-h",
            str(server.folder),
            "-U",
            "centre",
            SERVICES["postgresql"]["environment"]["POSTGRES_DB"],
        )
        yield server


@pytest.fixture
def broker(net: Network, tmp_path: Path) -> Iterator[None]:
    file = (MADE / SERVICES["mosquitto"]["volumes"][0].split(":")[0]).resolve()
    with (tmp_path / "mosquitto.log").open("wb") as log:
        process = subprocess.Popen(net.inside("mosquitto", "-c", file), stdout=log, stderr=log)
    yield
    process.terminate()
    process.wait()


def test_all_of_it_by_its_own_files(net: Network, database: Database, broker: None, tmp_path: Path) -> None:
    """From a device's register to the page's interface, the table of PostgreSQL and the topic of MQTT."""
    gateway, centre = container("gateway", tmp_path), container("centre", tmp_path)
    with (centre.root / "etc/hosts").open("a") as hosts:
        hosts.write("127.0.0.1 postgresql mosquitto\n")
    password = secrets.token_urlsafe()

    def ask(path: str) -> Any:
        done = subprocess.run(
            net.inside(sys.executable, "-c", ASK, path, "anna", password),
            env=os.environ | {"PYTHONPATH": str(containers.ROOT / "scripts")},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        return json.loads(done.stdout) if done.returncode == 0 else []

    with ExitStack() as stack:
        stack.enter_context(gateway.running(net))
        stack.enter_context(centre.running(net))
        words = ("openrtu", "centre", "/etc/openrtu-centre/centre.json", "user", "anna", "--role", "engineer")
        centre.until(lambda: centre.execute(*words, stdin=password).returncode == 0, "a user is made")
        centre.until(
            lambda: any(station["link"] == 3 for station in ask("/api/stations")), "the station is polled"
        )
        centre.until(
            lambda: any(point.get("quality") == 0 for point in ask("/api/points")), "a point is good"
        )
        stored = (
            "psql",
            "-h",
            str(database.folder),
            "-U",
            "centre",
            "-c",
            "SELECT 1 FROM points LIMIT 1",
            "-Atq",
            "centre",
        )
        assert database._run(*stored) == "1\n"
        heard = [
            "mosquitto_sub",
            "-h",
            "127.0.0.1",
            "-t",
            "openrtu/station/substation",
            "-C",
            "1",
            "-W",
            "60",
        ]
        done = subprocess.run(net.inside(*heard), capture_output=True, text=True, check=True)
        assert json.loads(done.stdout)["link"] == 3
