# SPDX-License-Identifier: GPL-3.0-or-later
"""What the board could not boot is refused: images made by mkimage, dtc and ubinize, not by us."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from image import manifest
from image.manifest import Refused, judge_device_tree, main, read_limits, ubi_crc

ROOT = Path(__file__).resolve().parents[2]
LIMITS = ROOT / "board/nuc980/boards/gateway/image-limits.toml"
HEADER = 64
KERNEL = "Linux-5.10.140-rt73"
TREE = """/dts-v1/;
/ {{
	model = "A gateway";
	compatible = "example,gateway", "{soc}";
	nand {{
		partitions {{
			compatible = "fixed-partitions";
			#address-cells = <1>;
			#size-cells = <1>;
			partition@200000 {{ reg = <0x200000 0x1400000>; }};
			partition@1600000 {{ label = "{label}"; reg = <0x1600000 {size}>; }};
		}};
	}};
}};
"""


def tool(*words: str | Path) -> None:
    subprocess.run([str(word) for word in words], check=True, capture_output=True)


class Output:
    """Buildroot's output folder, as far as a manifest needs it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.images = folder / "images"
        self.images.mkdir()
        self.manifest = self.images / "manifest.json"
        etc = folder / "target" / "etc"
        etc.mkdir(parents=True)
        (etc / "os-release").write_text(
            "NAME=Buildroot\nVERSION=2026.02.3\nID=buildroot\nIMAGE_VERSION=1.2.3.7\n"
        )
        self.configure("# BR2_TARGET_ROOTFS_INITRAMFS is not set")
        self.kernel(size=100_000)
        self.device_tree()
        self.ubi()

    def configure(self, line: str) -> None:
        known = (
            'BR2_DEFCONFIG="/a/folder/nuc980_gateway_defconfig"\nBR2_LINUX_KERNEL_CUSTOM_REPO_VERSION="d366"'
        )
        (self.folder / ".config").write_text(f"{known}\n{line}\n")

    def for_network(self) -> None:
        self.configure("BR2_TARGET_ROOTFS_INITRAMFS=y")

    def kernel(self, size: int, *options: str, load: str = "0x8000") -> None:
        payload = self.folder / "zImage"
        payload.write_bytes(bytes(size))
        given = [
            "-A",
            "arm",
            "-O",
            "linux",
            "-T",
            "kernel",
            "-C",
            "none",
            "-a",
            load,
            "-e",
            load,
            "-n",
            KERNEL,
        ]
        tool("mkimage", *given, *options, "-d", payload, self.images / "uImage")

    def device_tree(
        self, *options: str, soc: str = "nuvoton,nuc980", size: str = "0x6480000", label: str = "rootfs"
    ) -> None:
        source = self.folder / "tree.dts"
        source.write_text(TREE.format(soc=soc, size=size, label=label))
        tool("dtc", "-q", *options, "-O", "dtb", "-o", self.images / "nuc980-gateway.dtb", source)

    def ubi(
        self, block: str = "128KiB", *options: str, volume: str = "20MiB", content: int = 300_000
    ) -> None:
        image = self.folder / "content"
        image.write_bytes(os.urandom(300_000))
        rows = ["[root]", "mode=ubi", f"image={image}", "vol_id=0", "vol_type=dynamic", "vol_name=rootfs"]
        (self.folder / "ubinize.cfg").write_text(
            "\n".join([*rows, f"vol_size={volume}", "vol_flags=autoresize", ""])
        )
        given = ["-p", block, "-m", "2048", *options, self.folder / "ubinize.cfg"]
        tool("ubinize", "-o", self.images / "rootfs.ubi", *given)

    def ubi_from(self, start: int) -> None:
        image = self.images / "rootfs.ubi"
        image.write_bytes(image.read_bytes()[start:])

    def move_volume_table(self, at: int) -> None:
        """The first block's header says that its data begins there."""
        image = self.images / "rootfs.ubi"
        data = image.read_bytes()
        header = data[:20] + at.to_bytes(4, "big") + data[24:60]
        image.write_bytes(header + ubi_crc(header).to_bytes(4, "big") + data[64:])

    def change(self, name: str, at: int, value: int | None = None) -> None:
        """One byte, or all from there on away."""
        data = bytearray((self.images / name).read_bytes())
        if value is None:
            del data[at:]
        else:
            data[at] ^= value
        (self.images / name).write_bytes(data)

    def judge(self, *more: str) -> int:
        words = ["--images", self.images, "--config", self.folder / ".config", "--limits", LIMITS]
        return main([str(word) for word in [*words, "--out", self.manifest, *more]])


@pytest.fixture
def output(tmp_path: Path) -> Output:
    return Output(tmp_path)


def test_manifest_says_what_is_there(output: Output) -> None:
    (output.images / "netboot").mkdir()
    (output.images / "netboot" / "readme").write_text("any other file")
    assert output.judge() == 0
    manifest = json.loads(output.manifest.read_text())
    assert (manifest["configuration"], manifest["boots-from"]) == ("nuc980_gateway_defconfig", "flash")
    files = {row["name"]: row for row in manifest["files"]}
    assert {name: row.get("kind") for name, row in files.items()} == {
        "netboot/readme": None,
        "nuc980-gateway.dtb": "device-tree",
        "rootfs.ubi": "ubi",
        "uImage": "kernel",
    }
    assert [row["what"] for row in files.values() if "what" in row] == ["A gateway", "rootfs", KERNEL]
    uimage = (output.images / "uImage").read_bytes()
    assert files["uImage"]["size"] == len(uimage) == 100_000 + HEADER
    assert files["uImage"]["sha256"] == hashlib.sha256(uimage).hexdigest()


@pytest.mark.slow
def test_image_has_the_tree_of_its_board_alone(output: Output) -> None:
    """Buildroot compiles those of all boards in dts/nuvoton, once; the board may be another one later."""
    (output.images / "nuc980-numaker.dtb").write_bytes((output.images / "nuc980-gateway.dtb").read_bytes())
    settings = {"BR2_CONFIG": str(output.folder / ".config"), "SITE_SETTINGS": ""}
    for board in ("gateway", "numaker", "gateway"):
        subprocess.run(
            [ROOT / "board/nuc980/post-image.sh", output.images],
            env={**os.environ, **settings, "NUC980_BOARD": board},
            check=True,
        )
        names = {row["name"] for row in json.loads(output.manifest.read_text())["files"]}
        assert names == {f"nuc980-{board}.dtb", "rootfs.ubi", "uImage"}


def test_manifest_names_the_sources(output: Output) -> None:
    assert output.judge() == 0
    assert json.loads(output.manifest.read_text())["version"] == "1.2.3.7"
    sources = json.loads(output.manifest.read_text())["sources"]
    assert sources["linux"]["commit"] == "d366"
    assert sources["openrtu"]["version"] == (ROOT / "package/openrtu/src/VERSION").read_text().strip()
    assert sources["buildroot"]["version"] == "2026.02.3"
    assert f"commit: {sources['buildroot']['commit']}" in (ROOT / "configs" / "kas.yml").read_text()


def test_manifest_of_debians_sources_names_no_other_kernel(
    output: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(manifest, "OFFLINE", output.folder)
    (output.folder / "versions").write_text("linux 6.1.176-1\nopenssh 1:9.2p1-2+deb12u10\n")
    output.configure('BR2_PACKAGE_OVERRIDE_FILE="$(A_TREE)/../build/offline/overrides.mk"')
    assert output.judge() == 0
    sources = json.loads(output.manifest.read_text())["sources"]
    assert sources["debian"] == {"linux": "6.1.176-1", "openssh": "1:9.2p1-2+deb12u10"}
    assert {"openrtu", "buildroot"} <= set(sources)
    assert "linux" not in sources


@pytest.mark.parametrize(
    ("version", "known"),
    [
        ("2026.02.3", True),
        ("2026.02.3-g679b9ead76", True),
        ("2026.02.3-g679b9ead76-dirty", False),
        ("2026.05-12-gabcdef12", False),
    ],
)
def test_commit_is_claimed_for_the_pinned_buildroot_only(output: Output, version: str, known: bool) -> None:
    (output.folder / "target" / "etc" / "os-release").write_text(f'VERSION="{version}"\n')
    assert output.judge() == 0
    buildroot = json.loads(output.manifest.read_text())["sources"]["buildroot"]
    assert (buildroot["version"], buildroot["commit"] is not None) == (version, known)


def test_manifest_is_the_same_twice(output: Output) -> None:
    assert output.judge() == 0
    first = output.manifest.read_bytes()
    assert output.judge() == 0
    assert output.manifest.read_bytes() == first


@pytest.fixture(scope="session")
def tree(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    output = Output(tmp_path_factory.mktemp("tree"))
    return (output.images / "nuc980-gateway.dtb").read_bytes()


def test_limits_of_the_other_boards_judge_an_image(output: Output) -> None:
    """Their root is inside the kernel, and their flash may have no part for a device tree alone."""
    tree = (output.images / "nuc980-gateway.dtb").read_bytes()
    for file in sorted((ROOT / "board/nuc980/boards").glob("*/image-limits.toml")):
        limits = read_limits(file)
        assert manifest.judge_device_tree(tree, limits, in_flash=False) == "A gateway"
        assert limits.memory_room > 0


ROOM_IN_FLASH = 0x500000 - 4 * 0x20000
ROOM_IN_MEMORY = 0xA00000 - 0x7FC0


def test_rooms_are_those_of_the_issue() -> None:
    limits = read_limits(LIMITS)
    assert (limits.memory_room, limits.kernel_part.room) == (10_453_056, ROOM_IN_FLASH)
    parts = [limits.kernel_part, limits.device_tree_part, limits.root_part]
    ends = [part.offset + part.size for part in parts]
    assert all(end <= part.offset for end, part in zip(ends, parts[1:], strict=False))
    assert ends[-1] <= 1024 * limits.block


def test_page_names_the_rooms() -> None:
    limits = read_limits(LIMITS)
    page = (ROOT / "docs" / "image-buildroot.md").read_text()
    for room in (limits.memory_room, limits.kernel_part.room, limits.device_tree_part.room):
        assert f"{room:_} bytes".replace("_", " ") in page
    assert f"{limits.root_part.room // limits.block} blocks of 128 KiB" in page


@pytest.mark.parametrize(("over", "expected"), [(0, 0), (1, 1)])
def test_largest_kernel_for_the_flash(output: Output, over: int, expected: int) -> None:
    output.kernel(ROOM_IN_FLASH - HEADER + over)
    assert output.judge() == expected


@pytest.mark.parametrize(("over", "expected"), [(0, 0), (1, 1)])
def test_largest_kernel_for_the_network(output: Output, over: int, expected: int) -> None:
    output.for_network()
    output.kernel(ROOM_IN_MEMORY - HEADER + over)
    assert output.judge() == expected


def test_network_needs_no_flash(output: Output) -> None:
    output.for_network()
    (output.images / "rootfs.ubi").unlink()
    output.device_tree(size="0x1000")
    assert output.judge() == 0


Breaking = Callable[[Output], None]
BROKEN: dict[str, tuple[Breaking, str]] = {
    "header damaged": (lambda o: o.change("uImage", 9, 1), "header's CRC"),
    "kernel damaged": (lambda o: o.change("uImage", 5000, 1), "does not match its CRC"),
    "kernel cut off": (lambda o: o.change("uImage", 5000), "its header says 100000"),
    "kernel cut off in the header": (lambda o: o.change("uImage", 40), "cut off in the header"),
    "kernel for another address": (lambda o: o.kernel(1000, load="0x10000"), "made to run at 0x10000"),
    "kernel for another processor": (
        lambda o: o.kernel(1000, "-A", "mips"),
        "uncompressed Linux kernel",
    ),
    "kernel packed by gzip": (lambda o: o.kernel(1000, "-C", "gzip"), "uncompressed Linux kernel"),
    "no kernel but a root": (lambda o: o.kernel(1000, "-T", "ramdisk"), "uncompressed Linux kernel"),
    "no kernel": (lambda o: (o.images / "uImage").unlink(), "there is no uImage"),
    "name of a kernel": (lambda o: (o.images / "uImage").write_bytes(bytes(1000)), "there is no uImage"),
    "tree of another board": (lambda o: o.device_tree(soc="nuvoton,nuc970"), "for another board"),
    "tree cut off": (lambda o: o.change("nuc980-gateway.dtb", 200), "it has 200"),
    "tree cut off in the header": (
        lambda o: o.change("nuc980-gateway.dtb", 20),
        "a complete device tree",
    ),
    "tree damaged": (lambda o: o.change("nuc980-gateway.dtb", 0x3B, 0x40), "a complete device tree"),
    "tree too large": (lambda o: o.device_tree("-S", "786433"), "1 more than the 786432"),
    "no tree": (lambda o: (o.images / "nuc980-gateway.dtb").unlink(), "there is no device tree"),
    "root elsewhere": (lambda o: o.device_tree(size="0x6000000"), "no flash partition"),
    "root by another name": (lambda o: o.device_tree(label="user"), 'no flash partition "rootfs"'),
    "blocks of another flash": (lambda o: o.ubi("256KiB"), "no UBI header"),
    "smaller blocks": (lambda o: o.ubi("64KiB"), "made for smaller blocks"),
    "headers within a page": (lambda o: o.ubi("128KiB", "-s", "512"), "within a page"),
    "root cut off": (lambda o: o.change("rootfs.ubi", 300_000), "within a block"),
    "header of a block damaged": (lambda o: o.change("rootfs.ubi", 0x20000 + 8, 1), "block 1 has no UBI"),
    "volume table damaged": (lambda o: o.change("rootfs.ubi", 4096 + 3, 1), "volume table is damaged"),
    "volume table lost": (lambda o: o.ubi_from(2 * 0x20000), "no volume table"),
    "volume table cut off": (lambda o: o.move_volume_table(0x20000 - 2048), "volume table is cut off"),
    "no root": (lambda o: o.change("rootfs.ubi", 0), "there is no UBI image"),
    "volume too large": (lambda o: o.ubi(volume="98MiB"), "UBI would not attach"),
}


@pytest.mark.sample(7)
@pytest.mark.parametrize("what", BROKEN)
def test_broken_image_is_refused(output: Output, what: str, capsys: pytest.CaptureFixture[str]) -> None:
    breaking, reason = BROKEN[what]
    assert output.judge() == 0
    breaking(output)
    assert output.judge() == 1
    printed = capsys.readouterr().err
    assert reason in printed
    assert not output.manifest.exists()


def test_every_reason_is_told(output: Output, capsys: pytest.CaptureFixture[str]) -> None:
    output.kernel(ROOM_IN_FLASH)
    output.device_tree(soc="nuvoton,nuc970")
    (output.images / "rootfs.ubi").unlink()
    assert output.judge() == 1
    assert capsys.readouterr().err.count("manifest: refused:") == 3


def test_copy_for_the_network_is_judged_too(output: Output) -> None:
    (output.images / "netboot").mkdir()
    (output.images / "netboot" / "any-name").write_bytes((output.images / "uImage").read_bytes()[:-1])
    assert output.judge() == 1


@pytest.mark.slow
@settings(deadline=None)
@given(at=st.integers(0, 500), cut=st.integers(0, 500), value=st.binary(min_size=1, max_size=8))
def test_damaged_tree_is_refused_or_read(at: int, cut: int, value: bytes, tree: bytes) -> None:
    damaged = bytearray(tree[: len(tree) - cut])
    damaged[at : at + len(value)] = value
    with contextlib.suppress(Refused):
        judge_device_tree(bytes(damaged), read_limits(LIMITS), in_flash=True)


UNUSABLE: dict[str, Breaking] = {
    "no configuration": lambda o: (o.folder / ".config").unlink(),
    "empty configuration": lambda o: (o.folder / ".config").write_text(""),
    "no text": lambda o: (o.folder / ".config").write_bytes(b"\xff\xfe"),
    "no os-release": lambda o: (o.folder / "target" / "etc" / "os-release").unlink(),
}


@pytest.mark.parametrize("what", UNUSABLE)
def test_unusable_input_is_said(output: Output, what: str, capsys: pytest.CaptureFixture[str]) -> None:
    UNUSABLE[what](output)
    assert output.judge() == 2
    assert capsys.readouterr().err.startswith("manifest: ")


@pytest.mark.parametrize("text", ["", "[memory]\n", "uimage = ", "memory = 3\nflash = 4\n"])
def test_unusable_limits_are_said(tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text(text)
    output = Output(tmp_path)
    assert output.judge("--limits", str(limits)) == 2
    assert "image-limits.toml" in capsys.readouterr().err
