# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests of updates share: who signs, small images, a board that takes updates, its flash."""

import json
import re
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from image import update
from lab.board import SILENCE_US, Ssh, configuration
from lab.linesim import LineSim
from lab.site import make_certificate
from netboot.flashbench import at_prompt, options, switched_on
from netboot.ports import free_port
from netboot.test_slots_twin import QUICKER
from nuc980.netboot.cli import main
from nuc980.netboot.environment import read_environment
from nuc980.netboot.limits import BLOCK
from nuc980.netboot.plan import SetVariable
from nuc980.netboot.slots.layout import Area
from nuc980.twin.nand import DATA, PAGES, NandImage
from release.version import swupdate, tree_version
from rig.desk import CHAPTER_5

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ROOT / "build/root/packages"
LIBRARIES = (
    "usr/lib/arm-linux-gnueabi/libconfig.so.9",
    "usr/lib/arm-linux-gnueabi/libcrypto.so.3",
    "usr/lib/arm-linux-gnueabi/libatomic.so.1",
)
# What an image has that asks a server of updates.
PULL = {
    "usr/bin/curl": ROOT / "build/curl/root/usr/bin/curl",
    "usr/bin/jq": PACKAGES / "usr/bin/jq",
    **{
        f"usr/lib/arm-linux-gnueabi/{name}": PACKAGES / f"usr/lib/arm-linux-gnueabi/{name}"
        for name in ("libjq.so.1", "libonig.so.5", "libssl.so.3")
    },
}
VERSION = swupdate(tree_version())
NEXT = swupdate(tree_version(), 1)
SITE = "station-7"
PATIENCE = 180.0


def wait_for(condition: Callable[[], bool], seconds: float = PATIENCE) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline


def flash_after_install(
    folder: Path,
    qemu: Path,
    uboot: Path,
    kernel: bytes,
    tree: bytes,
    bad: Iterable[int] = (),
    *,
    settings: str = "setenv bootdelay 0",
    quicker: Iterable[tuple[str, str, str]] = QUICKER,
    ubi: Path | None = None,
) -> NandImage:
    """
    Both slots have these, by `nuc980-netboot install`, or A has them and a root in UBI; U-Boot does not wait.
    bad: offsets of blocks. settings: U-Boot's, from before. quicker: what its script then has instead.
    """
    nand = NandImage.blank(folder / "nand")
    for offset in bad:
        nand.mark_bad(offset // BLOCK)
    images = folder / "uImage.small", folder / "dtb.small"
    for image, content in zip(images, (kernel, tree), strict=True):
        image.write_bytes(content)
    with switched_on(qemu, uboot, nand) as board:
        with at_prompt(board) as session:
            session.console.run(f"{settings}; saveenv", 30).required()
        given = [] if ubi is None else ["--ubi", str(ubi)]
        given += options(board, folder / "netboot-site", free_port())
        assert main(["install", *map(str, images), "--no-backup", "a blank flash", *given]) == 0
        with at_prompt(board) as session:
            environment = read_environment(session.console).variables
            for name, long, short in quicker:
                SetVariable(name, environment[name].replace(long, short)).run(session)
            session.console.run("saveenv", 30).required()
    return nand


def ubi_image(root: Path, folder: Path) -> tuple[Path, Path]:
    """A root file system as Buildroot makes it for nuc980_gateway_lts: UBIFS, and all of UBI with it."""
    ubifs, ubi, volumes = folder / "rootfs.ubifs", folder / "rootfs.ubi", folder / "volumes"
    config = (ROOT / "configs/nuc980_gateway_lts_defconfig").read_text()
    block, most = re.findall(r"^BR2_TARGET_ROOTFS_UBIFS_(?:LEBSIZE|MAXLEBCNT)=(\w+)$", config, re.MULTILINE)
    subprocess.run(
        ["mkfs.ubifs", "-r", root, "-m", "2048", "-e", block, "-c", most, "-F", "-U", "-o", ubifs], check=True
    )
    text = (ROOT / "board/nuc980/ubinize.cfg").read_text()
    volumes.write_text(text.replace("BR2_ROOTFS_UBIFS_PATH", str(ubifs)))
    subprocess.run(["ubinize", "-o", ubi, "-m", "2048", "-p", "128KiB", volumes], check=True)
    return ubifs, ubi


def slow_lines() -> dict[str, Any]:
    """The devices' lines as a pty has them."""
    config = configuration()
    for port in config["port"]:
        port.update(baud_rate=9600, parity=0, stop_bits=1)
    return config


@contextmanager
def devices(folder: Path, linesim_program: Path) -> Iterator[LineSim]:
    """At those lines."""
    file = folder / "linesim.json"
    file.write_text(json.dumps(slow_lines()))
    values = CHAPTER_5 / "values.json"
    with LineSim(file, values, folder / "dev", silence_us=SILENCE_US, program=linesim_program) as lines:
        yield lines


def make_signer(folder: Path, name: str) -> update.Signer:
    """A key for this test alone, and its certificate."""
    signer = update.Signer(folder / f"{name}.key", folder / f"{name}.pem")
    make_certificate(signer.key, signer.certificate, name)
    return signer


def files_of(
    site: str, certificates: str, config: dict[str, Any], key: Path, folder: Path
) -> dict[str, Path | str]:
    """What `make image-debian` adds to a root for a site that takes updates."""
    texts = {
        "etc/openrtu/update.pem": certificates,
        "etc/openrtu/gateway.json": json.dumps(config),
        "etc/hwrevision": f"nuc980-gateway {site}\n",
        "root/.ssh/authorized_keys": key.with_suffix(".pub").read_text(),
    }
    files: dict[str, Path | str] = {"usr/bin/swupdate": ROOT / "build/swupdate/root/usr/bin/swupdate"}
    for path, text in texts.items():
        file = folder / path.rpartition("/")[2]
        file.write_text(text)
        file.chmod(0o600 if path.startswith("root") else 0o644)
        files[path] = file
    return files | {path: (PACKAGES / path).resolve() for path in LIBRARIES}


def install(ssh: Ssh, content: bytes, *options: str) -> tuple[int, str]:
    """Streams a file into `rtu-update install`; its exit code and all that it says."""
    done = subprocess.run(
        [*ssh.command, " ".join(("rtu-update install", *options))],
        input=content,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=600,
        check=False,
    )
    return done.returncode, done.stdout.decode()


def held(nand: NandImage, area: Area, size: int) -> bytes:
    """What an area's good blocks hold, one after the other."""
    bad = set(nand.bad_blocks())
    first, count = area.offset // (PAGES * DATA), area.size // (PAGES * DATA)
    pages = (
        nand.read(block * PAGES + page)[:DATA]
        for block in range(first, first + count)
        if block not in bad
        for page in range(PAGES)
    )
    content = bytearray()
    for page in pages:
        content += page
        if len(content) >= size:
            break
    return bytes(content[:size])
