# SPDX-License-Identifier: GPL-3.0-or-later
"""A site's settings on their way into the root file system."""

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "board" / "nuc980" / "post-build.sh"
LOCKED = "root:*:19000:0:99999:7:::\n"
HASH = "$6$salt.of/it$Zn.3/abcXYZ0"


@pytest.fixture
def target(tmp_path: Path) -> Path:
    """A root file system as Buildroot hands it over, with what an earlier build left."""
    root = tmp_path / "target"
    for folder in ("etc/init.d", "etc/openrtu", "root/.ssh"):
        (root / folder).mkdir(parents=True)
    (root / "etc/shadow").write_text(LOCKED)
    for script in ("S49chronyd", "S50sshd", "S59snmpd"):
        (root / "etc/init.d" / script).touch()
    (root / "etc/openrtu/gateway.json").write_text("of another site")
    (root / "root/.ssh/authorized_keys").write_text("of another site")
    return root


def build(target: Path, **files: str) -> subprocess.CompletedProcess[str]:
    """Runs the script for a site with these files; without any, for none."""
    site = target.parent / "a site"
    site.mkdir()
    for name, text in files.items():
        (site / name.replace("_json", ".json")).write_text(text)
    environment = {**os.environ, "SITE_SETTINGS": str(site) if files else ""}
    return subprocess.run([SCRIPT, target], env=environment, capture_output=True, text=True, check=False)


def test_without_a_site_nobody_can_log_in_and_nothing_listens(target: Path) -> None:
    assert build(target).returncode == 0
    assert (target / "etc/shadow").read_text() == LOCKED
    assert not (target / "root/.ssh").exists()
    assert not (target / "etc/openrtu").exists()
    assert not list((target / "etc/init.d").iterdir())
    assert not (target / "etc/chrony").exists()


def test_image_says_its_version_once(target: Path) -> None:
    """Buildroot's file is a link from etc, and the script runs at every build."""
    version = (SCRIPT.parents[2] / "package/openrtu/src/VERSION").read_text().strip()
    (target / "usr/lib").mkdir(parents=True)
    (target / "usr/lib/os-release").write_text("NAME=Buildroot\nVERSION=2026.02.3\n")
    (target / "etc/os-release").symlink_to("../usr/lib/os-release")
    assert build(target).returncode == 0
    (target.parent / "a site").rmdir()
    assert build(target).returncode == 0
    assert (target / "etc/os-release").is_symlink()
    assert (target / "usr/lib/os-release").read_text() == (
        f"NAME=Buildroot\nVERSION=2026.02.3\nIMAGE_ID=openrtu\nIMAGE_VERSION={version}\n"
    )


def test_settings_are_placed_with_their_modes(target: Path) -> None:
    done = build(target, config_json="{}", interfaces="auto lo\n", authorized_keys="ssh-ed25519 A\n")
    assert (done.returncode, done.stderr) == (0, "")
    assert (target / "etc/openrtu/gateway.json").read_text() == "{}"
    assert (target / "etc/network/interfaces").read_text() == "auto lo\n"
    keys = target / "root/.ssh/authorized_keys"
    assert keys.read_text() == "ssh-ed25519 A\n"
    assert (keys.stat().st_mode & 0o777, keys.parent.stat().st_mode & 0o777) == (0o600, 0o700)


def test_ntp_servers_are_chronys_sources(target: Path) -> None:
    servers = "# the substation's\nserver 192.0.2.1 iburst\n\npool ntp.example iburst maxsources 3\n"
    done = build(target, ntp=servers)
    assert (done.returncode, done.stderr) == (0, "")
    assert (target / "etc/chrony/site.sources").read_text() == servers


@pytest.mark.parametrize("bad", ["192.0.2.1\n", "server \n", "server 192.0.2.1\nallow all\n", "# none\n", ""])
def test_what_is_no_ntp_server_is_refused(target: Path, bad: str) -> None:
    done = build(target, ntp=bad)
    assert done.returncode != 0
    assert "/ntp" in done.stderr
    assert "server ADDRESS iburst" in done.stderr
    assert not (target / "etc/chrony").exists()


def test_root_password_goes_into_shadow(target: Path) -> None:
    assert build(target, **{"root-password": HASH + "\n"}).returncode == 0
    assert (target / "etc/shadow").read_text() == LOCKED.replace("*", HASH, 1)


@pytest.mark.parametrize("bad", ["secret", HASH + "|e true", HASH + "&", HASH + "\\n", HASH + ":0:", ""])
def test_what_is_no_hash_is_refused_and_changes_nothing(target: Path, bad: str) -> None:
    done = build(target, **{"root-password": bad})
    assert done.returncode != 0
    assert "is not a hash of crypt(5)" in done.stderr
    assert (target / "etc/shadow").read_text() == LOCKED


def test_unknown_file_is_an_error(target: Path) -> None:
    done = build(target, **{"authorized-keys": "ssh-ed25519 A\n"})
    assert done.returncode != 0
    assert "authorized-keys is not a setting of a site" in done.stderr
