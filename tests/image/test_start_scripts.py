# SPDX-License-Identifier: GPL-3.0-or-later
"""Start scripts of the root file system that the emulated board's image does not run as Buildroot's does."""

import os
import re
import subprocess
from pathlib import Path

import pytest

from rig.rights import NETWORK, need

OVERLAY = Path(__file__).resolve().parents[2] / "board" / "nuc980" / "rootfs-overlay"
SSH = OVERLAY / "etc/init.d/S85sshd"
SYSCTL = OVERLAY / "etc/sysctl.d/openrtu.conf"


def serve(root: Path) -> str:
    """Runs S85sshd to where it becomes the server, below `root`; gives the server's arguments."""
    server = root / "usr/sbin/sshd"
    server.parent.mkdir(parents=True, exist_ok=True)
    server.write_text('#!/bin/sh\necho "$@"\n')
    server.chmod(0o755)
    script = re.sub(r'"/(data|usr)/', rf'"{root}/\1/', SSH.read_text())
    done = subprocess.run(
        ["sh", "-c", script, "S85sshd", "serve"], env=os.environ, capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return done.stdout


@pytest.mark.slow
def test_openssh_has_the_key_that_is_configured_and_no_other(tmp_path: Path) -> None:
    assert serve(tmp_path) == "-D\n"
    configured = re.findall(r"^HostKey (\S+)$", (OVERLAY / "etc/ssh/sshd_config").read_text(), re.MULTILINE)
    keys = [file for file in tmp_path.rglob("*") if file.is_file() and file.name != "sshd"]
    assert [str(tmp_path) + name for name in configured] == [str(key) for key in keys]
    assert keys[0].stat().st_mode & 0o777 == 0o600
    assert keys[0].parent.stat().st_mode & 0o777 == 0o700
    shown = subprocess.run(["ssh-keygen", "-l", "-f", keys[0]], capture_output=True, text=True, check=True)
    assert shown.stdout.endswith("(ED25519)\n")


def test_openssh_keeps_its_key_and_never_takes_half_of_one(tmp_path: Path) -> None:
    """A power cut may leave a key that is not whole, or an empty file."""
    folder = tmp_path / "data/ssh"
    folder.mkdir(parents=True)
    (folder / "ssh_host_ed25519_key.new").write_text("-----BEGIN")
    (folder / "ssh_host_ed25519_key").touch()
    serve(tmp_path)
    made = (folder / "ssh_host_ed25519_key").read_bytes()
    assert len(made) > 100
    serve(tmp_path)
    assert (folder / "ssh_host_ed25519_key").read_bytes() == made


def test_no_neighbour_tells_a_port_where_its_packets_go(tmp_path: Path) -> None:
    """In a network of its own, with two ports that are there before the settings, as on the board."""
    need(NETWORK, "the kernel's settings of ports")
    namespace = ["unshare", "--net"] if os.geteuid() == 0 else ["unshare", "--map-root-user", "--net"]
    settings = tmp_path / "settings"
    settings.write_text("".join(line for line in SYSCTL.open() if line.startswith("net.")))
    keys = [
        f"net.{family}.conf.{port}.{key}"
        for port in ("eth0", "eth1")
        for family, key in (
            ("ipv4", "accept_redirects"),
            ("ipv4", "send_redirects"),
            ("ipv6", "accept_redirects"),
            ("ipv6", "accept_ra"),
        )
    ]
    script = (
        "set -e; ip link add eth0 type veth peer name eth1; "
        f"sysctl -q -p {settings}; "
        "for port in eth0 eth1; do ip link set $port up; done; ip address add 192.0.2.1/24 dev eth0; "
        f"sysctl -n {' '.join(keys)}"
    )
    done = subprocess.run([*namespace, "sh", "-c", script], capture_output=True, text=True, check=True)
    assert dict(zip(keys, done.stdout.split(), strict=True)) == dict.fromkeys(keys, "0")
