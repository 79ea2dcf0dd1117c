# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices that take less than the protocol allows: the gateway learns it, says it, and is told it."""

import contextlib
import copy
import json
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from rig.capture import recorded

pytestmark = pytest.mark.slow

PORT, SHORT, HOLED, LACKING = 1, 1, 2, 3
LIMIT = 16
LEARNED = 10  # of 40, halved until it is below the limit
MISSING = 5
SLOW_MS = 40
ENOUGH = 20  # answers
COILS, HOLDING, INPUT = 1, 3, 4  # functions
LEARNED_READS = {
    *((SHORT, function, first, LEARNED) for function in (COILS, HOLDING) for first in range(0, 40, 10)),
    *((HOLED, HOLDING, 0, 5), (HOLED, HOLDING, 8, 2), (HOLED, INPUT, 0, 20)),
    *((LACKING, HOLDING, 0, 4), (LACKING, HOLDING, 4, 1), (LACKING, HOLDING, 6, 2)),
}


def objects(*addresses: int) -> list[dict[str, int]]:
    return [{"address": address} for address in addresses]


def configuration() -> dict[str, Any]:
    slaves = [
        {"id": SHORT, "coils": objects(*range(40)), "holding_registers": objects(*range(40))},
        {
            "id": HOLED,
            "holding_registers": objects(*range(5), 8, 9),
            "input_registers": objects(*range(20)),
        },
        {"id": LACKING, "holding_registers": objects(*range(8))},
    ]
    for slave in slaves:  # a busy host is no silent device
        slave |= {"response_timeout_ms": 5000, "retries": 5}
    line = {"baud_rate": 38400, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return {"iec104": {}, "port": [{"value": PORT, "active": 1, **line, "slaves": slaves}]}


def of_devices() -> dict[str, Any]:
    """What is really there: one object is not."""
    config = configuration()
    config["port"][0]["slaves"][2]["holding_registers"].pop(MISSING)
    return config


@dataclass
class Bench:
    lines: LineSim
    directory: Path
    programs: Path

    @contextlib.contextmanager
    def gateway(self, config: dict[str, Any]) -> Iterator[Gateway]:
        config = listening_on(config, free_port())
        with Gateway(config, self.directory, self.programs) as gateway, recorded(gateway):
            gateway.wait_for(lambda: knows_everything(gateway), 60.0, "every device is known")
            yield gateway

    def asked(self, gateway: Gateway) -> set[tuple[int, ...]]:
        """The reads of two scans: unit, function, address, count; but what a device lacks."""
        mark, reads = self.lines.mark(), gateway.query("lines")[0]["answers"]
        planned = sum(device["planned_requests"] for device in devices(gateway).values())
        done = reads + 2 * planned
        gateway.wait_for(lambda: gateway.query("lines")[0]["answers"] > done, 60.0, "two scans")
        return {
            (
                frame.unit,
                frame.bytes[1],
                int.from_bytes(frame.bytes[2:4], "big"),
                int.from_bytes(frame.bytes[4:6], "big"),
            )
            for frame in self.lines.frames(mark)
            if frame.kind == "received" and (frame.unit, frame.bytes[3]) != (LACKING, MISSING)
        }

    def wait_asked(self, gateway: Gateway, reads: set[tuple[int, ...]]) -> None:
        """Until these are the reads. Where a busy host spoils an answer, a probe is among them once."""
        gateway.wait_for(lambda: self.asked(gateway) == reads, 60.0, f"it asks for {sorted(reads)}")

    def refused(self, unit: int) -> int:
        return int(self.lines.stats()[str(PORT)]["slaves"][str(unit)]["exceptions"])


def devices(gateway: Gateway) -> dict[int, dict[str, Any]]:
    return {device["id"]: device for device in gateway.query("lines")[0]["devices"]}


def knows_everything(gateway: Gateway) -> bool:
    return all(device["alive"] and device["learned"]["open"] == 0 for device in devices(gateway).values())


def known_to_react(gateway: Gateway) -> None:
    """Until so much has been answered that the average tells nothing but the device."""

    def answered() -> bool:
        return all(device["answers"] >= ENOUGH for device in devices(gateway).values())

    gateway.wait_for(answered, 60.0, f"each device has answered {ENOUGH} times")


def knows_how_fast(gateway: Gateway) -> bool:
    keys, _ = suggested(gateway)
    return keys == without_reactions(keys)


def run(gateway: Gateway, program: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [gateway.build / program, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True)


def suggested(gateway: Gateway) -> tuple[dict[str, Any], list[str]]:
    """What `rtuctl lines --suggest` prints, and its remarks."""
    result = run(gateway, "rtuctl/rtuctl", "--map", gateway.map, "lines", "--suggest")
    return json.loads(result.stdout), result.stderr.splitlines()


def without_reactions(keys: dict[str, Any]) -> dict[str, Any]:
    """What is suggested of what the devices take: how fast they are depends on how busy this host is."""
    ports = []
    for port in keys["port"]:
        slaves = [{key: slave[key] for key in slave if key != "reaction_ms"} for slave in port["slaves"]]
        if slaves := [slave for slave in slaves if slave.keys() > {"id"}]:
            ports.append({**port, "slaves": slaves})
    return {"port": ports}


def merged(config: dict[str, Any], keys: dict[str, Any]) -> dict[str, Any]:
    """The configuration with the keys at their places."""
    config = copy.deepcopy(config)
    ports = {port["value"]: port for port in config["port"]}
    for port in keys["port"]:
        slaves = {slave["id"]: slave for slave in ports[port["value"]]["slaves"]}
        for slave in port["slaves"]:
            slaves[slave["id"]].update(slave)
    return config


@contextlib.contextmanager
def bench_of(programs: Path, latency_us: int | None = None) -> Iterator[Bench]:
    directory = run_directory()
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        file = directory / "linesim.json"
        file.write_text(json.dumps(of_devices()))
        lines = stack.enter_context(LineSim(file, None, directory / "dev", latency_us=latency_us))
        lines.fault(f"{PORT}.{SHORT}", "limit", LIMIT)
        yield Bench(lines, directory, programs)


@pytest.fixture
def bench(programs: Path) -> Iterator[Bench]:
    with bench_of(programs) as bench:
        yield bench


def test_what_was_learned_spares_the_next_start_every_refusal(bench: Bench) -> None:
    with bench.gateway(configuration()) as gateway:
        short, holed, lacking = (devices(gateway)[unit]["learned"] for unit in (SHORT, HOLED, LACKING))
        assert (short["given_registers"], short["refused_registers"]) == (LEARNED, 2 * LEARNED)
        assert (short["given_bits"], short["refused_bits"]) == (LEARNED, 2 * LEARNED)
        assert holed["hole"] == {"function": 3, "address": 5, "count": 3, "exception": 2, "read": 10}
        assert lacking["lacking"] == {"function": 3, "address": MISSING, "exception": 2, "count": 1}
        keys, remarks = suggested(gateway)
        slaves = [
            {"id": SHORT, "max_bits": LEARNED, "max_registers": LEARNED},
            {"id": HOLED, "holes": False},
        ]
        assert without_reactions(keys) == {"port": [{"value": PORT, "slaves": slaves}]}
        remarks = [remark for remark in remarks if "reaction_ms" not in remark]
        assert len(remarks) == 4
        assert remarks[-1].startswith(
            f"rtuctl: port {PORT}, slave {LACKING}: no key for holding register {MISSING}"
        )
        bench.wait_asked(gateway, LEARNED_READS)
        assert bench.refused(SHORT) == 6
    at_start = {unit: bench.refused(unit) for unit in (SHORT, HOLED)}
    with bench.gateway(merged(configuration(), keys)) as gateway:
        bench.wait_asked(gateway, LEARNED_READS)
        assert {unit: bench.refused(unit) for unit in (SHORT, HOLED)} == at_start
        assert {unit: devices(gateway)[unit]["exceptions"] for unit in (SHORT, HOLED)} == {SHORT: 0, HOLED: 0}
        keys, _ = suggested(gateway)
        assert without_reactions(keys) == {"port": []}


def test_how_fast_devices_are_is_learned_and_computed_with(programs: Path) -> None:
    config = configuration()
    with bench_of(programs, SLOW_MS * 1000) as bench:
        with bench.gateway(config) as gateway:
            known_to_react(gateway)
            keys, remarks = suggested(gateway)
            told = [remark for remark in remarks if "reaction_ms" in remark]
            assert len(told) == len(config["port"][0]["slaves"])
            for slave in keys["port"][0]["slaves"]:
                assert SLOW_MS <= slave["reaction_ms"] <= 2 * SLOW_MS  # on a busy host
        with bench.gateway(merged(config, keys)) as gateway:
            gateway.wait_for(lambda: knows_how_fast(gateway), 60.0, "no other reaction is suggested")
            plan = run(gateway, "rtud/rtud", "--plan", gateway.config_file).stdout
            reactions = [float(ms) for ms in re.findall(r"reacts in (\S+) ms$", plan, re.MULTILINE)]
            assert len(reactions) == len(config["port"][0]["slaves"])
            assert min(reactions) >= SLOW_MS


def test_plan_of_the_configuration_is_what_is_asked(bench: Bench) -> None:
    config = configuration()
    config["port"][0]["slaves"][0] |= {"max_bits": LIMIT, "max_registers": LIMIT}
    config["port"][0]["slaves"][1]["holes"] = False
    config["port"][0]["slaves"].pop()
    with bench.gateway(config) as gateway:
        plan = run(gateway, "rtud/rtud", "--plan", gateway.config_file).stdout
        rows = [
            line.split() for line in plan.splitlines() if line.replace(".", "").replace(" ", "").isdigit()
        ]
        bench.wait_asked(gateway, {tuple(map(int, row[:4])) for row in rows})
        assert bench.refused(SHORT) == bench.refused(HOLED) == 0


def test_lines_show_what_was_learned(bench: Bench) -> None:
    with bench.gateway(configuration()) as gateway:
        table = gateway.ctl("lines").split("\n\n")[3].splitlines()
        assert table[0].split() == [
            *("PORT", "ID", "LEAST", "MS", "TYPICAL", "MS", "MOST", "MS"),
            *("PAUSE", "MS", "BITS", "REGISTERS", "REFUSED"),
        ]
        assert table[1].endswith("       0    10         10  20 bits; 20 registers")
        assert table[2].endswith("       0     0         20  hole at holding registers 5 to 7")
        assert table[3].endswith("       0     0          4  holding register 5")
        device = devices(gateway)[HOLED]
        # linesim answers 2 ms behind the silence of 1.75 ms.
        assert 3.75 <= device["latency_least_ms"] <= device["latency_typical_ms"] <= device["latency_most_ms"]
