# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on the kernel's command line: that it is read whole, and that its root can be there."""

from __future__ import annotations

import re
from collections.abc import Iterator

from nuc980.pins.findings import Finding, at
from nuc980.pins.rules.context import Context, rule
from nuc980.pins.rules.properties import is_one_off

LONGEST = 1024  # bytes with the end (COMMAND_LINE_SIZE of ARM)
# Long ones: of shorter names too many are one letter away.
PARAMETERS = (
    *("console", "earlycon", "initcall_debug", "loglevel", "mtdparts", "nfsroot", "noinitrd", "printk.time"),
    *("rootdelay", "rootflags", "rootfstype", "rootwait", "ubi.block", "ubi.mtd"),
)
ROOT_VALUE = re.compile(r"/dev/|ubi\d|PARTUUID=|LABEL=|UUID=")
UBI_ROOT = re.compile(r"ubi\d*([:_!].*|$)|/dev/ubi(block)?\d.*")


@rule(
    "cut-command-line",
    "The kernel does not read all of the command line.",
    "It reads the first string of bootargs, and of that 1023 bytes. What is behind it is as if it were not "
    "there, often the root file system.",
)
def cut_command_line(context: Context) -> Iterator[Finding]:
    chosen = context.tree.find("/chosen")
    strings = chosen.strings("bootargs") if chosen else []
    fault, remedy = "", ""
    if len(strings) > 1:
        fault, remedy = (
            f"is a list of {len(strings)} strings; the kernel reads the first",
            "Join them with blanks",
        )
    elif strings and len(strings[0].encode()) >= LONGEST:
        fault, remedy = f"has {len(strings[0].encode())} bytes; the kernel reads {LONGEST - 1}", "Shorten it"
    if fault:
        yield Finding(
            "cut-command-line",
            **at(chosen, "bootargs"),
            message=f"bootargs {fault}",
            remedy=f"{remedy} in bootargs",
        )


@rule(
    "wrong-root",
    "The root file system of the command line is on what the kernel does not have by then.",
    "It waits for the root for ever, or panics (unable to mount root fs).",
)
def wrong_root(context: Context) -> Iterator[Finding]:
    words = dict(word.partition("=")[::2] for word in context.command_line)
    root = words.get("root", "")
    fault, remedy = _root_fault(context, root, words)
    if fault:
        yield Finding(
            "wrong-root",
            **at(context.chosen, "bootargs"),
            message=f"the command line has root={root}, but {fault}",
            remedy=remedy,
        )


def _root_fault(context: Context, root: str, words: dict[str, str]) -> tuple[str, str]:
    """What is missing, and what to do; empty: nothing."""
    if UBI_ROOT.fullmatch(root) and "ubi.mtd" not in words:
        return "no ubi.mtd=, so there is no UBI device", "Add ubi.mtd= with the label of its partition"
    if UBI_ROOT.fullmatch(root) and words.get("rootfstype") in ("jffs2", "ext4", "ext2"):
        return f"rootfstype={words['rootfstype']} is no file system of UBI", "Write rootfstype=ubifs"
    if root == "/dev/nfs" and "ip" not in words:
        return "no ip=, so it has no address when it mounts the root", "Add ip=dhcp, or the addresses"
    if root.startswith("/dev/mmcblk") and not _is_on(context, "sdh"):
        return "no SD host is enabled", "Enable sdh, or fmi with the pins of SD0, or name another root"
    if root.startswith("/dev/sd") and not _is_on(context, "usbh"):
        return "no USB host is enabled", "Enable usbh_ehci, or name another root"
    return "", ""


def _is_on(context: Context, label: str) -> bool:
    """An SD card may also be at fmi, with SD0's pins, or at an SPI bus."""
    if label == "sdh":
        by_spi = any("mmc-spi-slot" in node.strings("compatible") for node in context.enabled)
        if by_spi or any((claim.signal or "").startswith("SD0_") for claim in context.claims):
            return True
    return any(one.label.startswith(label) for one in context.devices.values())


@rule(
    "unknown-parameter",
    "A word of the command line is one letter off a parameter of the kernel.",
    "The kernel passes what it does not know on to init, and reports it at best among its first messages.",
)
def unknown_parameter(context: Context) -> Iterator[Finding]:
    names = {word.partition("=")[0] for word in context.command_line}
    for word in context.command_line:
        name, _, value = word.partition("=")
        nearest = [known for known in PARAMETERS if is_one_off(name, known)]
        if ROOT_VALUE.match(value) and "root" not in names and is_one_off(name, "root"):
            nearest.append("root")
        if nearest and name not in PARAMETERS:
            yield Finding(
                "unknown-parameter",
                **at(context.chosen, "bootargs"),
                message=f"the command line has {word}; it probably means {nearest[0]}",
                remedy=f"Write {nearest[0]}",
            )


RULES = (cut_command_line, wrong_root, unknown_parameter)
