# SPDX-License-Identifier: GPL-3.0-or-later
"""How long a flash takes, before and during; and a dry run that a person can read."""

import ast
import io
import random
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest

from netboot.double import BLOCK, Double
from netboot.images import ubi_image
from nuc980.netboot import progress
from nuc980.netboot.cli import main
from nuc980.netboot.console import Console
from nuc980.netboot.flash.backup import BySerial, plan_backup
from nuc980.netboot.flash.forecast import CHARACTER_BITS, COMMAND_SECONDS, Forecast
from nuc980.netboot.plan import Cost, Step
from nuc980.netboot.progress import Progress, duration
from nuc980.netboot.session import Session
from nuc980.netboot.transport import Line

BAUD = 115200
NETWORK = ("--board-ip", "192.168.1.20/24", "--server-ip", "192.168.1.1")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.4, "0 s"), (99, "99 s"), (3600, "60 min"), (6000, "1 h 40 min"), (38400, "10 h 40 min")],
)
def test_duration_is_said_as_a_person_does(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.slow
def test_forecast_counts_what_goes_over_the_line(tmp_path: Path) -> None:
    """Of a block that is not erased, backed up over the line: what comes from the board."""
    log, target = tmp_path / "log", tmp_path / "backup"
    content = random.Random(1).randbytes(BLOCK)
    with Double("factory") as double, Line(double.port, BAUD, log) as line:
        double.nand.load(0x700000, content)
        console = Console(line)
        console.reach()
        before = bytes_in(log)
        (step,) = plan_backup("tree", [0x700000], BLOCK, 0x100000, BLOCK, target, BySerial(BLOCK))
        step.run(Session(console, Progress(io.StringIO())))
    assert target.read_bytes() == content
    moved = (bytes_in(log) - before) * CHARACTER_BITS / BAUD
    forecast = Forecast([step], BAUD).seconds(step) - COMMAND_SECONDS * len(step.commands())
    assert moved == pytest.approx(forecast, rel=0.03)


def bytes_in(log: Path) -> int:
    """How many came, by a log of the line; what is typed goes over while its echo comes."""
    return sum(
        len(ast.literal_eval(text))
        for way, text in re.findall(r"^ *[\d.]+ ([<>]) (.*)$", log.read_text(), re.MULTILINE)
        if way == "<"
    )


@dataclass(frozen=True)
class Read(Step):
    """Reads so many seconds' worth of the flash."""

    size: int
    phase: ClassVar[str] = "read back"

    def title(self) -> str:
        return f"Read {self.size} bytes."

    def commands(self) -> tuple[str, ...]:
        return ()

    def cost(self) -> Cost:
        return Cost(read=self.size)

    def run(self, session: Session) -> None:
        return


def test_rest_follows_what_was_measured() -> None:
    """A board half as fast as forecast: what is left doubles, and falls to nothing."""
    now = [0.0]
    steps = [Read(300_000_000 + number) for number in range(4)]  # of 100 s
    forecast = Forecast(steps, BAUD, lambda: now[0])
    assert str(forecast) == "about 7 min: read back 7 min"
    assert forecast.left(0.0) == pytest.approx(400, rel=0.01)
    left = []
    for step in steps:
        with forecast.measured(step):
            now[0] += 100
            left.append(forecast.left(0.5))
            now[0] += 100
    assert left == pytest.approx([700, 500, 300, 100], rel=0.1)
    assert forecast.left(0.0) == pytest.approx(0, abs=0.1)


def test_bar_says_the_rest_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not only at each quarter: that of a serial backup is hours away."""
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    out = io.StringIO()
    shown = Progress(out, left=lambda share: 36_000 * (1 - share))
    with shown.bar("kernel", 1000) as bar:
        for done in range(0, 101, 10):
            now[0] += 100
            bar.at(done)
    assert re.findall(r"(\d+)%.*, (.*) to the end", out.getvalue()) == [
        ("2", "9 h 48 min"),
        ("5", "9 h 30 min"),
        ("8", "9 h 12 min"),
    ]


def flash(tmp_path: Path, *options: str) -> list[str]:
    """The command line of a dry run with an image for the whole board."""
    image, site = tmp_path / "ubi", tmp_path / "site"
    site.mkdir(exist_ok=True)
    (site / "macs").write_text("eth0 02:00:00:00:00:01\neth1 02:00:00:00:00:02\n")
    image.write_bytes(ubi_image(random.Random(1), 300))
    return ["flash", "--dry-run", "--ubi", str(image), "--site", str(site), *NETWORK, *options]


@pytest.mark.slow
def test_dry_run_is_a_summary_of_all_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(flash(tmp_path)) == 0
    summary = capsys.readouterr().out
    assert len(summary.splitlines()) < 100
    assert main(flash(tmp_path, "--all-lines")) == 0
    lines = re.findall(r"^    => if (.*?); then", capsys.readouterr().out, re.MULTILINE)
    assert len(lines) > 10_000
    counted = Counter[str]()
    for words, times in re.findall(r"^    => (.*) … (\d+) times$", summary, re.MULTILINE):
        counted[words] += int(times)
    once = re.findall(r"^    => if (.*?); then", summary, re.MULTILINE)
    assert sum(counted.values()) + len(once) == len(lines)
    assert counted["md.l"] == sum(line.startswith("md.l ") for line in lines)
    assert set(once) <= set(lines)


@pytest.mark.slow
def test_hours_are_told_before_they_begin(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As many as the bytes of the place need at the line's speed; a quarter at four times the speed."""

    def back_up(*options: str) -> int:
        assert main(flash(tmp_path, *options)) == 0
        found = re.search(r"^It takes about .*back up (?:(\d+) h )?(\d+) min", capsys.readouterr().out, re.M)
        assert found
        return int(found[1] or 0) * 60 + int(found[2])

    place = 844 * BLOCK  # the factory's `user`, up to the tables of bad blocks
    least = place * 4.1875 * CHARACTER_BITS / BAUD / 60
    assert least < back_up() < 1.1 * least
    assert back_up("--baud", "460800") < 0.4 * least
    assert main(flash(tmp_path, "--no-backup", "empty")) == 0
    assert "back up" not in capsys.readouterr().out
