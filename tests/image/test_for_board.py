# SPDX-License-Identifier: GPL-3.0-or-later
"""A program of others for the board is the same whoever builds it, and where."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CHANGELOG = """thing (1.0-1) unstable; urgency=low

  * It is there.

 -- Somebody <somebody@example.invalid>  Mon, 02 Mar 2026 06:59:41 +0000
"""
# Into what leaks: a zone as in BusyBox's banner, a language's words, what umask leaves of a file.
ROW = """
build() {
\tmkdir -p "$folder/root"
\tdate --date "@$SOURCE_DATE_EPOCH" >"$folder/root/when"
\tstrerror=$(cat there-is-none 2>&1) || true
\techo "$strerror $LC_ALL" >"$folder/root/words"
}
"""


def built(folder: Path, umask: int, **environment: str) -> dict[str, tuple[int, str]]:
    """Modes and contents."""
    tree = folder / "tree"
    shutil.copytree(ROOT / "scripts/for-board", tree / "scripts/for-board")
    shutil.copy(ROOT / "scripts/build-for-board.sh", tree / "scripts")
    (tree / "scripts/for-board/thing.sh").write_text(ROW)
    (folder / "source/debian").mkdir(parents=True)
    (folder / "source/debian/changelog").write_text(CHANGELOG)
    subprocess.run(
        [tree / "scripts/build-for-board.sh", "thing", folder / "source", folder / "out"],
        env=os.environ | environment,
        umask=umask,
        check=True,
    )
    files = sorted((folder / "out/root").iterdir())
    return {file.name: (file.stat().st_mode & 0o777, file.read_text()) for file in files}


@pytest.mark.slow  # not for its time: what it builds with is no package of `make test-quick`
@pytest.mark.parametrize(
    ("umask", "environment"),
    [(0o077, {"TZ": "America/St_Johns"}), (0o002, {"TZ": "Pacific/Apia", "LC_ALL": "C.UTF-8"})],
)
def test_program_for_the_board_is_the_same_for_everybody(
    tmp_path: Path, umask: int, environment: dict[str, str]
) -> None:
    one = built(tmp_path / "one", 0o022, TZ="UTC", LC_ALL="C")
    assert one["when"] == (0o644, "Mon Mar  2 06:59:41 UTC 2026\n")
    assert built(tmp_path / "another folder", umask, **environment) == one
