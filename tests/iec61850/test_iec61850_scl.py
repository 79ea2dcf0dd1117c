# SPDX-License-Identifier: GPL-3.0-or-later
"""`rtud --scl`: IEC's schema takes it, and it says what the server answers, by name and type."""

import json
import struct
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from peers import mms, scl
from rig.desk import chapter_5

DEVICE, TRANSFORMED = "OpenRTUCA1010", "OpenRTUCA7"
NODES = {  # points of DEVICE that are more than GGIO's
    "feeder10.breaker-command": "Q0CSWI1.Pos",
    "feeder10.breaker-position": "Q0XCBR1.Pos",
    "feeder10.disconnector-position": "Q1XSWI1.Pos",
    "feeder10.spring-charged": "Q0XCBR1.LocKey",
    "feeder10.protection-trip": "PTOC1.Op",
    "feeder10.active-power": "MMXU1.TotW",
    "feeder10.cubicle-temperature": "STMP1.Tmp",
}


def site_config(port: int) -> dict[str, Any]:
    config = chapter_5() | {
        "iec61850": {"address": "127.0.0.1", "port": port, "controllers": ["127.0.0.1"], "max_pdu": 65000}
    }
    tables = ("coils", "discrete_inputs", "input_registers", "holding_registers")
    for each in (each for s in config["port"][0]["slaves"] for table in tables for each in s[table]):
        if each["name"] in NODES:
            each["ln"] = NODES[each["name"]]
    config["modules"] = [TRANSFORMER]
    feeder = next(each for each in config["port"][0]["slaves"] if each["id"] == 10)
    feeder["holding_registers"].append(SET_POINT)
    config["iec61850"] |= {"data_sets": CHOSEN, "limits": LIMITS}
    return config


CHOSEN = [
    {
        "name": "Tap",
        "points": ["t1.limit", "t1.tap", "t1.energy"],  # of several nodes, under ST and MX
        "reports": [
            {
                "name": "brcbTap",
                "buffered": True,
                "instances": 2,
                "id": "T1 & tap",
                "triggers": ["dchg", "dupd", "period"],
                "options": ["seqNum", "entryID", "configRef"],
                "buffer_ms": 40,
                "integrity_ms": 60000,
            },
            {"name": "urcbTap", "triggers": ["gi"], "options": ["dataRef", "dataSet"]},
        ],
    },
    {
        "name": "Attributes",
        "ln": "T1YLTC1",
        "points": ["t1.limit[mxVal.f]", "t1.tap[valWTr]", "t1.tap[q]", "t1.energy[actVal]", "t1.trip"],
        "reports": [{"name": "urcbSome", "triggers": ["gi"], "options": ["dataRef", "dataSet"]}],
    },
    {"name": "All", "conf_rev": 7, "points": ["t1.trip", "t1.tap"], "reports": [{"name": "urcbAll"}]},
]
# Units as people write them: SIUnit and multiplier, as IEC 61850-7-3 numbers them, if it does.
UNITS = {
    "MW": (38, 6),
    "kV": (29, 3),
    "A": (5, 0),
    "Mvar": (63, 6),
    "kVA": (61, 3),
    "Hz": (33, 0),
    "°C": (23, 0),
    "%": (1, -2),
    "m³/s": (45, 0),
    "hPa": (39, 2),
    "µS": (27, -6),
    "mg": (3, -6),
    "min": (85, 0),
    "mm²": None,
    "bar": None,
    "furlong": None,
}
MEASURED = [
    {"name": f"unit{i}", "type": ("float", "scaled")[i % 2], "ioa": 100 + i, "unit": unit}
    for i, unit in enumerate(UNITS)
] + [
    {"name": "unit.counter", "type": "counter", "ioa": 200, "unit": "kWh"},
    {"name": "unit.whole", "type": "integer", "ioa": 201, "unit": "h"},
    {"name": "unit.part", "type": "normalized", "ioa": 202, "unit": "A", "deadband": 16384},
    {"name": "unit.angle", "type": "angle", "ioa": 203},
    {"name": "unit.band", "type": "float", "ioa": 204, "deadband": 0.25},
    {"name": "range.plain", "type": "float", "ioa": 205},
    {"name": "range.all", "type": "normalized", "ioa": 206, "unit": "%", "deadband": 64},
    {"name": "range.node", "type": "integer", "ioa": 207, "unit": "kW", "ln": "MMXU2.TotW"},
]
LIMITS = [
    {"point": "range.node", "high_high": 9, "high": 8, "low": -8, "low_low": -9},
    {"point": "range.all", "high_high": 32767, "high": 16384, "low": -16384, "low_low": -32768},
    {"point": "range.plain", "high_high": 0.5, "high": 0.5, "low": 0.25, "low_low": 0.25},
]
SET_POINT = {  # of a holding register of DEVICE
    "address": 950,
    "type": "float",
    "ioa": 9950,
    "name": "feeder10.limit",
    "unit": "°C",
    "step": 0.5,
    "min": -10,
    "max": 40,
}
TRANSFORMER = {
    "name": "transformer",
    "program": "/bin/false",
    "ca": 7,
    "points": [
        {"name": "t1.tap", "type": "step", "ioa": 1, "ln": "T1YLTC1.TapPos"},
        {"name": "t1.commanded-tap", "type": "step", "ioa": 2, "ln": "T1YLTC1.TapChg"},
        {"name": "q9.kind", "type": "integer", "ioa": 3, "ln": "Q9XSWI1.SwTyp"},
        {"name": "t1.energy", "type": "counter", "ioa": 4, "ln": "T1MMTR1.SupWh"},
        {"name": "t1.trip", "type": "single", "ioa": 5, "ln": "T1PTRC1.Str"},
        {"name": "t1.limit", "type": "float", "ioa": 6, "command": True, "ln": "T1GGIO2.AnOut17"},
        {"name": "t1.state", "type": "bitstring", "ioa": 7},
        *MEASURED,
    ],
}


def site_gateway(port: int, directory: Path, programs: Path) -> Gateway:
    """Its lines have no devices, and one module no program: names and types need none."""
    return Gateway(listening_on(site_config(port), free_port()), directory, programs)


@pytest.fixture(scope="module")
def gateway(programs: Path) -> Iterator[Gateway]:
    directory = run_directory()
    try:
        with site_gateway(free_port(), directory, programs) as running:
            yield running
    finally:
        remove(directory)


Describe = Callable[..., bytes]


@pytest.fixture
def describe(programs: Path, tmp_path: Path) -> Describe:
    """What `rtud --scl` prints of a configuration; `said`: on stderr."""

    def run(config: dict[str, Any], *options: str, code: int = 0, message: str = "") -> bytes:
        file = tmp_path / "gateway.json"
        file.write_text(json.dumps(config))
        command = [programs / "rtud/rtud", "--scl", *options, file]
        result = subprocess.run(command, capture_output=True, check=False)
        assert result.returncode == code, result.stderr
        assert message in result.stderr.decode()
        return result.stdout

    return run


def type_of(octets: bytes) -> Any:
    """A TypeSpecification, as peers.scl has it."""
    ((tag, content),) = mms.elements(octets)
    if tag == 0xA2:
        ((_, components),) = mms.elements(content)
        parts = []
        for _, component in mms.elements(components):
            (_, name), (_, kind) = mms.elements(component)
            parts.append((name.decode(), type_of(kind)))
        return parts
    sized = tag in (0x84, 0x85, 0x86, 0x89, 0x8A)
    return tag, int.from_bytes(content, "big", signed=True) if sized else None


def served_type(client: mms.Client, device: str, name: str) -> Any:
    tag, ((_, content),) = client.ask(mms.element(mms.TYPE, mms.element(0xA0, mms.name(device, name))))
    assert tag == mms.RESPONSE, name
    _, (_, kind) = mms.elements(content)
    return type_of(kind)


def served_members(client: mms.Client, device: str, name: str) -> list[str]:
    tag, ((_, content),) = client.ask(mms.element(mms.LIST_ATTRIBUTES, mms.name(device, name)))
    assert tag == mms.RESPONSE, name
    return mms.variable_names(mms.elements(content)[1][1])


def shown(octets: tuple[int, bytes]) -> str:
    """A value, as SCL writes it."""
    tag, content = octets
    if tag in (0x85, 0x86):
        return str(int.from_bytes(content, "big", signed=True))
    return fewest_digits(content[1:]) if tag == 0x87 else content.decode()


def fewest_digits(octets: bytes) -> str:
    """Of a float: 0.1, and not 0.100000001."""
    (number,) = struct.unpack(">f", octets)
    texts = (f"{number:.{digits}g}" for digits in range(6, 10))
    return next(text for text in texts if struct.pack(">f", float(text)) == octets)


def check_same(client: mms.Client, file: scl.File) -> None:
    """Every name, type, data set and value of the file is the server's, and the server has no other."""
    assert client.names(9) == list(file.devices)
    for name, device in file.devices.items():
        assert set(client.names(0, name)) == device.names
        assert client.names(2, name) == sorted(device.sets)
        for variable, kind in device.types.items():
            assert served_type(client, name, variable) == kind, variable
        for data_set, members in device.sets.items():
            assert served_members(client, name, data_set) == members
        variables = list(device.values)
        for i in range(0, len(variables), 100):
            some = variables[i : i + 100]
            answers = client.values(*[(name, variable) for variable in some])
            assert [shown(answer) for answer in answers] == [device.values[variable] for variable in some]
        revisions = client.values(*[(name, f"{block}$ConfRev") for block in device.revisions])
        assert [int.from_bytes(content, "big") for _, content in revisions] == list(device.revisions.values())


def test_the_file_says_what_the_server_answers(gateway: Gateway, describe: Describe) -> None:
    config = gateway.configuration()
    text = describe(config, "--cid")
    assert scl.errors(text) == []
    with mms.Client(config["iec61850"]["port"], 65000) as client:
        check_same(client, scl.File(text))


def test_a_point_is_the_data_object_that_the_file_says(gateway: Gateway) -> None:
    invalid, unknown = bytes.fromhex("034200"), bytes(8)
    with mms.Client(gateway.configuration()["iec61850"]["port"], 65000) as client:
        names = set(client.names(0, DEVICE))
        for point, name in NODES.items():
            node, _, data = name.partition(".")
            (value,) = client.values((DEVICE, f"{node}$DC${data}$d"))
            assert value == (0x8A, point.encode())
        assert "Q0CSWI1$CO$Pos$SBOw" in names and not any(name.startswith("Q0XCBR1$CO") for name in names)
        assert "Q0XCBR1$ST$Loc$stVal" in names and "Q0CSWI1$ST$Loc$stVal" not in names
        # What the class has to have, and no point is: there, and not valid.
        assert client.values(
            (DEVICE, "Q0XCBR1$ST$Beh$stVal"),
            (DEVICE, "Q0XCBR1$ST$BlkOpn$stVal"),
            (DEVICE, "Q0XCBR1$ST$BlkOpn$q"),
            (DEVICE, "Q0XCBR1$ST$OpCnt$t"),
            (DEVICE, "Q1XSWI1$ST$SwTyp$stVal"),
        ) == [(0x85, b"\1"), (0x83, b"\0"), (0x84, invalid), (0x91, unknown), (0x85, b"\1")]


def numbers(answers: list[tuple[int, bytes]]) -> list[float]:
    return [float(shown(answer)) for answer in answers]


def test_units_are_those_of_the_points(gateway: Gateway) -> None:
    """SIUnit and multiplier of what has a unit that IEC 61850 knows; nothing of the others."""
    with mms.Client(gateway.configuration()["iec61850"]["port"], 65000) as client:
        names = client.names(0, TRANSFORMED)

        def units(data: str) -> tuple[float, ...] | None:
            if f"GGIO1$CF${data}$units" not in names:
                assert not any(name.startswith(f"GGIO1$CF${data}$units") for name in names)
                return None
            parts = (f"GGIO1$CF${data}$units$SIUnit", f"GGIO1$CF${data}$units$multiplier")
            return tuple(numbers(client.values(*[(TRANSFORMED, part) for part in parts])))

        assert {unit: units(f"AnIn{100 + i}") for i, unit in enumerate(UNITS)} == UNITS
        assert (units("CntVal200"), units("IntIn201")) == ((72, 3), (84, 0))
        assert (units("AnIn202"), units("AnIn203"), units("AnIn204")) == (None, (9, 0), None)


def test_deadbands_and_limits_are_those_of_the_points(gateway: Gateway) -> None:
    """A deadband is all of dbRef; a set-point has what it may be set to."""
    deadbands = [f"GGIO1$CF$AnIn{ioa}${name}" for ioa in (204, 202) for name in ("db", "dbRef")]
    parts = ("minVal$f", "maxVal$f", "stepSize$f", "units$SIUnit")
    with mms.Client(gateway.configuration()["iec61850"]["port"], 65000) as client:
        answers = client.values(*[(TRANSFORMED, name) for name in deadbands])
        assert numbers(answers) == [100_000, 0.25, 100_000, 0.5]
        assert "GGIO1$CF$AnIn100$db" not in client.names(0, TRANSFORMED)
        answers = client.values(*[(DEVICE, f"GGIO1$CF$AnOut9950${part}") for part in parts])
        assert numbers(answers) == [-10, 40, 0.5, 23]
        limits = [f"GGIO1$CF$AnIn206$rangeC${name}$f" for name in ("hhLim", "hLim", "lLim", "llLim")]
        answers = client.values(*[(TRANSFORMED, name) for name in limits])
        assert numbers(answers) == [pytest.approx(32767 / 32768), 0.5, -0.5, -1]


@pytest.mark.slow
def test_another_unit_starts_the_module_again(gateway: Gateway) -> None:
    config = gateway.configuration()
    changed = json.loads(json.dumps(config))
    feeder = next(each for each in changed["port"][0]["slaves"] if each["id"] == 10)
    feeder["holding_registers"][-1]["unit"] = "kV"
    name = "GGIO1$CF$AnOut9950$units$multiplier"
    for document, multiplier in ((changed, 3), (config, 0)):
        gateway.ctl("reload", gateway.put(document))

        def told(wanted: int = multiplier) -> bool:
            try:
                with mms.Client(config["iec61850"]["port"], 65000) as client:
                    return numbers(client.values((DEVICE, name))) == [wanted]
            except (OSError, AssertionError, ValueError):
                return False  # it ends, or has not begun

        gateway.wait_for(told, 20, "the point has its other unit")


@pytest.mark.slow
def test_rtuctl_shows_who_has_which_block(gateway: Gateway) -> None:
    block, yes = "LLN0$RP$urcbStatus01", bytes.fromhex("8301ff")

    def shown() -> dict[str, Any]:
        (found,) = gateway.query("iec61850")
        return found

    with mms.Client(gateway.configuration()["iec61850"]["port"], 2000) as client:
        assert client.write(DEVICE, (f"{block}$RptEna", yes)) == [mms.DONE]
        gateway.wait_for(lambda: len(shown()["blocks"]) == 1, 10, "the block is shown")
        (association,), (reserved,) = shown()["associations"], shown()["blocks"]
        assert (association["peer"], association["associated"]) == ("127.0.0.1", True)
        assert association["pdu"] == 2000
        assert reserved == {"block": f"{DEVICE}/{block}", "peer": "127.0.0.1", "enabled": True, "sqnum": 0}
        assert f"{DEVICE}/{block}" in gateway.ctl("iec61850", "blocks")
    gateway.wait_for(lambda: not shown()["associations"] and not shown()["blocks"], 10, "nobody is shown")


@pytest.mark.slow
def test_another_ln_starts_the_module_again(gateway: Gateway) -> None:
    config = gateway.configuration()
    port = config["iec61850"]["port"]
    changed = json.loads(json.dumps(config).replace("Q1XSWI1.Pos", "Q2XSWI1.Pos"))
    for document, there in ((changed, "Q2XSWI1"), (config, "Q1XSWI1")):
        gateway.ctl("reload", gateway.put(document))

        def renamed(name: str = there) -> bool:
            try:
                with mms.Client(port, 65000) as client:
                    return name in client.names(0, DEVICE)
            except (OSError, AssertionError, ValueError):
                return False  # it ends, or has not begun

        gateway.wait_for(renamed, 20, "the point has its other name")


@pytest.mark.parametrize(
    ("device", "block"),
    [
        (DEVICE, "urcbStatus01"),
        (DEVICE, "brcbMeasured02"),
        (TRANSFORMED, "urcbTap01"),
        (TRANSFORMED, "urcbSome01"),
    ],
)
def test_a_report_has_the_members_of_all_nodes(gateway: Gateway, device: str, block: str) -> None:
    """What an interrogation tells is what a Read of the same names does."""
    node = "T1YLTC1" if block == "urcbSome01" else "LLN0"
    path = f"{node}${'BR' if block[0] == 'b' else 'RP'}${block}"
    yes = bytes.fromhex("8301ff")
    with mms.Client(gateway.configuration()["iec61850"]["port"], 65000) as client:
        ((_, of),) = client.values((device, f"{path}$DatSet"))
        names = served_members(client, device, of.decode().partition("/")[2])
        writes = [("TrgOps", "84020204"), ("OptFlds", "8403060400")]  # gi, dataRef
        for name, octets in writes:
            assert client.write(device, (f"{path}${name}", bytes.fromhex(octets))) == [mms.DONE]
        assert client.write(device, (f"{path}$RptEna", yes), (f"{path}$GI", yes)) == [mms.DONE] * 2
        _, _, _, *rest = client.report()
        assert len(rest) == 2 * len(names)
        references, values = rest[: len(names)], rest[len(names) :]
        assert [text.decode() for _, text in references] == [f"{device}/{name}" for name in names]
        assert values == client.values(*[(device, name) for name in names])
        assert len({name.partition("$")[0] for name in names}) > 1


def test_blocks_begin_as_the_file_has_them(gateway: Gateway) -> None:
    attributes = ["RptID", "ConfRev", "OptFlds", "BufTm", "TrgOps", "IntgPd", "ResvTms"]
    with mms.Client(gateway.configuration()["iec61850"]["port"], 65000) as client:
        names = [(TRANSFORMED, f"LLN0$BR$brcbTap02${name}") for name in attributes]
        text, _, options, buffer_ms, triggers, integrity_ms, reserved = client.values(*names)
        assert text == (0x8A, b"T1 & tap") and reserved == (0x85, b"\0")
        assert (options[1], triggers[1]) == (bytes.fromhex("064180"), bytes.fromhex("0258"))
        assert (buffer_ms[1], integrity_ms[1]) == (b"\x28", b"\0\xea\x60")
        assert client.values((TRANSFORMED, "LLN0$RP$urcbAll01$ConfRev")) == [(0x86, b"\7")]


@pytest.mark.slow
def test_a_reservation_outlives_the_association_of_its_client(gateway: Gateway) -> None:
    port = gateway.configuration()["iec61850"]["port"]
    block, busy = "LLN0$BR$brcbTap01", (0x80, b"\2")

    def reserve(client: mms.Client, seconds: int) -> list[tuple[int, bytes]]:
        return client.write(TRANSFORMED, (f"{block}$ResvTms", mms.element(0x85, bytes([seconds]))))

    def owner(client: mms.Client) -> bytes:
        return client.values((TRANSFORMED, f"{block}$Owner"))[0][1]

    with mms.Client(port, 65000, source="127.0.0.2") as client:
        assert owner(client) == b""
        assert reserve(client, 0xFF) == [(0x80, b"\x0b")]  # -1 is of configurations
        assert reserve(client, 100) == [mms.DONE]
        assert owner(client) == bytes([127, 0, 0, 2])
        assert client.write(TRANSFORMED, (f"{block}$Owner", mms.element(0x89, b""))) == [(0x80, b"\3")]
    with mms.Client(port, 65000) as other:
        gateway.wait_for(lambda: not gateway.query("iec61850")[0]["blocks"], 10, "its client is gone")
        assert reserve(other, 1) == [busy] and owner(other) == bytes([127, 0, 0, 2])
        with mms.Client(port, 65000, source="127.0.0.2") as again:
            assert reserve(again, 1) == [mms.DONE]
        gateway.wait_for(lambda: owner(other) == b"", 20, "the reservation is over")
        assert reserve(other, 1) == [mms.DONE] and owner(other) == bytes([127, 0, 0, 1])
        assert reserve(other, 0) == [mms.DONE] and owner(other) == b""


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": ["t1.tap", "feeder10.active-power"]}, "another common address"),
        ({"points": ["t1.tap", "t1.tap"]}, "in the data set already"),
        ({"points": ["t1.lost"]}, "the name of no point"),
        ({"points": []}, "expected one at least"),
        ({"points": ["t1.tap[stVal]"]}, 'no attribute "stVal", expected one of valWTr q t'),
        ({"points": ["t1.tap[]x"]}, "the name of no point"),
        ({"points": ["t1.tap[q]", "t1.tap[q]"]}, "in the data set already"),
        ({"name": "1st"}, "no name of SCL"),
        ({"name": "All"}, 'two data sets "All" of CA 7'),
        ({"ln": "T9YLTC1"}, '"T9YLTC1" is no logical node of CA 7 that has a point'),
        ({"ln": "LPHD1"}, '"LPHD1" is no logical node of CA 7 that has a point'),
        ({"reports": [{"name": "urcbAll"}]}, 'two control blocks "urcbAll"'),
        ({"reports": [{"name": "x", "options": ["entryID"]}]}, "of buffered reports alone"),
        (
            {"reports": [{"name": "x", "integrity_ms": 99}]},
            "an integrity_ms of 99, expected 0 or 100 at least",
        ),
        ({"reports": [{"name": "x", "triggers": ["GI"]}]}, "is none of dchg qchg dupd period gi"),
    ],
)
def test_data_sets_are_checked(describe: Describe, change: dict[str, Any], message: str) -> None:
    config = site_config(102)
    config["iec61850"]["data_sets"] = [CHOSEN[0] | change, CHOSEN[-1]]
    describe(config, code=1, message=message)


def test_an_icd_is_of_any_such_ied(describe: Describe) -> None:
    text = describe(site_config(102))
    assert scl.errors(text) == []
    file = scl.File(text)
    assert file.ied.get("name") == "TEMPLATE"
    assert file.root.find("Communication", scl.NS) is None
    assert describe(chapter_5(), code=1, message='has no object "iec61850"') == b""


CONTROL = {"SPC": "ST", "DPC": "ST", "INC": "ST", "APC": "MX"}  # the functional constraint of stSeld
# IEC 61850-7-3, edition 2.1, tables of the common data classes: what tells a change, a quality, an update.
TRIGGERS = {
    "stVal": "dchg", "general": "dchg", "dirGeneral": "dchg", "actVal": "dchg", "range": "dchg",
    "stSeld": "dchg",
    "mag": "dchg dupd", "mxVal": "dchg dupd", "valWTr": "dchg dupd", "q": "qchg",
}  # fmt: skip
UPDATED = ("INS", "ENS", "ENC", "INC")  # of which stVal is


@pytest.mark.parametrize("security", ["normal", "enhanced"])
def test_classes_have_what_is_mandatory_and_its_triggers(describe: Describe, security: str) -> None:
    """Presence conditions MOsbo and MOenhanced. What is under CF tells its changes."""
    config = site_config(102)
    config["iec61850"]["control_security"] = security
    models = set()
    for each in scl.File(describe(config)).root.iterfind(".//DOType", scl.NS):
        cdc = each.get("cdc")
        there = {(da.get("name"), da.get("fc")): da for da in each.iterfind("DA", scl.NS)}
        if ("ctlModel", "CF") in there:
            model = there["ctlModel", "CF"].findtext("Val", None, scl.NS)
            assert (("stSeld", CONTROL.get(cdc)) in there) is ("sbo" in model)
            assert (("sboTimeout", "CF") in there) is ("sbo" in model)
            assert (("operTimeout", "CF") in there) is ("enhanced" in model)
            models.add(model)
        for (name, fc), da in there.items():
            told = " ".join(word for word in ("dchg", "qchg", "dupd") if da.get(word) == "true")
            expected = "dchg" if fc == "CF" else TRIGGERS.get(name, "")
            if (name, fc) == ("stVal", "ST") and cdc in UPDATED:
                expected = "dchg dupd"
            assert told == expected, (each.get("id"), name)
    assert models == {"status-only", *(f"{way}-with-{security}-security" for way in ("direct", "sbo"))}


def test_capabilities_of_switches_are_of_their_classes(describe: Describe) -> None:
    """The report's own breaker has them (figure 6.4)."""
    config = site_config(102)
    kinds = ("Q7XCBR1.CBOpCap", "Q7XCBR1.POWCap", "Q7XCBR1.MaxOpCap", "Q7XSWI1.SwOpCap", "Q7XSWI1.MaxOpCap")
    config["modules"][0]["points"] += [
        {"name": f"q7.{ln}", "type": "integer", "ioa": 300 + place, "ln": ln}
        for place, ln in enumerate(kinds)
    ]
    text = describe(config)
    assert scl.errors(text) == []
    root = scl.File(text).root
    types = {each.get("id"): each for each in root.iterfind(".//DOType", scl.NS)}
    (breaker,) = root.iterfind(".//LNodeType[@id='CA7_Q7XCBR1']", scl.NS)
    there = {each.get("name"): types[each.get("type")] for each in breaker.iterfind("DO", scl.NS)}
    assert {name: there[name].get("cdc") for name in ("CBOpCap", "POWCap", "MaxOpCap")} == {
        "CBOpCap": "ENS", "POWCap": "ENS", "MaxOpCap": "INS"
    }  # fmt: skip
    (capability,) = root.iterfind(".//EnumType[@id='SwitchingCapabilityKind']", scl.NS)
    assert capability[4].text == "Close-Open-Close-Open"


def test_other_editions_and_an_iid(describe: Describe) -> None:
    """Edition 2 names no release, and is else the same; its schema is not here. An IID is a CID."""
    config = site_config(102)
    whole = describe(config, "--cid")
    assert describe(config, "--iid") == whole == describe(config, "--cid", "--edition", "2.1")
    second = describe(config, "--iid", "--edition", "2")
    root = scl.File(second).root
    assert (root.get("version"), root.get("revision"), root.get("release")) == ("2007", "B", None)
    assert whole.replace(b' release="4"', b"").replace(b' originalSclRelease="4"', b"") == second
    describe(config, "--edition", "1", code=2, message="--edition 1: expected 2 or 2.1")


def test_names_are_escaped(describe: Describe) -> None:
    config = site_config(102)
    config["port"][0]["slaves"][0]["description"] = 'Müller & <Söhne> "1"'
    text = describe(config)
    assert scl.errors(text) == []
    names = [each.get("desc") for each in scl.File(text).ied.iterfind(".//LDevice", scl.NS)]
    assert 'M??ller & <S??hne> "1"' in names


def test_each_point_has_its_address_of_104(programs: Path, describe: Describe, tmp_path: Path) -> None:
    config = site_config(102)
    file = scl.File(describe(config))
    found = {}
    for address in file.root.iter(f"{{{scl.NS_104}}}Address"):
        key = int(address.get("casdu")), int(address.get("ioa"))
        found.setdefault(key, []).append(int(address.get("ti")))
    (tmp_path / "points.json").write_text(json.dumps(config))
    command = [programs / "rtud/rtud", "--points", tmp_path / "points.json"]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    columns = [line.split(",")[:5] for line in lines[1:]]
    assert {(int(ca), int(ioa)) for ca, ioa, *_ in columns} == found.keys()
    numbers = {"M_SP_TB_1": 30, "M_DP_TB_1": 31, "M_ST_TB_1": 32, "M_BO_TB_1": 33, "M_ME_TD_1": 34}
    numbers |= {"M_ME_TE_1": 35, "M_ME_TF_1": 36, "M_IT_TB_1": 37, "M_ME_ND_1": 21}
    numbers |= {"C_SC_NA_1": 45, "C_DC_NA_1": 46, "C_SE_NA_1": 48, "C_SE_NB_1": 49, "C_SE_NC_1": 50}
    numbers |= {"C_BO_NA_1": 51}
    for ca, ioa, _, event, command_type in columns:
        wanted = [numbers[event]] + [numbers[name] for name in command_type.split()[:1]]
        assert found[int(ca), int(ioa)] == wanted, (ca, ioa)


def test_conf_rev_changes_with_the_data_set_alone(describe: Describe) -> None:
    def revisions(change: Callable[[dict[str, Any]], None] = lambda _: None) -> dict[str, dict[str, int]]:
        config = site_config(102)
        change(config)
        return {
            name: device.revisions for name, device in scl.File(describe(config, "--cid")).devices.items()
        }

    def harmless(config: dict[str, Any]) -> None:
        slave = config["port"][0]["slaves"][1]
        slave["description"] = "another"
        slave["retries"] = 1
        config["iec61850"]["controllers"] = []

    def grow(config: dict[str, Any]) -> None:
        slave = next(s for s in config["port"][0]["slaves"] if s["id"] == 10)
        slave.setdefault("coils", []).append({"address": 900, "type": "single", "ioa": 9900})

    def limit(high: float) -> Callable[[dict[str, Any]], None]:
        limits = {"point": "feeder10.active-power", "high_high": 99, "high": high, "low": 0, "low_low": 0}
        return lambda config: config["iec61850"].update(limits=[*LIMITS, limits])

    def changed(after: dict[str, dict[str, int]]) -> set[tuple[str, str]]:
        """Devices, and the kinds of their control blocks."""
        return {
            (device, block.split("$")[2][4:-2])
            for device, blocks in before.items()
            for block in blocks
            if after[device][block] != blocks[block]
        }

    before = revisions()
    assert revisions(harmless) == before
    assert changed(revisions(grow)) == {(DEVICE, "Status")}
    ranged = revisions(limit(90))  # the member has range then, wherever the limit is
    assert changed(ranged) == {(DEVICE, "Measured")} and revisions(limit(80)) == ranged


@pytest.mark.slow
def test_goose_control_blocks_of_the_ied_are_in_it(describe: Describe) -> None:
    def publication(name: str, device: str) -> dict[str, Any]:
        return {
            "name": name,
            "control_block": f"{device}/LLN0$GO${name}",
            "data_set": f"{device}/LLN0${name}",
            "destination": "01:0c:cd:01:00:0a",
            "app_id": 10,
            "vlan": 17,
            "points": ["feeder10.breaker-command"],
        }

    config = site_config(102)
    config["goose"] = {
        "interface": "eth1",
        "publish": [publication("bay", DEVICE), publication("x", "GW1LD0")],
    }
    text = describe(config, "--cid", message="goose.publish[1] is left out")
    assert scl.errors(text) == []
    file = scl.File(text)
    (block,) = file.root.iter(f"{{{scl.NS['']}}}GSEControl")
    assert (block.get("name"), block.get("datSet"), block.get("confRev")) == ("bay", "bay", "1")
    (address,) = file.root.iter(f"{{{scl.NS['']}}}GSE")
    assert (address.get("ldInst"), address.get("cbName")) == ("CA1010", "bay")
    parts = {each.get("type"): each.text for each in address.iterfind("Address/P", scl.NS)}
    assert parts == {
        "MAC-Address": "01-0C-CD-01-00-0A",
        "APPID": "000A",
        "VLAN-ID": "011",
        "VLAN-PRIORITY": "4",
    }
    (data_set,) = (
        each for each in block.getparent().iterfind("DataSet", scl.NS) if each.get("name") == "bay"
    )
    assert [each.get("daName") for each in data_set] == ["stVal", "q"]
