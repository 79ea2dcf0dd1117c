# SPDX-License-Identifier: GPL-3.0-or-later
"""A site's settings on their way into the root file system."""

import os
import subprocess
from pathlib import Path

import pytest

from release.version import swupdate, tree_version

SCRIPT = Path(__file__).resolve().parents[2] / "board" / "nuc980" / "post-build.sh"
LOCKED = "root:*:19000:0:99999:7:::\n"
CONFIG = '{"iec104": {}, "port": []}'
KEY = f"ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAI{'A' * 43} somebody\n"
HASH = "$6$salt.of/it$Zn.3/abcXYZ0"


@pytest.fixture
def target(tmp_path: Path) -> Path:
    """A root file system as Buildroot hands it over, with what an earlier build left."""
    root = tmp_path / "target"
    for folder in ("etc/init.d", "etc/openrtu", "root/.ssh", "usr/bin"):
        (root / folder).mkdir(parents=True)
    (root / "etc/shadow").write_text(LOCKED)
    for script in ("S01seedrng", "S49chronyd", "S50sshd", "S59snmpd", "S80swupdate"):
        (root / "etc/init.d" / script).touch()
    (root / "usr/bin/fw_printenv").touch()
    (root / "usr/bin/fw_setenv").symlink_to("fw_printenv")
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


def test_environment_of_u_boot_is_read_only(target: Path) -> None:
    assert build(target).returncode == 0
    assert [file.name for file in (target / "usr/bin").iterdir()] == ["fw_printenv"]


@pytest.mark.slow
def test_image_says_its_version_once(target: Path) -> None:
    """As SWUpdate compares it. Buildroot's file is a link from etc, and the script runs at every build."""
    version = swupdate(tree_version())
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


@pytest.mark.slow
def test_image_that_takes_updates_has_the_next_number(target: Path) -> None:
    """An update is newer than each image of the site before it, and what it claims is what the image says."""
    version = swupdate(tree_version())
    (target / "etc/os-release").write_text("NAME=OpenRTU\n")
    site = target.parent / "station-7"
    site.mkdir()
    (site / "update.pem").write_text(CERTIFICATE)
    environment = {**os.environ, "SITE_SETTINGS": str(site)}
    for number in (1, 2, 10):
        if number == 10:
            (site / "update-number").write_text("09\n")
        subprocess.run([SCRIPT], env=environment, check=True)
        subprocess.run([SCRIPT, target], env=environment, check=True)
        assert (target / "etc/os-release").read_text() == (
            f"NAME=OpenRTU\nIMAGE_ID=openrtu\nIMAGE_VERSION={version}.{number}\n"
        )
        assert (site / "update-number").read_text() == f"{number}\n"


@pytest.mark.parametrize("number", ["", "x", "-1", "123456", "1\n2"])
def test_what_is_no_number_of_an_image(target: Path, number: str) -> None:
    done = build_station(target, {"update.pem": CERTIFICATE, "update-number": number})
    assert done.returncode != 0
    assert "update-number is not the number" in done.stderr


def test_settings_are_placed_with_their_modes(target: Path) -> None:
    done = build(
        target, config_json=CONFIG, interfaces="auto eth0\n", authorized_keys=KEY, hostname="station-7\n"
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert (target / "etc/openrtu/gateway.json").read_text() == CONFIG
    assert (target / "etc/network/interfaces").read_text() == "auto eth0\n"
    assert (target / "etc/hostname").read_text() == "station-7\n"
    keys = target / "root/.ssh/authorized_keys"
    assert keys.read_text() == KEY
    assert (keys.stat().st_mode & 0o777, keys.parent.stat().st_mode & 0o777) == (0o600, 0o700)


RECEIVER = "refclock SOCK /run/gps/clock refid GPS poll 4 delay 0.5 precision 0.1 offset 0.3\n"


@pytest.mark.parametrize(
    "sources",
    [
        "# the substation's\nserver 192.0.2.1 iburst\n\npool ntp.example iburst maxsources 3\n",
        RECEIVER,
        f"server 192.0.2.1\n{RECEIVER}",
    ],
)
def test_sources_of_time_are_chronys(target: Path, sources: str) -> None:
    done = build(target, ntp=sources)
    assert (done.returncode, done.stderr) == (0, "")
    assert (target / "etc/chrony/site.conf").read_text() == sources


@pytest.mark.parametrize(
    "bad",
    [
        "192.0.2.1\n",
        "server \n",
        "server 192.0.2.1\nallow all\n",
        "# none\n",
        "",
        "refclock SHM 0\n",
        "refclock SOCK /run/gps/clock.other\n",
    ],
)
def test_what_is_no_source_of_time_is_refused(target: Path, bad: str) -> None:
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
    done = build(target, **{"authorized-keys": KEY})
    assert done.returncode != 0
    assert "authorized-keys is not a setting of a site" in done.stderr


def test_files_that_netboot_keeps_are_no_settings(target: Path) -> None:
    """docs/netboot.md: both tools take the same folder."""
    (target.parent / "kept/flash-20261121-101024").mkdir(parents=True)
    files = {"board-ip": "192.168.1.20/24\n", "environment.txt": "a=b\n", "environment-20261121.txt": "a=c\n"}
    site = target.parent / "kept"
    for name, text in files.items():
        (site / name).write_text(text)
    environment = {**os.environ, "SITE_SETTINGS": str(site)}
    done = subprocess.run([SCRIPT, target], env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert not [file for file in target.rglob("*") if file.name in files]


CERTIFICATE = "-----BEGIN CERTIFICATE-----\nMIIB\n-----END CERTIFICATE-----\n"


def build_site(
    target: Path, name: str, certificates: str, board: str = ""
) -> subprocess.CompletedProcess[str]:
    site = target.parent / name
    site.mkdir()
    (site / "update.pem").write_text(certificates)
    environment = {**os.environ, "SITE_SETTINGS": str(site), "NUC980_BOARD": board}
    return subprocess.run([SCRIPT, target], env=environment, capture_output=True, text=True, check=False)


def test_site_with_certificates_has_a_name(target: Path) -> None:
    done = build_site(target, "station-7", CERTIFICATE)
    assert (done.returncode, done.stderr) == (0, "")
    assert (target / "etc/openrtu/update.pem").read_text() == CERTIFICATE
    assert (target / "etc/hwrevision").read_text() == "nuc980-gateway station-7\n"
    (target.parent / "a site").mkdir()
    environment = {**os.environ, "SITE_SETTINGS": ""}
    subprocess.run([SCRIPT, target], env=environment, check=True)
    assert not (target / "etc/hwrevision").exists()


def test_other_board_has_a_name_and_its_own_ports(target: Path) -> None:
    assert build_site(target, "station-7", CERTIFICATE, "numaker").returncode == 0
    assert (target / "etc/hwrevision").read_text() == "nuc980-numaker station-7\n"
    interfaces = (target / "etc/network/interfaces").read_text()
    assert "auto eth0\n" in interfaces
    assert "eth1" not in interfaces


@pytest.mark.parametrize(
    ("name", "certificates", "why"),
    [
        ("station-7", "", "has no certificate"),
        ("station-7", f"-----BEGIN PRIVATE KEY-----\n{CERTIFICATE}", "has a private key"),
        ("station 7", CERTIFICATE, "the folder's name is the site's"),
    ],
)
def test_certificates_that_are_refused(target: Path, name: str, certificates: str, why: str) -> None:
    done = build_site(target, name, certificates)
    assert done.returncode == 1
    assert why in done.stderr


SERVER = "url https://updates.example:8443/DEFAULT/controller/v1\ntoken GatewayToken d1d2\n"


def with_server(server: str = SERVER) -> dict[str, str]:
    return {"update.pem": CERTIFICATE, "update-server.pem": CERTIFICATE, "update-server": server}


def build_station(target: Path, files: dict[str, str]) -> subprocess.CompletedProcess[str]:
    site = target.parent / "station-7"
    site.mkdir()
    for name, text in files.items():
        (site / name).write_text(text)
    environment = {**os.environ, "SITE_SETTINGS": str(site)}
    return subprocess.run([SCRIPT, target], env=environment, capture_output=True, text=True, check=False)


def test_server_of_updates_is_placed_and_its_token_is_for_root(target: Path) -> None:
    done = build_station(target, with_server())
    assert (done.returncode, done.stderr) == (0, "")
    placed = target / "etc/openrtu/update-server"
    assert placed.read_text() == SERVER
    assert placed.stat().st_mode & 0o777 == 0o600
    assert (target / "etc/openrtu/update-server.pem").read_text() == CERTIFICATE


@pytest.mark.parametrize("lacks", ["update.pem", "update-server.pem"])
def test_server_of_updates_needs_certificates(target: Path, lacks: str) -> None:
    done = build_station(target, {name: text for name, text in with_server().items() if name != lacks})
    assert done.returncode == 1
    assert f"{target.parent}/station-7/update-server: " in done.stderr
    assert lacks in done.stderr


@pytest.mark.parametrize(
    "server",
    [
        "",
        SERVER.replace("https", "http"),
        SERVER.replace("/DEFAULT/controller/v1", ""),
        SERVER.replace("d1d2", "d1 d2"),
        SERVER.replace("GatewayToken", "Basic"),
        SERVER.partition("\n")[2],
        SERVER + SERVER,
        SERVER + "id 7\n",
        SERVER.replace("updates.", "user@updates."),
    ],
)
def test_what_is_no_server_of_updates_is_refused(target: Path, server: str) -> None:
    done = build_station(target, with_server(server))
    assert done.returncode == 1
    assert "station-7/update-server: " in done.stderr
