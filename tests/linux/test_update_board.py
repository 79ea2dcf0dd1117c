# SPDX-License-Identifier: GPL-3.0-or-later
"""Updates on the emulated board: `rtu-update` on Linux in slot A, then what our U-Boot makes of the flash.

The board has the marks and the environment of `nuc980-netboot install`. Linux itself is started without it,
with the arguments of slot A. What comes as an update are small kernels that only say how they were started.
"""

import subprocess
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from update_board import (
    NEXT,
    PATIENCE,
    PULL,
    SITE,
    VERSION,
    devices,
    files_of,
    flash_after_install,
    held,
    install,
    make_signer,
    slow_lines,
    wait_for,
)

from image.update import Signer, data_format, update_file
from lab.board import ETHERNET, SSH_PORT, Ssh, lines_at
from lab.linesim import LineSim
from netboot.flashbench import copy, uimage
from netboot.test_slots_twin import slots_in, tree_that
from nuc980.netboot.limits import BLOCK
from nuc980.netboot.slots.layout import BASE, PLACES, TRIAL
from nuc980.netboot.slots.marks import TRIAL_WORD, page
from nuc980.netboot.slots.script import partitions
from nuc980.twin.linux import Kernel, Linux
from nuc980.twin.machine import INSTRUCTION_TIME, Machine
from nuc980.twin.nand import DATA, PAGE, PAGES, NandImage
from peers.ddi import Authority, UpdateServer

ROOT = Path(__file__).resolve().parents[2]
PAYLOAD = Path(__file__).parents[1] / "netboot/payload/Makefile"
KERNEL_BYTES = 300_001
OLDER = "1.0.0-rc.0"
ERASED = b"\xff" * PAGE
# What reads the network notes as whom, and with which capabilities.
READER = """#!/bin/sh
sed -n 's/^Uid:\\t//p; s/^CapPrm:\\t//p' /proc/self/status >>/run/readers
exec /usr/bin/{program} "$@"
"""
PULL_USER = "61199"


@pytest.fixture(scope="module")
def small(folder: Path) -> bytes:
    """A kernel that says how it was started, and ends as its tree wants."""
    subprocess.run(["make", "-s", "-f", PAYLOAD, f"O={folder}"], check=True)
    return uimage(KERNEL_BYTES, 1, (folder / "uImage").read_bytes()[64:])


@pytest.fixture(scope="module")
def nand(folder: Path, qemu: Path, uboot: Path, small: bytes) -> NandImage:
    """A flash after `install`, with bad blocks: a mark's first, that of B's tree, too many of B's kernel."""
    kernel, tree = PLACES["b"].kernel, PLACES["b"].device_tree
    spare = (kernel.size - kernel.room) // BLOCK
    bad = (tree.offset, BASE[0].offset, *(kernel.offset + BLOCK * at for at in range(spare + 1)))
    return flash_after_install(folder, qemu, uboot, small, uboot.with_suffix(".dtb").read_bytes(), bad)


@pytest.fixture(scope="module")
def signers(folder: Path) -> list[Signer]:
    """Two whose certificates the board has, for a rotation, and one whose it has not."""
    return [make_signer(folder, name) for name in ("present", "next", "unknown")]


@pytest.fixture(scope="module")
def extra_files(signers: list[Signer], ssh: Ssh, folder: Path) -> dict[str, Path | str]:
    certificates = "".join(signer.certificate.read_text() for signer in signers[:2])
    return files_of(SITE, certificates, slow_lines(), ssh.key, folder) | {
        path: file.resolve() for path, file in PULL.items()
    }


@pytest.fixture(scope="module")
def kernel(kernel: Kernel) -> Kernel:
    """That of the image, which takes partitions from its arguments."""
    arguments = f"{kernel.arguments} openrtu.slot=a openrtu.root=kernel {partitions()}"
    return replace(kernel, image=ROOT / "build/system/uImage", root=None, arguments=arguments)


@pytest.fixture(scope="module")
def board_arguments(nand: NandImage, ssh: Ssh) -> tuple[str | Path, ...]:
    drive = ("-drive", f"if=mtd,format=raw,file={nand.path}")
    return (*ETHERNET[0].arguments({ssh.port: SSH_PORT}), *drive, *INSTRUCTION_TIME)


@pytest.fixture(scope="module")
def board(linux: Linux, ssh: Ssh) -> Ssh:
    """Linux in slot A, with a way in."""
    wait_for(ssh.answers)
    return ssh


@pytest.fixture(scope="module")
def lines(folder: Path, linesim_program: Path) -> Iterator[LineSim]:
    with devices(folder, linesim_program) as lines:
        yield lines


@pytest.fixture(scope="module")
def board_chardevs(lines: LineSim) -> dict[int, str]:
    return lines_at(lines.directory)


Update = Callable[..., bytes]


@pytest.fixture(scope="module")
def update(small: bytes, uboot: Path, signers: list[Signer]) -> Update:
    """Makes updates, right ones unless something else is asked for."""

    def make(
        signer: int = 0,
        version: str = NEXT,
        site: str = SITE,
        board: str = "nuc980-gateway",
        writes: int | None = None,
        root: bytes | None = None,
    ) -> bytes:
        return update_file(
            small, tree_that("reset", uboot)[64:], version, site, signers[signer], board, writes, root
        )

    return make


def everything(nand: NandImage) -> bytes:
    return nand.path.read_bytes()


# ---- what is refused, in this order: nothing of it changes the flash


def test_a_board_after_install(board: Ssh) -> None:
    assert board.run("rtu-update status").splitlines() == [
        f"running  A, version {VERSION}",
        "base     A",
        "trial    none",
        "the next start takes A; if that does not load, B",
    ]


def test_environment_of_uboot_is_there_to_read(board: Ssh) -> None:
    assert board.run("fw_printenv bootcmd bootdelay").splitlines() == [
        "bootcmd=run rtu_trial; run rtu_base",
        "bootdelay=0",
    ]
    assert board.run("command -v fw_setenv || true") == ""


def damaged(content: bytes, at: int) -> bytes:
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


REFUSED: dict[str, tuple[Callable[[Update], bytes], str]] = {
    "signed by somebody else": (lambda update: update(signer=2), "not signed by a certificate of this board"),
    "a description that was changed": (lambda update: damaged(update(), 200), "not signed"),
    "a kernel that was changed": (lambda update: damaged(update(), 100_000), "not what was signed"),
    "cut short in the kernel": (lambda update: update()[:200_000], "not what was signed"),
    "cut short in the description": (lambda update: update()[:700], "not whole"),
    "cut short before its end": (lambda update: update()[: -3 * 512], "not what was signed"),
    "nothing": (lambda _: b"", "not whole, or no update"),
    "something else": (lambda _: bytes(range(256)) * 100, "not whole, or no update"),
    "an older version": (lambda update: update(version=OLDER), f"older than version {VERSION}"),
    "the version that runs": (lambda update: update(version=VERSION), f"version {VERSION} runs already"),
    "for another site": (lambda update: update(site="station-8"), "for another board or site"),
    "data that what runs could not read": (
        lambda update: update(writes=data_format("reads") + 1),
        f"version {VERSION} could not read what it writes to /data",
    ),
    "a root in UBI, where there is no UBI": (
        lambda update: update(root=b"root"),
        "its root is in UBI, and there is no place for it here: there is no UBI",
    ),
    "for another board": (lambda update: update(board="nuc980-numaker"), "for another board or site"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_refused(what: str, board: Ssh, nand: NandImage, update: Update) -> None:
    make, why = REFUSED[what]
    before = everything(nand)
    code, said = install(board, make(update))
    assert code == 1
    assert said.startswith("rtu-update: refused, and slot B is as it was: ")
    assert why in said
    assert everything(nand) == before
    assert board.run("mount | grep -c openrtu/update || true") == "0\n"


def test_no_rtud_no_update(board: Ssh, nand: NandImage, update: Update) -> None:
    """What could not be confirmed is not begun."""
    before = everything(nand)
    board.run("/etc/init.d/S80rtud stop")
    try:
        assert install(board, update()) == (
            1,
            "rtu-update: rtud does not run here, so a new version could not be told from a broken one\n",
        )
    finally:
        board.run("/etc/init.d/S80rtud start")
    assert everything(nand) == before


def test_kernel_that_does_not_fit_between_bad_blocks(
    board: Ssh, nand: NandImage, uboot: Path, signers: list[Signer]
) -> None:
    """Seen when it is read back. Slot B does not boot, and is not on trial."""
    large = uimage(PLACES["b"].kernel.room, 2)
    tree = uboot.with_suffix(".dtb").read_bytes()
    code, said = install(board, update_file(large, tree, NEXT, SITE, signers[0]))
    assert (code, said) == (
        1,
        "rtu-update: failed, and slot B holds nothing that boots: "
        "it does not fit the slot, or the slot's blocks are worn\n",
    )
    assert nand.read(PLACES["b"].device_tree.offset // DATA + PAGES) == ERASED
    assert trial_of(nand) == ERASED[:DATA]


# ---- what is taken


def trial_of(nand: NandImage) -> bytes:
    return nand.read(TRIAL.offset // DATA)[:DATA]


@pytest.fixture
def server(board: Ssh, folder: Path) -> Iterator[UpdateServer]:
    """A server of updates, as the board's site has it; the board notes its restarts instead of doing them."""
    host = ETHERNET[0].host
    authority = Authority(folder)
    board.run("mount -o remount,rw /")
    with UpdateServer(authority.server(host), host) as server:
        board.run("cat >/etc/openrtu/update-server", send=server.settings)
        board.run("cat >/etc/openrtu/update-server.pem", send=authority.certificate.read_text())
        board.run(f"date -u -s @{int(time.time())}; mount -t tmpfs data /data; mkdir -p /srv")
        board.run("cd /srv; cat >reboot; chmod +x reboot", send="#!/bin/sh\necho >/run/restarts\n")
        board.run(": >/run/readers; chmod 666 /run/readers")
        for program in ("curl", "jq"):
            board.run(f"cd /srv; cat >{program}; chmod +x {program}", send=READER.format(program=program))
        yield server
        board.run("umount /data; mount -o remount,ro /")


def test_fetched_from_a_server(
    board: Ssh, nand: NandImage, server: UpdateServer, update: Update, small: bytes
) -> None:
    """First one that is signed by somebody else; then a right one, whose connection breaks off."""
    pull = "PATH=/srv:$PATH rtu-pull once 2>&1; echo $?"
    before = everything(nand)
    server.action, server.content = "7", update(signer=2)
    said = board.run(pull)
    assert server.results == [("7", "proceeding", "none"), ("7", "closed", "failure")], said
    assert "not signed by a certificate of this board" in server.reports[-1]["status"]["details"][0]
    assert everything(nand) == before
    server.action, server.content, server.cuts = "8", update(), [100_000]
    said = board.run(pull)
    assert server.results[2:] == [("8", "proceeding", "none")], said
    assert held(nand, PLACES["b"].kernel, len(small)) == small
    assert trial_of(nand) == page(TRIAL_WORD, "b")
    assert board.run("ls /run/restarts; sed -n 2p /data/update/action").splitlines()[0] == "/run/restarts"
    assert [seen.rpartition(" ")[2] for seen in server.seen if "/file" in seen][1:] == ["0", "100000"]
    assert set(board.run("cat /run/readers").splitlines()) == {"\t".join([PULL_USER] * 4), "0" * 16}


def test_written_around_bad_blocks_and_on_trial(
    board: Ssh, nand: NandImage, update: Update, small: bytes, uboot: Path
) -> None:
    """Signed by the second certificate, as after a rotation."""
    answers = 'rtuctl --json lines | grep -q \'"ca": 1010, "alive": true\''
    board.run(f"until {answers}; do sleep 0.2; done")
    assert install(board, update(signer=1)) == (
        0,
        "The update is in slot B, read back, and on trial at the next start.\n",
    )
    before = board.run("cat /data/update/before").splitlines()
    assert "device 1 10" in before
    assert "device 1 0" not in before  # the broadcast answers nobody
    assert before[-1] == "network"
    tree = tree_that("reset", uboot)
    assert held(nand, PLACES["b"].kernel, len(small)) == small
    assert held(nand, PLACES["b"].device_tree, len(tree)) == tree
    assert trial_of(nand) == page(TRIAL_WORD, "b")
    assert board.run("rtu-update status").splitlines()[2:] == [
        "trial    B, 3 attempts left",
        "the next start takes B, then A; if that does not load, B",
    ]


# ---- the next starts; Linux is switched off


def starts(qemu: Path, uboot: Path, nand: NandImage) -> str:
    """As netboot/test_slots_twin.py has it: the slots up to the first that is not on trial."""
    drive = ("-drive", f"if=mtd,format=raw,file={nand.path}")
    with Machine(qemu, "-bios", uboot, *INSTRUCTION_TIME, *drive, options="pace=off") as machine:
        said = b""
        while not slots_in(said)[-1:].islower():
            said += machine.uarts[0].wait_for(b"Kernel command line: ", PATIENCE)
            said += machine.uarts[0].wait_for(b"\n", PATIENCE)
    return slots_in(said)


def test_version_that_resets_is_tried_three_times(
    linux: Linux, nand: NandImage, qemu: Path, uboot: Path
) -> None:
    linux.close()
    assert starts(qemu, uboot, nand) == "BBBa"


# ---- power cuts


@pytest.mark.parametrize(
    "share", [0.5, *(pytest.param(share / 20, marks=pytest.mark.soak) for share in range(20) if share != 10)]
)
def test_power_cut_while_it_is_written(
    share: float,
    boot: Callable[..., Linux],
    nand: NandImage,
    ssh: Ssh,
    extra_files: dict[str, Path | str],
    signers: list[Signer],
    small: bytes,
    qemu: Path,
    uboot: Path,
    folder: Path,
) -> None:
    """Slot B has no tree and is not marked, whatever of its kernel is there; the next start takes A."""
    flash = copy(nand, folder / "cut")
    drive = ("-drive", f"if=mtd,format=raw,file={flash.path}")
    linux = boot(*ETHERNET[0].arguments({ssh.port: SSH_PORT}), *drive, *INSTRUCTION_TIME, files=extra_files)
    ssh.close()
    wait_for(ssh.answers)
    ssh.run("rtu-update confirm; until pidof rtud; do sleep 0.2; done")
    before = flash.read(last_page(share, small))
    other = update_file(small[::-1], tree_that("hang", uboot)[64:], NEXT, SITE, signers[0])
    with ThreadPoolExecutor() as pool:
        done = pool.submit(install, ssh, other)
        wait_for(lambda: flash.read(last_page(share, small)) not in (before, ERASED))
        linux.machine.process.kill()
        assert done.result()[0] != 0
    linux.close()
    assert trial_of(flash) == ERASED[:DATA]
    assert flash.read(PLACES["b"].device_tree.offset // DATA + PAGES) == ERASED
    assert starts(qemu, uboot, flash) == "a"
    flash.path.unlink()


def last_page(share: float, kernel: bytes) -> int:
    """That which holds this share of slot B's kernel, behind the bad blocks at its begin."""
    area = PLACES["b"].kernel
    bad = (area.size - area.room) // BLOCK + 1
    return area.offset // DATA + bad * PAGES + int(share * len(kernel)) // DATA
