# SPDX-License-Identifier: GPL-3.0-or-later
"""Who has a serial port of this machine, and how to be allowed to open it. Needs Python alone."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

PTYS = range(136, 144)  # major numbers: UNIX98_PTY_SLAVE_MAJOR
LOCKS = Path("/proc/locks")


def is_pty(device: str) -> bool:
    return os.major(_device_number(device)) in PTYS


def how_to_be_allowed(device: str) -> str:
    group = Path(device).group()
    if group == "root":
        return "let a udev rule give the port to the group dialout, or run this as root"
    return f"sudo usermod -aG {group} $USER, then log out and in again"


def holders_of(device: str) -> list[str]:
    """The other processes that have it open or locked, as far as this user may know: `rtu-modbus (815)`."""
    number = _device_number(device)
    if not number:
        return []
    others = [process for process in Path("/proc").glob("[0-9]*") if process.name != str(os.getpid())]
    locking = set(_locking(Path(device)))
    return sorted(
        {_program(process) for process in others if process.name in locking or _has_open(process, number)}
    )


def _locking(device: Path) -> Iterator[str]:
    """The processes that have locked it: `1: FLOCK ADVISORY WRITE 815 00:16:5 0 EOF`. Everybody may know."""
    with suppress(OSError):
        inode = device.stat().st_ino
        for line in LOCKS.read_text().splitlines():
            words = [word for word in line.split() if word != "->"]  # one that waits
            if len(words) > 5 and words[5].rpartition(":")[2] == str(inode) and _same_disk(words[5], device):
                yield words[4]


def _same_disk(place: str, device: Path) -> bool:
    major, minor, _ = place.split(":")
    return os.makedev(int(major, 16), int(minor, 16)) == device.stat().st_dev


def _device_number(device: str) -> int:
    """0 for what is no device."""
    with suppress(OSError):
        return Path(device).stat().st_rdev
    return 0


def _has_open(process: Path, number: int) -> bool:
    """Not, as far as this user may know, or when it has just ended."""
    with suppress(OSError), os.scandir(process / "fd") as files:
        return any(_leads_to(Path(file), number) for file in files)
    return False


def _leads_to(file: Path, number: int) -> bool:
    with suppress(OSError):
        return file.stat().st_rdev == number
    return False


def _program(process: Path) -> str:
    with suppress(OSError):
        return f"{(process / 'comm').read_text().strip()} ({process.name})"
    return process.name
