# SPDX-License-Identifier: GPL-3.0-or-later
"""A gateway, wherever it runs; and one on this machine: starts and watches rtud and what that starts."""

from __future__ import annotations

import contextlib
import copy
import json
import os
import random
import re
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from lab import ports
from lab.errors import LabError
from lab.patience import Deadline

REPOSITORY = Path(__file__).resolve().parents[2]
START_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 30.0
PAUSE_MAX_S = 0.1  # between two questions
RESTARTS_MAX = 3
OWN = "rtu-"  # modules of the gateway
PORTS_FROM = 10240  # those below are known services' more often
HEARTBEAT_LIMIT_MS = 2000  # a line process that a busy host lets wait is not dead
TESTFR_ACT = bytes.fromhex("680443000000")
TESTFR_CON = bytes.fromhex("680483000000")


given_ports: set[int] = set()  # by free_port, in this process


class GatewayError(LabError):
    """The gateway did not do what was waited for; the text holds the end of its log."""


def default_build() -> Path:
    """The folder that `make build` fills, or the one that OPENRTU_BUILD names."""
    return Path(os.environ.get("OPENRTU_BUILD", REPOSITORY / "build" / "native"))


def free_port() -> int:
    """A TCP port of 127.0.0.1 that nobody listens on now.

    None that was given before: it may not be listened on yet. None that the kernel gives to connections,
    if it leaves others: one of them might take it before it is listened on.
    """
    given = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    while True:
        wanted = random.SystemRandom().randrange(PORTS_FROM, given) if given > 2 * PORTS_FROM else 0
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", wanted))
            port = int(probe.getsockname()[1])
            if port not in given_ports:
                given_ports.add(port)
                return port


def listening_on(config: dict[str, Any], port: int) -> dict[str, Any]:
    """A copy of a configuration whose station listens on 127.0.0.1, at that TCP port.

    If it does not say otherwise, its clock is the controlling station's, as this machine's may be
    synchronised, and its line processes may be late.
    """
    changed = copy.deepcopy(config)
    changed.setdefault("clock", "masters")
    changed.setdefault("modbus", {}).setdefault("heartbeat_limit_ms", HEARTBEAT_LIMIT_MS)
    changed.setdefault("iec104", {}).update(address="127.0.0.1", port=port)
    return changed


def run_directory() -> Path:
    """A new folder on a tmpfs that the modules' unprivileged users may enter."""
    folder = Path(tempfile.mkdtemp(prefix=f"openrtu-{os.getpid()}-", dir="/dev/shm"))
    folder.chmod(0o755)
    return folder


class Rtu(ABC):
    """A running gateway, as an engineer has it: rtuctl, its log, and the address of its station."""

    address: tuple[str, int]
    rtuctl: list[str]  # what runs it on this machine, before its own arguments
    by_shell = False  # those arguments pass one more shell on their way
    killed: tuple[str, ...] = ()  # the modules that were killed on purpose

    @abstractmethod
    def processes(self) -> list[int]:
        """The processes of this machine that listen for it."""

    @abstractmethod
    def ctl(self, *arguments: str) -> str:
        """What `rtuctl` prints. Raises GatewayError."""

    @abstractmethod
    def configuration(self) -> dict[str, Any]:
        """What its rtud was started with."""

    @abstractmethod
    def put(self, config: dict[str, Any]) -> str:
        """Another configuration; returns the path that `rtuctl reload` takes."""

    @abstractmethod
    def log(self, lines: int = 40) -> str:
        """The end of rtud's log."""

    @abstractmethod
    def kill(self, module: str) -> None:
        """SIGKILL to a module."""

    @abstractmethod
    def check_up(self) -> None:
        """Raises GatewayError when it has ended, as far as that can be known."""

    def check_ours(self) -> None:
        """Raises GatewayError when somebody else listens at its address: not an octet is for them."""
        if not ports.is_listened_on_by(self.address, self.processes()):
            port = self.address[1]
            raise GatewayError(
                f"{ports.holders(self.address) or 'nobody'} listens on TCP port {port}",
                expected=f"this show's own station on TCP port {port}",
            )

    def query(self, *arguments: str) -> Any:
        """What `rtuctl --json` prints, decoded."""
        return json.loads(self.ctl("--json", *arguments))

    def modules(self) -> dict[str, dict[str, Any]]:
        """The module table by name."""
        return {module["name"]: module for module in self.query("modules")}

    def points(self, pattern: str = "*") -> dict[str, dict[str, Any]]:
        """The points whose names match a glob, by name."""
        return {point["name"]: point for point in self.query("points", pattern)}

    def wait_for(self, condition: Callable[[], bool], timeout_s: float, what: str) -> float:
        """Waits until condition() is true; returns the seconds it took. Raises GatewayError with the log.

        timeout_s is for an idle machine (lab.patience). Each question leaves the gateway twice the time of
        its answer: a board that does nothing but answer would do the rest late. What takes long is asked for
        less and less often.
        """
        deadline = Deadline(timeout_s)
        asked = deadline.waited
        while not condition():
            self.check_up()
            if deadline.over:
                seen = f"not within {deadline.waited:.0f} s"
                raise GatewayError(f"{seen}: {what}\n{self.log()}", expected=what, seen=seen, late=True)
            now = deadline.waited
            time.sleep(max(0.005, 2 * (now - asked), min(now / 10, PAUSE_MAX_S)))
            asked = deadline.waited
        return deadline.waited


class Gateway(Rtu):
    """A running rtud. `directory` gets its configuration, log and map; its dev holds the serial devices."""

    def __init__(self, config: dict[str, Any], directory: Path, build: Path | None = None) -> None:
        self.build = build or default_build()
        self.directory = directory
        self.map = directory / "map"
        self.dev = directory / "dev"
        self.config_file = directory / "gateway.json"
        self.log_file = directory / "rtud.log"
        settings = config.get("iec104", {})
        self.listens_at = (settings.get("address", "127.0.0.1"), settings.get("port", 2404))
        self.address = self.listens_at  # the tests put a recording relay before it
        self.config_file.write_text(json.dumps(config, indent=2))
        self.rtuctl = [f"{self.build}/rtuctl/rtuctl", "--map", f"{self.map}"]
        self.process: subprocess.Popen[bytes] | None = None
        self.options: list[str | Path] = []  # more of rtud

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self) -> None:
        """Starts rtud and waits until its modules run and the station answers on its port."""
        # Whoever shows or tests the gateway may be killed, or end with its terminal, which rtud does not.
        command = ["setpriv", "--pdeathsig", "TERM", self.build / "rtud" / "rtud"]
        command += ["--map", self.map, "--dev", self.dev]
        command += ["--modules", self.build / "modules", *self.options, self.config_file]
        with self.log_file.open("ab") as log:
            self.process = subprocess.Popen(command, stderr=log, stdin=subprocess.DEVNULL)
        try:
            self.wait_for(self._is_up, START_TIMEOUT_S, "the gateway is up")
        except GatewayError:
            self.stop()
            raise

    def stop(self) -> int:
        """Stops rtud as an init system does. Returns its exit code."""
        if self.process is None:
            return 0
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        try:
            code = self.process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise GatewayError(
                f"rtud did not stop within {STOP_TIMEOUT_S} s\n{self.log()}", late=True
            ) from None
        self._check_sanitizers()
        return code

    def _check_sanitizers(self) -> None:
        """A module that a sanitizer ended was restarted, and may have been missed by nobody."""
        if re.search("Sanitizer:|runtime error:", self.log_file.read_text(errors="replace")):
            raise GatewayError(f"a sanitizer found something\n{self.log()}")

    def ctl(self, *arguments: str, check: bool = True) -> str:
        """What `rtuctl` prints."""
        command = [self.build / "rtuctl" / "rtuctl", "--map", self.map, *arguments]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if check and result.returncode != 0:
            raise GatewayError(
                f"rtuctl {' '.join(arguments)}: {result.stderr.strip() or result.stdout.strip()}"
            )
        return result.stdout

    def configuration(self) -> dict[str, Any]:
        """Its file."""
        config: dict[str, Any] = json.loads(self.config_file.read_text())
        return config

    def put(self, config: dict[str, Any]) -> str:
        """Beside its own file."""
        path = self.config_file.with_name("other.json")
        path.write_text(json.dumps(config, indent=2))
        return str(path)

    def log(self, lines: int = 40) -> str:
        """The end of rtud's log."""
        return "\n".join(self.log_file.read_text(errors="replace").splitlines()[-lines:])

    def kill(self, module: str) -> None:
        """SIGKILL to a module."""
        os.kill(self.modules()[module]["pid"], signal.SIGKILL)
        self.killed += (module,)

    def check_up(self) -> None:
        """Raises GatewayError when rtud has ended."""
        if self.process is not None and self.process.poll() is not None:
            raise GatewayError(f"rtud exited with {self.process.returncode}\n{self.log()}")

    def processes(self) -> list[int]:
        """The modules; rtud has opened the station's socket, and may have handed it over."""
        return [module["pid"] for module in self.modules().values() if module["pid"]]

    def _is_up(self) -> bool:
        try:
            modules = self.query("modules")
        except GatewayError:
            return False  # there is no map yet
        for module in modules:  # those of a site may end as they like
            if module["name"].startswith(OWN) and module["restarts"] >= RESTARTS_MAX:
                raise GatewayError(f"{module['name']} does not stay up\n{self.log()}")
        pids = [module["pid"] for module in modules if module["pid"]]
        return ports.is_listened_on_by(self.listens_at, pids) and self._station_answers()

    def _station_answers(self) -> bool:
        """A controlled station confirms a test frame."""
        try:
            with socket.create_connection(self.listens_at, timeout=1.0) as connection:
                connection.sendall(TESTFR_ACT)
                return connection.recv(len(TESTFR_CON)) == TESTFR_CON
        except OSError:
            return False


def remove(directory: Path) -> None:
    """Removes a run directory."""
    shutil.rmtree(directory, ignore_errors=True)
