# SPDX-License-Identifier: GPL-3.0-or-later
"""What makes a bill of materials useless: each fault is found, and said."""

import json
from datetime import UTC, datetime
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
        "serialNumber": "urn:uuid:3e671687-395b-41f5-a30f-a58921a69b79",
        "metadata": {
            "timestamp": "2026-11-29T08:00:00+00:00",
            "authors": [{"name": "OpenRTU"}],
            "component": {"bom-ref": "image", "name": "image", "version": "1.2.3", "type": "firmware"},
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


# ---- what Buildroot leaves out

NOW = datetime(2026, 11, 29, 8, 0, tzinfo=UTC)
LIBC = b"""\0GNU C Library (Buildroot) stable release version 2.41.
Compiled by GNU CC version 14.3.0.\0"""
SUM = "ab" * 32


def raw() -> dict[str, Any]:
    """As Buildroot writes it, of an image with a root file system."""
    made = bill()
    del made["serialNumber"], made["metadata"]["timestamp"], made["metadata"]["authors"]
    made["components"].append({"bom-ref": "busybox", "type": "library", "name": "busybox", "version": "1.37"})
    return made


@pytest.fixture
def target(tmp_path: Path) -> Path:
    (tmp_path / "target/lib").mkdir(parents=True)
    (tmp_path / "target" / sbom.C_LIBRARY).write_bytes(LIBC)
    (tmp_path / "target" / sbom.GCC_LIBRARY).write_bytes(b"gcc")
    return tmp_path / "target"


def test_what_buildroot_leaves_out_is_found_and_completed(target: Path, tmp_path: Path) -> None:
    (tmp_path / "package/busybox").mkdir(parents=True)
    (tmp_path / "package/busybox/busybox.hash").write_text(
        f"# comment\nsha256  {SUM}  busybox-1.37.tar.bz2\nsha256  {'cd' * 32}  LICENSE\n"
    )
    packages = {
        "busybox": {
            "downloads": [{"source": "busybox-1.37.tar.bz2"}],
            "hashes": ["package/busybox/busybox.hash", "package/busybox/none.hash"],
        }
    }
    made = raw()
    assert found(made)[:3] == ["it has no serial number", "it has no timestamp", "it has no authors"]
    assert len(found(made)) == 5
    sbom.complete(made, packages, tmp_path, target, NOW)
    assert found(made) == []
    components = {each["name"]: each for each in made["components"]}
    assert components["busybox"]["hashes"] == [{"alg": "SHA-256", "content": SUM}]
    assert components["glibc"]["cpe"] == "cpe:2.3:a:gnu:glibc:2.41:*:*:*:*:*:*:*"
    assert components["libgcc"]["cpe"] == "cpe:2.3:a:gnu:gcc:14.3.0:*:*:*:*:*:*:*"
    assert all(components[name]["licenses"] and components[name]["hashes"] for name in ("glibc", "libgcc"))
    assert made["dependencies"][0]["dependsOn"] == ["glibc", "libgcc", "linux", "openrtu"]


def test_library_that_is_known_is_not_named_twice(target: Path) -> None:
    """Of an image from Debian's sources, offline.py says the C library's release."""
    made = raw()
    made["components"].append({"bom-ref": "toolchain-external-custom", "type": "library", "name": "glibc"})
    sbom.complete(made, {}, target, target, NOW)
    assert [each["name"] for each in made["components"]].count("glibc") == 1


def test_same_image_same_number_and_another_another(target: Path) -> None:
    bills = [raw(), raw(), raw()]
    bills[2]["components"][0]["version"] = "1.2.4"
    for made in bills:
        sbom.complete(made, {}, target, target, NOW)
    one, same, other = (made["serialNumber"] for made in bills)
    assert one == same != other


def test_image_that_is_not_built_has_no_toolchain(tmp_path: Path) -> None:
    made = raw()
    sbom.complete(made, {}, tmp_path, tmp_path / "nowhere", NOW)
    assert [line.split()[0] for line in found(made)] == ["glibc", "libgcc"]


def test_command_completes_the_file(target: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    version = tmp_path / "VERSION"
    version.write_text("1.2.3\n")
    monkeypatch.setattr(sbom, "VERSION", version)
    file, packages = tmp_path / "sbom.cdx.json", tmp_path / "show-info.json"
    file.write_text(json.dumps(raw()))
    packages.write_text("{}")
    assert sbom.main([str(file)]) == 1
    words = [str(file), "--packages", str(packages), "--target", str(target), "--buildroot", str(tmp_path)]
    assert sbom.main(words) == 0
    assert sbom.main([str(file)]) == 0
