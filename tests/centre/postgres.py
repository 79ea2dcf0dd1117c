# SPDX-License-Identifier: GPL-3.0-or-later
"""A server of PostgreSQL of one's own: Debian's, in a folder that goes with it. It never runs as root."""

from __future__ import annotations

import csv
import io
import os
import pwd
import shutil
import subprocess
import tempfile
from itertools import count
from pathlib import Path
from typing import Self

USER = "nobody"  # whoever runs the tests, if that is not root
LIMIT_S = 120
SEGMENT_MIB = 1  # of the log
# What is on the disk after a power cut is the server's business: its own death is what is tested.
SETTINGS = "-c listen_addresses= -c fsync=off -c shared_buffers=16MB -c autovacuum=off -c max_connections=30"


class Server:
    def __init__(self) -> None:
        programs = sorted(Path("/usr/lib/postgresql").glob("*/bin"))
        assert programs, "no PostgreSQL: apt-get install $(grep -v '#' scripts/packages-centre.txt)"
        self.programs = programs[-1]
        self.folder = Path(tempfile.mkdtemp(prefix="openrtu-postgres-"))
        self.data = self.folder / "data"
        self.numbers = count(1)
        self.name = ""  # of the last database
        self.before: list[str] = []
        if os.geteuid() == 0:
            user = pwd.getpwnam(USER)
            os.chown(self.folder, user.pw_uid, user.pw_gid)
            self.before = ["setpriv", f"--reuid={USER}", f"--regid={user.pw_gid}", "--clear-groups"]

    def _run(self, program: str, *words: str) -> str:
        done = subprocess.run(
            [*self.before, self.programs / program, *words],
            cwd=self.folder, capture_output=True, text=True, timeout=LIMIT_S, check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"{program} {words}: {done.stderr or done.stdout}"
        return done.stdout

    def __enter__(self) -> Self:
        words = ("-U", "centre", "-A", "trust", "--no-sync", "--no-locale", "-E", "UTF8")
        self._run("initdb", "-D", str(self.data), *words, f"--wal-segsize={SEGMENT_MIB}")
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        if (self.data / "postmaster.pid").exists():
            self.stop()
        shutil.rmtree(self.folder)

    def start(self) -> None:
        """Its answers go to a file: what it starts would hold a pipe."""
        options = f"{SETTINGS} -c unix_socket_directories={self.folder}"
        with (self.folder / "start").open("w") as log:
            subprocess.run(
                [*self.before, self.programs / "pg_ctl", "-D", self.data, "-w", "-o", options, "start"],
                cwd=self.folder, stdout=log, stderr=log, timeout=LIMIT_S, check=True,
            )  # fmt: skip

    def stop(self) -> None:
        """As if it were killed."""
        self._run("pg_ctl", "-D", str(self.data), "-m", "immediate", "stop")

    def processes(self) -> list[int]:
        """The postmaster and all that it has started."""
        first = (self.data / "postmaster.pid").read_text().split()[0]
        children = Path(f"/proc/{first}/task/{first}/children").read_text().split()
        return [int(first), *map(int, children)]

    def new_database(self) -> str:
        """Its address."""
        self.name = f"centre{next(self.numbers)}"
        self._run("createdb", "-h", str(self.folder), "-U", "centre", self.name)
        return f"postgresql://centre@/{self.name}?host={self.folder}"

    def psql(self) -> subprocess.Popen[str]:
        """A session of somebody else in the last database."""
        where = ("-h", str(self.folder), "-U", "centre", "-d", self.name)
        return subprocess.Popen(
            [*self.before, self.programs / "psql", *where, "--csv", "-tXq", "-v", "ON_ERROR_STOP=1"],
            cwd=self.folder, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip

    def rows(self, sql: str) -> list[tuple[str, ...]]:
        session = self.psql()
        out, error = session.communicate(sql, timeout=LIMIT_S)
        assert session.returncode == 0, error
        return [tuple(row) for row in csv.reader(io.StringIO(out))]
