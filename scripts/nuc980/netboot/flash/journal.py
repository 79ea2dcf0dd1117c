# SPDX-License-Identifier: GPL-3.0-or-later
"""What a flash has done to a board, on the disk before and after each step: lines of JSON in a folder."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

from nuc980.netboot.errors import JournalUnusable, SiteBusy, Unfinished

FILE = "journal.jsonl"
PREFIX = "flash-"
NEW, OLD = "new", "old"  # which content

Event = dict[str, Any]


class Journal:
    """The events of one flash, oldest first; the first is the header, `begun`."""

    def __init__(self, folder: Path) -> None:
        """Opens what is there, up to the last whole line. Raises JournalUnusable."""
        self.folder = folder
        try:
            content = (folder / FILE).read_bytes()
        except OSError as error:
            raise JournalUnusable(f"{folder}: there is no journal: {error.strerror}") from error
        self.events, whole = _events(folder, content)
        if whole < len(content):
            os.truncate(folder / FILE, whole)

    @classmethod
    def create(cls, site: Path, header: Event) -> Journal:
        """A new one in a new folder of the site; its whole header is on the disk, or it does not exist."""
        folder = _new_folder(site)
        draft = folder / f"{FILE}.new"
        _append(draft, {"event": "begun", "time": _now(), **header})
        draft.rename(folder / FILE)
        for changed in (folder, site):
            _sync(changed)
        return cls(folder)

    def add(self, event: str, **facts: Any) -> None:
        """Writes an event; it is on the disk when this returns."""
        entry = {"event": event, "time": _now(), **facts}
        _append(self.folder / FILE, entry)
        self.events.append(entry)

    @property
    def header(self) -> Event:
        return self.events[0]

    def named(self, event: str) -> Iterator[Event]:
        """The events of one name."""
        return (entry for entry in self.events if entry["event"] == event)

    @property
    def is_finished(self) -> bool:
        ends = [entry["event"] for entry in self.events if entry["event"] in ("finished", "begun again")]
        return ends[-1:] == ["finished"]

    def content_of(self, image: str) -> str | None:
        """What an image's place holds as far as this journal knows.

        NEW or OLD when it was read back and nothing erased since; OLD when nothing ever was; None in between.
        """
        content: str | None = OLD
        for entry in self.events:
            if entry.get("image") == image:
                if entry["event"] == "begin" and entry.get("erases"):
                    content = None
                elif entry["event"] == "verified":
                    content = entry["content"]
        return content

    def in_work(self) -> set[int]:
        """The offsets of blocks whose erasing or writing was begun and not ended."""
        begun = [entry for entry in self.events if entry.get("erases") and entry["event"] in ("begin", "end")]
        last = {entry["offset"]: entry["event"] for entry in begun}
        return {offset for offset, event in last.items() if event == "begin"}

    def backup_of(self, image: str) -> Event | None:
        """The whole backup of an image's place, if there is one."""
        found = [entry for entry in self.named("backup") if entry["image"] == image]
        return found[-1] if found else None


def newest_unfinished(site: Path) -> Journal | None:
    """The journal that --resume and --roll-back mean when no folder is named."""
    for folder in sorted(site.glob(f"{PREFIX}*"), reverse=True):
        if (folder / FILE).exists():
            journal = Journal(folder)
            if not journal.is_finished:
                return journal
    return None


def refuse_unfinished(site: Path) -> None:
    """Raises Unfinished: a new flash would leave what was begun without a way back."""
    journal = newest_unfinished(site)
    if journal:
        raise Unfinished(f"The flash of {journal.header['time']} is not finished: {journal.folder}")


@contextmanager
def only_one(site: Path) -> Iterator[None]:
    """Keeps every other nuc980-netboot from flashing this site's board meanwhile. Raises SiteBusy."""
    site.mkdir(parents=True, exist_ok=True)
    with (site / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise SiteBusy(f"Another nuc980-netboot works on the board of {site}.") from None
        yield


def _events(folder: Path, content: bytes) -> tuple[list[Event], int]:
    """The events, and the bytes they take; a last line that was cut does not count."""
    events: list[Event] = []
    whole = 0
    lines = content.splitlines(keepends=True)
    for number, line in enumerate(lines, 1):
        try:
            if not line.endswith(b"\n"):
                raise ValueError
            event = json.loads(line)
            if not isinstance(event, dict) or "event" not in event:
                raise ValueError
        except (ValueError, RecursionError):
            if number == len(lines):
                break
            raise _damaged(folder, f"line {number} is damaged") from None
        events.append(event)
        whole += len(line)
    if not events or events[0].get("event") != "begun":
        raise _damaged(folder, "it does not begin as a journal does")
    return events, whole


def _damaged(folder: Path, how: str) -> JournalUnusable:
    next_step = f"move {folder} elsewhere, and flash again; its backups, if there are any, are unchanged"
    return JournalUnusable(f"{folder / FILE}: {how}.", next_step=next_step)


def _new_folder(site: Path) -> Path:
    name = f"{PREFIX}{datetime.now():%Y%m%d-%H%M%S}"
    for suffix in ("", *(f".{number}" for number in range(2, 100))):
        try:
            (site / (name + suffix)).mkdir(parents=True)
            return site / (name + suffix)
        except FileExistsError:
            continue
    raise SiteBusy(f"{site} has a hundred flashes of this second")


def _append(path: Path, entry: Event) -> None:
    try:
        with path.open("ab") as file:
            file.write(json.dumps(entry).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        error.filename = path
        raise


def _sync(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _now() -> str:
    return datetime.now().astimezone().isoformat(timespec="milliseconds")
