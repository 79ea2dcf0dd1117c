# SPDX-License-Identifier: GPL-3.0-or-later
"""Images for containers: as another program reads them, and the gateway's without an engine."""

import json
import os
import re
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from rig import containers
from rig.containers import ROOT, Container
from rig.rights import SUPERUSER, needed

pytestmark = pytest.mark.slow
NEEDS_ROOT = needed(SUPERUSER, "only root enters another root, as a container does")
GATEWAY = containers.compose()["services"]["gateway"]
FILES = {containers.MADE / f"show/{name}": f"/etc/openrtu/{name}" for name in ("gateway.json", "values.json")}
UID_BASE = 61200


def inspected(archive: Path, *words: str) -> dict[str, object]:
    done = subprocess.run(
        ["skopeo", "inspect", *words, f"oci-archive:{archive}"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    answer: dict[str, object] = json.loads(done.stdout)
    return answer


def archive_of(folder: Path, name: str, *, modified: int) -> Path:
    """An archive of a root with one file."""
    (folder / "file").write_text("content")
    root = folder / "root.tar"
    with tarfile.open(root, "w") as tar:
        entry = tar.gettarinfo(folder / "file", "etc/file")
        entry.mtime = 0
        with (folder / "file").open("rb") as content:
            tar.addfile(entry, content)
    os.utime(root, (modified, modified))
    out = folder / name
    subprocess.run(
        [sys.executable, ROOT / "scripts/oci-archive.py", root, out, "--name", "openrtu-x:1.0",
         "--architecture", "arm64", "--created", "86400", "--port", "2404", "--user", "somebody",
         "--", "start", "--now"], check=True,
    )  # fmt: skip
    return out


def test_archive_is_read_by_others(tmp_path: Path) -> None:
    archive = archive_of(tmp_path, "image.tar", modified=1)
    found = inspected(archive)
    assert (found["Architecture"], found["Os"], found["Created"]) == (
        "arm64",
        "linux",
        "1970-01-02T00:00:00Z",
    )
    config = inspected(archive, "--config")["config"]
    assert isinstance(config, dict)
    assert (config["Entrypoint"], config["User"]) == (["start", "--now"], "somebody")
    assert config["ExposedPorts"] == {"2404/tcp": {}}
    copied = tmp_path / "copied"
    subprocess.run(["skopeo", "copy", "--quiet", f"oci-archive:{archive}", f"dir:{copied}"], check=True)
    (layer,) = [blob for blob in copied.iterdir() if tarfile.is_tarfile(blob)]
    with tarfile.open(layer) as tar:
        assert tar.getnames() == ["etc/file"]


def test_same_root_gives_the_same_archive(tmp_path: Path) -> None:
    one, other = (archive_of(tmp_path, f"{number}.tar", modified=number) for number in (1, 2))
    assert one.read_bytes() == other.read_bytes()


def test_the_shows_simulator_is_the_same_from_each_folder(linesim_program: Path) -> None:
    """What debuggers are told would name the folder of the build, and the build ID is made of that, too."""
    assert str(ROOT).encode() not in linesim_program.read_bytes()


@NEEDS_ROOT
def test_what_is_mounted_is_readable_whatever_its_makers_mask() -> None:
    """The centre's container runs as a user who is nobody outside."""
    containers.image("show")
    mounted = [file for file in (containers.MADE / "show").iterdir() if file.is_file()]
    assert mounted and all(file.stat().st_mode & 0o044 == 0o044 for file in mounted)


@NEEDS_ROOT
def test_gateway_runs_with_the_capabilities_that_are_named(tmp_path: Path) -> None:
    """linesim's devices are polled, each module is a user of its own and has no capability."""
    gateway = Container(containers.image("show"), tmp_path / "root", GATEWAY["cap_add"], FILES)
    with gateway.running():
        gateway.until(
            lambda: gateway.execute(*GATEWAY["healthcheck"]["test"][1:]).returncode == 0, "it is well"
        )
        gateway.until(lambda: "good" in points(gateway), "a point is good")
        modules = json.loads(gateway.execute("rtuctl", "--json", "modules").stdout)
        running = [module for module in modules if module["pid"] and module["name"] != "rtud"]
        status = {module["name"]: Path(f"/proc/{module['pid']}/status").read_text() for module in running}
        users = {int(text.partition("\nUid:\t")[2].split()[0]) for text in status.values()}
        assert len(running) == len(users) == 3 and min(users) > UID_BASE
        assert all("\nCapBnd:\t0000000000000000\n" in text for text in status.values())
        assert "real-time priority" not in gateway.log()
        os.kill(running[0]["pid"], 19)  # SIGSTOP
        gateway.until(lambda: gateway.execute("gateway-health").returncode != 0, "that it is not well")


def points(gateway: Container) -> set[str]:
    done = gateway.execute("rtuctl", "--json", "points")
    return {point["quality"] for point in json.loads(done.stdout)} if done.returncode == 0 else set()


@NEEDS_ROOT
def test_image_has_nothing_of_the_machine_that_made_it(tmp_path: Path) -> None:
    """Neither its name nor its name servers, and apt asks Debian's own servers, not its mirror."""
    etc = Container(containers.image("gateway"), tmp_path / "root").root / "etc"
    assert [name for name in ("hostname", "resolv.conf", "machine-id") if (etc / name).exists()] == []
    servers = re.findall(r"^deb \w+://([^/]+)/", (etc / "apt/sources.list").read_text(), re.MULTILINE)
    assert len(servers) == 3
    assert {server.partition(".")[2] for server in servers} == {"debian.org"}


@NEEDS_ROOT
def test_gateway_without_root_says_what_is_lost(tmp_path: Path) -> None:
    config = tmp_path / "gateway.json"
    config.write_text(json.dumps({"iec104": {"address": "127.0.0.1"}, "port": []}))
    own = tmp_path / "map"
    own.mkdir()
    os.chown(own, 65534, 65534)
    mounts = {config: "/etc/openrtu/gateway.json", own: "/run/openrtu"}
    gateway = Container(containers.image("gateway"), tmp_path / "root", mounts=mounts, user="65534")
    with containers.network("127.0.0.2") as net, gateway.running(net):
        gateway.until(lambda: gateway.execute("gateway-health").returncode == 0, "it is well")
        assert "not started as root: all modules run as user 65534" in gateway.log()
    config_of = inspected(gateway.archive, "--config")["config"]
    assert isinstance(config_of, dict) and config_of["Entrypoint"] == ["gateway-start"]
