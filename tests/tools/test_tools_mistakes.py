# SPDX-License-Identifier: GPL-3.0-or-later
"""What `openrtu` says of files and words that it cannot use: one line, exit code 2, nothing written."""

import json
import os
import shlex
import subprocess
from pathlib import Path
from typing import Any

import pytest

from openrtu_tools import missing
from openrtu_tools.cli import main

OPENRTU = Path(__file__).resolve().parents[2] / "scripts/openrtu"
HEAD = "ca,ioa,type,name,port,id,table,address\n"
SNMP = {"users": [{"name": "graphs"}], "sinks": [{"name": "nms", "user": "graphs"}]}
NOT_READ = [
    (b"", ":1: Expecting value"),
    (b'{\n"port": [],}', ":2: "),
    (b"\xff\xfe{\x00}\x00", ": this is not UTF-8 text"),
    (b"[]", ": is not a JSON object"),
    (b"[" * 100_000, ": is nested too deep"),
]


def refused(capsys: pytest.CaptureFixture[str], *words: str | Path) -> str:
    assert main([str(word) for word in words]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    assert said.err.startswith(f"openrtu {words[0]}: ")
    return said.err


@pytest.mark.parametrize(("octets", "says"), NOT_READ)
def test_a_configuration_that_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], octets: bytes, says: str
) -> None:
    file = tmp_path / "gateway.json"
    file.write_bytes(octets)
    (tmp_path / "points.csv").write_text(HEAD)
    for words in (
        ("points", tmp_path / "points.csv", "--lines", file),
        ("scl", file, "tool.cid", "--own", "own.cid"),
        ("snmp-keys", file, tmp_path / "keys"),
    ):
        assert f"{file}{says}" in refused(capsys, *words)
    assert not (tmp_path / "keys").exists()


def lines(*slaves: Any, **file: Any) -> dict[str, Any]:
    return {"port": [{"value": 1, "slaves": list(slaves)}], **file}


@pytest.mark.parametrize(
    ("config", "says"),
    [
        ({"port": [1]}, ": port: is not an array of objects"),
        (lines(3), ": port[0].slaves: is not an array of objects"),
        ({"port": [{"slaves": 3}]}, ": port[0].slaves: is not an array of objects"),
        (lines(include=3), ": include: is not an array of names of files"),
        (lines(include=[3]), ": include: is not an array of names of files"),
        (lines(templates=3), ": templates: is not an object of objects"),
        (lines(templates={"a": 1}), ": templates: is not an object of objects"),
    ],
)
def test_lines_of_another_shape(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], config: dict[str, Any], says: str
) -> None:
    (tmp_path / "points.csv").write_text(HEAD)
    file = tmp_path / "lines.json"
    file.write_text(json.dumps(config))
    assert f"{file}{says}" in refused(capsys, "points", tmp_path / "points.csv", "--lines", file)


def test_a_cell_without_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "points.csv").write_text(HEAD + "x" * 200_000)
    (tmp_path / "lines.json").write_text('{"port": []}')
    words = ("points", tmp_path / "points.csv", "--lines", tmp_path / "lines.json")
    assert "points.csv:2: field larger than" in refused(capsys, *words)


@pytest.mark.parametrize(
    ("snmp", "says"),
    [
        ([], ' has no object "snmp"'),
        ({"users": 3}, ": snmp.users: is not an array of objects"),
        ({"users": [{}]}, ": snmp.users[0].name: is missing, or is no text"),
        ({"sinks": [{"name": "nms"}]}, ": snmp.sinks[0].user: is missing, or is no text"),
    ],
)
def test_snmp_of_another_shape(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], snmp: Any, says: str
) -> None:
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps({"snmp": snmp}))
    assert f"{file}{says}" in refused(capsys, "snmp-keys", file, tmp_path / "keys")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--engine-id", "xx"), '"xx" is no engine ID, 5 to 32 octets in hexadecimal'),
        (("--engine-id", ""), '"" is no engine ID'),
        (("--engine-id", "00" * 12), "not all 00 or ff"),
        (("--engine-id", "ff" * 5), "not all 00 or ff"),
        (("--engine-id", "80" * 33), "5 to 32 octets"),
        (("--sink", "nms"), '"nms" is not NAME=ID'),
        (("--sink", "nms=80"), '"80" is no engine ID'),
    ],
)
def test_words_of_snmp_keys(capsys: pytest.CaptureFixture[str], words: tuple[str, str], says: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["snmp-keys", "gateway.json", "keys", *words])
    assert ended.value.code == 2
    assert says in capsys.readouterr().err


def test_nobody_is_there_to_answer(tmp_path: Path) -> None:
    (tmp_path / "gateway.json").write_text(json.dumps({"snmp": SNMP}))
    done = subprocess.run(
        ["setsid", OPENRTU, "snmp-keys", "gateway.json", "keys"],
        cwd=tmp_path, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    first, next_step = done.stderr.splitlines()
    assert first == "openrtu snmp-keys: there is no terminal to type at"
    assert "--passphrases" in next_step


@pytest.mark.parametrize(
    ("typed", "code", "says"),
    [
        (["maplesyrup", "maplesyrup", "pancakes", "pancakes"], 0, "keys goes to the gateway"),
        (
            ["maplesyrup", "maplesirup"],
            2,
            "two pass phrases of authentication differ; nothing is written",
        ),
    ],
)
def test_a_slip_in_a_pass_phrase_is_seen(tmp_path: Path, typed: list[str], code: int, says: str) -> None:
    """At a terminal, which shows nothing of it."""
    (tmp_path / "gateway.json").write_text(json.dumps({"snmp": {"users": [{"name": "ems"}]}}))
    ours, theirs = os.openpty()
    command = ["setsid", "--ctty", "--wait", OPENRTU, "snmp-keys", "gateway.json", "keys"]
    with subprocess.Popen(command, cwd=tmp_path, stdin=theirs, stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        shown = ""
        for phrase in typed:
            shown = read_until(ours, shown, ": ")
            os.write(ours, f"{phrase}\n".encode())
        shown = read_until(ours, shown, says)
    os.close(ours)
    assert process.returncode == code
    assert (tmp_path / "keys").exists() == (code == 0)
    assert not any(phrase in shown for phrase in typed)


def read_until(terminal: int, before: str, wanted: str) -> str:
    """What it shows, with what it showed before, until this comes newly."""
    shown = ""
    while wanted not in shown:
        shown += os.read(terminal, 4096).decode()
    return before + shown


@pytest.mark.parametrize("goose", [3, {"publish": [3]}, {"publish": [{"name": "trip"}]}])
def test_goose_of_another_shape(tmp_path: Path, capsys: pytest.CaptureFixture[str], goose: Any) -> None:
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps({"iec61850": {}, "goose": goose}))
    assert f"{file}: goose" in refused(capsys, "scl", file, "tool.cid", "--own", "own.cid")


def test_users_that_are_no_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "web.users").write_bytes(b"\xff\n")
    said = refused(capsys, "web-users", tmp_path / "web.users", "anna", "--role", "viewer")
    assert "web.users: this is not UTF-8 text" in said


@pytest.mark.slow
def test_a_pipe_that_ends_is_no_traceback(tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text(HEAD)
    (tmp_path / "lines.json").write_text(json.dumps({"port": [{"value": n} for n in range(50_000)]}))
    done = subprocess.run(
        ["bash", "-c", f"{shlex.quote(str(OPENRTU))} points points.csv --lines lines.json | head -n 1"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("{\n", "")


def test_a_missing_package_is_debians_where_python_is(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """There pip is refused (PEP 668)."""
    monkeypatch.setattr(missing, "CLONE", tmp_path)
    monkeypatch.setattr(missing, "STANDARD", tmp_path)
    lacks = ModuleNotFoundError(name="scipy.signal")
    assert "-m pip install 'openrtu-tools[logic]'" in missing.what_to_type(lacks, "logic")
    (tmp_path / "EXTERNALLY-MANAGED").touch()
    monkeypatch.setattr(missing.sys, "prefix", missing.sys.base_prefix)
    assert missing.what_to_type(lacks, "logic").endswith("type: apt install python3-scipy")
    assert missing.what_to_type(ModuleNotFoundError(name="paho"), "centre").endswith("python3-paho-mqtt")
