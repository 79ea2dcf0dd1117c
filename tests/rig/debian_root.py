# SPDX-License-Identifier: GPL-3.0-or-later
"""A minimal Debian of one's own, to install packages into: scripts/private-root.sh. It needs root."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rig.packaged import alone
from rig.rights import SUPERUSER, needed

ROOT = Path(__file__).resolve().parents[2]
TAR = ROOT / "build/debian-root.tar"
ARCHIVES = ROOT / "build/debian-archives"
MAKE = """
. scripts/private-root.sh
private_root_tar "$1.part" --skip=cleanup/apt/lists
mv "$1.part" "$1"
"""
# A shell's, with the root as $1. What is mounted is gone with the last process in there.
ENTER = """
mount --rbind /dev "$1/dev"
mount --rbind /proc "$1/proc"
mount --bind "$2" "$1/var/cache/apt/archives"
root=$1
shift 2
exec env --ignore-environment PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \\
  DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8 HOME=/ chroot "$root" "$@"
"""
NEEDS_ROOT = needed(SUPERUSER, "only root can install packages into a root of Debian")


class DebianRoot:
    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def command(self, *words: str) -> list[str | Path]:
        return [
            "unshare", "--mount", "sh", "-euc", ENTER, "-", self.folder, ARCHIVES, *words,
        ]  # fmt: skip

    def run(self, *words: str, code: int = 0, typed: str = "") -> str:
        done = subprocess.run(
            self.command(*words), input=typed, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            check=False,
        )  # fmt: skip
        assert done.returncode == code, done.stdout
        return done.stdout

    def apt(self, *words: str) -> str:
        """No power cut is waited for: the root is thrown away."""
        hasty = "--option=Dpkg::Options::=--force-unsafe-io"
        return self.run("apt-get", "--yes", "--no-install-recommends", hasty, *words)

    @contextmanager
    def running(self, *words: str) -> Iterator[subprocess.Popen[bytes]]:
        log = self.folder / "running.log"
        with log.open("wb") as out, subprocess.Popen(self.command(*words), stdout=out, stderr=out) as process:
            try:
                yield process
            finally:
                process.terminate()

    def files(self) -> set[str]:
        """All that is no folder, but what dpkg, apt, a running system and the tests keep."""
        own = (
            "var/lib/dpkg/",
            "var/lib/apt/",
            "var/cache/",
            "var/log/",
            "dev/",
            "proc/",
            "run/",
            "srv/",
            "running.log",
        )
        found = (str(path.relative_to(self.folder)) for path in self.folder.rglob("*") if not path.is_dir())
        return {name for name in found if not name.startswith(own)}


def unpacked(folder: Path) -> Path:
    """Debian's own minimal root: fetched once, for all that test with it."""
    with alone("debian-root"):
        if not TAR.exists():
            done = subprocess.run(
                ["bash", "-euc", MAKE, "-", TAR], cwd=ROOT, capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, done.stderr
    folder.mkdir()
    subprocess.run(
        ["tar", "--extract", "--file", TAR, "--directory", folder, "--exclude=./dev/*"], check=True
    )
    return folder
