# SPDX-License-Identifier: GPL-3.0-or-later
"""What we add to other projects, as they take it: a series of patches for each, in a folder of its own.

series.py FOLDER [--author 'NAME <ADDRESS>']: FOLDER/PROJECT/0001-….patch and so on for `git am --empty=drop`,
and the cover letter, 0000-cover-letter.patch. patches/PROJECT/series.toml names the parts: a message with the
hunks in files of the project's (a patch of that folder), the whole files of ours that belong to it, or both.

Exit codes: 0 written; 2 a file of ours is in no patch, in two, or is no text.
"""

from __future__ import annotations

import argparse
import fnmatch
import re
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from email.utils import formatdate
from pathlib import Path

from nuc980.errors import UnusableInput

ROOT = Path(__file__).resolve().parents[1]
PROJECTS = ("linux", "uboot", "qemu")
COVER = "0000-cover-letter.patch"
LICENCE = re.compile(r"^SPDX-License-Identifier: .*\n\n?", re.MULTILINE)
DIFF = re.compile(r"^(?:---\n\n?)?(?=diff --git |--- a/)", re.MULTILINE)


@dataclass(frozen=True)
class Patch:
    """A message, and what it changes, as git writes it."""

    author: str
    subject: str
    text: str
    diff: str


@dataclass(frozen=True)
class Series:
    cover: Patch
    patches: list[Patch]

    def mails(self, date: int) -> Iterator[tuple[str, str]]:
        """The name of each file and its text, the cover letter first."""
        total = len(self.patches)
        yield COVER, mail(self.cover, f"{0:0{len(str(total))}}/{total}", date, statistics(self.cover.diff))
        for number, patch in enumerate(self.patches, 1):
            slug = re.sub(r"[^\w.]+", "-", patch.subject).strip("-")[:52].rstrip("-")
            changed = f"---\n{statistics(patch.diff)}\n{patch.diff}"
            yield (
                f"{number:04}-{slug}.patch",
                mail(signed(patch), f"{number:0{len(str(total))}}/{total}", date + number, changed),
            )


def series_of(project: str, root: Path = ROOT) -> Series:
    folder = root / "patches" / project
    table = tomllib.loads((folder / "series.toml").read_text())
    ours = our_files(root, table["sources"])
    rows = table["patch"]
    hooks = {row["hooks"]: hook(folder / row["hooks"]) for row in rows if "hooks" in row}
    check_hooks(folder, rows)
    check_files(
        folder, ours, [row.get("adds", []) for row in rows] + [table.get("kept", {}).get("files", [])]
    )
    author = next(iter(hooks.values())).author
    patches = []
    for row in rows:
        base = hooks[row["hooks"]] if "hooks" in row else Patch(author, row["subject"], row["text"], "")
        added = [new_file(name, ours[name]) for name in matching(ours, row.get("adds", []))]
        patches.append(Patch(base.author, base.subject, base.text, base.diff + "".join(added)))
    listed = "\n".join(f"  {patch.subject}" for patch in patches)
    text = f"{table['cover']['text'].strip()}\n\n{author.partition(' <')[0]} ({len(patches)}):\n{listed}\n"
    cover = Patch(author, table["cover"]["subject"], text, "".join(patch.diff for patch in patches))
    return Series(cover, patches)


def our_files(root: Path, sources: dict[str, str]) -> dict[str, Path]:
    """Its path in the project: where it is here. `sources` names the folders, by their paths there."""
    return {
        str(Path(at) / path.relative_to(root / folder)): path
        for at, folder in sources.items()
        for path in sorted((root / folder).rglob("*"))
        if path.is_file()
    }


def matching(ours: dict[str, Path], patterns: list[str]) -> list[str]:
    return [name for name in ours if any(fnmatch.fnmatch(name, each) for each in patterns)]


def check_files(folder: Path, ours: dict[str, Path], patterns: list[list[str]]) -> None:
    """Each file of ours is in one patch, or among those that are kept."""
    times = Counter(name for each in patterns for name in matching(ours, each))
    for name in ours:
        if times[name] != 1:
            raise UnusableInput(f"{folder}/series.toml: {name} is in {times[name]} patches")
    for pattern in (one for each in patterns for one in each):
        if not matching(ours, [pattern]):
            raise UnusableInput(f"{folder}/series.toml: there is no file {pattern}")


def check_hooks(folder: Path, rows: list[dict[str, str]]) -> None:
    named = Counter(row["hooks"] for row in rows if "hooks" in row)
    present = {str(path.relative_to(folder)) for path in folder.rglob("*.patch")}
    if set(named) != present or len(present) != named.total():
        raise UnusableInput(f"{folder}/series.toml names {sorted(named)}; there are {sorted(present)}")


def hook(path: Path) -> Patch:
    """A patch of ours: its author, subject and text, without what the series adds or does not want."""
    head, diff = DIFF.split(path.read_text(), maxsplit=1)
    header, _, text = head.partition("\n\n")
    found = re.fullmatch(r"From: (.+)\nSubject: \[PATCH\] (.+(?:\n .+)*)", header)
    if not found:
        raise UnusableInput(f"{path}: does not begin with From and Subject")
    return Patch(found[1], found[2].replace("\n", ""), LICENCE.sub("", text), diff)


def new_file(name: str, path: Path) -> str:
    text = path.read_bytes().decode(errors="replace")
    if not text.endswith("\n") or "\r" in text or "\ufffd" in text:
        raise UnusableInput(f"{path}: is not lines of text, each with a newline at its end")
    lines = text[:-1].split("\n")
    added = "".join(f"+{line}\n" for line in lines)
    start = f"@@ -0,0 +1,{len(lines)} @@" if len(lines) != 1 else "@@ -0,0 +1 @@"
    return (
        f"diff --git a/{name} b/{name}\nnew file mode 100644\n--- /dev/null\n+++ b/{name}\n{start}\n{added}"
    )


def signed(patch: Patch) -> Patch:
    text = f"{patch.text.strip()}\n\nSigned-off-by: {patch.author}\n"
    return Patch(patch.author, patch.subject, text, patch.diff)


def statistics(diff: str) -> str:
    """Made in no clone: in a folder of one git leaves out what is outside of the folder."""
    command = ["git", "apply", "--stat", "--summary", "-"]
    return subprocess.run(command, cwd="/", input=diff, check=True, capture_output=True, text=True).stdout


def mail(patch: Patch, position: str, date: int, rest: str) -> str:
    return (
        f"From {40 * '0'} Mon Sep 17 00:00:00 2001\n"
        f"From: {patch.author}\n"
        f"Date: {formatdate(date)}\n"
        f"Subject: [PATCH {position}] {patch.subject}\n"
        "MIME-Version: 1.0\n"
        "Content-Type: text/plain; charset=UTF-8\n"
        "Content-Transfer-Encoding: 8bit\n"
        f"\n{patch.text.strip()}\n{rest}"
    )


def write(folder: Path, project: str, author: str | None, date: int) -> None:
    series = series_of(project)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, text in series.mails(date):
        (folder / name).write_text(text.replace(series.cover.author, author) if author else text)
    print(f"{folder}: {len(series.patches)} patches and the cover letter")


def source_date() -> int:
    return int(subprocess.run([ROOT / "scripts/source-date.sh"], check=True, capture_output=True).stdout)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="series", description="Write a series of patches for each project.")
    parser.add_argument("folder", type=Path, help="gets a folder for each project")
    parser.add_argument(
        "--author", metavar="'NAME <ADDRESS>'", help="who signs: a person, in the authors' place"
    )
    parsed = parser.parse_args(arguments)
    if parsed.author and not re.fullmatch(r"[^<>\n]+ <[^<>@\s]+@[^<>@\s]+>", parsed.author):
        parser.error(f"{parsed.author} is not a name with an address, as 'Ada Byron <ada@example.org>'")
    try:
        for project in PROJECTS:
            write(parsed.folder / project, project, parsed.author, source_date())
    except UnusableInput as error:
        print(f"series: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
