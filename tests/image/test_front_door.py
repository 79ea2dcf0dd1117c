# SPDX-License-Identifier: GPL-3.0-or-later
"""The image's targets of the Makefile, in a copy of the tree, a stand-in for Buildroot, and kas itself."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time
from hashlib import sha256
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
IMAGES = ["nuc980_gateway", "nuc980_netboot"]
SAID = ["O", "BR2_EXTERNAL", "SITE_SETTINGS", "BR2_DL_DIR", "IMAGE", "FORCE_UNSAFE_CONFIGURE"]
# With the variables of the packages: make hands them to what it runs, where an exported one has such a name.
BUILDROOT = f"""\
BR2_EXTERNAL_OPENRTU_PATH = $(BR2_EXTERNAL)
all:
	mkdir -p $(O)/images
	printf '%s\\n' {" ".join(f"'{name} $({name})'" for name in SAID)} > $(O)/images/manifest.json
%_defconfig:
	mkdir -p $(O)
	sed '/^#.SPDX/d; /^#.Parts/d' $(BR2_EXTERNAL)/configs/$@ > $(O)/.config
defconfig:
	cp $(BR2_DEFCONFIG) $(O)/.config
savedefconfig:
	cp $(O)/.config $(BR2_DEFCONFIG)
include $(BR2_EXTERNAL)/external.mk
"""
# What `make sbom` calls of Buildroot's; all that show-info says here is Linux' version in its CPE. Buildroot
# has taken the commit for it before it reads external.mk.
LINUX = """\
qstrip = $(strip $(subst ",,$(1)))
BR2_ROOTFS_OVERLAY = "/a/tree/board/nuc980/rootfs-overlay"
LINUX_PATCHES = https://example.net/patch-5.10.140-rt73.patch
LINUX_CPE_ID_VERSION = d366b3919a926b710e2b819556849967f6fe311c
"""
SHOW_INFO = """\
show-info:
	@echo '{"linux": {"release": "$(LINUX_CPE_ID_VERSION)"}}'
"""
SHOW_PACKAGES = """\
show-info:
	@echo '{}'
"""
GENERATE = """\
#!/usr/bin/env python3
import json, sys
name, version, read, write = sys.argv[2::2]
linux = {"bom-ref": "linux", "type": "library", "name": "linux"}
release = json.load(open(read))["linux"]["release"]
linux["cpe"] = f"cpe:2.3:o:linux:linux_kernel:{release}:-:*:*:*:*:*:*"
gateway = {"bom-ref": "openrtu", "type": "library", "name": "openrtu"}
image = {"bom-ref": name, "type": "firmware", "name": name, "version": version}
bill = {"bomFormat": "CycloneDX", "specVersion": "1.6", "metadata": {"component": image}}
bill |= {"components": [linux, gateway], "dependencies": [{"ref": name, "dependsOn": ["linux", "openrtu"]}]}
json.dump(bill, open(write, "w"))
"""
# What `make cves` calls: Linux has what the folder of CVEs is said to have.
CVE_CHECK = """\
#!/usr/bin/env python3
import json, sys
bill = json.load(open(sys.argv[2]))
cve = {"id": "CVE-2025-1", "analysis": {"state": "exploitable"}, "affects": [{"ref": "linux"}]}
print(json.dumps(bill | {"vulnerabilities": [cve]}))
"""


def command_of_the_page() -> str:
    """What the page tells to type where there is no network."""
    found = re.search(r"^cp -a .*debian\.dsc$", (ROOT / "docs/image-buildroot.md").read_text(), re.MULTILINE)
    assert found
    return found[0].replace("folder/source", "build/source")


class Tree:
    """What the image's targets need of the tree, where `make setup` seems done."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "package/openrtu/src").mkdir(parents=True)
        for name in ("Makefile", "requirements.txt", "package/openrtu/src/VERSION"):
            shutil.copy(ROOT / name, folder / name)
        for name in ("board", "configs", "dts", "br2-external", "mk", "scripts"):
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=ignored)
        for package in (ROOT / "package").glob("*/*.mk"):
            copied = folder / package.relative_to(ROOT)
            copied.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(package, copied)
        (folder / "build").mkdir()
        (folder / ".venv").mkdir()
        for name in ("bin", "lib", "pyvenv.cfg"):
            (folder / ".venv" / name).symlink_to(Path(sys.prefix) / name)
        for kind, place in (("packages", "build"), ("python", ".venv")):
            for each in (folder / "scripts").glob(f"{kind}*.txt"):
                (folder / place / f"{each.stem}.done").touch()
        self.buildroot = folder / "buildroot"
        self.buildroot.mkdir()
        (self.buildroot / "Makefile").write_text(BUILDROOT)

    def plant(self, program: str, name: str) -> None:
        """A program of Buildroot's that reads what its show-info says."""
        (self.buildroot / "Makefile").write_text(LINUX + BUILDROOT + SHOW_INFO)
        file = self.buildroot / name
        file.parent.mkdir(parents=True)
        file.write_text(program)
        file.chmod(0o755)

    def make(self, *words: str) -> subprocess.CompletedProcess[str]:
        unwanted = ("MAKE", "MFLAGS", "BR2_", "OPENRTU", "SITE", "IMAGE", "BUILDROOT_DIR", "FORCE_UNSAFE")
        known = {name: value for name, value in os.environ.items() if not name.startswith(unwanted)}
        return subprocess.run(["make", *words], cwd=self.folder, env=known, capture_output=True, text=True)

    def make_with_stand_in(self, *words: str) -> subprocess.CompletedProcess[str]:
        return self.make(*words, f"BUILDROOT_DIR={self.buildroot}")

    def built(self, image: str) -> dict[str, str]:
        lines = (self.folder / "build" / image / "images" / "manifest.json").read_text().splitlines()
        return {name: value.strip() for name, _, value in (line.partition(" ") for line in lines)}


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    return Tree(tmp_path)


@pytest.mark.parametrize("words", [["SITE=a site"], ["SITE=a site", "IMAGE=nuc980_netboot"]])
def test_image_builds_both_or_the_one_that_is_named(tree: Tree, words: list[str]) -> None:
    site = tree.folder / "a site"
    site.mkdir()
    (tree.buildroot / "Makefile").write_text(f"IMAGE :=\n{BUILDROOT}")  # which what was typed would override
    done = tree.make_with_stand_in("image-buildroot", *words)
    assert done.returncode == 0, done.stderr
    images = [folder.name for folder in (tree.folder / "build").glob("nuc980*")]
    assert sorted(images) == (list(IMAGES) if len(words) == 1 else ["nuc980_netboot"])
    for image in images:
        assert tree.built(image) == {
            "O": str(tree.folder / "build" / image),
            "BR2_EXTERNAL": str(tree.folder / "br2-external"),
            "SITE_SETTINGS": str(site),
            "BR2_DL_DIR": str(tree.folder / "build" / "dl"),
            "IMAGE": "",
            "FORCE_UNSAFE_CONFIGURE": "1" if os.geteuid() == 0 else "",  # root may configure Buildroot's tar
        }


def test_site_that_is_not_there_is_said_at_once(tree: Tree) -> None:
    done = tree.make_with_stand_in("image-buildroot", "SITE=nowhere")
    assert done.returncode == 2
    assert "SITE=nowhere is not a folder; docs/image-buildroot.md says" in done.stderr
    assert not (tree.folder / "build" / IMAGES[0]).exists()


def test_folder_without_buildroot_is_said(tree: Tree) -> None:
    done = tree.make("image-buildroot", "BUILDROOT_DIR=nowhere")
    assert done.returncode == 2
    assert "BUILDROOT_DIR=nowhere is not a Buildroot checkout" in done.stderr


def test_changed_configuration_is_built_until_the_defconfig_is_newer(tree: Tree) -> None:
    assert tree.make_with_stand_in("image-buildroot").returncode == 0
    config = tree.folder / "build" / IMAGES[0] / ".config"
    with config.open("a") as file:
        file.write("BR2_BY_MENUCONFIG=y\n")
    assert tree.make_with_stand_in("image-buildroot").returncode == 0
    assert "BR2_BY_MENUCONFIG=y" in config.read_text()
    soon = time.time() + 10
    os.utime(tree.folder / "configs" / "nuc980_gateway_defconfig", (soon, soon))
    assert tree.make_with_stand_in("image-buildroot").returncode == 0
    assert "BR2_BY_MENUCONFIG=y" not in config.read_text()


def test_image_for_development_is_beside_the_others(tree: Tree) -> None:
    done = tree.make_with_stand_in("image-buildroot", "IMAGES=nuc980_gateway-development")
    assert done.returncode == 0, done.stderr
    assert [folder.name for folder in (tree.folder / "build").glob("nuc980*")] == [
        "nuc980_gateway-development"
    ]
    config = tree.folder / "build/nuc980_gateway-development/.config"
    assert config.read_text() == "".join(
        (tree.folder / "configs" / name).read_text()
        for name in ("nuc980_gateway_defconfig", "parts/development.config")
    )


def test_image_offline_gets_its_compiler_and_overrides(tree: Tree) -> None:
    (tree.buildroot / "Makefile").write_text(BUILDROOT + SHOW_PACKAGES)
    (tree.folder / "configs/offline.toml").write_text("source = []\n[programs]\n")  # nothing to fetch
    done = tree.make_with_stand_in("image-offline")
    assert done.returncode == 0, done.stderr
    for image, parts in {
        "nuc980_gateway_lts": ("offline", "offline-system"),
        "nuc980_uboot": ("offline",),
    }.items():
        config = tree.folder / f"build/{image}-offline/.config"
        names = (f"{image}_defconfig", *(f"parts/{part}.config" for part in parts))
        assert config.read_text() == "".join((tree.folder / "configs" / name).read_text() for name in names)
        assert tree.built(f"{image}-offline")["O"] == str(config.parent)
    assert (tree.folder / "build/offline/toolchain/bin/arm-linux-gnueabi-gcc").exists()
    assert (tree.folder / "build/offline/overrides.mk").exists()


def test_image_offline_without_buildroot_is_said_before_anything_is_fetched(tree: Tree) -> None:
    done = tree.make("image-offline", "BUILDROOT_DIR=nowhere")
    assert done.returncode == 2
    assert "BUILDROOT_DIR=nowhere is not a Buildroot checkout" in done.stderr
    assert not (tree.folder / "build/offline").exists()


def test_source_is_one_folder_for_a_build_without_network(tree: Tree) -> None:
    """The other tree's make must fetch nothing: its debian-source.sh would fail."""
    (tree.buildroot / "Makefile").write_text(BUILDROOT + SHOW_PACKAGES)
    (tree.buildroot / ".git").mkdir()
    text = "Version: 1-1\n"
    row = f'package = "a"\ndebian = "a"\nversion = "1-1"\nsha256 = "{sha256(text.encode()).hexdigest()}"'
    (tree.folder / "configs/offline.toml").write_text(f"[[source]]\n{row}\n[programs]\n")
    fetcher = tree.folder / "scripts/debian-source.sh"
    fetcher.write_text(f"#!/bin/sh\nmkdir -p $2 && echo source > $2/file && printf '{text}' > $2.dsc\n")
    done = tree.make_with_stand_in("source", "IMAGES=nuc980_uboot-offline")
    assert done.returncode == 0, done.stderr
    source = tree.folder / "build/source"
    assert (source / "build/a/debian/file").read_text() == "source\n"
    assert not (source / "buildroot/.git").exists()
    shutil.rmtree(tree.folder / "build/a")
    shutil.rmtree(tree.folder / "build/offline")
    fetcher.write_text("#!/bin/sh\nexit 1\n")
    subprocess.run(["bash", "-c", command_of_the_page()], cwd=tree.folder, check=True)
    done = tree.make("build/offline/overrides.mk", "BUILDROOT_DIR=build/source/buildroot")
    assert done.returncode == 0, done.stderr


def test_source_of_what_buildroot_downloads_is_its_own_targets(tree: Tree) -> None:
    recorded = "source:\n\techo $(O) >> $(BR2_DL_DIR)/asked\n"
    (tree.buildroot / "Makefile").write_text(BUILDROOT + recorded)
    done = tree.make_with_stand_in("source", "IMAGES=nuc980_gateway nuc980_uboot")
    assert done.returncode == 0, done.stderr
    asked = (tree.folder / "build/source/dl/asked").read_text().split()
    assert [Path(folder).name for folder in asked] == ["nuc980_gateway", "nuc980_uboot"]


@pytest.mark.parametrize("image", IMAGES)
def test_savedefconfig_writes_back_and_keeps_the_licence(tree: Tree, image: str) -> None:
    assert tree.make_with_stand_in("image-buildroot").returncode == 0
    defconfig = tree.folder / "configs" / f"{image}_defconfig"
    before = defconfig.read_text()
    with (tree.folder / "build" / image / ".config").open("a") as file:
        file.write("BR2_BY_MENUCONFIG=y\n")
    done = tree.make_with_stand_in("savedefconfig", f"IMAGE={image}")
    assert done.returncode == 0, done.stderr
    assert defconfig.read_text() == f"{before}BR2_BY_MENUCONFIG=y\n"


def pin(tree: Tree, url: str, commit: str) -> None:
    """Another repository into kas.yml, without a tag."""
    file = tree.folder / "configs" / "kas.yml"
    lines = [line for line in file.read_text().splitlines() if "tag:" not in line]
    new = {"url:": f"    url: {url}", "commit:": f"    commit: {commit}"}
    lines = [next((row for key, row in new.items() if line.strip().startswith(key)), line) for line in lines]
    file.write_text("\n".join(lines) + "\n")


def git(folder: Path, *words: str) -> str:
    author = ["-c", "user.name=x", "-c", "user.email=x@example.org", "-c", "commit.gpgsign=false"]
    done = subprocess.run(["git", *author, *words], cwd=folder, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def test_sbom_is_the_images_with_its_version_and_a_release_of_linux(tree: Tree) -> None:
    tree.plant(GENERATE, "utils/generate-cyclonedx")
    done = tree.make_with_stand_in("sbom", "IMAGE=nuc980_netboot")
    assert done.returncode == 0, done.stderr
    bill = json.loads((tree.folder / "build/nuc980_netboot/sbom.cdx.json").read_text())
    version = (ROOT / "package/openrtu/src/VERSION").read_text().strip()
    image = bill["metadata"]["component"]
    assert (image["bom-ref"], image["version"]) == ("nuc980_netboot", version)
    assert ":linux_kernel:5.10.140:" in bill["components"][0]["cpe"]


def test_cves_are_of_the_images_bill_and_of_the_named_folder(tree: Tree) -> None:
    tree.plant(GENERATE, "utils/generate-cyclonedx")
    tree.plant(CVE_CHECK, "support/scripts/cve-check")
    cve = tree.folder / "nvd/git/CVE-2025/CVE-2025-00xx/CVE-2025-0001.json"
    cve.parent.mkdir(parents=True)
    cve.touch()
    done = tree.make_with_stand_in("cves", "IMAGE=nuc980_netboot", "NVD=nvd")
    assert done.returncode == 0, done.stderr
    assert "linux      5.10.140  CVE-2025-1" in done.stdout
    assert (tree.folder / "build/nuc980_netboot/cves.cdx.json").exists()


def test_checkout_brings_the_pinned_commit(tree: Tree) -> None:
    git(tree.buildroot, "init", "--quiet")
    git(tree.buildroot, "add", "Makefile")
    git(tree.buildroot, "commit", "--quiet", "-m", "the pinned one")
    commit = git(tree.buildroot, "rev-parse", "HEAD")
    git(tree.buildroot, "commit", "--quiet", "--allow-empty", "-m", "a newer one")
    pin(tree, f"file://{tree.buildroot}", commit)
    done = tree.make("checkout")
    assert done.returncode == 0, done.stderr
    assert git(tree.folder / "build" / "buildroot", "rev-parse", "HEAD") == commit
    assert tree.make("image-buildroot").returncode == 0


def test_without_network_checkout_says_what_it_could_not_reach(tree: Tree) -> None:
    url, commit = "https://buildroot.invalid/buildroot.git", "0123456789abcdef0123456789abcdef01234567"
    pin(tree, url, commit)
    done = tree.make("image-buildroot")
    assert done.returncode == 2
    assert f"Buildroot could not be brought from {url}" in done.stderr
    assert f"With a checkout of commit {commit}: make image-buildroot BUILDROOT_DIR=folder" in done.stderr
    assert "Traceback" not in done.stderr


WRONG = [
    (
        "run IMAGE=nope",
        "there is no image in nope: it lacks uImage; make image-buildroot makes build/",
    ),
    ("run IMAGE=configs", "there is no image in configs: it lacks uImage"),
    ("run PORT=0", "PORT=0 is not a TCP port: give a number from 1 to 65535, such as PORT=2405"),
    ("run-native PORT=65536", "PORT=65536 is not a TCP port"),
    ("run-native PORT=/dev/ttyUSB0", "PORT=/dev/ttyUSB0 is not a TCP port"),
    ("run-native KEEP=1 PORT=2'4", "PORT=2'4 is not a TCP port"),
    ("image SITE=nope", "SITE=nope is not a folder"),
    ("image IMAGES=nope", "IMAGES=nope: there is no configs/nope_defconfig; there are nuc980_gateway "),
    ("update KEY=nope CERTIFICATE=Makefile", "KEY=nope is not a file; docs/update.md says how to make one"),
    ("update KEY=Makefile CERTIFICATE=nope", "CERTIFICATE=nope is not a file"),
    ("update SITE=sites/plain", "SITE=sites/plain has no update.pem: its boards take no updates"),
    ("update BOARD=nope", "BOARD=nope: there is no such board"),
    ("image IMAGE=nope", "IMAGES=nope: there is no configs/nope_defconfig"),
    ("menuconfig IMAGE=nope", "IMAGE=nope: there is no configs/nope_defconfig"),
    ("cves IMAGE=nope", "IMAGE=nope: there is no configs/nope_defconfig"),
    ("cves NVD=nope", "NVD=nope is not a folder; docs/security.md says what belongs in it"),
    ("system SITE=sites/json", "sites/json/config.json is not JSON"),
    ("system SITE=sites/more", "sites/more/config.yaml is not a setting of a site"),
    ("image SITE=sites/macs", 'sites/macs/macs has no line "eth0 XX:XX:XX:XX:XX:XX"'),
    ("image SITE=sites/ntp", "sites/ntp/ntp: it names neither a server nor the receiver"),
    ("image-debian SITE=sites/key", "sites/key/authorized_keys: it has a private key"),
    ("update SITE=sites/far", "sites/far/interfaces: line 3: no address: 192.168.1.300/24"),
    ("centre PORT=nope", "PORT=nope is not a TCP port"),
    ("centre STATIONS=nope.json", "STATIONS=nope.json is not a file; docs/centre.md says what belongs in it"),
    ("netboot SITE=sites/password PORT=/dev/null", "sites/password/root-password is not a hash of crypt(5)"),
    ("netboot", "netboot: PORT is missing"),
    ("netboot PORT=/dev/nope", "netboot: PORT=/dev/nope is not a serial port; this machine has: "),
    ("netboot PORT=/dev/null BOARD_IP=192.0.2.1", "BOARD_IP=192.0.2.1 is not an address with its prefix"),
    ("netboot PORT=/dev/null IMAGE=nope", "there is no image in build/nope"),
    ("dtb DTS=nope", "DTS=nope is not a file"),
    ("dtb SWITCHES=nonsense", "SWITCHES=nonsense: nonsense: dts/nuvoton/nuc980-gateway.dts has the switches"),
    ("fuzz FUZZ_SECONDS=soon", "FUZZ_SECONDS=soon is not a number of seconds"),
    ("bench LIB60870=nope", "LIB60870=nope is not a folder"),
]
SITES = {
    "json": ("config.json", "{"),
    "more": ("config.yaml", ""),
    "macs": ("macs", "eth0 01:00:00:00:00:01\n"),
    "ntp": ("ntp", "# none\n"),
    "password": ("root-password", "secret\n"),
    "plain": ("hostname", "station-7\n"),
    "key": ("authorized_keys", "-----BEGIN OPENSSH PRIVATE KEY-----\n"),
    "far": ("interfaces", "auto eth0\niface eth0 inet static\naddress 192.168.1.300/24\n"),
}


@pytest.fixture(scope="module")
def bare_tree(tmp_path_factory: pytest.TempPathFactory) -> Tree:
    """With sites, and nothing built."""
    tree = Tree(tmp_path_factory.mktemp("bare"))
    for folder in ("build", ".venv"):
        shutil.rmtree(tree.folder / folder)
    for name, (file, text) in SITES.items():
        (tree.folder / "sites" / name).mkdir(parents=True)
        (tree.folder / "sites" / name / file).write_text(text)
    return tree


@pytest.mark.sample(6)
@pytest.mark.parametrize(("words", "message"), WRONG)
def test_what_cannot_be_used_is_said_before_anything_is_built(
    bare_tree: Tree, words: str, message: str
) -> None:
    run = bare_tree.make(*words.split())
    assert run.returncode == 2
    assert message in run.stderr.splitlines()[-1]
    assert run.stdout == ""
    assert not (bare_tree.folder / "build").exists()


def test_a_path_with_a_space_is_refused_where_nothing_can_be_built_in_one(tmp_path: Path) -> None:
    folder = tmp_path / "a b"
    folder.mkdir()

    def said(goal: str, **environment: str) -> str:
        command = [ROOT / "scripts/check-arguments.sh", goal]
        done = subprocess.run(
            command, cwd=folder, env=os.environ | environment, capture_output=True, text=True, check=True
        )
        return done.stdout

    assert "cannot be built in a path with a space" in said("run")
    assert said("run-native") + said("test-quick") + said("run", DRY_RUN="n") == ""


def test_patch_that_is_gone_is_built_without(tree: Tree) -> None:
    built = tree.folder / "built"
    patches = [tree.folder / "patches" / name / "0002-x.patch" for name in ("qemu", "uboot", "linux/6.1")]
    for name, patch in zip(("qemu", "u-boot", "linux"), patches, strict=True):
        patch.parent.mkdir(parents=True)
        patch.touch()
        patch.with_name("0001-x.patch").touch()
        script = tree.folder / "scripts" / f"build-{name.replace('-', '')}.sh"
        script.write_text(f"#!/bin/sh\necho {name} >> {built}\n")
        (tree.folder / "build" / name).mkdir()
        (tree.folder / "build" / name / "debian.dsc").touch()

    def builds() -> set[str]:
        built.write_text("")
        done = tree.make("qemu", "uboot", "linux")
        assert done.returncode == 0, done.stderr
        return set(built.read_text().split())

    everything = {"qemu", "u-boot", "linux"}
    assert builds() == everything
    assert builds() == set()
    for patch in patches:
        patch.unlink()
        patch.with_name(".0001-x.patch.swp").touch()
    assert builds() == everything
    for patch in patches:
        patch.with_name(".0001-x.patch.swp").unlink()
    assert builds() == set()


def test_netboot_boots_what_is_asked_for(tree: Tree) -> None:
    images = tree.folder / "build/nuc980_netboot/images"
    site = tree.folder / "site"
    for folder in (images, site):
        folder.mkdir(parents=True)
    for name in ("uImage", "nuc980-gateway.dtb"):
        (images / name).touch()
    words = ["-n", "netboot", "PORT=/dev/null", "BOARD_IP=192.0.2.1/24", f"SITE={site}"]
    run = tree.make(*words, "IMAGE=nuc980_netboot")
    assert run.returncode == 0, run.stderr
    expected = (
        f"scripts/nuc980-netboot boot --port /dev/null --site {site} --board-ip 192.0.2.1/24 "
        "--console build/nuc980_netboot/images/uImage build/nuc980_netboot/images/nuc980-gateway.dtb"
    )
    assert " ".join(run.stdout.replace("\\\n", " ").split()).endswith(expected)
