# SPDX-License-Identifier: GPL-3.0-or-later
"""What a kernel of the board prints, and the little that can be said to it."""

from __future__ import annotations

from typing import Literal

from .faults import Reset
from .wire import Wire

Ending = Literal["login", "shell", "no root", "panic", "oops", "watchdog", "silent", "quiet", "panic first"]

HEAD = """\
[    0.000000] Booting Linux on physical CPU 0x0
[    0.000000] Linux version 5.10.140-rt73 (buildroot@openrtu) (arm-linux-gcc 12.3.0) #1 PREEMPT_RT
[    0.000000] CPU: ARM926EJ-S [41069265] revision 5 (ARMv5TEJ), cr=0005317f
[    0.000000] OF: fdt: Machine model: BLIIoT gateway
[    0.000000] Kernel command line: console=ttyS0,115200
[    0.310000] nuc980-emac0 nuc980-emac0: eth0 is using mac address 02:00:00:00:00:01
[    0.620000] nuc980-nand: 128 MiB, SLC, erase size: 128 KiB, page size: 2048, OOB size: 64
"""
NO_ROOT = """\
[    1.270000] VFS: Cannot open root device "ubi0:rootfs" or unknown-block(0,0): error -19
[    1.280000] Please append a correct "root=" boot option; here are the available partitions:
[    1.290000] Kernel panic - not syncing: VFS: Unable to mount root fs on unknown-block(0,0)
[    1.300000] CPU: 0 PID: 1 Comm: swapper Not tainted 5.10.140-rt73 #1
[    1.310000] Hardware name: NUC980 (Flattened Device Tree)
[    1.320000] ---[ end Kernel panic - not syncing: VFS: Unable to mount root fs on unknown-block(0,0) ]---
"""
PANIC = """\
[    0.810000] Kernel panic - not syncing: Attempted to kill init! exitcode=0x0000000b
[    0.820000] CPU: 0 PID: 1 Comm: init Not tainted 5.10.140-rt73 #1
[    0.830000] ---[ end Kernel panic - not syncing: Attempted to kill init! exitcode=0x0000000b ]---
"""
OOPS = """\
[    0.750000] Unable to handle kernel NULL pointer dereference at virtual address 00000004
[    0.760000] Internal error: Oops: 5 [#1] PREEMPT_RT ARM
[    0.770000] PC is at nuc980_emac_probe+0x40/0x3c4
"""
STORIES = {"no root": NO_ROOT, "panic": PANIC, "oops": OOPS}
INIT = """\
[    1.540000] Run /sbin/init as init process
Starting syslogd: OK
Starting network: OK

Welcome to Buildroot
"""


def run(wire: Wire, ending: Ending) -> None:
    """Plays the log and stays; only the board's power switch ends it."""
    wire.line_end = b"\r\n"
    if ending == "silent":
        wire.deaf()
    if ending == "quiet":
        stay(wire, "login")
    if ending == "panic first":
        wire.puts(PANIC)
        wire.deaf()
    wire.puts(HEAD)
    if ending == "watchdog":
        raise Reset
    if ending in STORIES:
        wire.puts(STORIES[ending])
        wire.deaf()
    wire.puts(INIT)
    stay(wire, ending)


def stay(wire: Wire, ending: Ending) -> None:
    """A login, or a shell, that understands nothing."""
    wire.line_end = b"\r\n"
    prompt = "gateway login: " if ending == "login" else "# "
    while True:
        wire.puts(prompt)
        line = _line(wire)
        if line and ending == "login":
            wire.puts("Password: ")
            wire.getc()
            wire.puts("\nLogin incorrect\n")
        elif line:
            wire.puts(f"-sh: {line.split()[0]}: not found\n")


def _line(wire: Wire) -> str:
    line = ""
    while (key := chr(wire.getc())) not in "\r\n":
        if key == "\x03":
            wire.puts("^C")
            line = ""
            break
        wire.puts(key)
        line += key
    wire.puts("\n")
    return line
