# SPDX-License-Identifier: GPL-3.0-or-later
"""
Judges an image that Buildroot or `make image-debian` made and writes its manifest: names, sizes, hashes,
versions, sources. An image that the board could not boot is refused, and then there is no manifest.

What a file is, its content says, not its name. This is one file with nothing but the standard library:
post-image.sh runs it with whatever python3 Buildroot has on its path.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import struct
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

from image.gateway import programs_of
from nuc980.errors import UnusableInput

ROOT = Path(__file__).resolve().parents[2]
OFFLINE = ROOT / "build" / "offline"
DONE, REFUSED, UNUSABLE = 0, 1, 2


class Refused(Exception):
    """Why the board would not boot a file."""


# ---- the limits ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Part:
    """A part of the flash, in bytes; `reserve` is what bad blocks may take of it."""

    offset: int
    size: int
    reserve: int

    @property
    def room(self) -> int:
        return self.size - self.reserve


@dataclass(frozen=True)
class Limits:
    """A board's image-limits.toml, in bytes."""

    uimage: int
    entry: int
    device_tree: int
    block: int
    page: int
    kernel_part: Part
    device_tree_part: Part | None  # None: the board's flash has no part of its own for it
    root_part: Part
    root_label: str

    @property
    def memory_room(self) -> int:
        """From where the uImage is loaded up to the device tree."""
        return self.device_tree - self.uimage


def read_limits(file: Path) -> Limits:
    try:
        table = tomllib.loads(read_text(file))
        memory, flash = table["memory"], table["flash"]

        def part(name: str) -> Part:
            row = flash[name]
            return Part(row["offset"], row["size"], row["reserve"] * flash["block"])

        return Limits(
            uimage=memory["uimage"],
            entry=memory["entry"],
            device_tree=memory["device_tree"],
            block=flash["block"],
            page=flash["page"],
            kernel_part=part("kernel"),
            device_tree_part=part("device_tree") if "device_tree" in flash else None,
            root_part=part("root"),
            root_label=flash["root"]["label"],
        )
    except (tomllib.TOMLDecodeError, KeyError, TypeError) as error:
        raise UnusableInput(
            f"{file}: {error!r}; it must be a table as in board/nuc980/boards/gateway/image-limits.toml"
        ) from error


# ---- the kernel: U-Boot's legacy image -----------------------------------------------------------

# include/image.h of U-Boot 2016.11: magic, CRC of the header, time, size, load address, entry point, CRC of
# the data, system, processor, type, compression, name.
UIMAGE_HEADER = struct.Struct(">7I4B32s")
UIMAGE_MAGIC = bytes.fromhex("27051956")
LINUX, ARM, KERNEL, NOT_COMPRESSED = 5, 2, 2, 0


def judge_uimage(data: bytes, limits: Limits, in_flash: bool) -> str:
    """The kernel's version, from the image's name. Raises Refused."""
    if len(data) < UIMAGE_HEADER.size:
        raise Refused("it is cut off in the header")
    magic, header_crc, time, size, load, entry, data_crc, *kind, name = UIMAGE_HEADER.unpack_from(data)
    bare = UIMAGE_HEADER.pack(magic, 0, time, size, load, entry, data_crc, *kind, name)
    payload = data[UIMAGE_HEADER.size :]
    if crc32(bare) != header_crc:
        raise Refused("its header does not match the header's CRC")
    if len(payload) != size:
        raise Refused(f"it holds {len(payload)} bytes, and its header says {size}")
    if crc32(payload) != data_crc:
        raise Refused("what it holds does not match its CRC")
    if kind != [LINUX, ARM, KERNEL, NOT_COMPRESSED]:
        raise Refused(
            f"it is not an uncompressed Linux kernel for ARM (system, processor, type, compression {kind})"
        )
    if (load, entry) != (limits.entry, limits.entry):
        raise Refused(
            f"it is made to run at {load:#x}, entry {entry:#x}; the board runs it at {limits.entry:#x}"
        )
    if in_flash:
        _refuse_above(
            len(data), limits.kernel_part.room, "the boot command reads that much, less the reserve"
        )
    else:
        _refuse_above(len(data), limits.memory_room, f"the device tree is loaded at {limits.device_tree:#x}")
    return name.rstrip(b"\0").decode("ascii", "replace")


def _refuse_above(size: int, room: int, why: str) -> None:
    if size > room:
        raise Refused(f"it has {size} bytes, {size - room} more than the {room} there are ({why})")


# ---- the device tree -----------------------------------------------------------------------------

DTB_MAGIC = bytes.fromhex("d00dfeed")
DTB_HEADER = struct.Struct(">10I")  # Devicetree Specification v0.4, 5.2
DTB_VERSION = 17
BEGIN_NODE, END_NODE, PROPERTY, NOTHING, END = 1, 2, 3, 4, 9
SOC = b"nuvoton,nuc980"


def properties(data: bytes) -> Iterator[tuple[str, str, bytes]]:
    """Node path, name and value of each property of a DTB. Raises Refused for what is none."""
    try:
        _, total, struct_at, strings_at, _, version, _, _, strings_size, struct_size = DTB_HEADER.unpack_from(
            data
        )
        if version != DTB_VERSION or total != len(data):
            raise Refused(f"its header says version {version}, {total} bytes; it has {len(data)}")
        words, strings = data[struct_at:][:struct_size], data[strings_at:][:strings_size]
        yield from _walk(words, strings)
    except (struct.error, ValueError, IndexError) as error:
        raise Refused(f"it is not a complete device tree: {error}") from error


def _walk(words: bytes, strings: bytes) -> Iterator[tuple[str, str, bytes]]:
    def text(of: bytes, at: int) -> str:
        return of[at : of.index(b"\0", at)].decode("ascii")

    at, path = 0, []
    while True:
        (token,) = struct.unpack_from(">I", words, at)
        at += 4
        if token == BEGIN_NODE:
            path.append(text(words, at))
            at += (len(path[-1]) + 4) & ~3
        elif token == END_NODE:
            path.pop()
        elif token == PROPERTY:
            length, name = struct.unpack_from(">2I", words, at)
            yield "/".join(path) or "/", text(strings, name), words[at + 8 : at + 8 + length]
            at += 8 + ((length + 3) & ~3)
        elif token == END:
            return
        elif token != NOTHING:
            raise ValueError(f"token {token} at {at - 4}")


def judge_device_tree(data: bytes, limits: Limits, in_flash: bool) -> str:
    """The board's model. Raises Refused."""
    tree = {(node, name): value for node, name, value in properties(data)}
    if SOC not in tree.get(("/", "compatible"), b"").split(b"\0"):
        raise Refused(f"it is for another board: its root is not compatible with {SOC.decode()}")
    if limits.device_tree_part:
        _refuse_above(len(data), limits.device_tree_part.room, "its part of the flash less the reserve")
    if in_flash:
        _judge_partition(tree, limits)
    return tree.get(("/", "model"), b"").rstrip(b"\0").decode("ascii", "replace")


def _judge_partition(tree: dict[tuple[str, str], bytes], limits: Limits) -> None:
    """The kernel finds its root by the partition's label; the rest of the flash is laid out by its place."""
    wanted = struct.pack(">2I", limits.root_part.offset, limits.root_part.size)
    label = limits.root_label.encode() + b"\0"
    labelled = [node for (node, name), value in tree.items() if name == "label" and value == label]
    if not any(tree.get((node, "reg")) == wanted for node in labelled):
        raise Refused(
            f'it has no flash partition "{limits.root_label}" at {limits.root_part.offset:#x} with '
            f"{limits.root_part.size:#x} bytes, where the kernel looks for its root"
        )


# ---- the root file system: UBI -------------------------------------------------------------------

# drivers/mtd/ubi/ubi-media.h: the headers of a block and the records of the volume table. All CRCs start from
# 0xFFFFFFFF and are not inverted at the end.
UBI_MAGIC = b"UBI#"
EC_HEADER = struct.Struct(
    ">4sB3xQ3I32xI"
)  # magic, version, erase counter, VID offset, data offset, sequence, CRC
VID_HEADER = struct.Struct(">4s4BII")  # magic, version, type, copy, compat, volume, block of the volume
VOLUME = struct.Struct(
    ">3I2BH128sB23xI"
)  # reserved blocks, alignment, padding, type, marker, name length, name, …, CRC
VOLUME_TABLE = 0x7FFFEFFF
MOST_VOLUMES = 128
LAYOUT, WEAR_LEVELLING, ATOMIC_CHANGE = 2, 1, 1  # blocks that UBI takes for itself


def judge_ubi(data: bytes, limits: Limits) -> str:
    """The names of the volumes. Raises Refused."""
    blocks = [data[at : at + limits.block] for at in range(0, len(data), limits.block)]
    for number, block in enumerate(blocks):
        _judge_block(number, block, limits)
    volumes = _volumes(blocks)
    _refuse_above(
        sum(volumes.values()) + LAYOUT + WEAR_LEVELLING + ATOMIC_CHANGE,
        limits.root_part.room // limits.block,
        "blocks of the partition less the reserve: UBI would not attach it",
    )
    return ", ".join(volumes)


def _judge_block(number: int, block: bytes, limits: Limits) -> None:
    if len(block) != limits.block:
        raise Refused(f"it ends within a block of {limits.block} bytes: made for another flash, or cut off")
    if not _has_header(block, 0):
        raise Refused(f"block {number} has no UBI header: made for larger blocks, or damaged")
    if any(_has_header(block, at) for at in range(limits.page, limits.block, limits.page)):
        raise Refused(f"block {number} has a second UBI header: made for smaller blocks")
    if (vid := EC_HEADER.unpack_from(block)[3]) % limits.page:
        raise Refused(
            f"its volume headers are at {vid}, within a page: the controller writes {limits.page} bytes"
        )


def _has_header(block: bytes, at: int) -> bool:
    if not block.startswith(UBI_MAGIC, at):
        return False
    header = block[at : at + EC_HEADER.size]
    return ubi_crc(header[:-4]) == int.from_bytes(header[-4:], "big")


def _volumes(blocks: Sequence[bytes]) -> dict[str, int]:
    """Blocks reserved for each volume, by name."""
    for block in blocks:
        _, _, _, vid, start, _, _ = EC_HEADER.unpack_from(block)
        if block[vid : vid + 4] == b"UBI!" and VID_HEADER.unpack_from(block, vid)[5] == VOLUME_TABLE:
            table = block[start : start + MOST_VOLUMES * VOLUME.size]
            break
    else:
        raise Refused("it has no volume table")
    if len(table) < MOST_VOLUMES * VOLUME.size:
        raise Refused("its volume table is cut off")
    found = {}
    for at in range(0, len(table), VOLUME.size):
        reserved, _, _, _, _, length, name, _, crc = VOLUME.unpack_from(table, at)
        if ubi_crc(table[at : at + VOLUME.size - 4]) != crc:
            raise Refused("its volume table is damaged")
        if reserved:
            found[name[:length].decode("utf-8", "replace")] = reserved
    return found


def ubi_crc(data: bytes) -> int:
    return crc32(data) ^ 0xFFFFFFFF


# ---- all of an image -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Judged:
    """A file of the images' folder: its row in the manifest, and why it is refused, if it is."""

    row: dict[str, str | int]
    refusal: str | None = None


def judge(file: Path, name: str, limits: Limits, in_flash: bool) -> Judged:
    data = file.read_bytes()
    row: dict[str, str | int] = {"name": name, "size": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    judges: dict[bytes, tuple[str, Callable[[], str]]] = {
        UIMAGE_MAGIC: ("kernel", lambda: judge_uimage(data, limits, in_flash)),
        DTB_MAGIC: ("device-tree", lambda: judge_device_tree(data, limits, in_flash)),
        UBI_MAGIC: ("ubi", lambda: judge_ubi(data, limits)),
    }
    if data[:4] not in judges:
        return Judged(row)
    row["kind"], examine = judges[data[:4]]
    try:
        return Judged(row | {"what": examine()})
    except Refused as refusal:
        return Judged(row, f"{name} ({row['kind']}): {refusal}")


def missing(judged: Sequence[Judged], in_flash: bool) -> list[str]:
    """What an image must have and this one has not."""
    kinds = {each.row.get("kind") for each in judged}
    wanted = {"kernel": "uImage", "device-tree": "device tree"} | ({"ubi": "UBI image"} if in_flash else {})
    return [
        f"there is no {name}: no file begins like one" for kind, name in wanted.items() if kind not in kinds
    ]


def read_config(file: Path) -> dict[str, str]:
    """Symbol and value, unquoted, of a .config."""
    rows = re.findall(r"^(BR2_\w+)=(.*)$", read_text(file), re.MULTILINE)
    if not rows:
        raise UnusableInput(f"{file} sets no BR2_ symbol; name the .config of Buildroot's output folder")
    return {name: value.strip('"') for name, value in rows}


def read_text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise UnusableInput(f"{file}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise UnusableInput(f"{file} is not text: {error}") from error


def buildroot_version(os_release: Path) -> str:
    found = re.search(r"^VERSION=\"?([^\"\n]*)\"?$", read_text(os_release), re.MULTILINE)
    if found is None:
        raise UnusableInput(f"{os_release} has no VERSION; name the target folder that Buildroot filled")
    return found[1]


def image_version(os_release: Path) -> str | None:
    """What post-build.sh has written there; None if nothing."""
    if not os_release.exists():
        return None
    found = re.search(r"^IMAGE_VERSION=(\S+)$", read_text(os_release), re.MULTILINE)
    return found[1] if found else None


def pinned_commit(version: str) -> str | None:
    """The commit that configs/kas.yml pins, if Buildroot's version is its tag or names it; else None."""
    pinned = read_text(ROOT / "configs" / "kas.yml")
    tag, commit = (
        re.search(rf"^\s*{key}: *[\"']?([\w.-]+)", pinned, re.MULTILINE) for key in ("tag", "commit")
    )
    named = re.search(r"-g([0-9a-f]{7,})$", version)  # what setlocalversion adds in a clone without tags
    if not (tag and commit) or not (version == tag[1] or (named and commit[1].startswith(named[1]))):
        return None
    return commit[1]


def commit_of_tree() -> str | None:
    """Of OpenRTU, with "-dirty" when files differ; None for a tree without git."""
    git = ["git", "-c", "safe.directory=*", "-C", str(ROOT)]
    describe = [*git, "describe", "--always", "--exclude=*", "--abbrev=40", "--dirty"]
    try:
        return subprocess.run(describe, check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None


def openrtu() -> dict[str, str | None]:
    """Version and commit of this tree."""
    version = read_text(ROOT / "package" / "openrtu" / "src" / "VERSION").strip()
    return {"version": version, "commit": commit_of_tree()}


def sources_of_buildroot(config: dict[str, str], os_release: Path) -> dict[str, dict[str, str | None]]:
    """Where all of it comes from. The version of a package: the SBOM has them."""
    version = buildroot_version(os_release)
    return {
        "buildroot": {"version": version, "commit": pinned_commit(version)},
        **(sources_of_debian(OFFLINE / "versions") if is_offline(config) else sources_of_upstream(config)),
        "toolchain": {
            "gcc": config.get("BR2_TOOLCHAIN_GCC_AT_LEAST"),
            "headers": config.get("BR2_TOOLCHAIN_HEADERS_AT_LEAST"),
        },
    }


def is_offline(config: dict[str, str]) -> bool:
    """Made from Debian's sources: `make image-offline`."""
    return config.get("BR2_PACKAGE_OVERRIDE_FILE", "").endswith("/build/offline/overrides.mk")


def sources_of_upstream(config: dict[str, str]) -> dict[str, dict[str, str | None]]:
    linux = "BR2_LINUX_KERNEL"
    return {
        "openrtu": openrtu(),
        "linux": {
            "version": config.get(f"{linux}_VERSION"),
            "repository": config.get(f"{linux}_CUSTOM_REPO_URL"),
            "commit": config.get(f"{linux}_CUSTOM_REPO_VERSION"),
            "patch": config.get(f"{linux}_PATCH"),
        },
    }


def sources_of_debian(versions: Path) -> dict[str, dict[str, str | None]]:
    """From a line for each of Debian's packages: name, version."""
    rows = re.findall(r"^(\S+) (\S+)$", read_text(versions), re.MULTILINE)
    if not rows:
        raise UnusableInput(f"{versions} names no package; each line is a name and a version")
    return {"openrtu": openrtu(), "debian": dict(sorted(rows))}


@dataclass(frozen=True)
class Origin:
    """What an image was made by: the configuration's name, where its root is, its sources."""

    configuration: str
    version: str | None  # what it says itself, /etc/os-release: with a number where it takes updates
    modules: list[str]  # the programs that its gateway has
    in_flash: bool
    sources: dict[str, dict[str, str | None]]


def origin_of(arguments: argparse.Namespace) -> Origin:
    target = arguments.target or arguments.images.resolve().parent / "target"
    version = image_version(target / "etc" / "os-release")
    modules = list(programs_of(target))
    if arguments.versions:
        return Origin("system", version, modules, False, sources_of_debian(arguments.versions))
    config = read_config(arguments.config)
    return Origin(
        Path(config.get("BR2_DEFCONFIG", "")).name,
        version,
        modules,
        config.get("BR2_TARGET_ROOTFS_INITRAMFS") != "y",
        sources_of_buildroot(config, target / "etc" / "os-release"),
    )


def run(arguments: argparse.Namespace) -> int:
    limits = read_limits(arguments.limits)
    arguments.out.unlink(missing_ok=True)
    origin = origin_of(arguments)
    in_flash = origin.in_flash
    files = sorted(file for file in arguments.images.rglob("*") if file.is_file())
    judged = [judge(file, str(file.relative_to(arguments.images)), limits, in_flash) for file in files]
    refusals = [each.refusal for each in judged if each.refusal] + missing(judged, in_flash)
    for refusal in refusals:
        print(f"manifest: refused: {refusal}", file=sys.stderr)
    if refusals:
        print(
            'manifest: the board could not boot this; docs/image-buildroot.md, "Sizes", says what to do',
            file=sys.stderr,
        )
        return REFUSED
    manifest = {
        "configuration": origin.configuration,
        "version": origin.version,
        "modules": origin.modules,
        "boots-from": "flash" if in_flash else "network",
        "sources": origin.sources,
        "files": [each.row for each in judged],
    }
    arguments.out.write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    return DONE


def main(words: Sequence[str] | None = None) -> int:
    """0 the manifest is written, 1 refused, 2 unusable."""
    parser = argparse.ArgumentParser(prog="manifest", description="Judge an image, write its manifest.")
    parser.add_argument("--images", type=Path, required=True, metavar="DIR", help="the images' folder")
    made = parser.add_mutually_exclusive_group(required=True)
    made.add_argument("--config", type=Path, metavar="FILE", help="Buildroot's .config it was made from")
    made.add_argument("--versions", type=Path, metavar="FILE", help="Debian's packages it was made from")
    parser.add_argument(
        "--limits", type=Path, required=True, metavar="FILE", help="board/…/image-limits.toml"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the manifest (JSON)")
    parser.add_argument(
        "--target",
        type=Path,
        metavar="DIR",
        help="the root file system, as a folder (Buildroot's target, beside the images, if not named)",
    )
    arguments = parser.parse_args(words)
    try:
        return run(arguments)
    except UnusableInput as error:
        print(f"manifest: {error}", file=sys.stderr)
    except OSError as error:
        print(f"manifest: {error.filename}: {error.strerror}", file=sys.stderr)
    return UNUSABLE


if __name__ == "__main__":
    sys.exit(main())
