# SPDX-License-Identifier: GPL-3.0-or-later
"""The journal of a flash: what a crash of the host leaves of it can be read, and only one tool writes it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from nuc980.netboot.errors import JournalUnusable, SiteBusy, Unfinished
from nuc980.netboot.flash.journal import (
    FILE,
    NEW,
    OLD,
    Journal,
    newest_unfinished,
    only_one,
    refuse_unfinished,
)

ROOT = Path(__file__).parents[2]


@pytest.fixture
def journal(tmp_path: Path) -> Journal:
    return Journal.create(tmp_path, {"version": 1, "images": []})


def test_events_come_back(journal: Journal) -> None:
    journal.add("begin", step="Erase", image="kernel", erases=True)
    again = Journal(journal.folder)
    assert again.events == journal.events
    assert again.header["version"] == 1
    assert [event["event"] for event in again.events] == ["begun", "begin"]


def test_two_in_one_second_have_their_own_folders(tmp_path: Path) -> None:
    folders = {Journal.create(tmp_path, {}).folder for _ in range(4)}
    assert len(folders) == 4


@pytest.mark.slow
def test_cut_anywhere_it_is_read_up_to_the_last_whole_line(journal: Journal) -> None:
    for number in range(3):
        journal.add("begin", number=number)
    path = journal.folder / FILE
    content = path.read_bytes()
    header = content.index(b"\n") + 1
    for length in range(header, len(content) + 1):
        path.write_bytes(content[:length])
        whole = content[:length].count(b"\n")
        cut = Journal(journal.folder)
        assert len(cut.events) == whole
        cut.add("end")
        assert [event["event"] for event in Journal(journal.folder).events][-1] == "end"
        assert all(json.loads(line) for line in path.read_text().splitlines())


@pytest.mark.parametrize("content", [b"", b'{"event": "begun"}', b'{"event": "begin"}\n', b"\0\0\0\n{}\n"])
def test_without_its_header_it_is_none(journal: Journal, content: bytes) -> None:
    (journal.folder / FILE).write_bytes(content)
    with pytest.raises(JournalUnusable):
        Journal(journal.folder)


@pytest.mark.parametrize("line", [b"5", b"[]", b"{}", b"[" * 100_000])
def test_line_that_is_no_event_is_damage(journal: Journal, line: bytes) -> None:
    """Nor a traceback; and what is to be done is not what a damaged journal makes impossible."""
    path = journal.folder / FILE
    header, *events = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([header, line + b"\n", *events, header]))
    with pytest.raises(JournalUnusable) as unusable:
        refuse_unfinished(journal.folder.parent)
    assert f"move {journal.folder} elsewhere" in unusable.value.next_step


def test_damage_in_the_middle_is_not_passed_over(journal: Journal) -> None:
    journal.add("begin")
    journal.add("end")
    path = journal.folder / FILE
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([lines[0], b"\0" * 40 + b"\n", lines[2]]))
    with pytest.raises(JournalUnusable, match="line 2"):
        Journal(journal.folder)


def test_full_disk_is_named(journal: Journal) -> None:
    path = journal.folder / FILE
    path.unlink()
    path.symlink_to("/dev/full")
    with pytest.raises(OSError, match=r"No space left on device: .*journal\.jsonl"):
        journal.add("begin")


def test_folder_without_a_journal_was_never_begun(tmp_path: Path) -> None:
    (tmp_path / "flash-20260101-000000").mkdir()
    (tmp_path / f"flash-20260101-000000/{FILE}.new").write_text('{"event": "beg')
    assert newest_unfinished(tmp_path) is None
    refuse_unfinished(tmp_path)


def test_new_flash_is_refused_while_one_is_unfinished(journal: Journal) -> None:
    site = journal.folder.parent
    with pytest.raises(Unfinished, match=r"--resume.*--roll-back") as refused:
        refuse_unfinished(site)
    assert str(journal.folder) in str(refused.value)
    journal.add("finished")
    refuse_unfinished(site)
    journal.add("begun again")
    with pytest.raises(Unfinished):
        refuse_unfinished(site)


def test_the_newest_unfinished_one_is_meant(journal: Journal) -> None:
    second = Journal.create(journal.folder.parent, {})
    third = Journal.create(journal.folder.parent, {})
    third.add("finished")
    found = newest_unfinished(journal.folder.parent)
    assert found
    assert found.folder == second.folder


def test_what_a_place_holds_is_known_only_when_it_was_read_back(journal: Journal) -> None:
    def step(event: str, **facts: object) -> str | None:
        journal.add(event, image="kernel", **facts)
        return journal.content_of("kernel")

    assert journal.content_of("kernel") == OLD
    assert step("begin", step="load") == OLD
    assert step("begin", erases=True) is None
    assert step("end", erases=True) is None
    assert step("verified", content=NEW) == NEW
    assert step("begin", erases=True) is None
    assert step("verified", content=OLD) == OLD
    assert journal.content_of("UBI") == OLD


def test_only_one_tool_works_on_a_site(tmp_path: Path) -> None:
    program = (
        "import sys; from pathlib import Path; from nuc980.netboot.flash.journal import only_one\n"
        "with only_one(Path(sys.argv[1])): print('in', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", program, tmp_path]
    environment = {"PYTHONPATH": str(ROOT / "scripts")}
    with subprocess.Popen(
        command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout
        assert other.stdout.readline() == "in\n"
        with pytest.raises(SiteBusy), only_one(tmp_path):
            pass
        other.kill()
    with only_one(tmp_path):
        pass
