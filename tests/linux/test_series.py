# SPDX-License-Identifier: GPL-3.0-or-later
"""Our port to the kernel, board/nuc980/linux and patches/linux/6.1: as the kernel's maintainers want it."""

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

from rig import git_am
from series import series_of

ROOT = Path(__file__).resolve().parents[2]
SERIES = sorted((ROOT / "patches/linux/6.1").glob("*.patch"))
_, *MAILS = series_of("linux").mails(0)
# The machine's patch has the folders for MAINTAINERS; gpiolib's own word for "no such setting" is ENOTSUPP.
IGNORED = "FILE_PATH_CHANGES,ENOTSUPP"
DRIVERS = [patch for patch in SERIES if not re.search("printk|rcu", patch.name)]  # one mend each
BUILD = ROOT / "build/linux"
# In an oops with its lock held a console writes without it: a lock by a condition is beyond sparse.
LOCK_IN_OOPS = "context imbalance in 'nuc980_console_write'"
# Files of the kernel's that a patch may add to: where drivers are named.
REGISTERS = re.compile(r"(.*/)?(Kconfig|Makefile)|MAINTAINERS|include/uapi/linux/serial_core\.h")


@dataclass(frozen=True)
class Change:
    """What a patch does to one file."""

    file: str
    new: bool
    hunks: int
    removed: int

    @property
    def fits(self) -> bool:
        """Lines added at one place where drivers are named; a file of our own is a source."""
        named = bool(REGISTERS.fullmatch(self.file))
        return named and not self.new and self.hunks == 1 and not self.removed


def changes(patch: str) -> list[Change]:
    return [
        Change(
            file=part.split("\n", 1)[0].split(" b/", 1)[1],
            new="\n--- /dev/null\n" in part,
            hunks=len(re.findall(r"^@@ ", part, re.MULTILINE)),
            removed=len(re.findall(r"^-(?!-- )", part, re.MULTILINE)),
        )
        for part in re.split(r"^diff --git ", patch, flags=re.MULTILINE)[1:]
    ]


@pytest.fixture(scope="session")
def source() -> Path:
    """What `make linux` builds: Debian's kernel with all patches applied."""
    if not (BUILD / "source").exists():
        pytest.fail(f"{BUILD / 'source'} is not there: `make linux`", pytrace=False)
    return BUILD / "source"


def checkpatch(source: Path, folder: Path, mail: tuple[str, str]) -> str:
    """What the kernel's own check says of a patch as it would be sent.

    Not that MAINTAINERS might need an entry for each new file: the machine's patch adds patterns for all.
    """
    path = folder / mail[0]
    path.write_text(mail[1])
    done = subprocess.run(
        ["scripts/checkpatch.pl", "--strict", "--terse", "--no-summary", f"--ignore={IGNORED}", path],
        cwd=source, capture_output=True, text=True,
    )  # fmt: skip
    assert bool(done.stdout) == bool(done.returncode), done.stderr
    return done.stdout


def patch_files(folder: Path, patch: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["patch", "--strip=1", "--fuzz=0", "--force", *options, f"--input={patch}"],
        cwd=folder, capture_output=True, text=True,
    )  # fmt: skip


def test_there_is_a_series() -> None:
    assert [patch.name[:4] for patch in SERIES] == [f"{n:04}" for n in range(1, len(SERIES) + 1)]
    assert len(SERIES) == len(DRIVERS) + 2


@pytest.mark.parametrize("patch", DRIVERS, ids=lambda patch: patch.name[:4])
def test_a_patch_names_one_driver(patch: Path) -> None:
    """So each can be read, taken and reverted alone."""
    parts = changes(patch.read_text())
    assert parts
    assert [part for part in parts if not part.fits] == []
    assert len({part.file for part in parts}) == len(parts)


@pytest.mark.parametrize(
    ("file", "lines"),
    [
        ("drivers/tty/serial/8250/8250_core.c", "+x\n"),
        ("drivers/tty/serial/Kconfig", "-x\n"),
        ("drivers/tty/serial/Kconfig", "+x\n@@ -9 +9 @@\n+x\n"),
    ],
)
def test_a_patch_beside_its_driver_is_seen(file: str, lines: str) -> None:
    (change,) = changes(f"diff --git a/{file} b/{file}\n--- a/{file}\n+++ b/{file}\n@@ -1 +1 @@\n{lines}")
    assert not change.fits


@pytest.mark.parametrize("mail", MAILS, ids=lambda mail: mail[0][:4])
def test_checkpatch_says_nothing(source: Path, tmp_path: Path, mail: tuple[str, str]) -> None:
    assert checkpatch(source, tmp_path, mail) == ""


def test_checkpatch_would_speak(source: Path, tmp_path: Path) -> None:
    name, text = MAILS[-1]
    faulty = name, text.replace("Signed-off-by", "Signed-of-by")
    assert "Missing Signed-off-by" in checkpatch(source, tmp_path, faulty)


def test_sparse_says_nothing(source: Path) -> None:
    """Of each C file of ours, compiled as it is in the kernel."""
    port = ROOT / "board/nuc980/linux"
    objects = [str(path.relative_to(port).with_suffix(".o")) for path in sorted(port.rglob("*.c"))]
    done = subprocess.run(
        ["make", f"O={BUILD / 'build'}", "ARCH=arm", "CROSS_COMPILE=arm-linux-gnueabi-", "C=2", *objects],
        cwd=source, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert [each for each in objects if f"/{Path(each).with_suffix('.c')}\n" not in done.stdout] == []
    assert [line for line in done.stderr.splitlines() if LOCK_IN_OOPS not in line] == []


def test_sparse_would_speak(tmp_path: Path) -> None:
    faulty = tmp_path / "faulty.c"
    faulty.write_text("static int *none = 0;\nint f(void);\nint f(void) { return none == (void *)0; }\n")
    done = subprocess.run(["sparse", faulty], capture_output=True, text=True)
    assert "Using plain integer as NULL pointer" in done.stderr


def test_each_applies_at_its_own_position(source: Path, tmp_path: Path) -> None:
    """From the whole series back to Debian's kernel: each comes off, and goes on again, without a doubt."""
    for file in {change.file for patch in SERIES for change in changes(patch.read_text())}:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source / file, tmp_path / file)
    for patch in reversed(SERIES):
        off = patch_files(tmp_path, patch, "--reverse")
        assert off.returncode == 0, f"{patch.name}:\n{off.stdout}"
    for patch in SERIES:
        on = patch_files(tmp_path, patch)
        assert on.returncode == 0, f"{patch.name}:\n{on.stdout}"
    for file in tmp_path.rglob("*"):
        if file.is_file():
            assert file.read_bytes() == (source / file.relative_to(tmp_path)).read_bytes()


def debian_with_rt(folder: Path) -> Path:
    """Debian's kernel with its PREEMPT_RT series: the files that either series changes."""
    debian, series = BUILD / "debian", series_of("linux")
    rt = debian / "debian/patches-rt"
    patches = [rt / name for name in (rt / "series").read_text().split("\n") if name and name[0] != "#"]
    of_rt = {name for patch in patches for name in git_am.CHANGED.findall(patch.read_text(errors="replace"))}
    for name in of_rt | git_am.changed_files(series):
        if (debian / name).exists():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(debian / name, folder / name)
    for patch in patches:
        done = patch_files(folder, patch)
        assert done.returncode == 0, f"{patch.name}:\n{done.stdout}"
    return folder


def test_git_takes_the_series(source: Path, tmp_path: Path) -> None:
    """On Debian's kernel with PREEMPT_RT; what it leaves is what we build."""
    series = series_of("linux")
    (tmp_path / "before").mkdir()
    repository = git_am.applied(tmp_path, series, debian_with_rt(tmp_path / "before"))
    git_am.check(repository, series, source)


def test_a_patch_that_does_not_fit_is_named(tmp_path: Path) -> None:
    """As when Debian has changed the file since: the build ends with the patch's name, without a source."""
    debian = BUILD / "debian"
    if not debian.exists():
        pytest.fail(f"{debian} is not there: `make linux`", pytrace=False)
    patches = [Path(shutil.copy(patch, tmp_path)) for patch in SERIES]
    wrong = next(patch for patch in patches if "drivers/dma/Kconfig" in patch.read_text())
    text = wrong.read_text()
    assert text.count("\n config OWL_DMA\n") == 1
    wrong.write_text(text.replace("\n config OWL_DMA\n", "\n config OWL_DMA_2\n"))
    (tmp_path / "overlay").mkdir()
    done = subprocess.run(
        [ROOT / "scripts/patched-source.sh", debian, tmp_path / "overlay", tmp_path / "source", *patches],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 1
    assert f"{wrong} does not fit Debian's source" in done.stderr
    assert not list((tmp_path / "source").iterdir())
