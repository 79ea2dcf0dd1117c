# SPDX-License-Identifier: GPL-3.0-or-later
"""Updates of a board whose root is in UBI: from `nuc980-netboot install --ubi` to the new version.

The image is Buildroot's, of `make test-offline`, or Debian's root with the kernel of `make image-debian`.
That kernel has a root inside, which U-Boot's arguments hide from it: so it has arguments of its own that must
not hold, as a kernel of Buildroot has.
"""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from update_board import (
    NEXT,
    SITE,
    VERSION,
    files_of,
    flash_after_install,
    install,
    make_signer,
    ubi_image,
    wait_for,
)

from image.update import Signer, update_file
from lab.board import ETHERNET, MACS, SSH_PORT, Ssh
from lab.boots import Image
from lab.gateway import free_port
from nuc980.twin.linux import SAME_ADDRESSES
from nuc980.twin.machine import INSTRUCTION_TIME, Machine
from nuc980.twin.nand import NandImage
from rig.desk import chapter_5

TREE = Path(__file__).resolve().parents[2]
SYSTEM = TREE / "build/system"
OFFLINE = Path(os.environ.get("OPENRTU_IMAGE", TREE / "build/nuc980_gateway_lts-offline"))
# U-Boot's own for kernels: here no root inside. Ten seconds between two attempts are too many. QEMU's network
# goes on with the MAC address that it knows, so each start needs the same.
SETTINGS = (
    "setenv bootdelay 0; setenv bootargs console=ttyS0,115200n8 rdinit=/none;"
    f" setenv ethaddr {MACS[0]}; setenv eth1addr {MACS[1]}"
)
QUICKER = (("rtu_root", "panic=10", f"panic=1 {SAME_ADDRESSES}"),)
START_SECONDS = 900.0  # on a busy machine
UPDATING = "until grep -q 1 /sys/class/ubi/ubi0_2/upd_marker; do sleep 0.01; done"


@dataclass(frozen=True)
class SignedImage:
    """What boards get, and who may log in to them and sign their updates."""

    uimage: Path
    tree: Path
    ubifs: Path
    ubi: Path
    site: str
    key: Path
    signer: Signer
    version: str  # as it says itself

    def kernel_and_tree(self) -> tuple[bytes, bytes]:
        return self.uimage.read_bytes(), self.tree.read_bytes()


def debian(folder: Path, key: Path) -> SignedImage:
    """UBIFS and UBI of Debian's root, with what a site adds."""
    signer = make_signer(folder, "present")
    root = folder / "root"
    root.mkdir()
    with (TREE / "build/system.parts/initramfs.cpio").open("rb") as archive:
        subprocess.run(["cpio", "-idf", "--quiet", "dev/*"], stdin=archive, cwd=root, check=True)
    for name, file in files_of(SITE, signer.certificate.read_text(), chapter_5(), key, folder).items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, root / name)
    ubifs, ubi = ubi_image(root, folder)
    return SignedImage(
        SYSTEM / "uImage", SYSTEM / "nuc980-gateway.dtb", ubifs, ubi, SITE, key, signer, VERSION
    )


def offline() -> SignedImage:
    """As Buildroot has made it for the site that takes updates."""
    built, site = Image(OFFLINE), TREE / "build/site"
    if not built.ubi.exists():
        pytest.skip(f"{built.ubi} is not there: make test-offline")
    return SignedImage(
        built.uimage, built.dtb, built.images / "rootfs.ubifs", built.ubi,
        "field", site / "key", Signer(site / "update.key", site / "field/update.pem"),
        json.loads((built.images / "manifest.json").read_text())["version"],
    )  # fmt: skip


@pytest.fixture(scope="module", params=["debian", pytest.param("offline", marks=pytest.mark.soak)])
def image(request: pytest.FixtureRequest, folder: Path, key: Path) -> SignedImage:
    return offline() if request.param == "offline" else debian(folder, key)


@pytest.fixture(scope="module")
def ssh(image: SignedImage, folder: Path) -> Iterator[Ssh]:
    with Ssh(free_port(), image.key, folder) as ssh:
        yield ssh


@pytest.fixture(scope="module")
def nand(folder: Path, qemu: Path, uboot: Path, image: SignedImage) -> NandImage:
    more = {"settings": SETTINGS, "quicker": QUICKER, "ubi": image.ubi}
    return flash_after_install(folder, qemu, uboot, *image.kernel_and_tree(), **more)


class Powered:
    """The board as it starts by itself, by U-Boot."""

    def __init__(self, qemu: Path, uboot: Path, nand: NandImage, ssh: Ssh) -> None:
        drive = ("-drive", f"if=mtd,format=raw,file={nand.path}")
        network = ETHERNET[0].arguments({ssh.port: SSH_PORT})
        self.arguments = (qemu, "-bios", uboot, *network, *drive, *INSTRUCTION_TIME)
        self.ssh = ssh
        self.on()

    def on(self) -> None:
        self.machine = Machine(*self.arguments, options="pace=off")

    def cut(self) -> None:
        self.machine.process.kill()
        self.machine.close()
        self.ssh.close()

    def restart(self) -> None:
        self.ssh.run("(sleep 1; reboot) </dev/null >/dev/null 2>&1 &")
        self.ssh.close()

    def next_start(self) -> str:
        """The slot that U-Boot starts, as `B` on trial and `a` without; its root must be of the slot."""
        self.machine.uarts[0].wait_for(b"Kernel command line: ", START_SECONDS)
        words = self.machine.uarts[0].wait_for(b"\n", START_SECONDS).decode().split()
        holds = words[: words.index("--")]
        slot = next(word[-1] for word in holds if word.startswith("openrtu.slot="))
        assert [word for word in holds if word.startswith("root=")] == [f"root=ubi0:root_{slot}"]
        return slot.upper() if "openrtu.trial" in holds else slot

    def comes_up(self) -> None:
        """Its console is read up to the log-in: it waits for who does not."""
        self.machine.uarts[0].wait_for(b"login:", START_SECONDS)
        wait_for(self.ssh.answers, START_SECONDS)
        self.ssh.run("until pidof rtud; do sleep 0.2; done", START_SECONDS)


@pytest.fixture(scope="module")
def board(qemu: Path, uboot: Path, nand: NandImage, ssh: Ssh) -> Iterator[Powered]:
    board = Powered(qemu, uboot, nand, ssh)
    try:
        assert board.next_start() == "a"
        board.comes_up()
        yield board
    finally:
        board.cut()


@pytest.fixture(scope="module")
def update(image: SignedImage) -> bytes:
    """The same image under a later number."""
    later = NEXT if image.version == VERSION else f"{image.version}0"
    root = image.ubifs.read_bytes()
    return update_file(*image.kernel_and_tree(), later, image.site, image.signer, root=root)


def test_board_after_install(board: Powered, image: SignedImage) -> None:
    """B has nothing yet: an image has one root."""
    assert board.ssh.run("rtu-update status").splitlines() == [
        f"running  A, version {image.version}",
        "root     ubi0:root_a",
        "base     A",
        "trial    none",
        "the next start takes A; if that does not load, B",
    ]
    assert board.ssh.run("rtu-data status").startswith("data: flash, ")


def test_root_that_was_changed_is_refused(board: Powered, update: bytes) -> None:
    at = len(update) // 8  # the root comes first
    changed = update[:at] + bytes([update[at] ^ 1]) + update[at + 1 :]
    code, said = install(board.ssh, changed)
    assert (code, said.partition(": its ")[0]) == (1, "rtu-update: refused, and slot B is as it was")
    assert "not what was signed" in said


@pytest.mark.soak
def test_power_cut_while_the_root_is_written(board: Powered, update: bytes) -> None:
    """B has no tree and is not marked."""
    command = [*board.ssh.command, "rtu-update install"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL) as writes:
        assert writes.stdin
        writes.stdin.write(update)
        writes.stdin.close()
        board.ssh.run(UPDATING, START_SECONDS)
        board.cut()
    board.on()
    assert board.next_start() == "a"
    board.comes_up()
    assert "trial    none" in board.ssh.run("rtu-update status")


@pytest.mark.soak
def test_root_that_does_not_mount(board: Powered, update: bytes) -> None:
    """On trial, as if blocks had gone bad since they were read back: the kernel panics, three times."""
    assert install(board.ssh, update)[0] == 0
    board.ssh.run("head -c 200000 /dev/urandom >/tmp/other && ubiupdatevol /dev/ubi0_2 /tmp/other; sync")
    board.restart()
    assert [board.next_start() for _ in range(4)] == ["B", "B", "B", "a"]
    board.comes_up()


def test_goes_into_the_other_root_and_is_confirmed(board: Powered, image: SignedImage, update: bytes) -> None:
    board.ssh.run("echo kept >/data/note; sync")
    assert install(board.ssh, update) == (
        0,
        "The update is in slot B, read back, and on trial at the next start.\n",
    )
    board.restart()
    assert board.next_start() == "B"
    board.comes_up()
    assert board.ssh.run("rtu-update confirm; rtu-update status; cat /data/note").splitlines() == [
        f"Slot B with version {image.version} is what boots from now on.",
        f"running  B, on trial, version {image.version}",
        "root     ubi0:root_b",
        "base     B",
        "trial    none",
        "the next start takes B; if that does not load, A",
        "kept",
    ]
