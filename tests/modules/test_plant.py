# SPDX-License-Identifier: GPL-3.0-or-later
"""The simulated plant of docs/examples: by itself, and in a gateway with programs of logic."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from lab.gateway import Gateway, GatewayError, free_port, listening_on, remove, run_directory
from lab.modules import EXAMPLES, PACKAGE, place, program
from openrtu_tools.cli import main

LOGIC = EXAMPLES.parent / "logic"
PATIENCE_S = 60.0


@pytest.fixture
def plant(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    monkeypatch.syspath_prepend(PACKAGE)
    monkeypatch.syspath_prepend(EXAMPLES)
    import plant

    yield plant
    sys.modules.pop("plant")


def test_tank_and_feeder_in_virtual_time(plant: ModuleType) -> None:
    tank = plant.Tank(level=50, inflow=1.0, pumped=3.0)
    for _ in range(30):
        tank.step(1.0)
    tank.pump = True
    tank.step(10.0)
    assert tank.level == 60.0
    tank.step(100.0)
    assert tank.level == 0.0
    feeder = plant.Feeder()
    feeder.close(True)
    feeder.step(1.0)
    assert (feeder.current_a, feeder.tripped) == (120.0, False)
    feeder.load_a = 500.0
    feeder.step(0.06)
    assert feeder.closed
    feeder.step(0.06)
    assert (feeder.closed, feeder.tripped, feeder.current_a) == (False, True, 0.0)
    feeder.earthed, feeder.load_a = True, 120.0
    feeder.close(True)
    assert (feeder.current_a, feeder.tripped) == (8000.0, False)
    feeder.step(0.1)
    assert feeder.tripped


@pytest.mark.slow
def test_programs_run_the_plant(programs: Path) -> None:
    directory = run_directory()
    try:
        place(directory, programs)
        config = json.loads((LOGIC / "plant.json").read_text())
        config["modules"][0]["program"] = program(directory, "plant", EXAMPLES / "plant.py")
        config["modules"][0]["config"]["tank"] |= {"inflow": 20.0, "pumped": 30.0}
        config["modules"][0]["heartbeat_limit_ms"] = 5000
        for one in config["logic"]:
            compiled = directory / one["program"]
            assert main(["logic", "compile", str(LOGIC / f"{one['name']}.st"), "-o", str(compiled)]) == 0
            one["program"] = str(compiled)
        with Gateway(listening_on(config, free_port()), directory, programs) as gateway:

            def wait(name: str, value: object) -> None:
                gateway.wait_for(
                    lambda: gateway.points(name)[name]["value"] == value, PATIENCE_S, f"{name} is {value}"
                )

            wait("phase", 2)  # the level has risen to the limit: the sequence has started the pump
            wait("tank.pump", "on")
            wait("phase", 0)
            gateway.ctl("set", "order", "on")
            wait("feeder.current", 120)
            gateway.ctl("set", "order", "off")
            wait("feeder.breaker", "off")
            gateway.ctl("set", "feeder.earth", "on")
            wait("locked", "on")
            with pytest.raises(GatewayError, match="interlock"):
                gateway.ctl("set", "order", "on")
            gateway.ctl("set", "feeder.breaker", "on")  # past the interlock: a short circuit
            wait("feeder.tripped", "on")
    finally:
        remove(directory)
