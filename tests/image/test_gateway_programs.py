# SPDX-License-Identifier: GPL-3.0-or-later
"""What a site's configuration needs of an image's gateway, and what the image has."""

import json
import os
import re
import subprocess
from pathlib import Path

import pytest

from image import gateway

ROOT = Path(__file__).resolve().parents[2]
KINDS = ROOT / "package/openrtu/src/modules"
POST_BUILD = ROOT / "board/nuc980/post-build.sh"


def test_each_program_of_a_kind_is_known_and_each_key_is_one() -> None:
    programs = {
        name
        for file in KINDS.glob("*/kind.c")
        for name in re.findall(r'\.name = "(rtu-[a-z0-9-]+)"', file.read_text())
        if "programs" in file.read_text()
    }
    known = {program + end for program in gateway.FOR_KEY.values() for end in ("", gateway.TLS)}
    assert programs and programs <= known
    schema = json.loads((ROOT / "package/openrtu/src/rtud/config.schema.json").read_text())
    assert gateway.FOR_KEY.keys() <= schema["properties"].keys()


@pytest.mark.parametrize(
    ("configuration", "programs"),
    [
        ({}, set()),
        ({"port": []}, set()),
        ({"port": [{"active": False}]}, set()),
        ({"port": [{}], "iec104": {}}, {"rtu-modbus", "rtu-iec104"}),
        ({"iec104": {}, "tls": {}}, {"rtu-iec104-tls"}),
        ({"outstations": [{}], "outstations_tls": {}}, {"rtu-104m-tls"}),
        ({"iec61850": {}}, {"rtu-iec61850"}),
        ({"iec61850": {"tls": {}}, "web": {}, "snmp": {}}, {"rtu-iec61850-tls", "rtu-web", "rtu-snmp"}),
        ({"net": {}, "journal": {}, "logic": [{}]}, {"rtu-synch", "rtu-journal", "rtu-logic"}),
    ],
)
def test_programs_of_a_configuration(configuration: dict[str, object], programs: set[str]) -> None:
    assert gateway.needed(configuration) == programs


@pytest.fixture
def target(tmp_path: Path) -> Path:
    """A root file system as Buildroot hands it over: its gateway has two programs."""
    root = tmp_path / "target"
    for folder in ("etc", gateway.MODULES):
        (root / folder).mkdir(parents=True)
    for program in ("rtu-modbus", "rtu-iec104"):
        (root / gateway.MODULES / program).touch()
    return root


@pytest.mark.slow
@pytest.mark.parametrize(("more", "code"), [({}, 0), ({"web": {"users": "/data/users"}}, 1)])
def test_site_that_needs_more_than_the_image_has_is_not_built(
    target: Path, tmp_path: Path, more: dict[str, object], code: int
) -> None:
    """Without rtud of this machine: nothing is said of the configuration itself."""
    site = tmp_path / "site"
    site.mkdir()
    (site / "config.json").write_text(json.dumps({"iec104": {}, "port": []} | more))
    script = tmp_path / "board/nuc980/post-build.sh"
    for folder in ("board/nuc980", "scripts", "package"):
        (tmp_path / folder).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / folder).symlink_to(ROOT / folder)
    environment = {**os.environ, "SITE_SETTINGS": str(site)}
    text = POST_BUILD.read_text().replace('"$(dirname "$0")/../.."', f'"{tmp_path}"')
    command = ["bash", "-c", text, script, target]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == code, done.stderr
    assert ("needs what this image has not: rtu-web:" in done.stderr) == bool(code)


def test_manifest_lists_what_an_image_can(target: Path) -> None:
    assert list(gateway.programs_of(target)) == ["rtu-iec104", "rtu-modbus"]
