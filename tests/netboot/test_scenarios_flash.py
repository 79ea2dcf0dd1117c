# SPDX-License-Identifier: GPL-3.0-or-later
"""`flash` on boards that have something wrong with them: it is written, or what was there is kept.

Each erase is judged at its moment: that its place was named, that a file of the host has what is there, that
a journal tells it, that what comes there is in the RAM.
"""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from netboot.double import BLOCK, FACTORY_ENVIRONMENT, faults
from netboot.images import uimage
from netboot.scenario import (
    BOTH,
    ENVIRONMENT,
    FLASH,
    KERNEL,
    LOADER,
    ROOT,
    TREE,
    Bench,
    Scenario,
    play,
    table,
)
from nuc980.netboot import errors
from nuc980.netboot.slots.layout import BASE, PLACES, TRIAL

OURS = {"variant": "ours"}
DTB = ("flash", "--dtb", "%tree")
PLACE = {TREE: "tree"}
FIRST = TREE.start // BLOCK  # the block that the device tree begins in
TREES_AND_MARKS = (*(slot.device_tree for slot in PLACES.values()), *BASE, TRIAL)
SLOTS = {
    **{range(slot.kernel.offset, slot.kernel.end): "kernel" for slot in PLACES.values()},
    **{range(area.offset, area.end): "" for area in TREES_AND_MARKS},
    ENVIRONMENT: "",
}
SMALL_ROOT = range(ROOT.start, ROOT.start + 6 * BLOCK)
UNFINISHED = ("Not finished. `flash --resume` and",)
ODD = "if nand read 0x7FC0 0x200000 0x500000; then bootm 0x7fc0; fi"


def written(bench: Bench) -> None:
    bench.check_written()


def as_before(bench: Bench) -> None:
    """Nothing was erased or programmed."""
    assert bench.double.nand.journal == []


def bad(*blocks: int) -> Callable[[Bench], None]:
    return lambda bench: bench.double.nand.bad.update(blocks)


def environment(**variables: str) -> dict[str, object]:
    """The factory's, with these; an empty one is left out."""
    both = FACTORY_ENVIRONMENT | variables
    return {"environment": {name: value for name, value in both.items() if value}}


def file(name: str, content: bytes) -> Callable[[Bench], None]:
    return lambda bench: bench.files.__setitem__(name, content)


def works(
    name: str,
    *wrong: faults.Fault,
    command: tuple[str, ...] = DTB,
    board: dict[str, object] | None = None,
    writes: dict[range, str] | None = None,
    **more: object,
) -> Scenario:
    """All is written, read back, and nothing else touched."""
    places = PLACE if writes is None else writes
    return Scenario(name, command, wrong, board or {}, writes=places, then=written, **more)


def refuses(
    name: str,
    error: type[errors.NetbootError],
    *wrong: faults.Fault,
    command: tuple[str, ...] = DTB,
    board: dict[str, object] | None = None,
    **more: object,
) -> Scenario:
    """It ends before anything is erased."""
    return Scenario(name, command, wrong, board or {}, error=error, then=as_before, **more)


def breaks(
    name: str,
    error: type[errors.NetbootError],
    *wrong: faults.Fault,
    then: Callable[[Bench], None],
    **more: object,
) -> Scenario:
    """It ends in the middle."""
    return Scenario(name, DTB, wrong, error=error, writes=PLACE, then=then, **more)


def resumed(bench: Bench) -> None:
    """Switched off and on and mended, it goes on to the new bytes."""
    bench.mend()
    bench.double.power_cycle()
    assert bench.run("flash", "--resume") == 0
    bench.check_written()


def rolled_back(bench: Bench) -> None:
    """Switched off and on and mended, the old bytes come back."""
    bench.mend()
    bench.double.power_cycle()
    bench.contents = {place: bench.old[place] for place in bench.contents}
    assert bench.run("flash", "--roll-back") == 0
    bench.check_written()


def resumed_and_rolled_back(bench: Bench) -> None:
    """To the new bytes, and by the finished journal's name back to the old ones."""
    resumed(bench)
    (journal,) = bench.site.glob("flash-*")
    bench.contents = {place: bench.old[place] for place in bench.contents}
    assert bench.run("flash", "--roll-back", str(journal)) == 0
    bench.check_written()


def not_flashed_anew(bench: Bench) -> None:
    """Another flash would lose the way back: it is refused."""
    bench.mend()
    count = len(bench.double.nand.journal)
    assert bench.run(*DTB) == errors.Unfinished.exit_code
    assert len(bench.double.nand.journal) == count


def refuses_another_file(bench: Bench) -> None:
    bench.mend()
    bench.double.power_cycle()
    (bench.folder / "tree").write_bytes(bench.files["tree"][:-1] + b"?")
    assert bench.run("flash", "--resume") == errors.JournalUnusable.exit_code
    rolled_back(bench)


def refuses_another_board(bench: Bench) -> None:
    """A block that the journal knows as bad is good on this one."""
    bench.mend()
    bench.double.power_cycle()
    bench.double.nand.bad.clear()
    count = len(bench.double.nand.journal)
    assert bench.run("flash", "--resume") == errors.JournalUnusable.exit_code
    assert len(bench.double.nand.journal) == count


def refuses_other_content(bench: Bench) -> None:
    """A board with the same bad blocks, and with something else where the work was."""
    bench.mend()
    bench.double.power_cycle()
    for block in range(TREE.start, TREE.stop, BLOCK):
        bench.double.nand.load(block, bench.chance.randbytes(BLOCK))
    count = len(bench.double.nand.journal)
    for way in ("--resume", "--roll-back"):
        assert bench.run("flash", way) == errors.JournalUnusable.exit_code
    assert len(bench.double.nand.journal) == count


def torn_journal(bench: Bench) -> None:
    """The host's power went too: the last line is cut."""
    (journal,) = bench.site.glob("flash-*/journal.jsonl")
    journal.write_bytes(journal.read_bytes()[:-7])
    resumed(bench)


def lost_backup(bench: Bench) -> None:
    """Without the backup there is no way back, but one to the end."""
    for backup in bench.site.glob("flash-*/*.backup"):
        backup.write_bytes(b"")
    bench.mend()
    bench.double.power_cycle()
    assert bench.run("flash", "--roll-back") == errors.JournalUnusable.exit_code
    resumed(bench)


def marked_bad(*blocks: int) -> Callable[[Bench], None]:
    def then(bench: Bench) -> None:
        assert bench.double.nand.bad >= set(blocks)
        bench.check_written()

    return then


def keeps_what_it_did_not_erase(bench: Bench) -> None:
    """What Linux has written meanwhile where nothing was erased is newer than its backup."""
    bench.mend()
    bench.double.power_cycle()
    newer = bench.chance.randbytes(BLOCK)
    bench.double.nand.load(KERNEL.start, newer)
    bench.contents = {TREE: bench.old[TREE]}
    assert bench.run("flash", "--roll-back") == 0
    bench.check_written()
    assert bench.double.nand.content(KERNEL.start, BLOCK) == newer


def interrupts(bench: Bench) -> None:
    """Ctrl-C at the third erase."""

    class Interrupts(faults.Counted):
        def erases(self, board: object, block: int) -> bool:
            if self.strikes():
                os.kill(os.getpid(), signal.SIGINT)
            return True

    bench.double.faults.append(Interrupts(at=3))


def another_file_at(command: str) -> Callable[[Bench], None]:
    """The image is built anew while the board does something."""

    def prepare(bench: Bench) -> None:
        class Builds(faults.Counted):
            def command(self, board: object, words: list[str]) -> None:
                if " ".join(words).startswith(command) and self.strikes():
                    for name, content in bench.files.items():
                        (bench.folder / name).write_bytes(content[:-1] + b"?")

        bench.double.faults.append(Builds())

    return prepare


def keeps_no_sign_of_its_work(bench: Bench) -> None:
    """A board that has it in its saved environment would not tell that it was reset."""
    bench.check_written()
    assert bench.run(*DTB, "--no-backup", "again") == 0
    bench.mend()
    interrupts(bench)
    assert bench.run(*DTB, "--no-backup", "again") == 130
    assert bench.run("flash", "--resume") == 0
    for kept in bench.site.glob("environment*.txt"):
        assert "flashing" not in kept.read_text()
    assert any("setenv flashing;" in line for line in bench.double.lines)


def has_slots(bench: Bench) -> None:
    """U-Boot, which has looked at its partitions meanwhile, has put variables of its own in."""
    environment = bench.double.stored_environment()
    assert environment["bootcmd"] == "run rtu_trial; run rtu_base"
    assert "mtdparts" in environment
    bench.check_written()


def tells_why(bench: Bench) -> None:
    (journal,) = bench.site.glob("flash-*/journal.jsonl")
    assert json.loads(journal.read_text().splitlines()[0])["no_backup"] == "never booted"
    bench.check_written()


def keeps_two(bench: Bench) -> None:
    """A second flash has a backup of the first's."""
    bench.files["tree"] = bench.files["tree"][:-1] + b"2"
    bench.old = dict(bench.contents)
    assert bench.run(*DTB) == 0
    assert len(list(bench.site.glob("flash-*"))) == 2
    bench.check_written()


WRITTEN = [
    works("device tree", quick=True),
    Scenario("slots", ("install", "%kernel", "%tree", "--no-backup", "new"), writes=SLOTS, then=has_slots),
    works("kernel", command=("flash", "--kernel", "%kernel"), writes={KERNEL: "kernel"}),
    works("both", command=FLASH, writes=BOTH),
    works("both, our U-Boot", command=FLASH, writes=BOTH, board=OURS),
    works(
        "UBI, at a place of its own",
        command=("flash", "--ubi", "%root", "--ubi-at", "0x1600000+0xc0000"),
        writes={SMALL_ROOT: "root"},
        board=OURS,
    ),
    works(
        "all three",
        command=(*FLASH, "--ubi", "%root", "--ubi-at", "0x1600000+0xc0000"),
        writes=BOTH | {SMALL_ROOT: "root"},
        board=OURS,
    ),
    works("our U-Boot, backup by tftpput", board=OURS, quick=True),
    works("our U-Boot, backup by serial", command=(*DTB, "--backup-by", "serial"), board=OURS),
    works(
        "an empty place",
        prepare=lambda bench: (
            [bench.double.nand.erase(FIRST + at) for at in range(8)] and bench.double.nand.journal.clear()
        ),
    ),
    works("twice", board=OURS),
    Scenario("no sign is left", DTB, board=OURS, writes=PLACE, then=keeps_no_sign_of_its_work),
    works("quiet is set", board=environment(quiet="1")),
    works(
        "a boot command with run",
        board=environment(
            bootcmd="run read; bootm 0x7fc0 - 0xa00000",
            read="nand read 0x7FC0 0x200000 0x500000; nand read 0xA00000 0x700000 0x100000",
        ),
    ),
    works(
        "no boot command, and a place",
        command=(*DTB, "--dtb-at", "0x700000+0x100000"),
        board=environment(bootcmd=""),
    ),
    Scenario("no backup, and why", (*DTB, "--no-backup", "never booted"), writes=PLACE, then=tells_why),
    Scenario(
        "boot loader, knowing",
        ("flash", "--bootloader", "%loader", "--i-know"),
        prepare=file("loader", b"\x12\0\0\xea" + bytes(range(256)) * 1000),
        board=OURS,
        writes={range(LOADER.start, LOADER.start + 4 * BLOCK): "loader"},
        then=lambda bench: None,
    ),
]

WORN = [
    works("a bad block in the place", prepare=bad(FIRST + 2), quick=True),
    works("a bad block at its begin", prepare=bad(FIRST)),
    works("all but one bad", prepare=bad(*range(FIRST + 1, FIRST + 8))),
    Scenario(
        "a block cannot be erased",
        DTB,
        [faults.CannotErase(FIRST)],
        writes=PLACE,
        then=marked_bad(FIRST),
    ),
    Scenario(
        "a block cannot be programmed",
        DTB,
        [faults.CannotProgram(FIRST)],
        writes=PLACE,
        then=marked_bad(FIRST),
    ),
    Scenario(
        "two blocks fail",
        DTB,
        [faults.CannotErase(FIRST + 1), faults.CannotProgram(FIRST)],
        writes=PLACE,
        then=marked_bad(FIRST, FIRST + 1),
    ),
    works("a block forgets once", faults.ForgetsAfterWrite()),
    Scenario(
        "what is there cannot be read",
        DTB,
        prepare=lambda bench: bench.double.nand.spoil(TREE.start + 0x800),
        writes=PLACE,
        then=written,
        says=("cannot be read",),
    ),
    refuses("all blocks bad", errors.DoesNotFit, prepare=bad(*range(FIRST, FIRST + 8)), quick=True),
    Scenario(
        "all blocks fail",
        DTB,
        [faults.CannotErase(*range(FIRST, FIRST + 8))],
        error=errors.FlashFailed,
        writes=PLACE,
    ),
    Scenario(
        "a block that always forgets",
        DTB,
        [faults.ForgetsAfterWrite(times=0)],
        error=errors.FlashFailed,
        writes=PLACE,
    ),
]

LINE = [
    works("noise, one byte in 3000", faults.Noise(1 / 3000, seed=6), board=OURS),
    works("echo lost", faults.DropsEcho(at=900)),
    works("bytes lost now and then", faults.DropsReceived(every=997), board=OURS),
    works(
        "a kernel's words between",
        faults.Unsolicited("\n[   12.34] usb 1-1: reset\n", at=20, times=3),
        board=OURS,
    ),
    works("a sum misprinted in a backup by serial", faults.wrong_crc(at=3)),
    works("a sum misprinted in the backup", faults.wrong_crc(at=1), board=OURS),
    works("a sum misprinted before the erase", faults.wrong_crc(at=3), board=OURS, quick=True),
    works("a sum misprinted in the reading back", faults.wrong_crc(at=4), board=OURS),
    works("md misprints", faults.noisy_dump(at=5, times=3)),
    works("ACKs lost", faults.LosesAcks(at=4, times=2), board=OURS),
    works("a wrong bit in the RAM once", faults.FlipsInRam(), board=OURS, quick=True),
    works("only what fits the FIFO arrives", faults.OverrunsFifo(), board=OURS),
]

REFUSED = [
    refuses(
        "larger than what is read",
        errors.DoesNotFit,
        command=FLASH,
        prepare=file("kernel", uimage(bytes(0x500000))),
        says=("5242880",),
        quick=True,
    ),
    refuses(
        "larger than what bad blocks leave",
        errors.DoesNotFit,
        command=FLASH,
        prepare=lambda bench: (bad(0x11)(bench), file("kernel", uimage(bytes(0x4FFF00)))(bench)),
    ),
    refuses(
        "not a uImage", errors.UnusableImage, command=FLASH, prepare=file("kernel", b"no kernel"), quick=True
    ),
    refuses(
        "device tree cut off",
        errors.UnusableImage,
        prepare=lambda bench: file("tree", bench.files["tree"][:-5])(bench),
    ),
    refuses(
        "UBI image of other pages",
        errors.UnusableImage,
        command=("flash", "--ubi", "%root"),
        prepare=lambda bench: file(
            "root", bench.files["root"].replace(b"\0\0\x08\0\0\0\x10\0", b"\0\0\x02\0\0\0\x08\0")
        )(bench),
    ),
    refuses("nothing named", errors.UnusableInput, command=("flash",), says=("--kernel",)),
    refuses("file that is not there", errors.UnusableInput, command=("flash", "--dtb", "%nothing")),
    refuses(
        "boot loader, not knowing",
        errors.UnusableInput,
        command=("flash", "--bootloader", "%kernel"),
        says=("--i-know",),
        quick=True,
    ),
    refuses(
        "kernel into U-Boot's place",
        errors.LayoutUnknown,
        command=(*FLASH, "--kernel-at", "0x100000+0x100000"),
    ),
    refuses("one over the other", errors.LayoutUnknown, command=(*FLASH, "--kernel-at", "0x700000+0x100000")),
    refuses(
        "into the bad-block tables", errors.LayoutUnknown, command=(*DTB, "--dtb-at", "0x7f00000+0x100000")
    ),
    refuses("no boot command", errors.LayoutUnknown, board=environment(bootcmd=""), quick=True),
    refuses(
        "boot command from elsewhere",
        errors.LayoutUnknown,
        board=environment(bootcmd="sf read 0x7fc0 0 0x300000; bootm 0x7fc0"),
    ),
    refuses("boot command that is not understood", errors.LayoutUnknown, board=environment(bootcmd=ODD)),
    refuses(
        "boot command without bootm",
        errors.LayoutUnknown,
        board=environment(bootcmd="nand read 0x7fc0 0x200000 0x300000"),
    ),
    refuses("no NAND", errors.FlashNotPossible, faults.Refuses("^nand info", "", times=0)),
    refuses("an unknown reason", errors.UnusableInput, command=(*DTB, "--no-backup", "  ")),
    refuses(
        "resume of nothing",
        errors.UnusableInput,
        command=("flash", "--resume"),
        says=("no unfinished",),
        quick=True,
    ),
    refuses(
        "roll-back of nothing",
        errors.UnusableInput,
        command=("flash", "--roll-back"),
        says=("no unfinished",),
    ),
    Scenario(
        "dry run", (*DTB, "--dry-run"), then=as_before, says=("nand erase 0x700000 0x20000",), quick=True
    ),
]

BEFORE = [
    refuses("file never right in the RAM", errors.WrongBytes, faults.FlipsInRam(times=0), board=OURS),
    Scenario(
        "built anew during the backup",
        DTB,
        board=OURS,
        prepare=another_file_at("tftpput"),
        code=1,
        says=("likely cause", "changed while the board was worked with"),
        then=as_before,
    ),
    Scenario(
        "built anew before it is written",
        DTB,
        board=OURS,
        prepare=another_file_at("mw.b"),
        error=errors.UnusableImage,
        says=("changed while",),
        then=as_before,
    ),
    refuses("md never right", errors.LineUnsafe, faults.noisy_dump(times=0)),
    refuses(
        "upload refused",
        errors.BackupFailed,
        faults.Refuses("^tftpput", "TFTP error: 'Access denied' (2)\n", times=0),
        board=OURS,
    ),
    refuses(
        "out of memory at the read",
        errors.BackupFailed,
        faults.Refuses("^nand read 0x100000", "** out of memory\n", times=0),
        board=OURS,
    ),
    refuses("starts again at the load", errors.BoardReset, faults.ResetsAt("tftp", 5), board=OURS),
    refuses("no network", errors.NoEthernet, faults.NetworkSays(faults.NO_ETHERNET)),
    refuses("port goes in the backup", errors.LineLost, faults.Unplugged(at=120)),
    refuses("hangs at the read", errors.StuckConsole, faults.HangsAt("^nand read 0x100000"), patience=2.0),
]

MIDDLE = [
    breaks(
        "starts again at an erase, resumed",
        errors.BoardReset,
        faults.ResetsAt("erase", 1),
        then=resumed,
        quick=True,
    ),
    breaks(
        "starts again at an erase, rolled back",
        errors.BoardReset,
        faults.ResetsAt("erase", 1),
        then=rolled_back,
    ),
    breaks(
        "starts again at a late erase, resumed", errors.BoardReset, faults.ResetsAt("erase", 5), then=resumed
    ),
    breaks(
        "starts again at a late erase, rolled back",
        errors.BoardReset,
        faults.ResetsAt("erase", 5),
        then=rolled_back,
    ),
    breaks(
        "starts again at a program, resumed", errors.BoardReset, faults.ResetsAt("program", 1), then=resumed
    ),
    breaks(
        "starts again at a program, rolled back",
        errors.BoardReset,
        faults.ResetsAt("program", 1),
        then=rolled_back,
    ),
    breaks(
        "resumed, then rolled back",
        errors.BoardReset,
        faults.ResetsAt("program", 1),
        then=resumed_and_rolled_back,
    ),
    breaks(
        "hangs at an erase, resumed",
        errors.StuckConsole,
        faults.HangsAt("^nand erase"),
        patience=2.0,
        then=resumed,
    ),
    breaks("not flashed anew", errors.BoardReset, faults.ResetsAt("erase", 1), then=not_flashed_anew),
    breaks(
        "another file meanwhile", errors.BoardReset, faults.ResetsAt("erase", 1), then=refuses_another_file
    ),
    breaks(
        "another board meanwhile",
        errors.BoardReset,
        faults.ResetsAt("erase", 1),
        prepare=bad(0x300),
        then=refuses_another_board,
    ),
    breaks(
        "another content meanwhile",
        errors.BoardReset,
        faults.ResetsAt("erase", 2),
        then=refuses_other_content,
    ),
    breaks("journal's last line cut", errors.BoardReset, faults.ResetsAt("erase", 2), then=torn_journal),
    Scenario(
        "rolled back, but for what was not begun",
        FLASH,
        [faults.ResetsAt("erase", 1)],
        OURS,
        error=errors.BoardReset,
        writes=BOTH,
        then=keeps_what_it_did_not_erase,
    ),
    Scenario(
        "Ctrl-C", DTB, board=OURS, prepare=interrupts, code=130, says=UNFINISHED, writes=PLACE, then=resumed
    ),
    breaks("backup lost", errors.BoardReset, faults.ResetsAt("erase", 2), then=lost_backup),
]


@pytest.mark.slow
@pytest.mark.parametrize("scenario", table(WRITTEN + WORN + LINE + REFUSED + BEFORE + MIDDLE))
def test_flash(
    scenario: Scenario,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    play(scenario, tmp_path, capsys, monkeypatch)
