# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-site: what it takes and refuses of a site's settings, here as on the board."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from lab.site import write_site

ROOT = Path(__file__).resolve().parents[2]
JUDGE = ROOT / "board/nuc980/rootfs-overlay/usr/sbin/rtu-site"
ED25519 = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIGZvcnR5LXRocmVlIGNoYXJhY3RlcnMgb2YgYmFzZTY0" + "A"
STATIC = "auto eth0\niface eth0 inet static\n"
LOOPBACK = "auto lo\niface lo inet loopback\n"


@pytest.fixture(params=["sh", "busybox"])
def judge(request: pytest.FixtureRequest, tmp_path: Path) -> list[str]:
    """The shell, awk and grep of this machine, and those of the board's kind."""
    if request.param == "sh":
        return ["sh", str(JUDGE)]
    busybox = shutil.which("busybox")
    assert busybox, "make setup installs busybox-static"
    bin_folder = tmp_path / "bin"
    bin_folder.mkdir()
    for applet in ("sh", "awk", "grep", "cut", "tr"):
        (bin_folder / applet).symlink_to(busybox)
    return ["env", f"PATH={bin_folder}", "sh", str(JUDGE)]


def judged(judge: list[str], folder: Path, name: str, text: str, rtud: str = "/nowhere") -> tuple[int, str]:
    file = folder / name
    file.write_text(text)
    environment = {**os.environ, "RTUD": rtud}
    done = subprocess.run([*judge, "check", name, file], env=environment, capture_output=True, text=True)
    assert done.stderr == ""
    return done.returncode, done.stdout


def made_key(folder: Path, kind: str) -> Path:
    key = folder / kind
    subprocess.run(["ssh-keygen", "-q", "-t", kind, "-N", "", "-C", "who it is", "-f", key], check=True)
    return key


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ed25519", "rsa", "ecdsa"])
def test_key_that_ssh_keygen_made(judge: list[str], tmp_path: Path, kind: str) -> None:
    key = made_key(tmp_path, kind)
    public = key.with_suffix(".pub").read_text()
    with_options = f'# ours\n\nno-pty,command="echo a b" {public}'
    for text in (public, with_options, public.replace("\n", "\r\n"), public.strip()):
        assert judged(judge, tmp_path, "authorized_keys", text) == (0, "")
    code, why = judged(judge, tmp_path, "authorized_keys", key.read_text())
    assert code == 1
    assert "private key, which no image may have" in why


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "it has no public key"),
        ("# none\n", "it has no public key"),
        ("garbage\n", "line 1 is no public key"),
        (f"{ED25519}\nAAAA\n", "line 2 is no public key"),
        ("ssh-ed25519 AAAA\n", "line 1 is no public key"),
        (f"ssh-rsa {ED25519.split()[1]}\n", "line 1 is no public key"),
        (ED25519.replace("ssh-ed25519 ", "ssh-ed25519"), "line 1 is no public key"),
        ("PuTTY-User-Key-File-3: ssh-ed25519\n", "private key"),
        (f"---- BEGIN SSH2 PUBLIC KEY ----\n{ED25519}\n", "line 1 is no public key"),
    ],
)
def test_what_is_no_key(judge: list[str], tmp_path: Path, text: str, why: str) -> None:
    code, said = judged(judge, tmp_path, "authorized_keys", text)
    assert code == 1
    assert why in said


@pytest.mark.parametrize("name", ["config.json", "interfaces", "update.pem", "update-server.pem", "macs"])
def test_private_key_is_refused_in_any_file(judge: list[str], tmp_path: Path, name: str) -> None:
    code, why = judged(judge, tmp_path, name, "-----BEGIN RSA PRIVATE KEY-----\n")
    assert (code, "private key" in why) == (1, True)


@pytest.mark.parametrize(
    "text",
    [
        (ROOT / "board/nuc980/rootfs-overlay/etc/network/interfaces").read_text(),
        (ROOT / "board/nuc980/boards/numaker/interfaces").read_text(),
        f"{STATIC}\taddress 192.168.1.20/24\n\tgateway 192.168.1.1\n",
        f"{STATIC}address 192.168.1.20\nnetmask 24\n",
        f"{STATIC}address 10.0.0.0/31\n",
        f"{LOOPBACK}auto eth1\niface eth1 inet dhcp\n  hostname of-mine\n",
        f"{STATIC}address 10.1.2.3/8\niface eth0 inet6 static\naddress fd00::1/64\n",
        f"{STATIC}address 10.1.2.3/8\nbroadcast +\n",
    ],
)
def test_interfaces_that_come_up(judge: list[str], tmp_path: Path, text: str) -> None:
    assert judged(judge, tmp_path, "interfaces", text) == (0, "")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (f"{STATIC}address 192.168.1.300/24\n", "line 3: no address: 192.168.1.300/24"),
        (f"{STATIC}address 192.168.1.20\n", "eth0 has no netmask"),
        (f"{STATIC}", "eth0 is static and has no address"),
        (f"{STATIC}address 192.168.1/24\n", "no address"),
        (f"{STATIC}address 192.168.1.20/33\n", "no address"),
        (f"{STATIC}address 192.168.1.20/24/8\n", "no address"),
        (f"{STATIC}address 192.168.1.20\nnetmask 255.0.255.0\n", "no netmask: 255.0.255.0"),
        (f"{STATIC}address 192.168.1.0/24\n", "that of its network"),
        (f"{STATIC}address 192.168.1.255/24\n", "that of its network"),
        (f"{STATIC}address 224.0.0.5/24\n", "not one for a port"),
        (f"{STATIC}address 127.0.0.5/8\n", "not one for a port"),
        (f"{STATIC}address 0.0.0.5/24\n", "not one for a port"),
        (f"{STATIC}address 192.168.1.20/24\ngateway 192.168.2.1\n", "gateway is not in its network"),
        (f"{STATIC}address 192.168.1.20/24\ngateway here\n", "no address: here"),
        (f"{STATIC}address 192.168.1.20/24\nbroadcast 1.2.3\n", "no address: 1.2.3"),
        ("auto eth0\niface eth0 inet statc\n", "no way to get an address: statc"),
        (f"garbage\n{STATIC}address 10.1.2.3/8\n", "line 1: it belongs to no interface: garbage"),
        (LOOPBACK, "it brings up neither eth0 nor eth1"),
        ("", "it brings up neither eth0 nor eth1"),
    ],
)
def test_interfaces_that_would_leave_the_board_out_of_reach(
    judge: list[str], tmp_path: Path, text: str, why: str
) -> None:
    code, said = judged(judge, tmp_path, "interfaces", text)
    assert code == 1
    assert why in said


@pytest.mark.parametrize("text", ["station-7\n", "a\n", "7\n", f"{'a' * 63}\n", "A7"])
def test_name_of_a_host(judge: list[str], tmp_path: Path, text: str) -> None:
    assert judged(judge, tmp_path, "hostname", text) == (0, "")


@pytest.mark.parametrize(
    "text", ["", "\n", "a b\n", "-a\n", "a-\n", "a.b\n", "a\nb\n", f"{'a' * 64}\n", "\u010d\n"]
)
def test_what_is_no_name_of_a_host(judge: list[str], tmp_path: Path, text: str) -> None:
    code, why = judged(judge, tmp_path, "hostname", text)
    assert (code, "letters, digits" in why) == (1, True)


def test_configuration_is_judged_by_the_gateway(judge: list[str], programs: Path, tmp_path: Path) -> None:
    rtud = str(programs / "rtud/rtud")
    assert judged(judge, tmp_path, "config.json", '{"iec104": {}, "port": []}', rtud) == (0, "")
    code, why = judged(judge, tmp_path, "config.json", '{"pints": {}, "iec104": 5}', rtud)
    assert code == 1
    assert "pints: unknown key" in why


@pytest.mark.slow
@pytest.mark.usefixtures("programs")
def test_sites_of_this_tree_are_sound(tmp_path: Path) -> None:
    write_site(tmp_path, updates=True)
    for site in (ROOT / "tests/linux/site-tls", tmp_path / "lab", tmp_path / "field"):
        done = subprocess.run(
            [ROOT / "board/nuc980/post-build.sh"], env={**os.environ, "SITE_SETTINGS": str(site)},
            capture_output=True, text=True,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, ""), site
