# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests of nuc980-netboot share: the payload that is booted, emulated boards on a pty."""

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import libfdt
import pytest

from netboot.emulated import Emulated
from netboot.flashbench import uimage
from netboot.ports import free_port

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


@pytest.fixture
def emulated(tmp_path: Path) -> Iterator[Callable[..., Emulated]]:
    """Starts machines, by their command; they end with the test."""
    machines: list[Emulated] = []

    def start(*command: str | Path) -> Emulated:
        folder = tmp_path / f"machine{len(machines)}"
        folder.mkdir()
        machines.append(Emulated(command, folder))
        return machines[-1]

    yield start
    for machine in machines:
        machine.close()


NICS = [part for n in (0, 1) for part in ("-nic", f"user,id=net{n},net=10.0.{n}.0/24")]


@pytest.fixture
def twin(emulated: Callable[..., Emulated], qemu: Path, uboot: Path) -> Emulated:
    """The board with our U-Boot, and a network at each port: the host is 10.0.N.2 in both."""
    return emulated(qemu, "-M", "nuc980", "-bios", uboot, *NICS)


@pytest.fixture(scope="session")
def hasty_uboot(uboot: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Our U-Boot, which takes the console's pins away without flush(), as the vendor's does."""
    names = subprocess.run(
        ["arm-linux-gnueabi-nm", uboot.with_suffix("")], check=True, capture_output=True, text=True
    ).stdout
    address = dict(line.split()[::-2] for line in names.splitlines())
    at = int(address["flush"], 16) - int(address["_start"], 16)
    code = bytearray(uboot.read_bytes())
    code[at : at + 4] = bytes.fromhex("1eff2fe1")  # bx lr
    file = tmp_path_factory.mktemp("hasty") / "u-boot.bin"
    file.write_bytes(code)
    return file


@pytest.fixture
def hasty_twin(emulated: Callable[..., Emulated], qemu: Path, hasty_uboot: Path) -> Emulated:
    """The twin with that one. Its time is counted in instructions: no busy host lets the line get ahead."""
    return emulated(qemu, "-M", "nuc980", "-icount", "shift=3", "-bios", hasty_uboot, *NICS)


@pytest.fixture(scope="session")
def payload(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the payload, built: uImage for the board, uImage-virt for QEMU's machine virt."""
    folder = tmp_path_factory.mktemp("payload")
    done = subprocess.run(
        ["make", "-s", "-f", HERE / "payload/Makefile", f"O={folder}"], capture_output=True, text=True
    )
    if done.returncode:
        pytest.fail(f"the payload does not build:\n{done.stderr}", pytrace=False)
    return folder


@pytest.fixture(scope="session")
def dtb(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The board's device tree, compiled."""
    file = tmp_path_factory.mktemp("dtb") / "nuc980-gateway.dtb"
    source = ROOT / "dts/nuvoton/nuc980-gateway.dts"
    subprocess.run([ROOT / "scripts/build-dtb.sh", source, file], check=True, capture_output=True)
    return file


@pytest.fixture
def udp_port() -> int:
    """One that is free."""
    return free_port()


@pytest.fixture
def wrapped(tmp_path: Path) -> Callable[..., Path]:
    """Makes uImages of any bytes, by mkimage: like the board's kernel but for what is said otherwise."""

    def make(body: bytes, **otherwise: str) -> Path:
        kind = {
            "A": "arm",
            "O": "linux",
            "T": "kernel",
            "C": "none",
            "a": "0x8000",
            "e": "0x8000",
            "n": "Linux",
        }
        options = [word for name, value in {**kind, **otherwise}.items() for word in (f"-{name}", value)]
        (tmp_path / "body").write_bytes(body)
        file = tmp_path / "wrapped"
        subprocess.run(["mkimage", *options, "-d", tmp_path / "body", file], check=True, capture_output=True)
        return file

    return make


@pytest.fixture
def images(tmp_path: Path) -> list[str]:
    """A kernel and a device tree for a double."""
    kernel, tree = tmp_path / "uImage", tmp_path / "board.dtb"
    kernel.write_bytes(uimage(200_000, seed=1))
    own = libfdt.Fdt.create_empty_tree(4096)
    own.setprop_str(0, "compatible", "nuvoton,nuc980")
    own.setprop_str(own.add_subnode(0, "chosen"), "bootargs", "console=ttyS0,115200n8 mem=64M")
    own.pack()
    tree.write_bytes(own.as_bytearray())
    return [str(kernel), str(tree)]


@pytest.fixture
def site(tmp_path: Path) -> Path:
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "macs").write_text("eth0 02:00:00:00:00:01\neth1 02:00:00:00:00:02\n")
    (folder / "board-ip").write_text("192.168.1.20/24\n")
    return folder
