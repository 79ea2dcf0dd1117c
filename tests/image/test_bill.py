# SPDX-License-Identifier: GPL-3.0-or-later
"""The bill of materials of an image from Debian's packages: CycloneDX's own schema is the judge."""

import json
from pathlib import Path

import pytest
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

from image import bill

MANIFEST = {
    "configuration": "system",
    "version": None,
    "sources": {
        "openrtu": {"version": "1.0.0-rc1", "commit": "0" * 40},
        "debian": {"linux": "6.1.176-1", "libc6": "2.36-9+deb12u14", "mtd-utils": "1:2.1.5-1"},
    },
}


@pytest.fixture(autouse=True)
def dated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1790000000")


def written(folder: Path, manifest: object = MANIFEST) -> str:
    (folder / "manifest.json").write_text(json.dumps(manifest))
    out = folder / "system.cdx.json"
    assert bill.main([str(folder / "manifest.json"), str(out), "linux"]) == 0
    return out.read_text()


def test_each_package_is_in_it_by_its_url(tmp_path: Path) -> None:
    text = written(tmp_path)
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    found = json.loads(text)
    assert {each["name"]: each.get("purl") for each in found["components"]} == {
        "openrtu": None,
        "libc6": "pkg:deb/debian/libc6@2.36-9%2Bdeb12u14?arch=armel&distro=debian-12",
        "linux": "pkg:deb/debian/linux@6.1.176-1?arch=source&distro=debian-12",
        "mtd-utils": "pkg:deb/debian/mtd-utils@1%3A2.1.5-1?arch=armel&distro=debian-12",
    }
    (image,) = (each for each in found["dependencies"] if each["ref"] == "image")
    assert image["dependsOn"] == [each["bom-ref"] for each in found["components"]]
    assert all(each["supplier"]["name"] for each in found["components"])


def test_same_image_has_the_same_bill(tmp_path: Path) -> None:
    first = written(tmp_path)
    assert "2026-09-21T14:13:20+00:00" in first
    assert written(tmp_path) == first
    assert (
        json.loads(written(tmp_path, MANIFEST | {"version": "1.0.0-rc1"}))["serialNumber"]
        == (json.loads(first)["serialNumber"])
    )
    other = written(tmp_path, MANIFEST | {"version": "1.0.0-rc1.7"})
    assert json.loads(other)["serialNumber"] != json.loads(first)["serialNumber"]


def test_without_a_manifest_it_says_what_makes_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bill.main([str(tmp_path / "none.json"), str(tmp_path / "out.json")]) == 2
    assert "make image-debian writes it" in capsys.readouterr().err
