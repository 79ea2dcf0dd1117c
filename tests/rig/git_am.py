# SPDX-License-Identifier: GPL-3.0-or-later
"""A series of ours, taken as its project takes it: `git am` on the files that it changes."""

import os
import re
import subprocess
from pathlib import Path

from series import Series

NEW = re.compile(r"^new file mode 100644\n--- /dev/null\n\+\+\+ b/(.+)$", re.MULTILINE)
CHANGED = re.compile(r"^--- a/(.+)$", re.MULTILINE)


def changed_files(series: Series) -> set[str]:
    """What is there before: not what the series makes."""
    return {name for patch in series.patches for name in CHANGED.findall(patch.diff)}


def new_files(series: Series) -> list[str]:
    return [name for patch in series.patches for name in NEW.findall(patch.diff)]


def git(folder: Path, *words: str) -> str:
    """As somebody who has no settings."""
    names = {
        f"GIT_{who}_{what}": "tester@localhost"
        for who in ("AUTHOR", "COMMITTER")
        for what in ("NAME", "EMAIL")
    }
    alone = {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_SYSTEM": os.devnull}
    ran = subprocess.run(
        ["git", *words], cwd=folder, env=os.environ | names | alone, capture_output=True, text=True
    )
    assert ran.returncode == 0, f"{ran.stdout}{ran.stderr}"
    return ran.stdout


def applied(folder: Path, series: Series, before: Path) -> Path:
    """A repository with a commit for each patch, on a commit of the files as they were in `before`."""
    mails, repository = folder / "mails", folder / "repository"
    for each in (mails, repository):
        each.mkdir()
    for name in changed_files(series):
        (repository / name).parent.mkdir(parents=True, exist_ok=True)
        (repository / name).write_bytes((before / name).read_bytes())
    git(repository, "init", "--quiet")
    git(repository, "add", "--all")
    git(repository, "commit", "--quiet", "--message=before")
    for name, text in series.mails(0):
        (mails / name).write_text(text)
    git(repository, "am", "--quiet", "--empty=drop", *(str(path) for path in sorted(mails.iterdir())))
    return repository


def check(repository: Path, series: Series, built: Path) -> None:
    """The tree that is built has each file as the series leaves it, and each patch is one commit, signed."""
    names = changed_files(series) | set(new_files(series))
    other = {name for name in names if (repository / name).read_bytes() != (built / name).read_bytes()}
    assert other == set()
    log = git(
        repository,
        "log",
        "--reverse",
        "--format=%s%x09%an <%ae>%x09%(trailers:key=Signed-off-by,valueonly,separator=,)",
    )
    _, *commits = (line.split("\t") for line in log.splitlines())
    author = series.cover.author
    assert commits == [[patch.subject, author, author] for patch in series.patches]
