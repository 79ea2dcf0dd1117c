# SPDX-License-Identifier: GPL-3.0-or-later
"""The site's time zone in the centre's file."""

import json
from pathlib import Path

import pytest

from openrtu_tools.centre import zone
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.settings import load


def read(folder: Path, **own: str) -> str:
    file = folder / "centre.json"
    file.write_text(json.dumps({"stations": [], "centre": own}))
    return load(file).zone


def test_zone_is_that_of_the_file_or_of_the_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert read(tmp_path, zone="Europe/Belgrade") == "Europe/Belgrade"
    link = tmp_path / "localtime"
    link.symlink_to("/usr/share/zoneinfo/Asia/Kathmandu")
    monkeypatch.setattr(zone, "LOCAL", link)
    monkeypatch.delenv("TZ", raising=False)
    assert read(tmp_path) == "Asia/Kathmandu"
    monkeypatch.setenv("TZ", ":/usr/share/zoneinfo/Europe/Vienna")
    assert read(tmp_path) == "Europe/Vienna"
    monkeypatch.setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3")  # a rule has no name that a browser knows
    assert read(tmp_path) == "UTC"


@pytest.mark.parametrize("name", ["Europe/Beograd", "../../etc/passwd", "Europe", "", "/etc/localtime"])
def test_zone_that_is_none_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(CentreError, match="no zone is named"):
        read(tmp_path, zone=name)
