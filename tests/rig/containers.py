# SPDX-License-Identifier: GPL-3.0-or-later
"""Containers without an engine: an image's root and command, with mounts, rights and user, in a chroot."""

import json
import subprocess
import tarfile
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import yaml

from lab.patience import Deadline
from rig.packaged import alone, packages

ROOT = Path(__file__).resolve().parents[2]
MADE = ROOT / "build/tested-containers"
PATIENCE_S = 60.0
# A shell's: the root, a folder in memory and its options, pairs of a path and where it is to be, --, words.
ENTER = """
root=$1
mkdir -p "$root$2"
mount -t tmpfs -o "$3" tmpfs "$root$2"
shift 3
mount --rbind /dev "$root/dev"
mount --rbind /proc "$root/proc"
while [ "$1" != -- ]; do
  mkdir -p "$root$(dirname "$2")"
  if [ -d "$1" ]; then mkdir "$root$2"; else touch "$root$2"; fi
  mount --bind "$1" "$root$2"
  shift 2
done
shift
exec chroot "$root" "$@"
"""


def compose() -> dict[str, Any]:
    loaded: dict[str, Any] = yaml.safe_load((ROOT / "package/openrtu/container/compose.yaml").read_text())
    return loaded


def image(name: str) -> Path:
    """The archive; made of the packages that these tests have."""
    archive = MADE / f"openrtu-{name}.oci.tar"
    debs = packages()
    with alone("tested-containers"):
        if not archive.exists() or archive.stat().st_mtime < (debs / "run").stat().st_mtime:
            done = subprocess.run(
                ["scripts/build-containers.sh", MADE, debs, name],
                cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
                umask=0o077,
            )  # fmt: skip
            assert done.returncode == 0, done.stdout
    return archive


@dataclass
class Network:
    """Of the containers alone: the address that compose.yaml gives the gateway, and loopback."""

    holder: subprocess.Popen[str]

    def inside(self, *words: str | Path) -> list[str | Path]:
        return ["nsenter", f"--net=/proc/{self.holder.pid}/ns/net", *words]


@contextmanager
def network(address: str) -> Iterator[Network]:
    script = f"ip link set lo up && ip address add {address}/24 dev lo && echo up && exec cat"
    with subprocess.Popen(
        ["unshare", "--net", "sh", "-euc", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "up\n"
        yield Network(holder)
        holder.terminate()


@dataclass
class Container:
    """What an engine would make of an image and of a service of compose.yaml."""

    archive: Path
    root: Path
    capabilities: Sequence[str] = ()
    mounts: Mapping[Path, str] = field(default_factory=dict)
    user: str = ""  # another than the image's
    tmpfs: str = "/run"

    def __post_init__(self) -> None:
        with tarfile.open(self.archive) as archive:

            def blob(described: Mapping[str, Any]) -> IO[bytes]:
                algorithm, _, digest = described["digest"].partition(":")
                found = archive.extractfile(f"blobs/{algorithm}/{digest}")
                assert found is not None
                return found

            index = archive.extractfile("index.json")
            assert index is not None
            manifest = json.load(blob(json.load(index)["manifests"][0]))
            self.config = json.load(blob(manifest["config"]))["config"]
            with tempfile.NamedTemporaryFile() as layer:
                layer.write(blob(manifest["layers"][0]).read())
                layer.flush()
                self.root.mkdir()
                subprocess.run(
                    ["tar", "--extract", "--gzip", "--file", layer.name, "--directory", self.root,
                     "--exclude=./dev/*"], check=True,
                )  # fmt: skip

    def command(self) -> list[str | Path]:
        """What starts it."""
        mounts = [word for pair in self.mounts.items() for word in map(str, pair)]
        place, _, options = self.tmpfs.partition(":")
        tmpfs = [place, options or "mode=755"]  # root's alone, as podman makes it
        enter = ["unshare", "--mount", "sh", "-euc", ENTER, "-", self.root, *tmpfs, *mounts, "--"]
        return [*enter, *self._confined(*self.config["Entrypoint"])]

    def _confined(self, *words: str) -> list[str | Path]:
        bounding = ",".join(["-all", *(f"+{name.lower()}" for name in self.capabilities)])
        confined = ["setpriv", f"--bounding-set={bounding}", "--inh-caps=-all"]
        if user := self.user or self.config.get("User", ""):
            confined += [f"--reuid={user}", f"--regid={user}", "--clear-groups"]
        return ["env", "--ignore-environment", *self.config["Env"], *confined, *words]

    @contextmanager
    def running(self, net: Network | None = None) -> Iterator[None]:
        command = net.inside(*self.command()) if net else self.command()
        with (self.root.parent / f"{self.root.name}.log").open("wb") as log:
            self.process = subprocess.Popen(command, stdout=log, stderr=log)
        try:
            yield
        finally:
            self.process.terminate()
            self.process.wait()

    def log(self) -> str:
        return (self.root.parent / f"{self.root.name}.log").read_text(errors="replace")

    def execute(self, *words: str, stdin: str = "") -> subprocess.CompletedProcess[str]:
        """As `podman exec` does: in the namespaces of what runs."""
        there = ["nsenter", f"--target={self.process.pid}", "--mount", "--root", "--net", "--wdns=/"]
        return subprocess.run(
            [*there, *self._confined(*words)], input=stdin, capture_output=True, text=True, check=False
        )

    def until(self, found: Callable[[], bool], what: str) -> None:
        deadline = Deadline(PATIENCE_S)
        while not found():
            assert self.process.poll() is None, f"it has ended: {self.log()}"
            assert deadline.left > 0, f"not seen: {what}\n{self.log()}"
            time.sleep(0.2)
