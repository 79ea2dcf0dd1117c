# SPDX-License-Identifier: GPL-3.0-or-later
"""A scenario: a board that has something wrong with it, a command of nuc980-netboot, and how that ends."""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from lab.patience import stretch
from netboot.double import BLOCK, Double, Operation, hush
from netboot.double.faults import Fault
from netboot.images import device_tree, ubi_image, uimage
from netboot.ports import free_port
from nuc980 import ports
from nuc980.netboot import arrival, console, linux, probe, steps
from nuc980.netboot.cli import main
from nuc980.netboot.errors import NetbootError
from nuc980.netboot.flash import backup
from nuc980.netboot.flash import steps as flash_steps

HERE = "127.0.0.1"
OWN = range(0, 0x200000)  # SPL, environment and U-Boot
ENVIRONMENT, LOADER = range(0x80000, 0x100000), range(0x100000, 0x180000)
KERNEL, TREE, ROOT = range(0x200000, 0x700000), range(0x700000, 0x800000), range(0x1600000, 0x7A80000)
FLASH = ("flash", "--kernel", "%kernel", "--dtb", "%tree")
BOTH = {KERNEL: "kernel", TREE: "tree"}


@dataclass(frozen=True)
class Scenario:
    """name: tells it. command: the subcommand and its own words; %NAME is a file of the bench.

    board: settings of the double. prepare: what is done to it, and to the files, before.
    error: the class that it ends with, None for success; code: the exit code, if it is another than that
    class's; says: words of what it prints.
    writes: places of the flash that may be erased and programmed, with the file that belongs there, "" for
    what is no file's. then: what is looked at, or done, afterwards. patience: seconds that the tool waits for
    a command's end. quick: one of `make test-quick`.
    """

    name: str
    command: tuple[str, ...]
    faults: Sequence[Fault] = ()
    board: Mapping[str, object] = field(default_factory=dict)
    prepare: Callable[[Bench], object] = lambda bench: None
    error: type[NetbootError] | None = None
    code: int | None = None
    says: tuple[str, ...] = ()
    writes: Mapping[range, str] = field(default_factory=dict)
    then: Callable[[Bench], object] = lambda bench: None
    patience: float = 5.0
    quick: bool = False


class Bench:
    """A double, and the host's files. Each operation on the flash is judged as it comes.

    contents: what belongs to a place when all is done; old: what the factory left there.
    """

    def __init__(self, folder: Path, scenario: Scenario) -> None:
        self.folder, self.scenario = folder, scenario
        self.site = folder / "site"
        self.site.mkdir()
        (self.site / "macs").write_text("eth0 02:00:00:00:00:01\neth1 02:00:00:00:00:02\n")
        self.chance = random.Random(980)
        self.files = {
            "kernel": uimage(self.chance.randbytes(140_000)),
            "tree": device_tree(self.chance),
            "root": ubi_image(self.chance, 3),
        }
        self.port = free_port()
        self.faults = copy.deepcopy(list(scenario.faults))
        settings = {"tftp": (HERE, self.port), "faults": self.faults, "second": 0.1}
        self.double = Double(**settings | dict(scenario.board))
        self.sins: list[str] = []
        self._fill_flash()
        scenario.prepare(self)
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
        self.contents = {place: self.files[name] for place, name in scenario.writes.items() if name}
        self.own = self._own()
        self.environment = self.double.stored_environment()
        self.at_first = {
            place: self.double.nand.content(place.start, len(place)) for place in scenario.writes
        }
        self.double.nand.witness = self._judge

    def _fill_flash(self) -> None:
        """As the factory leaves it: SPL, U-Boot, a kernel, a device tree, a root file system."""
        for address in (0, LOADER.start):
            self.double.nand.load(address, self.chance.randbytes(3 * BLOCK))
        self.old = {
            KERNEL: uimage(self.chance.randbytes(60_000)),
            TREE: device_tree(self.chance),
            ROOT: ubi_image(self.chance, 2),
        }
        for place, content in self.old.items():
            self.double.nand.load(place.start, content)

    def run(self, *command: str) -> int:
        """The exit code of a command, the scenario's if none is given, in this process."""
        name, *words = command or self.scenario.command
        words = [str(self.folder / word[1:]) if word.startswith("%") else word for word in words]
        common = ["--site", str(self.site)]
        if "--port" not in words and "--dry-run" not in words:
            common += ["--port", self.double.port]
        if name in ("boot", "flash", "install"):
            common += ["--tftp-port", str(self.port), "--listen", HERE, "--seen-as", HERE]
            if "--board-ip" not in words:
                common += ["--board-ip", "10.77.0.5/24", "--server-ip", "10.77.0.1"]
        return main([name, *common, *words])

    def mend(self) -> None:
        """Nothing is wrong any more."""
        self.faults.clear()
        self.double.faults.clear()

    # ---- the invariants

    def _judge(self, operation: Operation) -> None:
        span = range(operation.address, operation.address + operation.size)
        place = next((place for place in self.scenario.writes if inside(span, place)), None)
        if place is None:
            self.sins.append(f"{operation} is outside of what may be written")
        elif operation.kind == "erase" and self.scenario.writes[place]:
            self._judge_erase(operation, place)

    def _judge_erase(self, operation: Operation, place: range) -> None:
        there = self.double.nand.content(operation.address, BLOCK)
        begin = operation.address - place.start
        is_first = there == self.at_first[place][begin : begin + BLOCK]
        if is_first and there.strip(b"\xff") and not self._is_kept(there):
            self.sins.append(f"{operation}: no file of the host has what is there")
        if not any(operation.address in _begun(path) for path in self.site.rglob("journal.jsonl")):
            self.sins.append(f"{operation}: no journal tells it")
        index = self._good_blocks(place).index(operation.address)
        coming = self.contents[place][index * BLOCK : (index + 1) * BLOCK]
        if self.double.ram.find(coming) < 0:
            self.sins.append(f"{operation}: what comes there is not in the RAM")

    def _is_kept(self, content: bytes) -> bool:
        if "--no-backup" in self.scenario.command:
            return True
        files = (path for path in self.site.rglob("*") if path.is_file())
        return any(content in path.read_bytes() for path in files)

    def check(self) -> None:
        """What holds after every scenario, whatever went wrong."""
        assert self.sins == []
        assert self._own() == self.own

    def check_run(self, typed: Iterable[str]) -> None:
        """That nothing ran on the board but what the tool meant to type, and what it boots by itself."""
        environments = (self.double.stored_environment() or {}, self.environment or {})
        own = (value for variables in environments for value in variables.values() if "bootm" in value)
        meant = [words for line in (*typed, *own) for words in hush.commands(hush.Parser(line).nodes())]
        fixed = {tuple(words) for words in meant if hush.MARK not in "".join(words)}
        begun = {words[0] for words in meant if hush.MARK in "".join(words)}  # with a variable in it
        others = [words for words in self.double.commands if tuple(words) not in fixed]
        assert [words for words in others if words[0] not in begun] == []

    def check_written(self) -> None:
        """That each place holds what belongs there, and 0xFF behind it."""
        for place, wanted in self.contents.items():
            blocks = self._good_blocks(place)
            there = b"".join(self.double.block(address // BLOCK) for address in blocks)
            assert there == wanted.ljust(len(blocks) * BLOCK, b"\xff"), f"{place} holds something else"
            assert all(self.double.nand.fits(address, BLOCK) for address in blocks)

    def _good_blocks(self, place: range) -> list[int]:
        bad = self.double.nand.bad
        return [address for address in place[::BLOCK] if address // BLOCK not in bad]

    def _own(self) -> dict[range, bytes]:
        """What is U-Boot's, as far as the scenario may not write it."""
        places = (range(0, 0x80000), ENVIRONMENT, range(0x100000, 0x200000))
        writes = self.scenario.writes
        return {
            place: self.double.nand.content(place.start, len(place))
            for place in places
            if not any(inside(each, place) for each in writes)
        }


def inside(one: range, other: range) -> bool:
    return other.start <= one.start and one.stop <= other.stop


def _begun(journal: Path) -> set[int]:
    """The offsets of the blocks whose erase a journal has announced."""
    events = (json.loads(line) for line in journal.read_text().splitlines())
    return {event["offset"] for event in events if event["event"] == "begin" and event.get("erases")}


# ---- pytest


def table(scenarios: Iterable[Scenario]) -> list[object]:
    """For parametrize: those that are not quick are slow."""
    return [
        pytest.param(each, id=each.name, marks=() if each.quick else pytest.mark.slow) for each in scenarios
    ]


def play(
    scenario: Scenario, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Runs a scenario, and judges how it ended and what it left."""
    hurry(monkeypatch, scenario.patience)
    monkeypatch.setattr(ports, "PTYS", ())  # the double's stands for a UART: it has a speed
    typed = recorded(monkeypatch)
    bench = Bench(folder, scenario)
    with bench.double:
        code = bench.run()
        output = "".join(capsys.readouterr())
        wanted = scenario.error.exit_code if scenario.error else 0
        assert code == (wanted if scenario.code is None else scenario.code), output
        for words in (*scenario.says, *_advice(scenario.error)):
            assert words in output, output
        assert "Traceback" not in output
        bench.check()
        scenario.then(bench)
    bench.check()
    bench.check_run(typed)


def _advice(error: type[NetbootError] | None) -> tuple[str, ...]:
    """The words by which an error's class is known, unless its instance has better ones."""
    return (error.next_step,) if error and error.next_step and error.next_step != "-" else ()


def recorded(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The lines that the tool means to type, as it comes to each."""
    lines: list[str] = []
    real = console.typed

    def typed(command: str, number: int) -> str:
        lines.append(real(command, number))
        return lines[-1]

    monkeypatch.setattr(console, "typed", typed)
    return lines


# The tool's patience, in seconds, cut to what a double needs.
HURRY = {
    console: {"ECHO_SECONDS": 0.3, "PROMPT_SECONDS": 0.6, "SETTLED_SECONDS": 0.05},
    arrival: {
        "POKE_SECONDS": 0.02,
        "SPEED_SECONDS": 0.15,
        "IDLE_POKE_SECONDS": 0.3,
        "SETTLED_SECONDS": 0.05,
        "COUNTING_POKE_SECONDS": 0.05,
        "LISTEN_SECONDS": 0.1,
        "KNOCK_SECONDS": 0.05,
    },
    linux: {"QUIET_SECONDS": 0.2},
    steps: {"SLOWEST": 1_000_000},
    backup: {"SLOWEST": 1_000_000},
}
COMMANDS_END = (
    (steps, "PATIENCE"),
    (backup, "PATIENCE"),
    (flash_steps, "PATIENCE"),
    (flash_steps, "BLOCK_SECONDS"),
)
SWITCHED_ON_WITHIN = 1.5


def hurry(monkeypatch: pytest.MonkeyPatch, patience: float) -> None:
    """Waits for nothing as long as on a bench, but longer on a busy host."""
    longer = stretch()
    monkeypatch.setattr(console.Console.reach, "__defaults__", (None, SWITCHED_ON_WITHIN * longer))
    for module, values in HURRY.items():
        for name, value in values.items():
            monkeypatch.setattr(module, name, value * longer)
    for module, name in (*COMMANDS_END, (probe, "FLASH_SECONDS")):
        monkeypatch.setattr(module, name, patience * longer)
