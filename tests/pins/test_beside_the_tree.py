# SPDX-License-Identifier: GPL-3.0-or-later
"""The image's command line and U-Boot's environment, held against the tree and the board's limits."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from mutations_boot import BOOT
from program import DONE, FOUND, UNUSABLE, run, write
from trees import ROOT

DTS = ROOT / "dts/nuvoton/nuc980-gateway.dts"
FACTORY = """\
baudrate=115200
args=console=ttyS0,115200n8 ubi.mtd=rootfs
bootargs=${args} root=ubi0:rootfs rootfstype=ubifs
bootcmd=run kernel; run tree; bootm 0x7fc0 - 0xa00000
kernel=nand read 0x7FC0 0x200000 0x500000
tree=nand read 0xA00000 0x700000 0x100000
"""


def rules(tmp_path: Path, environment: str) -> list[str]:
    file = tmp_path / "printenv.txt"
    file.write_text(environment)
    done = run("check", "--environment", file, write(tmp_path / "board.dts", BOOT))
    assert done.returncode in (DONE, FOUND)
    return re.findall(r": ([a-z-]+): ", done.stdout)


@pytest.mark.parametrize(
    ("was", "becomes", "found"),
    [
        ("", "", []),
        ("ubi.mtd=rootfs", "ubi.mtd=user", ["unknown-partition"]),
        ("ttyS0,", "ttyS1,", ["wrong-console"]),
        (" ubi.mtd=rootfs", "", ["wrong-root"]),
        ("0x200000 0x500000", "0x200000 0x600000", ["wrong-boot-command"]),
        ("0x700000 0x100000", "0x800800 0x100000", ["wrong-boot-command"]),
        ("args=", "mtdparts=nand0:1m(u-boot)ro,-(kernel)\nargs=", ["mtdparts-moved", "mtdparts-moved"]),
    ],
)
def test_environment_and_tree_are_one_claim(tmp_path: Path, was: str, becomes: str, found: list[str]) -> None:
    assert rules(tmp_path, FACTORY.replace(was, becomes, 1)) == found


def test_variables_that_name_each_other_end(tmp_path: Path) -> None:
    assert rules(tmp_path, "bootargs=${a}\na=${b} ${b}\nb=${a} ${a}\n") == []


def test_only_what_the_boot_command_runs_is_its_reading(tmp_path: Path) -> None:
    assert rules(tmp_path, f"{FACTORY}rescue=nand read 0x7FC0 0x800800 0x100000\n") == []
    ran = FACTORY.replace("run tree;", "run tree rescue;")
    assert rules(tmp_path, f"{ran}rescue=nand read 0x7FC0 0x800800 0x100000\n") == ["wrong-boot-command"]


def test_a_pipe_is_no_environment(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for file in (tmp_path / "pipe", "/dev/zero"):
        done = run("check", "--environment", file, DTS)
        assert (done.returncode, f"{file} is not a regular file" in done.stderr) == (UNUSABLE, True)


def test_what_is_no_environment_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("hello\n")
    done = run("check", "--environment", tmp_path / "x", DTS)
    assert done.returncode == UNUSABLE
    assert "none of bootargs, bootcmd and mtdparts" in done.stderr
    assert "No such file" in run("check", "--environment", tmp_path / "none", DTS).stderr


def test_command_line_of_an_image(tmp_path: Path) -> None:
    done = run("check", "--command-line", "console=ttyS0 root=/dev/mmcblk0p1", DTS)
    assert done.returncode == FOUND
    assert "wrong-root: the command line has root=/dev/mmcblk0p1, but no SD host is enabled" in done.stdout


@pytest.mark.parametrize("name", ["root-ubi", "root-initramfs"])
def test_our_images_fit_our_tree(name: str) -> None:
    fragment = (ROOT / f"board/nuc980/linux/{name}.fragment").read_text()
    [line] = re.findall(r'^CONFIG_CMDLINE="(.*)"', fragment, re.MULTILINE)
    assert run("check", "--command-line", line, DTS).returncode == DONE


def test_our_u_boot_fits_our_tree(tmp_path: Path) -> None:
    """Its partitions repeat those of the tree."""
    config = (ROOT / "board/nuc980/u-boot/configs/nuc980_gateway_defconfig").read_text()
    [parts] = re.findall(r'^CONFIG_MTDPARTS_DEFAULT="(.*)"', config, re.MULTILINE)
    (tmp_path / "env").write_text(f"mtdparts={parts}\n")
    assert run("check", "--environment", tmp_path / "env", DTS).returncode == DONE
