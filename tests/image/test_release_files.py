# SPDX-License-Identifier: GPL-3.0-or-later
"""What a release publishes, and its signature."""

import os
import shutil
import subprocess
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from release.version import debian

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "scripts/release-files.sh"
VERSION = (ROOT / "package/openrtu/src/VERSION").read_text().strip()
PACKAGES = [f"deb/openrtu_1.0_{name}.deb" for name in ("all", "amd64", "arm64", "armhf")]
IMAGE = f"openrtu-{VERSION}-nuc980_gateway"


@pytest.fixture
def build(tmp_path: Path) -> Path:
    names = (
        *(f"nuc980_gateway/images/{name}" for name in ("uImage", "rootfs.ubi", "manifest.json")),
        "nuc980_gateway/sbom.cdx.json",
        "nuc980_gateway-development/images/uImage",
        *PACKAGES,
    )
    for name in names:
        (tmp_path / "build" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "build" / name).write_text(name)
    return tmp_path / "build"


def release(build: Path, key: str = "", **settings: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"RELEASE_KEY": key, "PARTS": "packages buildroot"} | settings
    return subprocess.run(
        [SCRIPT, build.parent / "out", build], env=environment, capture_output=True, text=True, check=False
    )


def test_all_is_there_and_summed(build: Path) -> None:
    """But an image for development."""
    done = release(build)
    assert done.returncode == 0, done.stderr
    assert "has no signature" in done.stderr
    out = build.parent / "out"
    names = [f"{IMAGE}-{name}" for name in ("manifest.json", "rootfs.ubi", "sbom.cdx.json", "uImage")]
    names += [Path(name).name for name in PACKAGES]
    assert sorted(file.name for file in out.iterdir()) == sorted(["SHA256SUMS", *names])
    subprocess.run(
        ["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=out, check=True, capture_output=True
    )
    assert (out / "SHA256SUMS").read_text().count("\n") == len(names)


def test_compose_comes_with_what_it_mounts(build: Path) -> None:
    for name in ("openrtu-gateway.oci.tar", "compose.yaml", "show/gateway.json"):
        file = build / "containers" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(name)
    done = release(build, PARTS="containers")
    assert done.returncode == 0, done.stderr
    out = build.parent / "out"
    compose = f"openrtu-{VERSION}-compose"
    names = {f"openrtu-{VERSION}-gateway.oci.tar", f"{compose}.tar.gz", "SHA256SUMS"}
    assert {file.name for file in out.iterdir()} == names
    with tarfile.open(out / f"{compose}.tar.gz") as archive:
        files = {entry.name for entry in archive if entry.isfile()}
    assert files == {f"{compose}/compose.yaml", f"{compose}/show/gateway.json"}


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


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"PARTS": "wheels"}, "has no wheels/*.whl: make wheels"),
        ({"PARTS": "packages pages"}, "has no pages/html: make site; or name the parts in PARTS"),
        ({"PARTS": "page"}, "there is no part page; there are source wheels packages apt"),
        ({"RELEASE_TAG": "v0.9.9"}, f"the tag v0.9.9 is not v{VERSION}"),
    ],
)
def test_release_that_is_not_what_was_asked_for(build: Path, settings: dict[str, str], why: str) -> None:
    done = release(build, **settings)
    assert done.returncode == 1
    assert why in done.stderr


def test_tag_of_this_version(build: Path) -> None:
    assert release(build, RELEASE_TAG=f"v{VERSION}").returncode == 0


# ---- the repository of apt


def openpgp(home: Path, *words: str) -> str:
    done = subprocess.run(
        ["gpg", "--homedir", home, "--batch", "--passphrase", "", *words],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout


@pytest.fixture
def apt_key(tmp_path: Path) -> Iterator[str]:
    home = tmp_path / "gnupg"
    home.mkdir(mode=0o700)
    openpgp(home, "--quick-generate-key", "OpenRTU test", "ed25519", "sign", "never")
    yield openpgp(home, "--armor", "--export-secret-keys")
    subprocess.run(["gpgconf", "--homedir", home, "--kill", "all"], check=True)


def package(folder: Path, name: str, architecture: str) -> None:
    """A Debian package, as small as one can be."""
    control = folder / name / "DEBIAN/control"
    control.parent.mkdir(parents=True)
    control.write_text(
        f"Package: {name}\nVersion: {debian(VERSION)}\nArchitecture: {architecture}\n"
        "Maintainer: nobody <nobody@example.org>\nDescription: a test\n"
    )
    subprocess.run(
        ["dpkg-deb", "--root-owner-group", "--build", folder / name, folder], check=True, capture_output=True
    )
    shutil.rmtree(folder / name)


@pytest.fixture
def packages(tmp_path: Path) -> Path:
    folder = tmp_path / "packages/deb"
    folder.mkdir(parents=True)
    for architecture in ("amd64", "arm64", "armhf"):
        package(folder, "openrtu", architecture)
    package(folder, "openrtu-tools", "all")
    return folder.parent


# Of this machine's apt it has the program alone; what is there to be installed comes from the folder.
APT = """. scripts/private-apt.sh
private_apt_root "$1" arm64
echo "deb [$3] file:$2 $private_apt_suite main" >"$1/etc/sources.list"
export APT_CONFIG=$1/apt.conf
apt-get update --error-on=any && cd "$1/cache" && apt-get download openrtu openrtu-tools"""


def apt(folder: Path, repository: Path, option: str) -> subprocess.CompletedProcess[str]:
    words = ["bash", "-euc", APT, "apt", str(folder), str(repository), option]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_apt_takes_what_the_key_has_signed(packages: Path, tmp_path: Path, apt_key: str) -> None:
    done = release(packages, PARTS="apt", APT_KEY=apt_key)
    assert done.returncode == 0, done.stderr
    repository = packages.parent / "out/apt"
    signed = f"signed-by={repository / 'openrtu.gpg'}"
    taken = apt(tmp_path / "root", repository, signed)
    assert taken.returncode == 0, taken.stderr
    names = {file.name.split("_")[0] for file in (tmp_path / "root/cache").glob("*.deb")}
    assert names == {"openrtu", "openrtu-tools"}

    (release_file,) = repository.glob("dists/*/InRelease")
    release_file.write_text(release_file.read_text().replace("Label: OpenRTU", "Label: OpenRTx"))
    refused = apt(tmp_path / "other", repository, signed)
    assert refused.returncode != 0
    assert "signature" in refused.stderr


@pytest.mark.slow
def test_without_a_key_apt_wants_trust(packages: Path, tmp_path: Path) -> None:
    done = release(packages, PARTS="apt")
    assert done.returncode == 0, done.stderr
    assert "APT_KEY is not set, so the repository is not signed" in done.stderr
    repository = packages.parent / "out/apt"
    assert apt(tmp_path / "root", repository, "arch=arm64").returncode != 0
    assert apt(tmp_path / "other", repository, "trusted=yes").returncode == 0


@pytest.mark.slow
def test_same_files_and_keys_give_the_same_bytes(packages: Path, tmp_path: Path, apt_key: str) -> None:
    pages = packages / "pages/html"
    pages.mkdir(parents=True)
    (pages / "index.html").write_text("a page")
    key = tmp_path / "key"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", key], check=True)
    made = []
    for _ in range(2):
        done = release(packages, key.read_text(), PARTS="packages apt pages", APT_KEY=apt_key)
        assert done.returncode == 0, done.stderr
        out = packages.parent / "out"
        made.append({file.relative_to(out): file.read_bytes() for file in out.rglob("*") if file.is_file()})
        shutil.rmtree(out)
        (pages / "index.html").touch()
    assert made[0] == made[1]
    assert Path("SHA256SUMS.sig") in made[0]


@pytest.mark.slow
def test_apt_key_that_is_none_is_said(packages: Path) -> None:
    done = release(packages, PARTS="apt", APT_KEY="secret")
    assert done.returncode == 1
    assert "APT_KEY is not an OpenPGP private key" in done.stderr
    assert "secret" not in done.stderr.replace("--export-secret-keys", "")
