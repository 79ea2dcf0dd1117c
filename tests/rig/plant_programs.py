# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs of Structured Text between simulated devices and a controlling station."""

from pathlib import Path
from typing import Any

from lab.gateway import Gateway
from openrtu_tools.logic.binary import encode
from openrtu_tools.logic.compile import compile_text
from openrtu_tools.logic.errors import Findings
from rig.desk import Desk, patience

ROOT = Path(__file__).resolve().parents[2]
INTERLOCK = ROOT / "docs/examples/logic/interlock.st"
DEVICE = "1.10"
CA = {"interlock": 7000, "filling": 7001, "endless": 7002}
BREAKER, PUMP = 0, 1  # coils
EARTHED, SPIN = 0, 1  # discrete inputs
LEVEL = 0  # input register
WAIT_S = 60.0
FILLING = """PROGRAM filling
VAR_EXTERNAL level, limit, half : INT; pump : BOOL; starts : DINT; END_VAR
VAR above : TON; start, stop : COMMAND; rises : R_TRIG; END_VAR
VAR RETAIN count : DINT; END_VAR
above(IN := AS_GOOD(level) > limit, PT := T#200ms);
start(POINT := pump, EXECUTE := above.Q, VALUE := 1.0, SELECT := TRUE);
stop(POINT := pump, EXECUTE := level < 20, VALUE := 0.0, SELECT := TRUE);
rises(CLK := start.STATE = 9);
IF rises.Q THEN
  count := count + 1;
  MESSAGE('start {} of the pump at {}', count, level);
END_IF;
starts := count;
half := level / 2;
END_PROGRAM
"""
ENDLESS = """PROGRAM endless
VAR_EXTERNAL spin : BOOL; out : INT; END_VAR VAR n, m : DINT; END_VAR
out := 7; MESSAGE('out is {}', out);
WHILE spin DO
  out := 7; n := n MOD 99991 + 1; m := n;
END_WHILE;
END_PROGRAM
"""


def compiled(text: str, folder: Path, name: str) -> str:
    findings = Findings()
    program = compile_text(text, findings)
    assert not findings.failed, findings.sorted()
    file = folder / f"{name}.rtul"
    file.write_bytes(encode(program))
    return str(file)


def configuration(folder: Path) -> dict[str, Any]:
    pace = {"baud_rate": 19200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    slave = {
        "id": 10,
        **patience(),
        "probe_max_s": 1,
        "coils": [{"address": BREAKER, "name": "breaker"}, {"address": PUMP, "name": "pump", "select": True}],
        "discrete_inputs": [{"address": EARTHED, "name": "bay1.earthed"}, {"address": SPIN, "name": "spin"}],
        "input_registers": [{"address": LEVEL, "name": "level", "type": "scaled"}],
    }
    programs = [
        {
            "name": "interlock",
            "program": compiled(INTERLOCK.read_text(), folder, "interlock"),
            "period_ms": 50,
            "ca": CA["interlock"],
            "names": {"earthed": "bay1.earthed"},
            "points": [{"name": "order", "ioa": 1}, {"name": "locked", "ioa": 2}],
        },
        {
            "name": "filling",
            "program": compiled(FILLING, folder, "filling"),
            "period_ms": 20,
            "ca": CA["filling"],
            "points": [
                {"name": "limit", "ioa": 1, "value": 80},
                {"name": "half", "ioa": 2},
                {"name": "starts", "ioa": 3, "type": "counter"},
            ],
        },
        {
            "name": "endless",
            "program": compiled(ENDLESS, folder, "endless"),
            "budget": 1_000_000,
            "ca": CA["endless"],
            "points": [{"name": "out", "ioa": 1}],
        },
    ]
    port = {"value": 1, "active": 1, **pace, "slaves": [slave]}
    return {"iec104": {"connections_per_address": 8}, "force_max_s": 600, "port": [port], "logic": programs}


INITIAL = {
    DEVICE: {
        "coils": {"0": 0, "1": 0},
        "discrete_inputs": {"0": 1, "1": 0},
        "input_registers": {"0": 50},
    }
}


def settled(gateway: Gateway) -> bool:
    """Nobody has given the order yet: it is invalid."""
    return {name for name, point in gateway.points().items() if point["quality"] == "invalid"} <= {"order"}


def shown(desk: Desk, name: str) -> tuple[Any, str]:
    point = desk.gateway.points(name)[name]
    return point["value"], point["quality"]


def wait_value(desk: Desk, name: str, value: Any, quality: str = "good") -> None:
    def there() -> bool:
        seen, flags = shown(desk, name)
        return (seen, flags) == (value, quality) if value is not None else flags == quality

    desk.gateway.wait_for(there, WAIT_S, f"{name} is {value}, {quality}")


def wait_idle(desk: Desk) -> None:
    """Until no command goes on: a master hears of the confirmation before the value is read back."""
    desk.gateway.wait_for(
        lambda: {point["state"] for point in desk.gateway.query("commands")} == {"inactive command"},
        WAIT_S,
        "no command goes on",
    )
