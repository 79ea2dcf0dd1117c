# SPDX-License-Identifier: GPL-3.0-or-later
"""What a release publishes, and its signature."""

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "scripts/release-files.sh"
VERSION = (ROOT / "package/openrtu/src/VERSION").read_text().strip()
IMAGE = f"openrtu-{VERSION}-nuc980_gateway"


@pytest.fixture
def build(tmp_path: Path) -> Path:
    names = (
        *(f"nuc980_gateway/images/{name}" for name in ("uImage", "rootfs.ubi", "manifest.json")),
        "nuc980_gateway/sbom.cdx.json",
        "nuc980_gateway-development/images/uImage",
        "deb/openrtu_1.0_amd64.deb",
    )
    for name in names:
        (tmp_path / "build" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "build" / name).write_text(name)
    return tmp_path / "build"


def release(build: Path, key: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [SCRIPT, build.parent / "out", build],
        env=os.environ | {"RELEASE_KEY": key}, capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_all_is_there_and_summed(build: Path) -> None:
    """But an image for development."""
    done = release(build)
    assert done.returncode == 0, done.stderr
    assert "has no signature" in done.stderr
    out = build.parent / "out"
    names = [f"{IMAGE}-{name}" for name in ("manifest.json", "rootfs.ubi", "sbom.cdx.json", "uImage")]
    assert sorted(file.name for file in out.iterdir()) == ["SHA256SUMS", *names, "openrtu_1.0_amd64.deb"]
    subprocess.run(
        ["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=out, check=True, capture_output=True
    )
    assert (out / "SHA256SUMS").read_text().count("\n") == len(names) + 1


def test_signature_is_of_the_key(build: Path, tmp_path: Path) -> None:
    key = tmp_path / "key"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", key], check=True)
    assert release(build, key.read_text()).returncode == 0
    signers = tmp_path / "signers"
    signers.write_text(f"releases {key.with_suffix('.pub').read_text()}")
    sums = tmp_path / "out/SHA256SUMS"
    verify = ["ssh-keygen", "-Y", "verify", "-f", signers, "-I", "releases", "-n", "openrtu-release"]
    verify += ["-s", sums.with_suffix(".sig")]
    assert subprocess.run(verify, input=sums.read_bytes(), capture_output=True).returncode == 0
    assert subprocess.run(verify, input=sums.read_bytes() + b"x", capture_output=True).returncode != 0


@pytest.mark.parametrize(
    ("lacks", "why"),
    [("images/manifest.json", "has no manifest"), ("sbom.cdx.json", "make sbom IMAGE=nuc980_gateway")],
)
def test_what_is_not_whole_is_not_published(build: Path, lacks: str, why: str) -> None:
    (build / "nuc980_gateway" / lacks).unlink()
    done = release(build)
    assert done.returncode == 1
    assert why in done.stderr


def test_key_that_is_none_is_said(build: Path) -> None:
    done = release(build, "secret")
    assert done.returncode == 1
    assert "not an OpenSSH private key" in done.stderr
    assert "secret" not in done.stderr
