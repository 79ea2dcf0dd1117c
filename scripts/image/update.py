# SPDX-License-Identifier: GPL-3.0-or-later
"""
update.py: a signed update file for boards with two slots, of an image with its root inside the kernel or as
rootfs.ubifs beside it: what `rtu-update install` takes. SWUpdate's format: a cpio archive of its description,
the CMS signature of that, and the files. The same image and an RSA key give the same bytes. Exit codes: 0
done, 2 unusable input.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from image.cpio import Entry, archive
from nuc980.errors import UnusableInput
from nuc980.netboot.limits import ROOT_VOLUME
from nuc980.netboot.slots.command import wrapped
from nuc980.netboot.slots.layout import NAMES, PLACES, root_volume

ROOT = Path(__file__).resolve().parents[2]
DATA_FORMAT = ROOT / "board" / "nuc980" / "rootfs-overlay" / "usr" / "share" / "openrtu" / "data-format"
SCRIPT = Path(__file__).with_name("update-script.sh")
BOARD = "nuc980-gateway"
# What SWUpdate compares versions by: up to four numbers, or three and a candidate (release/version.py).
VERSION = re.compile(r"\d+(\.\d+){0,3}|\d+\.\d+\.\d+-rc(\.\d+)+")
NUMBERED = re.compile(r"\d+\.\d+\.\d+(-rc\.\d+)?\.\d+")  # the last of them is the build's
SITE = re.compile(r"[A-Za-z0-9._-]+")
# A board has the whole file in memory until it is known to be good: less than rtu-update's WORK_SIZE.
MOST = 19 << 20


@dataclass(frozen=True)
class Signer:
    """Who signs: a private key, and its certificate, which the board must have in update.pem."""

    key: Path
    certificate: Path

    def sign(self, content: bytes) -> bytes:
        """A detached CMS signature, DER. No time is in it. Raises UnusableInput."""
        self._check_purpose()
        with tempfile.NamedTemporaryFile() as file:
            file.write(content)
            file.flush()
            return self._openssl(
                "cms", "-sign", "-binary", "-noattr", "-outform", "DER", "-md", "sha256",
                "-in", file.name, "-signer", str(self.certificate), "-inkey", str(self.key),
            )  # fmt: skip

    def _check_purpose(self) -> None:
        shown = self._openssl("x509", "-noout", "-in", str(self.certificate), "-ext", "extendedKeyUsage")
        if b"Code Signing" not in shown:
            raise UnusableInput(
                f"{self.certificate} is not for signing code: no board takes it",
                next_step="make it with -addext extendedKeyUsage=codeSigning (docs/update.md)",
            )

    def _openssl(self, *words: str) -> bytes:
        done = subprocess.run(["openssl", *words], stdin=subprocess.DEVNULL, capture_output=True)
        if done.returncode:
            why = done.stderr.decode(errors="replace").strip().partition("\n")[0]
            raise UnusableInput(
                f"openssl cannot use {self.certificate} with {self.key}: {why}",
                next_step="name the key and the certificate that was made of it",
            )
        return done.stdout


def data_format(what: str) -> int:
    """The format of /data that this tree's image `writes`, or the newest that it `reads`."""
    found = re.search(rf"^{what}=(\d+)$", DATA_FORMAT.read_text(encoding="utf-8"), re.MULTILINE)
    assert found, DATA_FORMAT
    return int(found[1])


def update_file(
    kernel: bytes,
    tree: bytes,
    version: str,
    site: str,
    signer: Signer,
    board: str = BOARD,
    writes: int | None = None,
    root: bytes | None = None,
) -> bytes:
    """
    A signed update for a site's boards. tree: as it was compiled. writes: the format in which that version
    keeps /data [this tree's]. root: a UBIFS image, where it is not inside the kernel. Raises UnusableInput.
    """
    files = {} if root is None else {"root": root}
    files |= {
        "kernel": kernel,
        "tree": wrapped(tree, root_in_ubi=root is not None),
        "check": SCRIPT.read_bytes(),
    }
    _check(files, version, site)
    writes = data_format("writes") if writes is None else writes
    described = _description(files, version, board, site, writes).encode()
    signed = {"sw-description": described, "sw-description.sig": signer.sign(described)}
    return archive(Entry.file(name, content) for name, content in (signed | files).items())


def _check(files: dict[str, bytes], version: str, site: str) -> None:
    places = PLACES[NAMES[0]]
    for name, area in (("kernel", places.kernel), ("tree", places.device_tree)):
        if len(files[name]) > area.room:
            raise UnusableInput(f"The {name} has {len(files[name])} bytes; a slot takes {area.room}")
    if (size := sum(map(len, files.values()))) > MOST:
        raise UnusableInput(f"The update has {size} bytes; a board's memory takes {MOST}")
    if not VERSION.fullmatch(version):
        raise UnusableInput(f"{version!r} is no version for boards: up to four numbers, or as 1.0.0-rc.1")
    if not SITE.fullmatch(site):
        raise UnusableInput(f"{site!r} is no name of a site: letters, digits, '.', '_' and '-'")


def _description(files: dict[str, bytes], version: str, board: str, site: str, writes: int) -> str:
    """SWUpdate's sw-description: the same files for either slot; the board chooses. The tree is the last."""
    sums = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}

    def facts(*names: str) -> str:
        return " ".join(f"{len(files[name])} {sums[name]}" for name in names)

    def part(kind: str, name: str, what: str) -> str:
        return f'{{ filename = "{name}"; sha256 = "{sums[name]}"; type = "{kind}"; {what}; }}'

    def slot(name: str) -> str:
        images = [part("flash", each, f'mtdname = "{each}-{name}"') for each in ("kernel", "tree")]
        words, volumes = f"{name} {facts('kernel', 'tree')} {writes}", ""
        if "root" in files:
            volume = root_volume(name)
            images.insert(0, part("ubivol", "root", f'volume = "{volume}"'))
            words += f" {facts('root')} {ROOT_VOLUME}"
            volumes = f'partitions: ( {{ name = "{volume}"; device = "rootfs"; size = {ROOT_VOLUME}; }} ); '
        script = part("shellscript", "check", f'data = "{words}"')
        return f"{name}: {{ {volumes}images: ( {', '.join(images)} ); scripts: ( {script} ); }};"

    return f"""software = {{
    version = "{version}";
    {board} = {{
        hardware-compatibility: [ "{site}" ];
        slots: {{
            {slot("a")}
            {slot("b")}
        }};
    }};
}};
"""


def image_of(folder: Path, board: str) -> tuple[dict[str, bytes], str]:
    """
    The files of an image, and its own version, of manifest.json: boards compare by that what they run with
    what comes. Raises UnusableInput, OSError.
    """
    again = "make image-debian or make image-buildroot, with SITE= a folder that has update.pem"
    manifest = folder / "manifest.json"
    try:
        stated = json.loads(manifest.read_text(encoding="utf-8"))
        sums = {row["name"]: row["sha256"] for row in stated["files"]}
        version = stated["version"] or ""
    except (ValueError, KeyError, TypeError) as error:
        raise UnusableInput(f"{manifest} is no manifest of an image: {error!r}", next_step=again) from error
    if not NUMBERED.fullmatch(version):
        raise UnusableInput(f"{folder}: the image has version {version!r}, without a number", next_step=again)
    names = {"uImage": "kernel", f"{board}.dtb": "tree", "rootfs.ubifs": "root"}
    files = {what: (folder / name).read_bytes() for name, what in names.items() if what != "root"}
    if (folder / "rootfs.ubifs").exists():
        files["root"] = (folder / "rootfs.ubifs").read_bytes()
    for name, what in names.items():
        if what in files and hashlib.sha256(files[what]).hexdigest() != sums.get(name):
            raise UnusableInput(f"{folder / name} is not what {manifest} describes", next_step=again)
    return files, version


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="update", description="Make a signed update of an image.")
    parser.add_argument(
        "images",
        type=Path,
        help="the folder with uImage, BOARD.dtb and, if it is not inside, rootfs.ubifs",
    )
    parser.add_argument("--key", type=Path, required=True, help="the private key that signs (PEM)")
    parser.add_argument(
        "--certificate", type=Path, required=True, help="its certificate, which the boards have"
    )
    parser.add_argument("--board", default=BOARD, help=f"whose image it is [{BOARD}]")
    parser.add_argument("--site", required=True, help="the site's name: that of its folder")
    parser.add_argument("--out", type=Path, required=True, help="the file")
    given = parser.parse_args(words)
    try:
        files, version = image_of(given.images, given.board)
        signer = Signer(given.key, given.certificate)
        content = update_file(
            files["kernel"], files["tree"], version, given.site, signer, given.board, root=files.get("root")
        )
        given.out.write_bytes(content)
    except UnusableInput as error:
        print(f"update: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"update: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    print(f"{given.out}: version {version}, {len(content)} bytes, for the site {given.site}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
