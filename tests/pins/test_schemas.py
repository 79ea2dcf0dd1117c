# SPDX-License-Identifier: GPL-3.0-or-later
"""Bindings beside the rules, processed once (here ours: the kernel has its own): findings like others."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from program import DONE, FOUND, UNUSABLE, run
from trees import ROOT, content

from nuc980.pins.dtb import flattened, parse_dtb
from nuc980.pins.schemas import _findings
from nuc980.pins.source import read_source

DTS = ROOT / "dts/nuvoton/nuc980-gateway.dts"
WRONG = """#include "nuc980-gateway.dts"
&uart1 {
    pdma-enable = <7>;
};
"""


@pytest.fixture(scope="module")
def schemas(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("schemas") / "ours.json"
    program = Path(sys.executable).with_name("dt-mk-schema")
    with file.open("w") as out:
        subprocess.run(
            [program, "-j", ROOT / "dts/bindings"], stdout=out, stderr=subprocess.DEVNULL, check=True
        )
    return file


@pytest.mark.slow
def test_what_the_bindings_find_is_a_finding_at_its_line(schemas: Path, tmp_path: Path) -> None:
    file = tmp_path / "board.dts"
    file.write_text(WRONG)
    words = ("check", "--chip-only", "-I", ROOT / "dts/nuvoton", "--schemas", schemas, file)
    done = run(*words)
    assert done.returncode == FOUND
    [line] = [line for line in done.stdout.splitlines() if ": schema: " in line]
    assert line.startswith(f"{file}:3: schema: /apb/serial@b0071000: pdma-enable: ")
    assert "serial/nuvoton,nuc980-uart.yaml" in done.stdout
    sarif = json.loads(run(*words[:-1], "--format", "sarif", file).stdout)["runs"][0]
    assert "schema" in {result["ruleId"] for result in sarif["results"]}
    assert "schema" in {rule["id"] for rule in sarif["tool"]["driver"]["rules"]}


@pytest.mark.slow
def test_our_tree_has_none(schemas: Path) -> None:
    assert run("check", "--schemas", schemas, DTS).returncode == DONE


def test_what_is_no_file_of_schemas_is_refused(tmp_path: Path) -> None:
    done = run("check", "--schemas", tmp_path / "none", DTS)
    assert (done.returncode, "no such file; make it of the kernel's" in done.stderr) == (UNUSABLE, True)
    (tmp_path / "x").write_text("{")
    done = run("check", "--schemas", tmp_path / "x", DTS)
    assert (done.returncode, "make the file again" in done.stderr) == (UNUSABLE, True)
    assert "Traceback" not in done.stderr


def test_a_tree_in_memory_becomes_the_same_dtb(tmp_path: Path) -> None:
    tree = read_source(DTS)
    assert content(parse_dtb(flattened(tree), Path("x.dtb")).root) == content(tree.root)
    (tmp_path / "x.dtb").write_bytes(flattened(tree))
    subprocess.run(["dtc", "-q", "-I", "dtb", "-O", "dtb", "-o", "/dev/null", tmp_path / "x.dtb"], check=True)


def told(message: str, **more: object) -> dict[str, object]:
    return {"message": message, "node": "/apb/serial@b0071000", "schema": None, "property_path": []} | more


def test_what_a_compiled_tree_cannot_answer_is_left_out() -> None:
    tree = read_source(DTS)
    raw, cell = (
        told("b'\\x00\\x00' is not of type 'object', 'integer'"),
        told("[[0]] is not of type 'integer'"),
    )
    assert list(_findings(tree, [raw, cell])) == []


def test_one_fault_is_told_once_and_a_size_finds_its_node() -> None:
    tree = read_source(DTS)
    twice = told(
        "[[3]] is wrong", property_path=["status", 0], schema="http://devicetree.org/schemas/a/b.yaml#"
    )
    size = told("pdma-enable: size (4) error for type phandle", node=None)
    found = list(_findings(tree, [twice, twice | {"schema": "c"}, size]))
    assert found[0].remedy == "Write it as the binding says: a/b.yaml"
    assert [one.node for one in found[1:]] == [f"/apb/serial@b007{number}000" for number in range(10)]
