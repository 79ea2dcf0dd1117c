# SPDX-License-Identifier: GPL-3.0-or-later
"""Our port to the kernel, board/nuc980/linux and patches/linux/6.1: as the kernel's maintainers want it."""

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SERIES = sorted((ROOT / "patches/linux/6.1").glob("*.patch"))
PORT = ROOT / "board/nuc980/linux"
SOURCES = sorted(
    path for top in ("arch", "drivers", "include") for path in (PORT / top).rglob("*") if path.is_file()
)
# 0001 has the folders for MAINTAINERS; gpiolib's own word for "no such setting" is ENOTSUPP.
IGNORED = "FILE_PATH_CHANGES,ENOTSUPP"
DRIVERS = [patch for patch in SERIES if not re.search("printk|rcu", patch.name)]  # one mend each
BUILD = ROOT / "build/linux"
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


def checkpatch(source: Path, *file: str | Path) -> str:
    """What the kernel's own check says of a patch, or of a file with `-f` before it.

    Not that MAINTAINERS might need an entry for each new file: the first patch adds patterns for all.
    """
    done = subprocess.run(
        ["scripts/checkpatch.pl", "--strict", "--terse", "--no-summary", f"--ignore={IGNORED}", *file],
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


@pytest.mark.parametrize("patch", SERIES, ids=lambda patch: patch.name[:4])
def test_checkpatch_says_nothing(source: Path, patch: Path) -> None:
    assert checkpatch(source, patch) == ""


@pytest.mark.parametrize("file", SOURCES, ids=lambda file: str(file.relative_to(PORT)))
def test_checkpatch_says_nothing_of_a_source(source: Path, file: Path) -> None:
    assert checkpatch(source, "-f", file) == ""


def test_the_source_that_is_built_has_our_files(source: Path) -> None:
    other = {
        str(file.relative_to(PORT))
        for file in SOURCES
        if file.read_bytes() != (source / file.relative_to(PORT)).read_bytes()
    }
    assert other == set(), "run: make linux"


def test_checkpatch_would_speak(source: Path, tmp_path: Path) -> None:
    faulty = tmp_path / SERIES[-1].name
    faulty.write_text(SERIES[-1].read_text().replace("Signed-off-by", "Signed-of-by"))
    assert "Missing Signed-off-by" in checkpatch(source, faulty)


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
