# SPDX-License-Identifier: GPL-3.0-or-later
"""`probe` and `restore-env` on boards that have something wrong with them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from netboot.double import FACTORY_ENVIRONMENT, faults
from netboot.scenario import ENVIRONMENT, Bench, Scenario, play, table
from nuc980.netboot import errors

pytestmark = pytest.mark.slow

OURS = {"variant": "ours"}
PROBE = ("probe",)
RESTORE = ("restore-env", "%saved")
SAVE = ("restore-env", "--save", "%saved")
PLACE = {ENVIRONMENT: ""}
FIRST = ENVIRONMENT.start // 0x20000
ODD = {
    "bootargs": "console=ttyS0,115200n8 root=ubi0:rootfs ubi.mtd=4,2048",
    "quotes": 'it\'s "quoted"',
    "shell": "a; b && c || d # e $f ${g} \\ \\\\ $? *",
    "spaces": "  two  and  more  ",
    "long": "0123456789abcdef" * 60,
    "longer": "'\\;\"$" * 80,
}


def saved(**variables: str) -> Callable[[Bench], None]:
    """A file as printenv shows it: the factory's environment with these."""

    def prepare(bench: Bench) -> None:
        both = FACTORY_ENVIRONMENT | variables
        lines = (f"{name}={value}\n" for name, value in sorted(both.items()) if value)
        escaped = (line[:-1].replace("\\", "\\\\") + "\n" for line in lines)
        bench.files["saved"] = "".join(escaped).encode()

    return prepare


def holds(bench: Bench, **variables: str) -> None:
    """The flash's environment has these."""
    stored = bench.double.stored_environment() or {}
    assert {name: stored.get(name) for name in variables} == variables


def stored(**variables: str) -> Callable[[Bench], None]:
    return lambda bench: holds(bench, **variables)


def as_before(bench: Bench) -> None:
    assert bench.double.nand.journal == []
    holds(bench, **FACTORY_ENVIRONMENT)


def kept(bench: Bench) -> None:
    """The board's environment was saved before it was changed."""
    assert "bootdelay=3" in (bench.site / "environment.txt").read_text()
    as_before(bench)


def broken_and_mended(bench: Bench) -> None:
    """What was interrupted is done again."""
    bench.mend()
    bench.double.power_cycle()
    assert bench.run() == 0
    holds(bench, **ODD)


def looks(name: str, *wrong: faults.Fault, says: tuple[str, ...] = (), **more: object) -> Scenario:
    return Scenario(name, PROBE, wrong, says=says, then=as_before, **more)


LOOKED = [
    looks("factory's U-Boot", says=("2016.11", "128 MiB", "64 MiB", "emac", "No tftpput"), quick=True),
    looks("our U-Boot", says=("2023.01", "emac0", "rootfs", "bad-block tables"), board=OURS, quick=True),
    looks(
        "bad blocks",
        says=("0x820000", "0x1000000"),
        prepare=lambda bench: bench.double.nand.bad.update({0x41, 0x80}),
    ),
    looks(
        "worn out",
        says=("worn out",),
        prepare=lambda bench: bench.double.nand.bad.update(range(100, 160)),
    ),
    looks(
        "no link",
        faults.NoLink(),
        says=("no link",),
        board=OURS | {"environment": FACTORY_ENVIRONMENT | {"ethaddr": "02:00:00:00:00:01"}},
    ),
    looks("no NAND", faults.Refuses("^nand info", "", times=0), says=("finds no flash",)),
    looks("noise, one byte in 3000", faults.Noise(1 / 3000, seed=8)),
    looks("a kernel's words between", faults.Unsolicited("\n[   12.34] usb 1-1: reset\n", at=4)),
    Scenario("odd values", PROBE, board={"environment": FACTORY_ENVIRONMENT | ODD}),
    Scenario("no environment", PROBE, board={"environment": None}, says=("the prompt comes at once",)),
    Scenario(
        "bootdelay=0",
        PROBE,
        board={"environment": FACTORY_ENVIRONMENT | {"bootdelay": "0"}, "slow_start": True},
        says=("hardly a chance",),
    ),
    Scenario("without the flash", (*PROBE, "--no-flash"), says=("not asked",)),
    Scenario(
        "a value that is no ASCII",
        PROBE,
        board={"environment": FACTORY_ENVIRONMENT | {"name": "Ni\u0161"}},
    ),
    Scenario("hangs", PROBE, [faults.HangsAt("^nand bad")], error=errors.StuckConsole, patience=1.0),
    Scenario("starts again", PROBE, [faults.ResetsAt("command", 5)], error=errors.BoardReset, quick=True),
    Scenario("no hush", PROBE, board={"hush": False}, error=errors.NoStatus),
]

PUT_BACK = [
    Scenario("nothing differs", RESTORE, prepare=saved(), says=("Nothing differs",), then=as_before),
    Scenario(
        "another delay, in the RAM only",
        RESTORE,
        prepare=saved(bootdelay="5"),
        says=("+ bootdelay=5",),
        then=kept,
        quick=True,
    ),
    Scenario("odd and long values", RESTORE, prepare=saved(**ODD), then=kept),
    Scenario(
        "saved", SAVE, prepare=saved(bootdelay="5"), writes=PLACE, then=stored(bootdelay="5"), quick=True
    ),
    Scenario("saved, odd and long values", SAVE, prepare=saved(**ODD), writes=PLACE, then=stored(**ODD)),
    Scenario("saved, our U-Boot", SAVE, board=OURS, prepare=saved(**ODD), writes=PLACE, then=stored(**ODD)),
    Scenario(
        "saved, a bad block first",
        SAVE,
        prepare=lambda bench: (
            saved(**ODD)(bench),
            bench.double.nand.bad.add(FIRST),
            bench.double.nand.load(
                ENVIRONMENT.start + 0x20000, bench.double.nand.content(ENVIRONMENT.start, 0x20000)
            ),
        ),
        writes=PLACE,
        then=stored(**ODD),
    ),
    Scenario(
        "saved through noise",
        SAVE,
        [faults.Noise(1 / 3000, seed=9)],
        prepare=saved(bootdelay="5"),
        writes=PLACE,
        then=stored(bootdelay="5"),
    ),
    Scenario(
        "saved, echoes lost",
        SAVE,
        [faults.DropsEcho(at=600, times=2)],
        prepare=saved(bootdelay="5"),
        writes=PLACE,
        then=stored(bootdelay="5"),
    ),
    Scenario(
        "a variable removed",
        SAVE,
        board={"environment": FACTORY_ENVIRONMENT | {"more": "x"}},
        prepare=saved(),
        writes=PLACE,
        says=("- more=x",),
        then=lambda bench: holds(bench, bootdelay="3"),
    ),
    Scenario(
        "the flash does not take it",
        SAVE,
        [faults.CannotProgram(FIRST)],
        prepare=saved(bootdelay="5"),
        writes=PLACE,
        error=errors.CommandFailed,
        says=("FAILED",),
    ),
    Scenario(
        "starts again at the erase",
        SAVE,
        [faults.ResetsAt("erase")],
        prepare=saved(**ODD),
        writes=PLACE,
        error=errors.BoardReset,
        then=broken_and_mended,
    ),
    Scenario(
        "starts again at the program",
        SAVE,
        [faults.ResetsAt("program")],
        prepare=saved(**ODD),
        writes=PLACE,
        error=errors.BoardReset,
        then=broken_and_mended,
    ),
    Scenario(
        "line unsafe before it is saved",
        SAVE,
        [faults.WrongEcho(at=536, times=0)],
        prepare=saved(bootdelay="5"),
        error=errors.LineUnsafe,
        then=as_before,
    ),
    Scenario(
        "file that is none",
        SAVE,
        prepare=lambda bench: bench.files.__setitem__("saved", b"no environment\n"),
        error=errors.UnusableInput,
        then=as_before,
    ),
    Scenario(
        "file cut off",
        SAVE,
        prepare=lambda bench: bench.files.__setitem__(
            "saved", b"bootdelay=3\nbootcmd=nand re\n\nEnvironment size: 219/65532 bytes\n"
        ),
        error=errors.UnusableInput,
        says=("cut",),
        then=as_before,
    ),
    Scenario(
        "file with what no line carries",
        SAVE,
        prepare=saved(name="Ni\u0161"),
        error=errors.UnusableInput,
        says=("ASCII",),
        then=as_before,
    ),
    Scenario(
        "file that is not there", ("restore-env", "%nothing"), error=errors.UnusableInput, then=as_before
    ),
    Scenario(
        "dry run",
        ("restore-env", "--dry-run", "--save", "%saved"),
        prepare=saved(bootdelay="5"),
        says=("saveenv",),
        then=as_before,
    ),
]


@pytest.mark.parametrize("scenario", table(LOOKED))
def test_probe(
    scenario: Scenario,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    play(scenario, tmp_path, capsys, monkeypatch)


@pytest.mark.parametrize("scenario", table(PUT_BACK))
def test_restore_env(
    scenario: Scenario,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    play(scenario, tmp_path, capsys, monkeypatch)
