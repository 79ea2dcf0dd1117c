# SPDX-License-Identifier: GPL-3.0-or-later
"""A gateway with simulated devices behind it and a controlling station in front of it, for the tests."""

import contextlib
import copy
import json
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from lab.master import Master
from lab.patience import stretch
from rig.capture import recorded

CHAPTER_5 = Path(__file__).parents[1] / "fixtures" / "chapter5"
RESPONSE_TIMEOUT_MS = 500  # where a slave says nothing else
LONGEST_TIMEOUT_MS = 5000
STILL_TIMEOUT_S = 30.0
SCAN_S = 30.0
PROBE_MAX_S = 2  # a device that seemed dead is back soon


def chapter_5() -> dict[str, Any]:
    """The configuration of `make run`, with more patience: a device that a busy host delays is not dead.

    All masters have one address here.
    """
    loaded: dict[str, Any] = json.loads((CHAPTER_5 / "gateway.json").read_text())
    loaded.setdefault("iec104", {})["connections_per_address"] = 8
    for port in loaded["port"]:
        for slave in port.get("slaves", []):
            slave |= patience(slave.get("response_timeout_ms", RESPONSE_TIMEOUT_MS))
            if slave["id"]:
                slave["probe_max_s"] = PROBE_MAX_S
    return loaded


def patience(timeout_ms: int = RESPONSE_TIMEOUT_MS) -> dict[str, int]:
    """A device's response time-out, longer on a busy host, and no shorter one is learned."""
    patient_ms = max(timeout_ms, min(LONGEST_TIMEOUT_MS, round(timeout_ms * stretch())))
    return {"response_timeout_ms": patient_ms, "response_timeout_min_ms": patient_ms}


def values() -> dict[str, dict[str, dict[str, int]]]:
    """Its devices' initial values."""
    loaded: dict[str, dict[str, dict[str, int]]] = json.loads((CHAPTER_5 / "values.json").read_text())
    return loaded


def values_of(config: dict[str, Any]) -> dict[str, dict[str, dict[str, int]]]:
    """Those of the devices that a configuration has left of it."""
    devices = {
        f"{port['value']}.{slave['id']}" for port in config["port"] for slave in port.get("slaves", [])
    }
    return {device: tables for device, tables in values().items() if device in devices}


def of_port(config: dict[str, Any], number: int) -> dict[str, Any]:
    """One port of a configuration."""
    return next(port for port in config["port"] if port["value"] == number)


def errors_of(messages: str) -> str:
    """What rtud says of a configuration, without its notes: on chapter_5()'s probes, for one."""
    return "".join(line for line in messages.splitlines(keepends=True) if ": note: " not in line)


@dataclass
class Substation:
    """The gateway and the simulated devices on its lines."""

    lines: LineSim
    gateway: Gateway

    def ca(self, device: str) -> int:
        """The common address of device "port.unit"."""
        port, unit = device.split(".")
        return 1000 * int(port) + int(unit)

    def device(self, ca: int) -> str:
        return f"{ca // 1000}.{ca % 1000}"

    def set_and_scan(self, device: str, table: str, address: int, values: list[int]) -> None:
        """Changes values at a device; returns when the gateway has read them.

        That the device was asked is not enough: the gateway drops an answer that comes late.
        """
        port, unit = map(int, device.split("."))
        self.lines.set(device, table, address, *values)
        mark = self.lines.mark()  # before it the old values may have been read, and the first be the same
        asked = self.lines.wait_frame(
            lambda f: (
                (f.kind, f.unit, f.table, f.address, f.value) == ("reading", unit, table, address, values[0])
            ),
            since=mark,
        )
        self.lines.wait_frame(lambda f: (f.kind, f.port) == ("received", port), since=asked.number)
        if point := self.point_at(device, table, address):
            self.gateway.wait_for(
                lambda: self._was_read(point, asked.monotonic_ns), SCAN_S, f"{point} is read from the device"
            )

    def point_at(self, device: str, table: str, address: int) -> str:
        """The name of the point that begins there, or before; "" for what is only part of others' quality."""
        port, unit = map(int, device.split("."))
        config = json.loads(self.gateway.config_file.read_text())
        slave = next(each for each in of_port(config, port)["slaves"] if each["id"] == unit)
        places = {
            point["address"]: point.get("name", f"p{device}.{table[0]}{point['address']}")
            for point in slave.get(table, [])
        }
        return places.get(max((begin for begin in places if begin <= address), default=-1), "")

    def _was_read(self, point: str, since_ns: int) -> bool:
        """Whether a point's value came after that time, of this machine's monotonic clock."""
        now_ns = time.monotonic_ns()
        row = self.gateway.points(point)[point]
        lost = {"invalid", "not topical"} & set(row["quality"].split(","))  # at a time as well
        return not lost and now_ns - row["age_s"] * 1e9 > since_ns

    def wait_scan(self, device: str) -> None:
        """Until the device has been asked twice: what was queued before has been sent."""
        unit, mark = int(device.split(".")[1]), self.lines.mark()
        first = self.lines.wait_frame(lambda f: f.kind == "received" and f.unit == unit, since=mark)
        self.lines.wait_frame(lambda f: f.kind == "received" and f.unit == unit, since=first.number)

    def wait_all_good(self, ca: int, timeout_s: float = 30.0) -> None:
        """Until every point of a station is good again."""

        def good() -> bool:
            return all(p["quality"] != "invalid" for p in self.gateway.points().values() if p["ca"] == ca)

        self.gateway.wait_for(good, timeout_s, f"all points of CA {ca} are valid")


@dataclass
class Desk(Substation):
    """A controlling station besides."""

    master: Master


@contextlib.contextmanager
def gateway_on_lines(
    config: dict[str, Any], build: Path, initial: dict[str, Any] | None = None
) -> Iterator[tuple[LineSim, Gateway]]:
    """Simulated devices and a gateway on a free TCP port of its own, recorded; removed afterwards.

    `initial` replaces the devices' values of chapter 5.
    """
    directory = run_directory()
    config = listening_on(copy.deepcopy(config), free_port())
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        file = directory / "linesim.json"
        file.write_text(json.dumps(config))
        values = directory / "values.json"
        values.write_text(json.dumps(values_of(config) if initial is None else initial))
        lines = stack.enter_context(LineSim(file, values, directory / "dev"))
        gateway = stack.enter_context(Gateway(config, directory, build))
        stack.enter_context(recorded(gateway))
        yield lines, gateway


@contextlib.contextmanager
def substation_of(config: dict[str, Any], build: Path) -> Iterator[Substation]:
    """Both, once every device has been read."""
    with gateway_on_lines(config, build) as (lines, gateway):
        gateway.wait_for(lambda: everything_read(gateway), 60.0, "every device has been read")
        yield Substation(lines, gateway)


@contextlib.contextmanager
def desk_of(config: dict[str, Any], build: Path) -> Iterator[Desk]:
    """All three, once every device has been read."""
    with substation_of(config, build) as substation:
        gateway = substation.gateway
        with Master(*gateway.address) as master:
            master.synchronise_clock(next(iter(gateway.points().values()))["ca"])
            yield Desk(substation.lines, gateway, master)


def everything_read(gateway: Gateway) -> bool:
    """All points that are read are valid."""
    read = [point for point in gateway.points().values() if not point["never_read"]]
    return all(point["quality"] != "invalid" for point in read)


def processor_seconds(pid: int) -> float:
    """What a process has used so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def wait_still(used: Callable[[], float], limit_s: float) -> None:
    """Until a second passes in which a process uses less than that: a busy host lets it finish late."""
    deadline = time.monotonic() + STILL_TIMEOUT_S
    while True:
        before = used()
        time.sleep(1.0)  # the time that is measured
        if (now := used() - before) < limit_s:
            return
        assert time.monotonic() < deadline, f"{now:.2f} s of each second while it waits"
