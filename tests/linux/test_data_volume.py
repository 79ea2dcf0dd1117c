# SPDX-License-Identifier: GPL-3.0-or-later
"""/data on the emulated board: in the flash where someone has made its volume, else in memory."""

import dataclasses
import json
import random
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from nuc980.twin.linux import Kernel, Linux
from nuc980.twin.nand import DATA, PAGE, PAGES, NandImage
from rig.desk import chapter_5

BLOCK = PAGES * DATA
PARTITION = "/ahb/fmi@b0019000/partitions/partition@1600000"
OFFSET, SIZE = 0x1600000, 0xC00000  # an eighth of the board's: all of it is read before it is taken
ROOTFS = range(OFFSET // BLOCK, (OFFSET + SIZE) // BLOCK)  # blocks
KEY = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIPO2c5HIsA3Zyex1BKm4ZmTJV0A9U1kR2Tj1kXh5o1xG an engineer"
INTERFACES = """\
auto lo
iface lo inet loopback
auto eth0
iface eth0 inet static
	address 10.11.12.13
	netmask 255.255.255.0
"""
IMAGES_ADDRESS = "172.16.0.50"
CREATE_SECONDS = 300.0
# What the engineer has brought, as settings of the site.
SETTINGS = "/settings"
USE_SETTINGS = f"mkdir -p /data/site; cp {SETTINGS}/* /data/site; sync"

Boot = Callable[..., Linux]
Power = Callable[..., Linux]


@pytest.fixture(scope="module")
def kernel(kernel: Kernel, tmp_path_factory: pytest.TempPathFactory) -> Kernel:
    dtb = shutil.copy(kernel.dtb, tmp_path_factory.mktemp("dtb"))
    subprocess.run(["fdtput", "-t", "x", dtb, PARTITION, "reg", f"{OFFSET:x}", f"{SIZE:x}"], check=True)
    return dataclasses.replace(kernel, dtb=Path(dtb))


@pytest.fixture
def nand(tmp_path: Path) -> NandImage:
    return NandImage.blank(tmp_path / "nand")


@pytest.fixture
def power(boot: Boot, nand: NandImage) -> Power:
    """Starts the board with this flash; settings, by their names, lie there to be used."""

    def on(**settings: str) -> Linux:
        files = {f"{SETTINGS}/{name}": text for name, text in settings.items()}
        return boot(*with_flash(nand), files=files)

    return on


@pytest.fixture(scope="module")
def made(boot: Boot, tmp_path_factory: pytest.TempPathFactory) -> NandImage:
    """A flash with the data volume, made on the board, with what was in /data before."""
    nand = NandImage.blank(tmp_path_factory.mktemp("made") / "nand")
    nand.mark_bad(ROOTFS[1])
    with boot(*with_flash(nand)) as linux:
        linux.run("mkdir -p /data/site; echo kept > /data/note")
        output = linux.run("rtu-data create", CREATE_SECONDS)
        assert "it holds nothing" in output
        assert "1 bad" in output
        linux.run("sync")
    return nand


@pytest.fixture
def with_volume(made: NandImage, nand: NandImage) -> None:
    shutil.copyfile(made.path, nand.path)


def with_flash(nand: NandImage) -> tuple[str, ...]:
    return "-drive", f"if=mtd,format=raw,file={nand.path}"


def rootfs(nand: NandImage) -> bytes:
    """All of the partition, spare bytes included."""
    with nand.path.open("rb") as file:
        file.seek(ROOTFS[0] * PAGES * PAGE)
        return file.read(len(ROOTFS) * PAGES * PAGE)


def where(linux: Linux) -> str:
    return linux.run("cat /run/openrtu/data")


# ---- in memory


def test_without_a_flash(boot: Boot) -> None:
    with boot() as linux:
        assert where(linux).startswith("memory: ")
        assert linux.run("grep ' /data ' /proc/mounts").startswith("tmpfs ")
        assert "in memory, lost at restart" in linux.run("rtu-data status")
        status, output = linux.try_to("rtu-data create")
        assert status == 1
        assert "there is no flash" in output


def test_empty_flash_is_not_touched(power: Power, nand: NandImage) -> None:
    before = rootfs(nand)
    with power() as linux:
        assert where(linux) == "memory: no UBI volume"
        linux.run("echo x > /data/x")
        output = linux.run("rtu-data status")
        assert output.startswith("data: in memory, lost at restart: no UBI volume\n")
        assert "it holds no UBI" in output
        assert "no UBI volume" in linux.run("grep data: /var/log/messages")
    assert rootfs(nand) == before


# ---- what is made, and what is not


def test_volume_is_made_and_used_from_the_next_start_on(power: Power, with_volume: None) -> None:
    with power() as linux:
        assert where(linux) == "flash"
        assert linux.run("grep ' /data ' /proc/mounts").split()[0] == "ubi0:data"
        assert linux.run("cat /data/note") == "kept"
        free = int(linux.run("rtu-data status").splitlines()[0].split()[2])
        assert SIZE / 4 < free << 20 < SIZE
        assert "exists already" in linux.run("rtu-data create")
        linux.run("echo more > /data/more; sync")
    with power() as linux:
        assert linux.run("cat /data/more") == "more"


@pytest.mark.parametrize("block", [ROOTFS[0], ROOTFS[-1]])
def test_what_is_no_ubi_stays(power: Power, nand: NandImage, block: int) -> None:
    """The factory's system may be there, wherever it begins."""
    page = random.Random(block).randbytes(DATA)
    nand.write(block * PAGES + 63, page + b"\xff\xff\0\0")
    before = rootfs(nand)
    with power() as linux:
        assert where(linux) == "memory: no UBI volume"
        for arguments in ("", "--erase rootf", "--erase"):
            status, output = linux.try_to(f"rtu-data create {arguments}", CREATE_SECONDS)
            assert status in (1, 2), output
            assert "--erase rootfs" in output
    assert rootfs(nand) == before


def test_erase_with_the_name_typed_in_full(power: Power, nand: NandImage) -> None:
    for block in (ROOTFS[0], ROOTFS[3], ROOTFS[-1]):
        nand.write(block * PAGES, b"factory" * 100)
    nand.mark_bad(ROOTFS[2])
    with power() as linux:
        output = linux.run("rtu-data create --erase rootfs", CREATE_SECONDS)
        assert "it holds something else" in output
        linux.run("sync")
    with power() as linux:
        assert where(linux) == "flash"


def test_other_volumes_stay(power: Power) -> None:
    with power() as linux:
        linux.run("ubiattach -m 4 /dev/ubi_ctrl; ubimkvol /dev/ubi0 -N rootfs -s 2MiB", 120)
        linux.run(
            "mkdir -p /run/m; mount -t ubifs ubi0:rootfs /run/m; echo 1 > /run/m/file; umount /run/m", 60
        )
    with power() as linux:
        assert where(linux) == "memory: no UBI volume"
        output = linux.run("rtu-data create", 120)
        assert "volume rootfs: " in output
        linux.run("sync")
    with power() as linux:
        assert where(linux) == "flash"
        assert linux.run("mkdir -p /run/m; mount -t ubifs ubi0:rootfs /run/m; cat /run/m/file") == "1"


# ---- settings of the site


def test_settings_of_the_volume_replace_the_images(power: Power, with_volume: None) -> None:
    config = chapter_5()  # whose time-outs are of the host's load now
    settings = {"interfaces": INTERFACES, "authorized_keys": KEY, "config.json": json.dumps(config)}
    with power(**settings) as linux:
        linux.run(USE_SETTINGS)
    with power() as linux:
        assert "10.11.12.13" in linux.run("ip address show eth0")
        assert linux.run("cat /root/.ssh/authorized_keys") == KEY
        assert linux.run("stat -c %a /root/.ssh/authorized_keys") == "600"
        assert json.loads(linux.run("cat /etc/openrtu/gateway.json")) == config
        linux.run("n=0; until rtuctl modules; do n=$((n + 1)); [ $n -lt 30 ]; sleep 1; done", 60)
        last = linux.run("rtuctl modules").splitlines()[-1]
        assert last.startswith("data: flash, ")
        assert last.endswith(" MiB free")


BROKEN = (
    (INTERFACES.replace("address 10.11.12.13", "address 10.11.12.313"), "no address: 10.11.12.313"),
    (INTERFACES.replace("auto eth0", ""), "neither eth0 nor eth1"),
    (INTERFACES.replace("inet static", "inet ecstatic"), "ecstatic"),
    ("garbage\n" + INTERFACES, "garbage"),
)


def test_broken_settings_leave_the_board_in_reach(power: Power, with_volume: None) -> None:
    """Each start judges what was brought before it."""
    settings = {"authorized_keys": "no key", "config.json": '{"port": 1}', "interfaces": BROKEN[0][0]}
    with power(**settings) as linux:
        linux.run(USE_SETTINGS)
    following = [interfaces for interfaces, _ in BROKEN[1:]] + [INTERFACES]
    for (_, why), interfaces in zip(BROKEN, following, strict=True):
        with power(interfaces=interfaces) as linux:
            assert IMAGES_ADDRESS in linux.run("ip address show eth0")
            assert linux.try_to("[ -e /etc/openrtu/gateway.json ]")[0], "a broken configuration is used"
            log = linux.run("grep 'is not used' /var/log/messages")
            for name in ("interfaces", "authorized_keys", "config.json"):
                assert f"/data/site/{name} is not used" in log
            assert why in log
            linux.run(USE_SETTINGS)
