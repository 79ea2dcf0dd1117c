# SPDX-License-Identifier: GPL-3.0-or-later
"""A new version on trial: confirmed when it is healthy; with a third of the wait.

Linux is started without U-Boot, with the arguments of a trial of slot B; each reset is the same start again.
What U-Boot makes of the marks is in netboot/test_slots_twin.py.
"""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from nuc980.netboot.slots.layout import BASE, TRIAL, Area
from nuc980.netboot.slots.marks import BASE_WORD, TRIAL_WORD, page
from nuc980.netboot.slots.script import partitions
from nuc980.twin.linux import Kernel, Linux
from nuc980.twin.nand import DATA, PAGE, NandImage
from rig.desk import chapter_5

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = "usr/sbin/rtu-update"
HEALTHY_S = 60  # the script's own, three times what it is here
WAITS = {"HEALTHY_SECONDS=60": "HEALTHY_SECONDS=20"}
LESS_PATIENCE = {"PATIENCE_SECONDS=600": "PATIENCE_SECONDS=60"}
# A program that ends again and again, and a version before it whose module did not.
FLAPPING = """\
#!/bin/sh
[ "$1" = start ] || exit 0
mkdir -p /data/update
echo "module rtu-iec104" >/data/update/before
while [ ! -e /run/well ]; do sleep 7; kill -9 $(pidof PROGRAM); done >/dev/null 2>&1 &
"""
# On a busy machine.
CONFIRMED_SECONDS = 900.0
# The board's time leaps over its waits: nobody sits through them.
LEAPING = ("-icount", "shift=3,sleep=off")


@pytest.fixture(scope="module")
def nand(folder: Path) -> NandImage:
    return on_trial(folder / "nand")


def on_trial(file: Path) -> NandImage:
    """As far as Linux sees it: it erases the mark and does not read it."""
    nand = NandImage.blank(file)
    nand.write(TRIAL.offset // DATA, page(TRIAL_WORD, "b").ljust(PAGE, b"\xff"))
    return nand


@pytest.fixture(scope="module")
def kernel(kernel: Kernel) -> Kernel:
    """That of the image, which takes partitions from its arguments, as U-Boot starts a trial."""
    trial = "openrtu.slot=b openrtu.trial watchdog.open_timeout=180"
    arguments = f"{kernel.arguments} {trial} {partitions()}"
    return replace(kernel, image=ROOT / "build/system/uImage", root=None, arguments=arguments)


@pytest.fixture(scope="module")
def board_arguments(nand: NandImage) -> tuple[str, ...]:
    return with_flash(nand)


def with_flash(nand: NandImage) -> tuple[str, ...]:
    return (*LEAPING, "-drive", f"if=mtd,format=raw,file={nand.path}")


@pytest.fixture(scope="module")
def extra_files(folder: Path) -> dict[str, Path | str]:
    return files_with(folder, "rtu-iec104", WAITS)


def files_with(folder: Path, program: str, waits: dict[str, str]) -> dict[str, Path | str]:
    """Lines whose devices are all dead: nothing is wired to the board. The script with shorter waits."""
    script = folder / f"rtu-update-{program}"
    shutil.copy(ROOT / "board/nuc980/rootfs-overlay" / SCRIPT, script)
    text = script.read_text()
    for long, short in waits.items():
        assert f"\n{long}\n" in text
        text = text.replace(long, short)
    script.write_text(text)
    flapping = folder / f"S16-{program}"
    flapping.write_text(FLAPPING.replace("PROGRAM", program))
    flapping.chmod(0o755)
    return {
        "etc/openrtu/gateway.json": json.dumps(chapter_5()),
        "etc/init.d/S16flapping": flapping,
        SCRIPT: script,
    }


def held(nand: NandImage, area: Area) -> bytes:
    return nand.read(area.offset // DATA)[:DATA]


def test_version_whose_module_ends_again_and_again_is_not(linux: Linux, nand: NandImage) -> None:
    linux.run(f"sleep {HEALTHY_S}", seconds=CONFIRMED_SECONDS)
    assert held(nand, TRIAL) == page(TRIAL_WORD, "b")
    linux.run("touch /run/well")


def test_healthy_version_is_confirmed(linux: Linux, nand: NandImage) -> None:
    """Devices that were dead before the update may stay so. An rtud that hangs would be reset before."""
    confirmed = "grep -q 'what boots from now on' /var/log/messages"
    linux.run(f"until {confirmed}; do sleep 1; done", seconds=CONFIRMED_SECONDS)
    assert [held(nand, copy) for copy in BASE] == [page(BASE_WORD, "b")] * 2
    assert held(nand, TRIAL) == b"\xff" * DATA
    assert int(linux.run("cat /sys/class/watchdog/watchdog0/timeout")) < HEALTHY_S


def test_version_whose_rtud_ends_again_and_again_is_given_up(
    boot: Callable[..., Linux], folder: Path
) -> None:
    """rtud is started again in time for the watchdog, so it is rtu-update that ends the attempt."""
    nand = on_trial(folder / "nand-of-rtud")
    files = files_with(folder, "rtud", WAITS | LESS_PATIENCE)
    with boot(*with_flash(nand), files=files) as linux:
        linux.wait_for_shell(CONFIRMED_SECONDS)
        assert linux.run("cat /sys/class/watchdog/watchdog0/bootstatus") == "0"
        assert held(nand, TRIAL) == page(TRIAL_WORD, "b")
