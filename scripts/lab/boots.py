# SPDX-License-Identifier: GPL-3.0-or-later
"""An image's way onto the emulated board: over its network, or into its flash and from there by itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lab.board import ETHERNET, netboot
from lab.show import NotSeenError
from nuc980.netboot import cli
from nuc980.netboot.progress import Progress
from nuc980.netboot.target import Linux
from nuc980.netboot.transport import Line
from nuc980.twin.machine import Machine
from nuc980.twin.nand import NandImage
from nuc980.twin.network import free_udp_port

BOOT_SECONDS = 300.0
LOG_IN = r"^(\S+ login:)"


@dataclass(frozen=True)
class Image:
    """What was built, in its folder or in the folder images of that."""

    folder: Path

    @property
    def images(self) -> Path:
        inner = self.folder / "images"
        return inner if inner.is_dir() else self.folder

    @property
    def uimage(self) -> Path:
        return self.images / "uImage"

    @property
    def dtb(self) -> Path:
        return self.images / "nuc980-gateway.dtb"

    @property
    def ubi(self) -> Path:
        """Only where the root is in the flash."""
        return self.images / "rootfs.ubi"

    def missing(self) -> Path | None:
        return next((file for file in (self.uimage, self.dtb) if not file.exists()), None)

    def install(self, machine: Machine, directory: Path) -> None:
        """Into the flash, as one does with a board. Raises NotSeenError."""
        code = cli.main(
            ["flash", "--kernel", str(self.uimage), "--dtb", str(self.dtb), "--ubi", str(self.ubi),
             "--no-backup", "the flash is empty", "--site", str(directory / "site"),
             "--port", machine.pty(0), "--board-ip", ETHERNET[0].board, "--server-ip", ETHERNET[0].host,
             "--listen", "127.0.0.1", "--seen-as", "127.0.0.1", "--tftp-port", str(free_udp_port())]
        )  # fmt: skip
        if code:
            raise NotSeenError(
                f"nuc980-netboot flash ended with {code}; its lines are above",
                expected="the image in the flash",
            )

    def boot(self, machine: Machine, directory: Path, progress: Progress) -> None:
        """To the log-in, once it is installed. Raises NetbootError."""
        if self.ubi.exists():
            boot_from_flash(machine)
        else:
            netboot(machine, directory, self.uimage, self.dtb, progress)


def flash_for(image: Image, qemu: Path, uboot: Path, directory: Path) -> list[str]:
    """QEMU's arguments for a flash, with the image in it if that is its place. Raises NotSeenError.

    The machine that wrote it is switched off again. The vendor's kernel needs a flash, wherever its root is.
    """
    flash = ["-drive", f"if=mtd,format=raw,file={NandImage.blank(directory / 'nand.img').path}"]
    if image.ubi.exists():
        arguments = ["-bios", uboot, *ETHERNET[0].arguments({}), *flash]
        with Machine(qemu, *arguments, uarts=(), chardevs={0: "pty"}) as machine:
            image.install(machine, directory)
    return flash


def boot_from_flash(machine: Machine) -> None:
    """As a board does by itself: by its own boot command. Raises NetbootError."""
    with Line(machine.pty(0)) as line:
        machine.command("system_reset")
        Linux(line).expect(LOG_IN, BOOT_SECONDS)
