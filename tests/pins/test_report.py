# SPDX-License-Identifier: GPL-3.0-or-later
"""The four forms of a report: what a person, a script, a code host and a CI log read."""

import json
import re
from pathlib import Path

from nuc980.pins.findings import Claimant, Finding
from nuc980.pins.report import FORMATS, Checked
from nuc980.pins.rules import RULES
from nuc980.pins.tree import Place

CONFLICT = Finding(
    rule="pin-conflict",
    node="/ahb/sdh@b0018000",
    message="PF0 is claimed by two devices",
    remedy='Set status of one of them to "disabled", 100 % sure',
    place=Place("dts/a,b.dts", 12),
    claimants=(
        Claimant("/ahb/sdh@b0018000", "PF0 as SD1_CMD", Place("dts/nuvoton/nuc980.dtsi", 70)),
        Claimant("/ahb/emac1@b0022000", "PF0 as RMII1_RXERR"),
    ),
    pins=("PF0",),
)
KNOWN = Finding(
    "no-pins", "/apb/i2c0@b0080000", "i2c0 has no pins", "Give it pins", accepted="tested without"
)
COMPILED = Checked(Path("board.dtb"), (CONFLICT, KNOWN))


def test_text_names_place_claimants_and_remedy() -> None:
    lines = FORMATS["text"]([COMPILED]).splitlines()
    assert lines == [
        "dts/a,b.dts:12: pin-conflict: PF0 is claimed by two devices",
        "    /ahb/sdh@b0018000 (dts/nuvoton/nuc980.dtsi:70): PF0 as SD1_CMD",
        "    /ahb/emac1@b0022000: PF0 as RMII1_RXERR",
        '    To do: Set status of one of them to "disabled", 100 % sure',
        "",
        "board.dtb: /apb/i2c0@b0080000: no-pins: accepted: tested without",
        "board.dtb: 1 finding, 1 accepted",
    ]


def test_text_of_a_clean_file() -> None:
    assert FORMATS["text"]([Checked(Path("a.dts"), ())]) == "a.dts: no findings"


def test_json_has_all_of_it() -> None:
    (file,) = json.loads(FORMATS["json"]([COMPILED]))["files"]
    first, second = file["findings"]
    assert file["file"] == "board.dtb"
    assert first["place"] == {"file": "dts/a,b.dts", "line": 12}
    assert [claimant["wants"] for claimant in first["claimants"]] == ["PF0 as SD1_CMD", "PF0 as RMII1_RXERR"]
    assert (first["accepted"], second["accepted"], second["place"]) == (None, "tested without", None)


def test_sarif() -> None:
    log = json.loads(FORMATS["sarif"]([COMPILED]))
    (run,) = log["runs"]
    assert log["version"] == "2.1.0"
    assert [rule["id"] for rule in run["tool"]["driver"]["rules"]] == list(RULES)
    conflict, known = run["results"]
    location = conflict["locations"][0]
    assert location["physicalLocation"] == {
        "artifactLocation": {"uri": "dts/a%2Cb.dts"},
        "region": {"startLine": 12},
    }
    assert location["logicalLocations"][0]["fullyQualifiedName"] == "/ahb/sdh@b0018000"
    assert len(conflict["relatedLocations"]) == 2
    assert "suppressions" not in conflict
    assert known["suppressions"] == [{"kind": "external", "justification": "tested without"}]
    assert known["locations"][0]["physicalLocation"] == {"artifactLocation": {"uri": "board.dtb"}}


def test_sarif_names_files_by_uri() -> None:
    files = [Path("a b/50%#1.dtb"), Path("/a b.dtb")]
    log = json.loads(FORMATS["sarif"]([Checked(file, (KNOWN,)) for file in files]))
    uris = [
        result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"]
        for result in log["runs"][0]["results"]
    ]
    assert uris == ["a%20b/50%25%231.dtb", "file:///a%20b.dtb"]


def test_github_escapes_what_would_end_a_field() -> None:
    error, notice = FORMATS["github"]([COMPILED]).splitlines()
    assert error == (
        "::error file=dts/a%2Cb.dts,line=12,title=pin-conflict at /ahb/sdh@b0018000"
        '::PF0 is claimed by two devices. Set status of one of them to "disabled", 100 %25 sure.'
    )
    assert re.match(
        r"::notice file=board\.dtb,title=no-pins at /apb/i2c0@b0080000::.*Accepted: tested", notice
    )
