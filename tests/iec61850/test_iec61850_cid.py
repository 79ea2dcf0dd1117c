# SPDX-License-Identifier: GPL-3.0-or-later
"""`openrtu scl`: a CID that a tool has changed becomes the configuration, and hostile files do not."""

import io
import json
import subprocess
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from openrtu_tools.cli import main

POINTS = [
    {"name": "q0.position", "type": "double", "ioa": 1, "ln": "Q0XCBR1.Pos"},
    {"name": "q0.power", "type": "float", "ioa": 2, "unit": "MW", "ln": "MMXU1.TotW"},
    {"name": "q0.trip", "type": "single", "ioa": 3},
]
LIMITS = {"high_high": 60, "high": 50, "low": -50, "low_low": -60}
CONFIG = {
    "port": [],
    "iec61850": {"address": "192.0.2.1", "limits": [{"point": "q0.power", **LIMITS}]},
    "modules": [{"name": "bay", "program": "/bin/false", "ca": 7, "points": POINTS}],
    "goose": {
        "interface": "eth1",
        "publish": [
            {
                "name": "trip",
                "control_block": "OpenRTUCA7/LLN0$GO$trip",
                "data_set": "OpenRTUCA7/LLN0$Trip",
                "destination": "01:0c:cd:01:00:0a",
                "app_id": 10,
                "points": ["q0.trip"],
            }
        ],
    },
}


@dataclass
class Tool:
    """An engineer's: changes the CID as text."""

    rtud: Path
    folder: Path

    def cid(self, config: dict[str, Any]) -> str:
        (self.folder / "gateway.json").write_text(json.dumps(config))
        command = [self.rtud, "--scl", "--cid", self.folder / "gateway.json"]
        text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        (self.folder / "own.cid").write_text(text)
        return text

    def take(self, text: str, *options: str) -> tuple[int, str, str]:
        """The configuration that it becomes."""
        (self.folder / "tool.cid").write_text(text)
        files = [self.folder / "gateway.json", self.folder / "tool.cid", "--own", self.folder / "own.cid"]
        out, errors = io.StringIO(), io.StringIO()
        with redirect_stdout(out), redirect_stderr(errors):
            code = main(["scl", *map(str, files), *options])
        return code, out.getvalue(), errors.getvalue()

    def taken(self, text: str) -> tuple[dict[str, Any], str]:
        """The configuration; what it makes is taken as it is then."""
        code, out, errors = self.take(text)
        assert code == 0, errors
        config = json.loads(out)
        self.cid(config)
        code, again, more = self.take(text)
        assert (code, json.loads(again)) == (0, config), more
        return config, errors


@pytest.fixture(scope="module")
def own(programs: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    return Tool(programs / "rtud/rtud", tmp_path_factory.mktemp("own")).cid(CONFIG)


@pytest.fixture
def tool(programs: Path, tmp_path: Path, own: str) -> Tool:
    """It has the configuration, and what rtud says of it."""
    (tmp_path / "gateway.json").write_text(json.dumps(CONFIG))
    (tmp_path / "own.cid").write_text(own)
    return Tool(programs / "rtud/rtud", tmp_path)


def replace(text: str, *pairs: tuple[str, str]) -> str:
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    return text


def test_what_rtud_has_written_changes_nothing(tool: Tool, own: str) -> None:
    assert tool.taken(own) == (CONFIG, "")


def test_data_sets_blocks_names_and_addresses_are_taken(tool: Tool, own: str) -> None:
    text = replace(
        own,
        ('OpenRTU"', 'Bay7"'),
        (">192.0.2.1<", ">192.0.2.9<"),
        ('name="measured"', 'name="Power"'),
        ('datSet="measured"', 'datSet="Power"'),
        ('name="brcbMeasured"', 'name="brcbPower" rptID="P"'),
        ('<P type="APPID">000A', '<P type="APPID">000B'),
        ('type="GOOSE" datSet="Trip" confRev="1"', 'type="GOOSE" datSet="Trip" confRev="3"'),
    )
    config, errors = tool.taken(text)
    assert (config["iec61850"]["ied"], config["iec61850"]["address"]) == ("Bay7", "192.0.2.9")
    power = next(each for each in config["iec61850"]["data_sets"] if each["name"] == "Power")
    assert power["points"] == ["q0.power"]
    buffered = next(each for each in power["reports"] if each["name"] == "brcbPower")
    assert buffered["id"] == "P" and buffered["instances"] == 2 and buffered["buffered"]
    assert buffered["triggers"] == ["dchg", "qchg"]
    (trip,) = config["goose"]["publish"]
    assert (trip["control_block"], trip["app_id"], trip["conf_rev"]) == ("Bay7CA7/LLN0$GO$trip", 11, 3)
    assert {line.partition(":")[0] for line in errors.splitlines()} == {
        "iec61850.ied",
        "iec61850.address",
        "iec61850.data_sets",
        "goose.publish",
    }


def test_data_sets_of_other_nodes_and_of_attributes_are_taken(tool: Tool, own: str) -> None:
    """A tool moves a data set and its control block from LLN0 to the breaker's node, and names attributes."""
    member = '<FCDA ldInst="CA7" prefix="Q0" lnClass="XCBR" lnInst="1" doName="Pos"'
    data_set = f'<DataSet name="Pos">{member} daName="stVal" fc="ST"/>{member} daName="q" fc="ST"/></DataSet>'
    triggers = '<TrgOps dchg="true" gi="false"/>'
    block = f'<ReportControl name="urcbPos" datSet="Pos" confRev="4">{triggers}</ReportControl>'
    node = next(line for line in own.splitlines() if '<LN prefix="Q0" lnClass="XCBR"' in line)
    config, _ = tool.taken(replace(own, (node, node + data_set + block)))
    chosen = next(each for each in config["iec61850"]["data_sets"] if each["name"] == "Pos")
    assert (chosen["ln"], chosen["conf_rev"]) == ("Q0XCBR1", 4)
    assert chosen["points"] == ["q0.position[stVal]", "q0.position[q]"]
    (report,) = chosen["reports"]
    assert (report["name"], report["triggers"]) == ("urcbPos", ["dchg"])


def test_a_node_with_another_prefix_is_the_same_point(tool: Tool, own: str) -> None:
    text = replace(own, ('prefix="Q0"', 'prefix="Q1"'))
    config, errors = tool.taken(text)
    assert [each.get("ln") for each in config["modules"][0]["points"]] == ["Q1XCBR1.Pos", "MMXU1.TotW", None]
    assert '"q0.position": is Q1XCBR1.Pos' in errors


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('ldInst="CA7" prefix="Q0"', 'ldInst="CA7" prefix="Q9"'), "Q9XCBR1.Pos [ST] is no point"),
        (('<LDevice inst="CA7"', '<LDevice inst="CA8"'), "CA8: the map has no such logical device"),
        (('ioa="2"', 'ioa="9"'), "the map has no CA 7 IOA 9"),
        (('<DO name="Pos"', '<DO name="Position"'), "CA7/Q0XCBR1.Position: the map has no such data object"),
        (('bType="Dbpos"', 'bType="BOOLEAN"'), "ST stVal is Dbpos, not BOOLEAN"),
        (("<Val>status-only</Val>", "<Val>sbo-with-normal-security</Val>"), "ctlModel is status-only"),
        (
            ("<Val>M</Val>", "<Val>k</Val>"),
            "CA7/MMXU1.TotW: is in SIUnit=W multiplier=M, not in SIUnit=W multiplier=k",
        ),
        (("<Val>-50</Val>", "<Val>-40</Val>"), "TotW: lLim of rangeC is -50.0, not -40.0"),
        (
            ('name="range" fc="MX" dchg="true" bType="Enum"', 'name="range" fc="MX" bType="INT32"'),
            "MX range is Enum, not INT32",
        ),
        (('<RptEnabled max="2"/>', '<RptEnabled max="17"/>'), "expected 16 at most"),
        (('datSet="status"', 'datSet="lost"'), "CA7/LLN0: has no data set lost"),
        (('<P type="APPID">000A</P>', ""), "no GSE with MAC-Address and APPID"),
        (("</LN0>", '<LogControl name="log" logName="L"/></LN0>'), "CA7/LLN0: has LogControl"),
    ],
)
def test_what_the_gateway_cannot_be_is_named(
    tool: Tool, own: str, change: tuple[str, str], message: str
) -> None:
    code, out, error = tool.take(replace(own, change))
    assert (code, out) == (1, "") and message in error


def bomb(_: str) -> str:
    entities = "".join(f'<!ENTITY a{i + 1} "{f"&a{i};" * 10}">' for i in range(9))
    return f'<!DOCTYPE SCL [<!ENTITY a0 "ha">{entities}]><SCL>&a9;</SCL>'


@pytest.mark.parametrize(
    ("hostile", "message"),
    [
        (bomb, "has a DOCTYPE"),
        (lambda _: '<!DOCTYPE SCL SYSTEM "file:///etc/passwd"><SCL/>', "has a DOCTYPE"),
        (lambda _: "<a>" * 100_000, "nested deeper than 32"),
        (lambda text: text[: text.index("\n", len(text) // 2)], "no element found"),
        (lambda _: "<SCL/>", "is no SCL file"),
        (
            lambda text: text.replace(' name="OpenRTU" type', ' name="" type').replace("<IED", "<IEd"),
            "mismatched",
        ),
        (lambda text: text.replace('ioa="1"', 'ioa="one"'), "no number"),
        (lambda text: text.replace("<Val>-50</Val>", "<Val>low</Val>"), "no number"),
        (lambda text: text.replace("<BDA ", '<BDA bType="Struct" type="loop" ', 1), "duplicate attribute"),
    ],
)
def test_hostile_files_are_refused(tool: Tool, own: str, hostile: Callable[[str], str], message: str) -> None:
    code, out, error = tool.take(hostile(own))
    assert (code, out) == (2, "") and message in error


def test_a_file_of_several_ieds_needs_one_named(tool: Tool, own: str) -> None:
    text = replace(own, ("</IED>", '</IED><IED name="Relay"/>'))
    assert "say which with --ied" in tool.take(text)[2]
    assert tool.take(text, "--ied", "OpenRTU")[0] == 0


def test_a_file_that_is_too_long_is_not_read(tool: Tool) -> None:
    with (tool.folder / "own.cid").open("ab") as file:
        file.truncate((64 << 20) + 1)
    assert "is longer than 64 MiB" in tool.take("<SCL/>")[2]
