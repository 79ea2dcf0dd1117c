# SPDX-License-Identifier: GPL-3.0-or-later
"""What `probe` finds out, on the double's two U-Boots, on ours on the emulated board and on Debian's."""

import json
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from netboot.double import BLOCK, Double, faults
from netboot.flashbench import Board, at_prompt, changed_blocks, copy, switched_on
from nuc980.netboot.board import FACTORY, BoardReport, Nand, Port
from nuc980.netboot.commandline import typed
from nuc980.netboot.console import Console
from nuc980.netboot.errors import UnusableInput
from nuc980.netboot.probe import described, probe, questions, remarks
from nuc980.netboot.progress import Progress
from nuc980.netboot.slots.script import variables
from nuc980.netboot.transport import Line
from nuc980.twin.nand import NandImage

VIRT_UBOOT = Path("/usr/lib/u-boot/qemu_arm/u-boot.bin")


def asked(double: Double, *, flash: bool = True) -> BoardReport:
    with double, Line(double.port) as line:
        console = Console(line)
        console.reach()
        return probe(console, Progress(), flash=flash)


def printed(board: BoardReport) -> str:
    return "\n".join(remarks(board))


# ---- the factory's, as the double has it


def test_factorys_board() -> None:
    board = asked(double := Double("factory"))
    assert (
        replace(board, version=FACTORY.version, commands=FACTORY.commands, ram_end=FACTORY.ram_end) == FACTORY
    )
    assert board.version.startswith(FACTORY.version)
    assert board.commands >= FACTORY.commands - {"timer", "sf", "sspi"}
    assert 0x3E00000 <= board.ram_end < 0x3E4EED0  # below irq_sp
    assert double.nand.journal == []
    assert double.lines[1:] == [
        typed(question, number) for number, question in enumerate(questions(FACTORY, flash=True), 2)
    ]


@pytest.mark.slow
def test_bad_blocks_are_named() -> None:
    double = Double("factory")
    double.nand.bad |= {70, 1023}
    board = asked(double)
    assert board.nand and board.nand.bad == (70 * BLOCK, 1023 * BLOCK)
    assert re.search("^bad blocks +0x8c0000, 0x7fe0000$", described(board), re.MULTILINE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of", "words", "noise"),
    [
        ("^nand bad", "008c0000", "008d0000"),
        ("^nand info", "Erase size +131072", "Erase size   331072"),
        ("^mtdparts", "0x01600000", "0x01200000"),
        ("^bdinfo", "irq_sp *= 0x03", "irq_sp = 0x00"),
    ],
)
def test_noise_makes_no_other_flash_of_it(of: str, words: str, noise: str) -> None:
    """A digit that becomes another one would lead an erase elsewhere."""
    double = Double("factory", faults=[misprint := faults.Misprints(of, words, noise)])
    double.nand.bad |= {70}
    board = asked(double)
    assert misprint.seen > 0
    assert board.nand == replace(FACTORY.nand, bad=(70 * BLOCK,))
    assert 0x3E00000 <= board.ram_end < 0x3E4EED0


@pytest.mark.slow
def test_flash_is_left_out() -> None:
    board = asked(double := Double("factory"), flash=False)
    assert board.nand is None and not board.flash_asked
    assert not [line for line in double.lines if "nand" in line and "help" not in line]
    assert "The flash was left out" in printed(board)


# ---- remarks


@pytest.mark.parametrize(
    ("change", "remark"),
    [
        ({}, "No ethaddr:"),
        ({}, "reads 5242880 bytes of the NAND from 0x200000 on to 0x7FC0"),
        ({}, "No tftpput: a backup"),
        ({}, "UDP port than 69"),
        ({"environment": {"bootdelay": "-1", "bootcmd": "true"}}, "autoboot is off"),
        ({"environment": {"bootdelay": "0", "bootcmd": "true"}}, "hardly a chance"),
        ({"environment": {"bootdelay": "3"}}, "No bootcmd"),
        ({"ports": ()}, "no Ethernet port: built without a driver"),
        ({"commands": frozenset({"crc32", "nand"})}, "No tftpboot"),
        ({"commands": frozenset({"crc32", "tftpboot"})}, "No nand command"),
        ({"commands": frozenset({"nand"})}, "No crc32"),
        ({"nand": None}, "CONFIG_SPI_NAND"),
        ({"nand": Nand(1 << 27, 1 << 17, 2048, tuple(range(21)))}, "worn out"),
        ({"nand": Nand(1 << 27, 1 << 17, 2048, (), keeps_table=True)}, "uses bad-block tables"),
        ({"link": False}, "emac has no link"),
    ],
)
def test_remark(change: dict[str, Any], remark: str) -> None:
    assert remark in printed(replace(FACTORY, **change))


def test_a_board_with_everything_has_few_remarks() -> None:
    good = replace(
        FACTORY,
        environment={"bootcmd": "run other", "bootdelay": "3", "ethaddr": "02:00:00:00:00:01"},
        commands=FACTORY.commands | {"tftpput"},
        link=True,
    )
    assert [remark[:20] for remark in remarks(good)] == ["It does not tell whe", "Its U-Boot has the c"]


def test_a_u_boot_that_cannot_fall_back() -> None:
    without = replace(FACTORY, commands=FACTORY.commands - {"itest", "iminfo"})
    assert "No itest, iminfo: it cannot have two slots." in printed(without)


def test_a_board_with_slots() -> None:
    assert FACTORY.nand
    environment = FACTORY.environment | variables(FACTORY.nand, "")
    assert "It has two slots" in printed(replace(FACTORY, environment=environment))


def test_an_ordinary_wear_is_no_remark() -> None:
    assert "worn" not in printed(
        replace(FACTORY, nand=Nand(1 << 27, 1 << 17, 2048, tuple(range(20)), keeps_table=True))
    )


def test_text_is_read_at_a_glance() -> None:
    assert described(FACTORY).splitlines()[:12] == [
        "U-Boot      U-Boot 2016.11",
        "RAM         64 MiB at 0x0",
        "            free for files below 0x3e00000",
        "NAND        128 MiB: 1024 blocks of 128 KiB, pages of 2048 + 64 bytes",
        "bad blocks  none",
        "partitions  u-boot       0x00000000     2.00 MiB",
        "            kernel       0x00200000    20.00 MiB",
        "            user         0x01600000   106.00 MiB",
        "Ethernet    emac (no address)",
        "            in use: emac; link: U-Boot does not say",
        "            no address in the environment",
        "autoboot    after 3 s: " + FACTORY.environment["bootcmd"],
    ]


# ---- JSON


@pytest.mark.parametrize(
    "board",
    [
        FACTORY,
        replace(FACTORY, nand=None, ports=(), port_in_use=None),
        replace(FACTORY, phy=1, link=True, ports=(Port("emac0", "02:00:00:00:00:01"),)),
    ],
)
def test_json_comes_back(board: BoardReport) -> None:
    assert BoardReport.from_json(json.loads(json.dumps(board.as_json()))) == board


@pytest.mark.parametrize(
    "value",
    [
        None,
        [],
        {},
        {"schema": 2},
        {**FACTORY.as_json(), "more": 1},
        {**FACTORY.as_json(), "ram": 1},
        {**FACTORY.as_json(), "nand": {"bad": 1}},
    ],
)
def test_other_json_is_refused(value: object) -> None:
    with pytest.raises(UnusableInput, match="report"):
        BoardReport.from_json(value)


# ---- real U-Boots


@pytest.fixture(scope="module")
def worn(tmp_path_factory: pytest.TempPathFactory, qemu: Path, uboot: Path) -> NandImage:
    """A flash that U-Boot has seen before, with a bad block."""
    nand = NandImage.blank(tmp_path_factory.mktemp("probe") / "nand")
    with switched_on(qemu, uboot, nand) as board, at_prompt(board) as session:
        session.console.run("nand markbad 0x820000").required()
    return nand


@contextmanager
def twin(qemu: Path, uboot: Path, nand: NandImage) -> Iterator[tuple[Console, Board]]:
    with switched_on(qemu, uboot, nand) as board, at_prompt(board) as session:
        yield session.console, board


@pytest.mark.slow
def test_our_board(qemu: Path, uboot: Path, worn: NandImage, tmp_path: Path) -> None:
    nand = copy(worn, tmp_path / "nand")
    with twin(qemu, uboot, nand) as (console, _):
        board = probe(console, Progress(), flash=True)
        again = probe(console, Progress(), flash=True)
    assert board.nand
    assert (board.nand.size, board.nand.block, board.nand.page, board.nand.oob) == (1 << 27, BLOCK, 2048, 64)
    assert (board.nand.bad, board.nand.tables) == ((0x820000,), ())
    assert " ".join(part.name for part in board.nand.partitions) == "u-boot kernel device-tree spare rootfs"
    assert board.ports == (Port("emac0", None), Port("emac1", None))
    assert board.knows("tftpput") and board.knows("nand markbad")
    assert board.ram == ((0, 64 << 20),) and 0x3000000 < board.ram_end < 0x3B63950 + 1
    own = {"nand_erasesize", "nand_oobsize", "nand_writesize", "partition", "mtddevname", "mtddevnum"}
    assert {name: value for name, value in again.environment.items() if name not in own} == board.environment
    assert changed_blocks(worn.path, nand.path) == set()


@pytest.mark.slow
def test_link_of_our_board(qemu: Path, uboot: Path, worn: NandImage, tmp_path: Path) -> None:
    with twin(qemu, uboot, copy(worn, tmp_path / "nand")) as (console, board):
        console.run("setenv ethaddr 02:00:00:00:00:01; setenv eth1addr 02:00:00:00:00:02").required()
        up = probe(console, Progress(), flash=False)
        nic = re.search(r"nuc980-emac\.0\S*", board.machine.info("network"))
        assert nic, board.machine.info("network")
        board.machine.command("set_link", name=nic[0].rstrip(":"), up=False)
        down = probe(console, Progress(), flash=False)
        lines = list(questions(up, flash=False))
    assert (up.port_in_use, up.phy, up.link) == ("emac0", 1, True)
    assert (down.phy, down.link) == (1, False)
    assert lines[-3:] == ["mii info", "mii read 0x1 1", "mii read 0x1 1"]
    assert "emac0 has no link" in printed(down)


@pytest.mark.slow
def test_debians_uboot() -> None:
    """No NAND, another RAM, another network card; nobody here wrote it."""
    process = subprocess.Popen(
        ["qemu-system-arm", "-M", "virt", "-bios", VIRT_UBOOT, "-display", "none", "-nodefaults",
         "-netdev", "user,id=net", "-device", "virtio-net-device,netdev=net", "-serial", "pty"],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stdout
        port = re.search(r"/dev/pts/\d+", process.stdout.readline())
        assert port
        with Line(port[0]) as line:
            console = Console(line)
            console.reach()
            board = probe(console, Progress(), flash=True)
    finally:
        process.kill()
        process.wait()
    assert board.ram == ((0x40000000, 128 << 20),) and 0x40000000 < board.ram_end < 0x48000000
    assert board.nand is None
    assert len(board.ports) == 1 and board.ports[0].mac == "52:54:00:12:34:56"
    assert board.port_in_use == board.ports[0].name
    assert len(board.environment) > 50 and board.environment["bootcmd"] == "run distro_bootcmd"
    assert "No nand command" in printed(board)
