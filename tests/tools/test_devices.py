# SPDX-License-Identifier: GPL-3.0-or-later
"""`openrtu devices`: the list, a search, one device, and what a folder lacks."""

import json
from pathlib import Path

import pytest

from openrtu_tools import devices
from openrtu_tools.cli import main
from rig.configuration import check_document

TEMPLATE = {
    "description": "M",
    "input_registers": [{"address": 0, "name": "U", "type": "float", "unit": "V"}],
}
ABOUT = {"maker": "Acme", "device": "M1", "kind": "meter", "connection": "Modbus TCP", "untried": True}


def said(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(["devices", *words]) == 0
    return capsys.readouterr().out


def test_list_has_kind_name_and_maker(capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(capsys).splitlines()
    assert lines[0].split() == ["KIND", "TEMPLATE", "OBJECTS", "MAKER", "DEVICE"]
    assert any(line.split()[:4] == ["meter", "sdm630", "12", "Eastron"] for line in lines)


def test_words_search_and_one_that_fits_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    several = said(capsys, "METER", "schneider")
    assert "schneider-pm5000" in several and "sdm630" not in several
    alone = said(capsys, "sdm630")  # exactly, though sdm630-all fits too
    assert "Untried" in alone and "i52" in alone and "Source: volkszaehler/mbmd" in alone
    use = json.loads(alone[alone.rindex("\n{") :])
    assert use["port"][0]["slaves"][0]["template"] == "sdm630"
    assert Path(use["include"][0]).is_file()


def test_json_has_the_objects_of_one(capsys: pytest.CaptureFixture[str]) -> None:
    (device,) = json.loads(said(capsys, "abb-b23", "--json"))
    assert (device["kind"], device["untried"]) == ("meter", True)
    assert device["keys"]["holding_registers"][0]["unit"] == "kWh"
    assert len(json.loads(said(capsys, "--json"))) > 40


def test_a_folder_of_ones_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "m.json").write_text(json.dumps({"about": ABOUT, "templates": {"m1": TEMPLATE}}))
    (tmp_path / "old.json").write_text(json.dumps({"about": "A note.", "templates": {"m2": TEMPLATE}}))
    assert [row.split()[:2] for row in said(capsys, "--folder", str(tmp_path)).splitlines()[1:]] == [
        ["m2", "1"],
        ["meter", "m1"],
    ]
    assert '"host": "192.0.2.20"' in said(capsys, "--folder", str(tmp_path), "acme")


def test_a_device_of_several_models_is_one_template(capsys: pytest.CaptureFixture[str]) -> None:
    made = json.loads(said(capsys, "--sunspec", "103@40069", "160@40200"))
    rows = {row["name"]: row for row in made["templates"]["sunspec-device"]["holding_registers"]}
    assert (rows["m103/W"]["address"], rows["m103/W"]["scale_register"]) == (40083, 40084)
    assert (rows["m160/module1/DCA"]["address"], rows["m160/module1/DCA"]["scale_register"]) == (40219, 40202)
    assert len({row["ioa"] for row in rows.values()}) == len(rows)
    for wrong in ("103", "103@x", "99999@40069", "103@65500", "103@65535"):
        assert main(["devices", "--sunspec", wrong]) == 2
        assert wrong in capsys.readouterr().err
    assert main(["devices", "--sunspec", "103@40069", "160@40080"]) == 2
    assert "160@40080: its registers are another" in capsys.readouterr().err


@pytest.mark.parametrize("words", [("103@69",), ("103@0", "160@65000"), ("103@40069", "160@40200")])
def test_the_gateway_takes_a_device_of_several_models(
    programs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    made = json.loads(said(capsys, "--sunspec", *words))
    line = {"value": 7, "active": 1, "host": "127.0.0.1", "tcp_port": 502}
    slave = {"id": 1, "template": "sunspec-device"}
    checked = check_document(
        programs, tmp_path, {"templates": made["templates"], "port": [line | {"slaves": [slave]}]}
    )
    assert (checked.returncode, checked.stderr) == (0, "")


def test_no_two_devices_are_known_by_the_same() -> None:
    """But SunSpec's models, of which some have a shorter template too."""
    known = [
        json.dumps(device.template["identification"])
        for device in devices.read(devices.folder())
        if "identification" in device.template and not device.name.startswith("sunspec-model-")
    ]
    assert len(known) == len(set(known)) > 9


@pytest.mark.parametrize("text", [None, "[]", '{"templates": []}'])
def test_no_templates(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str | None) -> None:
    if text is not None:
        (tmp_path / "m.json").write_text(text)
    assert main(["devices", "--folder", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_nothing_fits(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["devices", "no-such-device"]) == 1
    assert "none of" in capsys.readouterr().err
