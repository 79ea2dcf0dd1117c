# SPDX-License-Identifier: GPL-3.0-or-later
"""`nuc980-netboot boot` with a U-Boot that nobody here wrote: Debian's, on QEMU's machine virt, at port 69.

QEMU and the tool run in a network of their own, where an unprivileged user may have that port.
"""

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from netboot.emulated import Emulated

pytestmark = pytest.mark.slow

UBOOT = Path("/usr/lib/u-boot/qemu_arm/u-boot.bin")
IN_NETWORK = ("unshare", "--user", "--map-root-user", "--net")
Boot = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def virt(emulated: Callable[..., Emulated]) -> Emulated:
    """The host is 10.9.0.1 on a wire to the board. The RAM starts at 0x40000000; there is no flash."""
    if subprocess.run([*IN_NETWORK, "true"], capture_output=True).returncode:
        pytest.skip("needs a network of its own: the host beside the board")
    wire = "tap,ifname=board,script=no,downscript=no,model=virtio-net-pci"
    machine = emulated(
        *IN_NETWORK, "qemu-system-arm", "-M", "virt", "-m", "128", "-bios", UBOOT, "-nic", wire
    )
    machine.prefix = ("nsenter", "-t", str(machine.process.pid), "-U", "-n", "--preserve-credentials")
    for words in ("address add 10.9.0.1/24 dev board", "link set board up"):
        subprocess.run([*machine.prefix, "ip", *words.split()], check=True)
    return machine


@pytest.fixture(scope="module")
def virt_tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The machine's own device tree."""
    file = tmp_path_factory.mktemp("virt") / "virt.dtb"
    machine = f"virt,dumpdtb={file}"
    subprocess.run(
        ["qemu-system-arm", "-M", machine, "-m", "128", "-display", "none"], check=True, capture_output=True
    )
    return file


@pytest.fixture
def boot(virt: Emulated, payload: Path, virt_tree: Path, tmp_path: Path) -> Boot:
    def run(
        *arguments: str | Path, kernel: Path = payload / "uImage-virt"
    ) -> subprocess.CompletedProcess[str]:
        return virt.netboot(
            *("boot", kernel, virt_tree, "--power-cycle", virt.power_cycle),
            *("--board-ip", "10.9.0.15/24", "--site", tmp_path / "site", *arguments),
        )

    return run


def test_kernel_comes_up(boot: Boot, tmp_path: Path) -> None:
    done = boot()
    assert done.returncode == 0, done.stdout
    macs = dict(line.split() for line in (tmp_path / "site/macs").read_text().splitlines())
    assert f"Kernel command line: ethaddr0={macs['eth0']} ethaddr1={macs['eth1']}" in done.stdout
    assert "to 0x40007fc0" in done.stdout


def test_large_kernel_comes_through_whole(boot: Boot, payload: Path, wrapped: Callable[..., Path]) -> None:
    body = (payload / "virt.bin").read_bytes().ljust(9_000_000, b"\x5a")
    done = boot(kernel=wrapped(body, a="0x40008000", e="0x40008000"))
    assert done.returncode == 0, done.stdout
    assert "Load uImage, 9000064 bytes" in done.stdout


def test_kernel_for_the_board_is_refused_here(boot: Boot, payload: Path) -> None:
    done = boot(kernel=payload / "uImage")
    assert done.returncode == 2
    assert "made to run at 0x8000" in done.stdout
    assert "mkimage -a 0x40008000" in done.stdout
    assert not re.search("^Load ", done.stdout, re.MULTILINE)


def test_host_without_an_address_there(boot: Boot) -> None:
    done = boot("--board-ip", "10.10.0.15/24")
    assert done.returncode == 2
    assert "sudo ip address add 10.10.0." in done.stdout


def test_uboot_that_keeps_its_own_address_says_so(boot: Boot, tmp_path: Path) -> None:
    """Without CONFIG_ENV_OVERWRITE it lets nobody change it."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site/macs").write_text("eth0 02:00:00:00:00:01\neth1 02:00:00:00:00:02\n")
    done = boot()
    assert done.returncode == 1
    assert """Can't overwrite "ethaddr\"""" in done.stdout
