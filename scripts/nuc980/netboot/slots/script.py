# SPDX-License-Identifier: GPL-3.0-or-later
"""The boot command of a board with slots, as variables of U-Boot's environment.

It is written once, at installation. What changes in service are marks (marks.py), because saveenv erases the
environment before it writes it. It needs only what the vendor's U-Boot 2016.11 has: there is no setexpr and
no bootcount. The order:

1. A slot on trial, if one is marked, at most three times. Each attempt is a page that is written before it,
   without an erase. A page that was torn counts too.
2. The base slot; if that does not load, the other one.

bootm of a uImage with a wrong CRC returns, and so does `nand read` of a page beyond its ECC: the next slot is
tried. A device tree has no CRC of its own, and bootm resets the board for a damaged one: a slot has it with
a uImage's header, which iminfo checks. ECC alone is not enough: a page whose programming was cut may look as
one that was never written, and then nobody checks it. `nand read` goes on behind bad blocks, so it reads
what an image may have and no more: not the neighbours of a place, of which one may be unreadable. On trial, a
kernel that hangs, panics or does not get to a program that feeds the watchdog is reset.

A kernel whose root is in UBI has a root= of its own, and puts its arguments behind those of U-Boot, so that
they would hold. Behind `--` they are init's, which does not look at them. The name in the tree's header says
which kind of image a slot has: to attach UBI where the root is inside would format an empty partition.
"""

from __future__ import annotations

from collections.abc import Mapping

from nuc980.netboot.board import BoardReport, Nand
from nuc980.netboot.errors import FlashNotPossible, LayoutUnknown, UnusableInput
from nuc980.netboot.limits import DEVICE_TREE_AT, PAGE, UIMAGE_AT
from nuc980.netboot.slots.layout import BASE, NAMES, PLACES, ROOT, TRIAL, root_volume
from nuc980.netboot.slots.marks import (
    ATTEMPTS,
    BASE_WORD,
    ERASED_WORD,
    LOOK,
    SLOT_WORDS,
    TRIAL_WORD,
    USED_WORD,
)
from nuc980.netboot.uimage import UImage

ROOM = 250  # characters of a value: U-Boot's line is one of 254 (commandline.py), also within `run`
MADE = LOOK + 0x1000  # in RAM: what an attempt's page is made of
# The device tree's name in its header, by whether the root is in UBI, and where U-Boot reads its first word.
TREE_NAMES = {False: b"device tree", True: b"root in UBI"}
TREE_NAME_AT = DEVICE_TREE_AT + UImage.LAYOUT.size - 32

# What the script runs, each with its subcommands.
NEEDED = (
    "run",
    "itest",
    "mw",
    "setenv",
    "saveenv",
    "bootm",
    "iminfo",
    "nand read",
    "nand write",
    "nand erase",
)

# The vendor's U-Boot takes the same interval, 2^20 ticks (nuc980_wdt.c there); from XIN / 512 it is 45 s. The
# next shorter one, 11 s, may be too short for a kernel to get to its driver. The low byte of 0xb0000240 is
# the divider of the MDIO clock, 0xff the slowest.
WATCHDOG = (
    "mw 0xb0000240 0x1ff; mw 0xb00001fc 0x59; mw 0xb00001fc 0x16; mw 0xb00001fc 0x88; "
    "mw 0xb0040008 0x5aa5; mw 0xb0040000 0x882; mw 0xb00001fc 0"
)
# Linux's core feeds a watchdog that runs already until a program opens it, and no longer than this.
OPEN_SECONDS = 180


def missing_commands(board: BoardReport) -> list[str]:
    """What a board's U-Boot lacks for slots."""
    return [name for name in NEEDED if not board.knows(name)]


def check_board(board: BoardReport) -> None:
    """Raises FlashNotPossible when this U-Boot has not all that the script runs."""
    if missing := missing_commands(board):
        raise FlashNotPossible(f"This U-Boot has no {', '.join(missing)}: its boot command cannot fall back.")


def variables(nand: Nand, arguments: str) -> dict[str, str]:
    """All that `install` adds to the environment. arguments: the kernel's, beside those of the script.

    Raises LayoutUnknown when there is no good block for a mark, UnusableInput for arguments without room.
    """
    base_1, base_2 = (area.first_good(nand) for area in BASE)
    trial = TRIAL.first_good(nand)
    pages = " ".join(f"{trial + PAGE * number:#x}" for number in range(1, ATTEMPTS + 1))
    is_b = f"itest *{LOOK + 4:#x} == {SLOT_WORDS['b']:#x}"
    script = {
        "bootcmd": "run rtu_trial; run rtu_base",
        "rtu_args": arguments,
        "rtu_parts": partitions(),
        "rtu_trial": (
            f"if {_has(trial, TRIAL_WORD)}; then setenv rtu_w openrtu.trial"
            f" watchdog.open_timeout={OPEN_SECONDS}; for rtu_p in {pages};"
            " do if run rtu_left; then run rtu_watch; run rtu_t; fi; done; fi"
        ),
        "rtu_t": f"if {is_b}; then run rtu_b; else run rtu_a; fi",
        "rtu_left": (
            f"nand read {MADE:#x} ${{rtu_p}} {PAGE:#x} && itest *{MADE:#x} == {ERASED_WORD:#x}"
            f" && itest *{MADE + PAGE - 4:#x} == {ERASED_WORD:#x} && run rtu_mark"
        ),
        "rtu_mark": (
            f"mw.l {MADE:#x} {USED_WORD:#x} {PAGE // 4:#x}; nand write {MADE:#x} ${{rtu_p}} {PAGE:#x}"
        ),
        "rtu_watch": WATCHDOG,
        "rtu_base": (
            f"setenv rtu_w; if run rtu_base1 || run rtu_base2; then if {is_b}; then run rtu_b; fi; fi;"
            " run rtu_a; run rtu_b"
        ),
        "rtu_base1": _has(base_1, BASE_WORD),
        "rtu_base2": _has(base_2, BASE_WORD),
        **{f"rtu_{name}": _slot(name) for name in NAMES},
        "rtu_boot": (
            f"nand read {UIMAGE_AT:#x} ${{rtu_k}} {PLACES['a'].kernel.room:#x}"
            f" && nand read {DEVICE_TREE_AT:#x} ${{rtu_d}} {PLACES['a'].device_tree.room:#x}"
            f" && iminfo {DEVICE_TREE_AT:#x} && run rtu_root"
            # One word: a command of U-Boot has 16 at most.
            ' && setenv bootargs "${rtu_args} ${rtu_parts} openrtu.slot=${rtu_s} ${rtu_w} ${rtu_r}"'
            f" && bootm {UIMAGE_AT:#x} - {DEVICE_TREE_AT + UImage.LAYOUT.size:#x}"
        ),
        # An update asks Linux for openrtu.root: a boot command without it knows no root in UBI.
        "rtu_root": (
            f"if itest *{TREE_NAME_AT:#x} == {int.from_bytes(TREE_NAMES[True][:4], 'little'):#x};"
            f" then setenv rtu_r openrtu.root=ubi {root_arguments('${rtu_s}')} --;"
            " else setenv rtu_r openrtu.root=kernel; fi"
        ),
    }
    for name, value in script.items():
        if len(value) >= ROOM:
            raise UnusableInput(f"{name} has {len(value)} characters; U-Boot's lines take {ROOM}: {value}")
    return script


def root_arguments(slot: str) -> str:
    """A kernel's with its root in UBI: those of board/nuc980/linux/root-ubi.fragment, for a slot."""
    root = f"ubi.mtd=rootfs,{PAGE} root=ubi0:{root_volume(slot)} rootfstype=ubifs rw"
    return f"console=ttyS0,115200n8 {root} panic=10"


def partitions() -> str:
    """The slots and marks as Linux' partitions, in the place of the device tree's: its argument `mtdparts`.

    U-Boot and its environment are read-only there. `rootfs` is the device tree's.
    """
    areas = [
        *((f"{what}-{name}", area) for name in NAMES for what, area in PLACES[name].named()),
        *((f"base-{number}", area) for number, area in enumerate(BASE, 1)),
        ("trial", TRIAL),
        ("rootfs", ROOT),
    ]
    parts = ",".join(f"{area.size // 1024}k@{area.offset // 1024}k({name})" for name, area in areas)
    return f"mtdparts=nand0:{PLACES['a'].kernel.offset // 1024}k(u-boot)ro,{parts}"


def check_installed(environment: Mapping[str, str]) -> None:
    """Raises LayoutUnknown."""
    if not is_installed(environment):
        raise LayoutUnknown(
            "This board has no slots: it has another boot command.",
            cause="its environment is the factory's, or somebody changed it",
            next_step="nuc980-netboot install makes them",
        )


def is_installed(environment: Mapping[str, str]) -> bool:
    """Whether a board boots by this script."""
    return environment.get("bootcmd") == "run rtu_trial; run rtu_base" and "rtu_boot" in environment


def _has(offset: int, word: int) -> str:
    return f"nand read {LOOK:#x} {offset:#x} {PAGE:#x} && itest *{LOOK:#x} == {word:#x}"


def _slot(name: str) -> str:
    places = PLACES[name]
    return (
        f"rtu_k={places.kernel.offset:#x}; rtu_d={places.device_tree.offset:#x}; rtu_s={name}; run rtu_boot"
    )
