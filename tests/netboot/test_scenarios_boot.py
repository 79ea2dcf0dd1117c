# SPDX-License-Identifier: GPL-3.0-or-later
"""`boot` on boards that have something wrong with them: Linux starts, or it is said what is wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from netboot.double import FACTORY_ENVIRONMENT, faults
from netboot.images import uimage
from netboot.ports import free_port
from netboot.scenario import Bench, Scenario, play, table
from nuc980.netboot import errors

BOOT = ("boot", "%kernel", "%tree")
HOOK = ("--power-cycle", "%hook")
OURS = {"variant": "ours"}
HUNG = "### ERROR ### Please RESET the board ###\n"
CHATTER = "\n[   12.340000] usb 1-1: new high-speed USB device number 2\nemac: link down\n"


def linux_started(bench: Bench) -> None:
    assert bench.double.kernels_started == 1


def environment(**more: str) -> dict[str, object]:
    return {"environment": FACTORY_ENVIRONMENT | more}


def file(name: str, change: Callable[[bytes], bytes]) -> Callable[[Bench], None]:
    """Makes another file of one of the bench's."""

    def prepare(bench: Bench) -> None:
        bench.files[name] = change(bench.files[name])

    return prepare


def hook(bench: Bench) -> None:
    """A power switch that a command can press."""
    path = bench.folder / "hook"
    path.write_text(f"#!/bin/sh\n{bench.double.power_hook}\n")
    path.chmod(0o755)


def works(
    name: str, *wrong: faults.Fault, board: dict[str, object] | None = None, **more: object
) -> Scenario:
    """Linux comes up all the same."""
    return Scenario(name, BOOT, wrong, board or {}, then=linux_started, **more)


def fails(
    name: str,
    error: type[errors.NetbootError],
    *wrong: faults.Fault,
    board: dict[str, object] | None = None,
    command: tuple[str, ...] = BOOT,
    **more: object,
) -> Scenario:
    return Scenario(name, command, wrong, board or {}, error=error, **more)


REACHED = [
    works("factory's U-Boot", quick=True),
    works("our U-Boot", board=OURS, quick=True),
    works("stays at the prompt already", board={"state": "prompt"}, quick=True),
    works("another prompt", board={"prompt": "U-Boot> "}),
    works("a prompt with a name", board={"prompt": "nuc980> "}),
    works("a prompt as Linux has one", board={"prompt": "# "}),
    works("no environment: no count-down", board={"environment": None}),
    works("autoboot off", board=environment(bootdelay="-1")),
    works("bootdelay=0 and a slow start", board=environment(bootdelay="0") | {"slow_start": True}),
    works("another speed of the table", board={"baud": 57600}, says=("57600",)),
    works("a speed of another board", board={"baud": 9600}, says=("9600",)),
    works("words of a kernel in the banner", faults.Unsolicited(CHATTER, times=2), board={"state": "prompt"}),
    Scenario(
        "Linux runs, and the supply is switched",
        (*BOOT, *HOOK),
        board={"state": "login"},
        prepare=hook,
        then=linux_started,
        quick=True,
    ),
    Scenario(
        "switched off, and the supply is switched",
        (*BOOT, *HOOK),
        board={"state": "off"},
        prepare=hook,
        then=linux_started,
    ),
    fails("dead board", errors.NoOutput, board={"talks": False}, says=("TX and RX swapped",)),
    fails("switched off", errors.NoOutput, board={"state": "off"}),
    fails("a speed that nobody tries", errors.Garbage, board={"baud": 1200}),
    fails("Linux at its login", errors.NotUBoot, board={"state": "login"}, says=("Linux runs",)),
    fails("Linux at a shell", errors.NotUBoot, board={"state": "shell"}),
    fails(
        "autoboot faster than any key",
        errors.AutobootMissed,
        board=environment(bootdelay="-2", bootcmd="bootm 0x7fc0"),
        prepare=lambda bench: bench.double.ram.__setitem__(slice(0x7FC0, 0x8000), uimage(b"")),
    ),
    fails("no hush", errors.NoStatus, board={"hush": False}, says=("'if'",)),
    fails(
        "power hook that fails",
        errors.PowerHookFailed,
        command=(*BOOT, "--power-cycle", "sh -c 'echo no relay >&2; exit 3'"),
        says=("no relay",),
    ),
    fails(
        "port that is not there", errors.UnusableInput, command=(*BOOT, "--port", "/dev/nothing"), quick=True
    ),
]

LINE = [
    works("echo of one character lost", faults.DropsEcho(at=70)),
    works("echo of one character wrong", faults.WrongEcho(at=200)),
    works("echo late", faults.SlowEcho(0.05, at=100, times=5)),
    works("a received byte lost now and then", faults.DropsReceived(every=401)),
    works("only what fits the FIFO arrives", faults.OverrunsFifo()),
    works("noise, one byte in 2000", faults.Noise(1 / 2000, seed=1), quick=True),
    works("noise, one byte in 2000, others", faults.Noise(1 / 2000, seed=5)),
    works("noise before a prompt", faults.Burst(at=6)),
    works("prompt late", faults.SlowPrompt(0.3, at=5)),
    works("prompt very late", faults.SlowPrompt(1.0, at=5)),
    works("a kernel's words between", faults.Unsolicited(CHATTER, at=7)),
    works("a kernel's words in an echo", faults.Unsolicited(CHATTER, at=120, within_echo=True)),
    fails("noise, one byte in 100", errors.LineUnsafe, faults.Noise(1 / 100, seed=3)),
    fails("noise before each prompt", errors.StuckConsole, faults.Burst(at=4, times=0)),
    fails("noise, one byte in 8", errors.NetbootError, faults.Noise(1 / 8, seed=4)),
    fails("each 20th byte lost", errors.LineUnsafe, faults.DropsReceived(every=20)),
    fails("echo always wrong", errors.LineUnsafe, faults.WrongEcho(at=30, times=0)),
    fails("port goes", errors.LineLost, faults.Unplugged(at=8), quick=True),
    fails("starts again at a command", errors.BoardReset, faults.ResetsAt("command", 8), quick=True),
    fails("starts again at a key", errors.BoardReset, faults.ResetsAt("echo", 250)),
    fails("hangs", errors.StuckConsole, faults.HangsAt("^tftp"), patience=0.5),
    fails(
        "gives up",
        errors.BoardHung,
        faults.HangsAt("^tftp", last=f"out of memory\n{HUNG}"),
        says=("out of memory",),
        patience=60.0,
        quick=True,
    ),
]

NETWORK = [
    works("ACKs lost", faults.LosesAcks(at=4, times=3)),
    works("ACKs twice", faults.DuplicatesAcks(times=0)),
    works("cut short once", faults.EndsEarly(at=3), says=("Once more",)),
    works("breaks off once", faults.StopsHearing(30, times=1), says=("Once more",)),
    works("a wrong bit in the RAM once", faults.FlipsInRam(), says=("CRC32", "Once more")),
    works("a sum misprinted once", faults.wrong_crc(), says=("Once more",)),
    works("no link at first", faults.NoLink(times=1), board=OURS, says=("Once more",)),
    fails("starts again while it loads", errors.BoardReset, faults.ResetsAt("tftp", 40)),
    fails("cut short each time", errors.WrongBytes, faults.EndsEarly(at=3, times=0)),
    fails("a wrong bit each time", errors.WrongBytes, faults.FlipsInRam(times=0)),
    fails("breaks off each time", errors.TransferBroken, faults.StopsHearing(30), board={"second": 0.02}),
    fails("no driver", errors.NoEthernet, faults.NetworkSays(faults.NO_ETHERNET), quick=True),
    fails("an address that is none", errors.NoMac, faults.NetworkSays(faults.BAD_ADDRESS)),
    fails("nobody answers", errors.NetbootError, faults.ArpFails(), says=("ARP", "--ethact")),
    fails("no link", errors.LinkDown, faults.NoLink(), board=OURS),
    fails("no link, vendor's driver", errors.LinkDown, faults.NoLink()),
    fails("another server answers", errors.FileRefused, faults.AsksFor("theirs"), says=("File not found",)),
    fails(
        "firewall",
        errors.NetbootError,
        board=OURS | {"second": 0.01},
        prepare=lambda bench: setattr(bench.double, "tftp", ("127.0.0.2", free_port())),
        says=("firewall",),
    ),
    fails(
        "factory's U-Boot asks at port 69 only",
        errors.NetbootError,
        board={"second": 0.01},
        prepare=lambda bench: setattr(bench.double, "tftp", ("127.0.0.1", free_port())),
        says=("tftpdstp", "port 69"),
    ),
    fails(
        "no address of this host in the board's network",
        errors.NoHostAddress,
        command=(*BOOT, "--board-ip", "10.231.77.5/30"),
        says=("no address",),
    ),
]

IMAGES = [
    works("arguments and fdt_high of U-Boot's", board=environment(bootargs="quiet", fdt_high="0xffffffff")),
    works("values that are long and odd", board=environment(long="x" * 900, odd="'a\" ; $b \\ c")),
    Scenario("until another line", (*BOOT, "--until", "Run /sbin/init"), then=linux_started),
    fails("not a uImage", errors.UnusableImage, prepare=file("kernel", lambda _: b"no kernel"), quick=True),
    fails("kernel cut off", errors.UnusableImage, prepare=file("kernel", lambda whole: whole[:-1])),
    fails(
        "kernel with a wrong bit",
        errors.UnusableImage,
        prepare=file("kernel", lambda k: k[:99] + b"?" + k[100:]),
    ),
    fails("device tree cut off", errors.UnusableImage, prepare=file("tree", lambda whole: whole[:-9])),
    fails(
        "the two exchanged",
        errors.UnusableImage,
        command=("boot", "%tree", "%kernel"),
        says=("kernel comes first",),
    ),
    fails(
        "for another address",
        errors.UnusableImage,
        prepare=file("kernel", lambda _: uimage(b"x", load=0x10000)),
    ),
    fails(
        "for another processor",
        errors.UnusableImage,
        prepare=file("kernel", lambda _: uimage(b"x", processor=3)),
    ),
    fails(
        "over the device tree",
        errors.DoesNotFit,
        prepare=file("kernel", lambda _: uimage(bytes(0x9F8041 - 64))),
    ),
    fails("file that is not there", errors.UnusableInput, command=("boot", "%nothing", "%tree")),
    fails(
        "MACs that are none",
        errors.UnusableInput,
        prepare=lambda bench: (bench.site / "macs").write_text("eth0 first\n"),
        says=("macs",),
    ),
    fails(
        "bootm gives up",
        errors.BoardHung,
        faults.HangsAt("^bootm", last=f"FDT creation failed! hanging...{HUNG}"),
        says=("FDT creation failed!",),
    ),
    fails(
        "bootm refuses",
        errors.BootmFailed,
        faults.Refuses("^bootm", "Bad Data CRC\nERROR: can't get kernel image!\n"),
        says=("bad RAM",),
    ),
]

LINUX = [
    fails(
        "no root file system",
        errors.RootMissing,
        board={"linux": "no root"},
        says=("Unable to mount root fs",),
        quick=True,
    ),
    works("not a word before the login", board={"linux": "quiet"}),
    fails(
        "a panic at first", errors.KernelPanic, board={"linux": "panic first"}, says=("Attempted to kill",)
    ),
    fails("kernel panic", errors.KernelPanic, board={"linux": "panic"}, says=("Attempted to kill init",)),
    fails("a driver's mistake", errors.KernelOops, board={"linux": "oops"}, says=("nuc980_emac_probe",)),
    fails("not a word", errors.KernelMute, board={"linux": "silent"}, command=(*BOOT, "--timeout", "1")),
    fails("no login", errors.LinuxSilent, command=(*BOOT, "--until", "never", "--timeout", "1")),
    fails("starts again", errors.BoardReset, board={"linux": "watchdog"}, says=("watchdog",)),
]


@pytest.mark.slow
@pytest.mark.parametrize("scenario", table(REACHED + LINE + NETWORK + IMAGES + LINUX))
def test_boot(
    scenario: Scenario,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    play(scenario, tmp_path, capsys, monkeypatch)
