# SPDX-License-Identifier: GPL-3.0-or-later
"""What makes a bill of materials useless: each fault is found, and said."""

import json
from pathlib import Path
from typing import Any

import pytest

from image import sbom

LINUX = "cpe:2.3:o:linux:linux_kernel:{}:-:*:*:*:*:*:*"


def bill() -> dict[str, Any]:
    """A good one of version 1.2.3: the image, the gateway and the kernel."""
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "metadata": {
            "component": {"bom-ref": "image", "name": "image", "version": "1.2.3", "type": "firmware"}
        },
        "components": [
            {"bom-ref": "openrtu", "type": "library", "name": "openrtu", "version": "1.2.3"},
            {"bom-ref": "linux", "type": "library", "name": "linux", "cpe": LINUX.format("5.10.140")},
        ],
        "dependencies": [
            {"ref": "image", "dependsOn": ["linux", "openrtu"]},
            {"ref": "openrtu", "dependsOn": []},
        ],
    }


def found(made: dict[str, Any]) -> list[str]:
    return list(sbom.findings(json.dumps(made), "1.2.3"))


def test_good_one_has_no_finding() -> None:
    assert found(bill()) == []


def test_component_with_the_reference_of_the_image_is_found() -> None:
    made = bill()
    made["metadata"]["component"]["bom-ref"] = "openrtu"
    made["dependencies"][0]["ref"] = "openrtu"
    assert found(made) == ['2 components have the bom-ref "openrtu"']


def test_dependency_on_nothing_is_found() -> None:
    made = bill()
    made["dependencies"][1]["dependsOn"] = ["jansson"]
    assert found(made) == ['"openrtu" depends on "jansson", which is not a component']


def test_what_the_schema_forbids_is_found() -> None:
    made = bill()
    made["components"][0]["type"] = "program"
    (finding,) = found(made)
    assert finding.startswith("CycloneDX 1.6: $.components[0].type: 'program' is not one of")


@pytest.mark.parametrize("spec", [None, "0.9", 6])
def test_unknown_schema_is_found(spec: object) -> None:
    assert found(bill() | {"specVersion": spec}) == [
        'it has no "specVersion" of CycloneDX that is known here'
    ]


def test_version_of_another_program_is_found() -> None:
    made = bill()
    made["metadata"]["component"]["version"] = "2026.02.3"
    assert found(made) == [
        'the image has the version "2026.02.3", and package/openrtu/src/VERSION says 1.2.3'
    ]


@pytest.mark.parametrize("version", ["d366b3919a926b710e2b819556849967f6fe311c", "", "v6.1"])
def test_linux_without_a_release_is_found(version: str) -> None:
    made = bill()
    made["components"][1]["cpe"] = LINUX.format(version)
    (finding,) = found(made)
    assert finding.startswith("the CPE of Linux names no release")


def test_no_bill_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert sbom.main([str(tmp_path / "none")]) == 2
    (tmp_path / "text").write_text("text")
    assert sbom.main([str(tmp_path / "text")]) == 2
    assert capsys.readouterr().err.count("make sbom writes it") == 2
