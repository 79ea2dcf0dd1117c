# SPDX-License-Identifier: GPL-3.0-or-later
"""What is seen while it works: a bar that keeps to its line on a terminal, plain lines elsewhere; times."""

import io
import os
import pty

import pytest

from nuc980.netboot.progress import Progress
from nuc980.netboot.report import Report


def drawn(monkeypatch: pytest.MonkeyPatch, columns: int) -> str:
    """What a terminal so wide gets."""
    monkeypatch.setenv("COLUMNS", str(columns))
    master, slave = pty.openpty()
    with os.fdopen(slave, "w") as terminal:
        progress = Progress(terminal)
        with progress.bar("uImage", 1000) as bar:
            for done in range(0, 1001, 10):
                bar.at(done)
        progress.note("next")
        received = b""
        while not received.endswith(b"next\r\n"):
            received += os.read(master, 4096)
    os.close(master)
    return received.decode()


@pytest.mark.parametrize("columns", [20, 40, 80, 200])
def test_bar_keeps_to_its_line(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    pictures = drawn(monkeypatch, columns).split("\r\n")[0].split("\r")
    assert all(len(picture) < columns for picture in pictures)
    assert "uImage" in pictures[-1] and "100%" in pictures[-1]
    assert ("#" * 5 in pictures[-1]) == (columns >= 40)


def test_bar_ends_with_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    assert drawn(monkeypatch, 80).endswith("\r\nnext\r\n")


def test_elsewhere_there_is_a_line_each_quarter() -> None:
    out = io.StringIO()
    with Progress(out).bar("uImage", 1000) as bar:
        for done in range(0, 1001, 10):
            bar.at(done)
    lines = out.getvalue().splitlines()
    assert [line.split(",")[0] for line in lines] == [f"  uImage: {share}%" for share in (25, 50, 75, 100)]
    assert all(line.endswith("B/s") for line in lines)


def test_phases_add_up_and_the_failed_one_is_known() -> None:
    progress = Progress(io.StringIO())
    with pytest.raises(ValueError), progress.phase("load"):
        with progress.phase("check"):
            pass
        with progress.phase("check"):
            raise ValueError
    assert list(progress.phases) == ["load", "check"]
    assert progress.failed == "check"
    report = Report("boot", phases={"load": 1.5, "check": 0.25})
    assert report.times() == "    1.50 s  load\n    0.25 s  check\n    1.75 s  together"
