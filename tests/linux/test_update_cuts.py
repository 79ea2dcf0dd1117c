# SPDX-License-Identifier: GPL-3.0-or-later
"""Power cuts over the whole of an update: the flash after each of its changes, whole or torn.

Three boards write down each erased block and programmed page: Linux in slot A with `rtu-update install`,
U-Boot with the attempts of the trial, Linux in slot B with `rtu-update confirm`. A cut is the flash of before
with the changes up to one of them, which may have been in work. U-Boot starts from it; the kernels that it
starts say which kernel and which tree they are. Another Linux mounts /data of it.
"""

from __future__ import annotations

import random
import re
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import libfdt
import pytest
from flash_changes import Change, changes, content, put, recording
from update_board import (
    NEXT,
    PATIENCE,
    SITE,
    devices,
    files_of,
    flash_after_install,
    held,
    install,
    make_signer,
    slow_lines,
    wait_for,
)

from image.update import Signer, update_file
from lab.board import ETHERNET, SSH_PORT, Ssh, lines_at
from netboot.flashbench import copy, uimage
from nuc980.netboot.limits import BLOCK
from nuc980.netboot.slots.command import wrapped
from nuc980.netboot.slots.layout import BASE, NAMES, PLACES, ROOT, TRIAL, Area
from nuc980.netboot.slots.marks import ATTEMPTS, BASE_WORD, TRIAL_WORD, Marks, page
from nuc980.netboot.slots.script import OPEN_SECONDS, partitions
from nuc980.twin.linux import SHELL, Kernel, Linux
from nuc980.twin.machine import INSTRUCTION_TIME, Machine
from nuc980.twin.nand import DATA, PAGES, NandImage
from rig.journal_file import RETAINED, cause_of, events, records, told_by

TREE = Path(__file__).resolve().parents[2]
PAYLOAD = Path(__file__).parents[1] / "netboot/payload/Makefile"
KERNEL_BYTES = 300_001
ERASED = b"\xff" * DATA
SEED = 980
ALL = 1_000_000  # cuts: there are some 1 400
# Of a change in work: shares of its bits that the flash has taken over.
DEPTHS = (1 / 64, 1 / 8, 1 / 2, 7 / 8, 63 / 64)
# The board's time leaps over its waits: nobody sits through them.
LEAPING = ("-icount", "shift=3,sleep=off")
VOLUME = 0xC00000  # of 100 MiB, because all of it is read before it is taken
CONFIG, EVENTS = "/data/site/config.json", "/data/openrtu/journal/events"
SHOW_EVENTS = f"hexdump -v -e '1/1 \"%02x\"' {EVENTS}"
CREATE_SECONDS = 300.0
JOURNAL_HOLDS = "until rtuctl --json modules | grep -q '\"events\": *{}'; do sleep 0.2; done"
STARTED = re.compile(
    rb"Linux version 5\.10\.140-(\w+)-* .*?Machine model: (\w+)\r*\n"
    rb".*?Kernel command line: [^\n]*openrtu\.slot=(\w)( openrtu\.trial)?[^\n]*\n",
    re.DOTALL,
)


@dataclass(frozen=True)
class Version:
    """A kernel that says its version's name, and a tree that does and lets the kernel end so."""

    kernel: bytes
    tree: bytes

    @classmethod
    def of(cls, name: str, payload: bytes, uboot: Path, ending: str) -> Version:
        program = payload.replace(b"140-payload", b"140-" + name.encode().ljust(7, b"-"))
        assert program != payload
        tree = libfdt.Fdt(bytearray(uboot.with_suffix(".dtb").read_bytes()))
        tree.resize(tree.totalsize() + 256)
        tree.setprop_str(0, "model", name)
        tree.setprop_str(tree.path_offset("/chosen"), "payload", f"payload={ending}")
        tree.pack()
        return cls(uimage(KERNEL_BYTES, len(name), program), bytes(tree.as_bytearray()))

    def is_in(self, nand: NandImage, slot: str) -> bool:
        kernel, tree = PLACES[slot].kernel, PLACES[slot].device_tree
        whole = wrapped(self.tree)
        return held(nand, kernel, len(self.kernel)) == self.kernel and held(nand, tree, len(whole)) == whole


@dataclass(frozen=True)
class Start:
    """What a kernel has said."""

    kernel: str
    tree: str
    slot: str
    trial: bool


@dataclass(frozen=True)
class Update:
    """The flash before it, and what changed there. Attempts: if nobody confirms."""

    before: NandImage
    install: Sequence[Change]
    attempts: Sequence[Change]
    confirm: Sequence[Change]
    events: set[bytes]  # in the journal, before

    @property
    def stories(self) -> tuple[list[Change], list[Change]]:
        """Confirmed after the first attempt; given up after the third."""
        first = [*self.install, *self.attempts[:1]]
        return [*first, *self.confirm], [*first, *self.attempts[1:]]

    def cuts(self) -> list[Cut]:
        """Each one that there is."""
        begins = 0, len(self.install) + 1
        return [
            Cut(number, done, depth)
            for number, (story, begin) in enumerate(zip(self.stories, begins, strict=True))
            for done in range(begin, len(story))
            for depth in (0.0, *DEPTHS)
        ]


@dataclass(frozen=True, order=True)
class Cut:
    """So many changes of a story are done; the next is in work, so far, or not begun."""

    story: int
    done: int
    depth: float


class Replay:
    """A flash that goes through a story, change by change."""

    def __init__(self, before: NandImage, file: Path, story: Sequence[Change]) -> None:
        self.nand = copy(before, file)
        self._story = story
        self._done = 0

    @contextmanager
    def at(self, cut: Cut) -> Iterator[tuple[Marks, Marks]]:
        """The marks before and after the change that was in work. Cuts come in their order."""
        for change in self._story[self._done : cut.done]:
            change.apply(self.nand)
        self._done = cut.done
        begun = self._story[cut.done]
        old, marks = content(self.nand, begun.page, begun.pages), marks_of(self.nand)
        if not cut.depth:
            yield marks, marks
            return
        begun.apply(self.nand)
        after = marks_of(self.nand)
        put(self.nand, begun.page, begun.torn(old, cut.depth, random.Random(f"{SEED} {cut}")))
        yield marks, after
        put(self.nand, begun.page, old)


def marks_of(nand: NandImage) -> Marks:
    """What is marked, on pages that are whole."""
    bad = nand.bad_blocks()

    def pages(area: Area) -> list[bytes]:
        first = next(block for block in range(area.offset // BLOCK, area.end // BLOCK) if block not in bad)
        return [nand.read(first * PAGES + number)[:DATA] for number in range(ATTEMPTS + 1)]

    def slot(content: bytes, word: int) -> str | None:
        return next((name for name in NAMES if content == page(word, name)), None)

    mark, *attempts = pages(TRIAL)
    first, second = (slot(pages(area)[0], BASE_WORD) for area in BASE)
    return Marks((first, second), slot(mark, TRIAL_WORD), sum(each == ERASED for each in attempts))


# ---- an update, written down


@pytest.fixture(scope="module")
def versions(folder: Path, uboot: Path) -> dict[str, Version]:
    """In each slot the one that belongs there: the new one does not come up by itself."""
    subprocess.run(["make", "-s", "-f", PAYLOAD, f"O={folder}"], check=True)
    payload = (folder / "uImage").read_bytes()[64:]
    return {"a": Version.of("old", payload, uboot, "login"), "b": Version.of("new", payload, uboot, "reset")}


@pytest.fixture(scope="module")
def nand(folder: Path, qemu: Path, uboot: Path, versions: dict[str, Version]) -> NandImage:
    """With a bad block in each place that is written."""
    places = PLACES["b"].kernel, PLACES["b"].device_tree, BASE[0], TRIAL
    old = versions["a"]
    return flash_after_install(folder, qemu, uboot, old.kernel, old.tree, [area.offset for area in places])


@pytest.fixture(scope="module")
def extra_files(folder: Path, signer: Signer, ssh: Ssh) -> dict[str, Path | str]:
    config = slow_lines()
    config["journal"] = {"interval_s": 1, "volume_mb": 1_000_000}
    config["redundancy_groups"] = [{"name": "Control centre", "masters": ["192.0.2.1"]}]
    return files_of(SITE, signer.certificate.read_text(), config, ssh.key, folder)


@pytest.fixture(scope="module")
def signer(folder: Path) -> Signer:
    return make_signer(folder, "present")


@pytest.fixture(scope="module")
def kernel(kernel: Kernel) -> Kernel:
    """That of the image, which takes partitions from its arguments."""
    parts = partitions().replace(f"{ROOT.size // 1024}k@", f"{VOLUME // 1024}k@")
    return replace(
        kernel, image=TREE / "build/system/uImage", root=None, arguments=f"{kernel.arguments} {parts}"
    )


def on_slot(kernel: Kernel, start: Start) -> Kernel:
    """With the arguments that U-Boot gives it."""
    trial = f" openrtu.trial watchdog.open_timeout={OPEN_SECONDS}" if start.trial else ""
    return replace(kernel, arguments=f"{kernel.arguments} openrtu.slot={start.slot}{trial}")


OLD = Start("old", "old", "a", False)
NEW_ON_TRIAL = Start("new", "new", "b", True)


@pytest.fixture(scope="module")
def update(
    boot: Callable[..., Linux],
    kernel: Kernel,
    nand: NandImage,
    versions: dict[str, Version],
    signer: Signer,
    extra_files: dict[str, Path | str],
    ssh: Ssh,
    linesim_program: Path,
    folder: Path,
    qemu: Path,
    uboot: Path,
) -> Update:
    """Of B, from begin to end; and the attempts of U-Boot, with nobody to confirm."""

    def power(start: Start, flash: NandImage, log: Path, chardevs: dict[int, str]) -> Linux:
        linux = boot(
            *ETHERNET[0].arguments({ssh.port: SSH_PORT}), *recording(flash, log), *INSTRUCTION_TIME,
            "-no-reboot", kernel=on_slot(kernel, start), chardevs=chardevs, files=extra_files,
        )  # fmt: skip
        wait_for(ssh.answers)
        return linux

    logs = [folder / f"log-{number}" for number in range(3)]
    work = copy(nand, folder / "work")
    with devices(folder, linesim_program) as lines:
        linux = power(OLD, work, logs[0], lines_at(lines.directory))
        unheard = make_volume(ssh)
        prepared = len(changes(logs[0]))
        new = versions["b"]
        file = update_file(new.kernel, new.tree, NEXT, SITE, signer)
        assert install(ssh, file)[0] == 0
        ssh.run("(sleep 1; reboot) </dev/null >/dev/null 2>&1 &")
        ssh.close()
        linux.machine.process.wait(PATIENCE)
    first = changes(logs[0])
    before = with_changes(nand, first[:prepared], folder / "before")
    assert starts(qemu, uboot, recording(work, logs[1])) == [*[NEW_ON_TRIAL] * ATTEMPTS, OLD]
    attempts = changes(logs[1])
    assert [change.is_in(TRIAL) for change in attempts] == [True] * ATTEMPTS
    with_changes(before, [*first[prepared:], attempts[0]], work.path)
    linux = power(NEW_ON_TRIAL, work, logs[2], {})
    ssh.run("until pidof rtu-journal; do sleep 0.2; done; rtu-update confirm; sync")
    ssh.close()
    linux.close()
    return Update(before, first[prepared:], attempts, changes(logs[2]), unheard)


def make_volume(ssh: Ssh) -> set[bytes]:
    """/data in the flash, with a configuration and events that nobody has acknowledged: these."""
    ssh.run(f"mkdir -p /data/site; cp /etc/openrtu/gateway.json {CONFIG}; /etc/init.d/S80rtud stop")
    ssh.run("rtu-data create && umount /data && rtu-data mount", CREATE_SECONDS)
    ssh.run("/etc/init.d/S80rtud start; " + JOURNAL_HOLDS.format("[1-9]"))
    ssh.run("sync")
    return journal_events(ssh.run(SHOW_EVENTS))


def journal_events(shown: str) -> set[bytes]:
    """What the events of a journal tell."""
    file = bytes.fromhex(re.findall(r"[0-9a-f]{96,}", shown)[-1])
    found = (event for record in records(file) for event in events(record))
    return {told_by(event) for event in found if cause_of(event) < RETAINED}


def with_changes(nand: NandImage, all_changes: Sequence[Change], file: Path) -> NandImage:
    changed = copy(nand, file)
    for change in all_changes:
        change.apply(changed)
    return changed


def starts(qemu: Path, uboot: Path, drive: tuple[str, str]) -> list[Start]:
    """What U-Boot starts, up to the first kernel that is not on trial."""
    found: list[Start] = []
    with Machine(qemu, "-bios", uboot, *INSTRUCTION_TIME, *drive, options="pace=off") as machine:
        while not found or found[-1].trial:
            said = machine.uarts[0].wait_for(b"Kernel command line: ", PATIENCE)
            said += machine.uarts[0].wait_for(b"\n", PATIENCE)
            kernel, tree, slot, trial = STARTED.findall(said)[-1]
            found.append(Start(kernel.decode(), tree.decode(), slot.decode(), bool(trial)))
    return found


# ---- cuts


def often(always: int, in_soak: int) -> list[object]:
    return [always, pytest.param(in_soak, marks=pytest.mark.soak)]


def sample(cuts: Sequence[Cut], count: int) -> list[Cut]:
    return sorted(random.Random(SEED).sample(cuts, min(count, len(cuts))))


def unchanged(nand: NandImage) -> tuple[str, str]:
    """QEMU's arguments for a board whose changes of this flash are forgotten with it."""
    return "-drive", f"if=mtd,format=raw,snapshot=on,file={nand.path}"


@pytest.fixture
def replays(update: Update, tmp_path: Path) -> Iterator[list[Replay]]:
    made = [Replay(update.before, tmp_path / str(n), story) for n, story in enumerate(update.stories)]
    yield made
    for replay in made:
        replay.nand.path.unlink()


@pytest.mark.parametrize("count", often(12, ALL))
def test_cut_anywhere(
    count: int,
    update: Update,
    replays: list[Replay],
    versions: dict[str, Version],
    qemu: Path,
    uboot: Path,
) -> None:
    """Something boots, old or new and no mixture; no version is on trial more often than it may."""
    for cut in sample(update.cuts(), count):
        nand = replays[cut.story].nand
        with replays[cut.story].at(cut) as marks:
            check_starts(starts(qemu, uboot, unchanged(nand)), marks, cut)
            assert versions["a"].is_in(nand, "a"), cut


def check_starts(seen: Sequence[Start], marks: tuple[Marks, Marks], cut: Cut) -> None:
    """marks: before and after the change that was in work."""
    tried = [each.attempts if each.trial else 0 for each in marks]
    assert min(tried) <= len(seen) - 1 <= max(tried), (cut, seen)
    assert seen[-1].slot in {each.base_slot for each in marks}, (cut, seen)
    for start in seen:
        assert {start.kernel, start.tree} == {{"a": "old", "b": "new"}[start.slot]}, (cut, seen)


@pytest.mark.parametrize("count", often(4, ALL))
def test_configuration_and_journal_are_kept(
    count: int,
    boot: Callable[..., Linux],
    kernel: Kernel,
    update: Update,
    replays: list[Replay],
    extra_files: dict[str, Path | str],
    tmp_path: Path,
) -> None:
    """One Linux mounts /data of all cuts: its flash changes while it has nothing mounted."""
    flash = copy(update.before, tmp_path / "flash")
    drive = ("-drive", f"if=mtd,format=raw,file={flash.path}")
    linux = boot(*drive, *INSTRUCTION_TIME, kernel=on_slot(kernel, OLD), files={"init": SHELL})
    linux.run("dmesg -n 1", PATIENCE)  # UBI says at length what it cannot read, and recovers
    config = sha256(Path(extra_files["etc/openrtu/gateway.json"]).read_bytes()).hexdigest()
    story = update.stories[0]
    cuts = [cut for cut in update.cuts() if cut.story == 0 and story[cut.done].is_in(ROOT)]
    for cut in sample(cuts, count):
        with replays[0].at(cut):
            put(flash, ROOT.offset // DATA, content(replays[0].nand, ROOT.offset // DATA, VOLUME // DATA))
        linux.run("rtu-data mount", CREATE_SECONDS)
        assert config in linux.run(f"sha256sum <{CONFIG}", PATIENCE), cut
        assert update.events <= journal_events(linux.run(SHOW_EVENTS, PATIENCE)), cut
        linux.run("umount /data; ubidetach -d 0 /dev/ubi_ctrl", PATIENCE)
    linux.close()
    flash.path.unlink()


@pytest.mark.parametrize("count", often(1, 20))
def test_linux_goes_on(
    count: int,
    boot: Callable[..., Linux],
    kernel: Kernel,
    update: Update,
    replays: list[Replay],
    extra_files: dict[str, Path | str],
    qemu: Path,
    uboot: Path,
) -> None:
    """With the configuration and the events of the flash, in the slot that U-Boot has chosen."""
    for cut in sample(update.cuts(), count):
        drive = unchanged(replays[cut.story].nand)
        with replays[cut.story].at(cut):
            start = starts(qemu, uboot, drive)[0]
            linux = boot(*drive, *LEAPING, kernel=on_slot(kernel, start), files=extra_files)
            linux.run(JOURNAL_HOLDS.format("[1-9]"), CREATE_SECONDS)
            assert linux.run("cat /run/openrtu/data", PATIENCE) == "flash", cut
            assert f"{CONFIG} is used" in linux.run("grep data: /var/log/messages", PATIENCE), cut
            status = linux.run("rtu-update status", PATIENCE)
            assert status.startswith(f"running  {start.slot.upper()}"), cut
            linux.close()
