# SPDX-License-Identifier: GPL-3.0-or-later
"""State that is saved and goes on elsewhere: each device's registers, a running machine."""

import json
import re
import subprocess
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from nuc980.twin.machine import Machine, SerialLine
from nuc980.twin.nand import NandImage

Start = Callable[..., Machine]
Reborn = Callable[[Machine], Machine]

# ---- every device --------------------------------------------------------------------------------

# No state of their own: what holds the devices that have theirs; what logs where there is no device.
STATELESS = {"nuc980", "nuc980-unmodelled"}


def test_every_device_type_saves_its_state(board: Start, qemu: Path, tmp_path: Path) -> None:
    types = board(registers=True).command("qom-list-types", implements="device")
    ours = {entry["name"] for entry in types if entry["name"].startswith("nuc980")}
    assert len(ours) > 10
    dump = tmp_path / "vmstate.json"
    subprocess.run([qemu, "-M", "nuc980", "-dump-vmstate", dump], check=True)
    assert ours - set(json.loads(dump.read_text())) == STATELESS


# What a walk over all registers must not write, or only some bits of, because it starts something.
SYS, AIC, EMAC, PDMA, FMI, WDT = 0xB0000000, 0xB0042000, 0xB0012000, 0xB0008000, 0xB0019000, 0xB0040000
EMACS = (EMAC, EMAC + 0x10000)
PDMAS = (PDMA, PDMA + 0x1000)
WRITABLE = {
    **dict.fromkeys((SYS + 0x60, SYS + 0x64, SYS + 0x68), 0),  # resets of devices
    SYS + 0x1FC: 0,  # the lock
    **{emac + 0x90: ~(1 << 24 | 1 << 8 | 1) for emac in EMACS},  # reset, receive, transmit
    **{pdma + 16 * channel: ~3 for pdma in PDMAS for channel in range(16)},  # a transfer's mode
    **{pdma + 0x408: 0 for pdma in PDMAS},  # software requests
    **{pdma + 0x460: 0 for pdma in PDMAS},  # channel resets
    FMI + 0x400: ~2,
    FMI + 0x800: ~1,
    FMI + 0x8A0: ~7,  # reset, DMA
    WDT: 0x7F,  # not the dog itself: time stands still, but it may not
}
# What a read changes.
UART, SPI = 0xB0070000, 0xB0060000
TAKES = {
    AIC + 0x120,  # takes the interrupt
    AIC + 0x124,
    *(emac + 0xB8 for emac in EMACS),  # clears the count of missed frames
    FMI + 0x8B8,  # takes a byte of the flash
    *(UART + 0x1000 * n for n in range(10)),
    *(SPI + 0x1000 * n + 0x30 for n in range(3)),
}


def regions(machine: Machine) -> dict[int, tuple[str, int]]:
    """Address: name and size of each register block that is modelled."""
    tree = machine.info("mtree -f")
    # What begins with @ is the rest of a block, behind something that lies in it.
    found = re.findall(r"(\w{16})-(\w{16}) \(prio \d+, i/o\): (nuc980[\w.-]+(?: @\w+)?)", tree)
    return {int(first, 16): (name, int(last, 16) + 1 - int(first, 16)) for first, last, name in found}


def scribble(machine: Machine, start: int, size: int) -> None:
    for address in range(start, start + size, 4):
        mask = WRITABLE.get(address, -1)
        if mask:
            machine.write(address, zlib.crc32(address.to_bytes(4, "little")) & mask & 0xFFFFFFFF)


def registers(machine: Machine, start: int, size: int) -> dict[int, int]:
    return {
        address: machine.read(address) for address in range(start, start + size, 4) if address not in TAKES
    }


def everything(machine: Machine) -> dict[int, int]:
    found: dict[int, int] = {}
    for start, (_, size) in regions(machine).items():
        found |= registers(machine, start, size)
    return found


def unlock(machine: Machine) -> None:
    for key in (0x59, 0x16, 0x88):
        machine.write(SYS + 0x1FC, key)


def named(machine: Machine, values: dict[int, tuple[int, int]]) -> dict[str, tuple[str, str]]:
    """Address and device of each value, to be read in a failure."""
    blocks = regions(machine)
    return {
        f"{max(start for start in blocks if start <= address):x}+{address & 0xFFF:03x} "
        f"{blocks[max(start for start in blocks if start <= address)][0]}": (hex(old), hex(new))
        for address, (old, new) in values.items()
    }


def differences(machine: Machine, old: dict[int, int], new: dict[int, int]) -> dict[str, tuple[str, str]]:
    return named(
        machine, {address: (old[address], new[address]) for address in old if old[address] != new[address]}
    )


def test_every_register_survives(board: Start, reborn: Reborn) -> None:
    bus = board("-rtc", "base=2026-11-21T12:00:00,clock=vm", registers=True)
    at_reset = everything(bus)
    bus.step(1_000_000)
    unlock(bus)
    for start, (_, size) in regions(bus).items():
        scribble(bus, start, size)
    before = everything(bus)
    assert differences(bus, before, everything(bus)) == {}, "a read changes these: TAKES"
    untouched = {
        f"{start:x} {name}"
        for start, (name, size) in regions(bus).items()
        if "@" not in name
        and not any(before[a] != at_reset[a] for a in range(start, start + size, 4) if a in before)
    }
    assert untouched == set()
    new = reborn(bus)
    assert differences(bus, before, everything(new)) == {}
    assert new.info("nuc980-pins") == bus.info("nuc980-pins")


# ---- a running machine ---------------------------------------------------------------------------

UART1_FSR = 0xB0071018
SLACK_US = 30  # from one timer's start to the other's, and an interrupt's way to its handler

# Instructions are the clock, 32 ns each: a busy host makes no tick late.
COUNTED = ("-icount", "shift=5,sleep=off")


@pytest.fixture
def counting(board: Start, probes: Path) -> Callable[..., Machine]:
    """Machines that run the probe count."""

    def start(*arguments: str | Path) -> Machine:
        machine = board("-bios", probes / "count.bin", *COUNTED, *arguments, uarts=(0, 1))
        machine.uarts[0].wait_for(b"ready\n")
        return machine

    return start


def counts(machine: Machine, number: int) -> tuple[int, int]:
    """What the probe says of itself, its ticks and bytes, once the ticks are right by the clock beside."""
    machine.uarts[0].send(b"%d\n" % number)
    machine.uarts[0].wait_for(b"%d: " % number)
    line = machine.uarts[0].wait_for(b"\n").decode()
    found = re.fullmatch(r"ticks (\d+) in (\d+) us, bytes (\d+), overruns 0\n", line)
    assert found, line
    ticks, time, echoed = map(int, found.groups())
    assert (time - SLACK_US) // 1000 <= ticks <= (time + SLACK_US) // 1000
    return ticks, echoed


def test_a_migrated_machine_loses_no_byte_and_no_tick(
    counting: Callable[..., Machine], reborn: Reborn
) -> None:
    machine = counting()
    text, heard = send_until_both_fifos_wait(machine.uarts[1], machine)
    new = reborn(machine)
    while more := machine.uarts[1].receive(0):
        heard += more
    assert len(heard) <= len(text) - 4
    assert heard + new.uarts[1].wait_for(text[len(heard) :]) == text
    assert counts(new, 1)[1] == len(text)
    new.uarts[1].send(b"more")
    new.uarts[1].wait_for(b"more")


def send_until_both_fifos_wait(line: SerialLine, machine: Machine) -> tuple[bytes, bytes]:
    """Sends till both FIFOs have bytes, and leaves the machine stopped: what was sent, and came back.

    A busy host may miss them, and only a machine that is stopped keeps them.
    """
    sent = heard = b""
    for _ in range(50):
        line.send(b"twelve bytes")
        sent += b"twelve bytes"
        while len(heard) < len(sent):
            machine.command("stop")
            if min(waiting(machine)) >= 2:
                return sent, heard
            machine.command("cont")
            heard += line.receive(0)
    pytest.fail("never seen in the middle of it")


def waiting(machine: Machine) -> tuple[int, int]:
    """Bytes in UART1's FIFOs: received, to be sent."""
    status = machine.read(UART1_FSR)
    return status >> 8 & 0x3F, status >> 16 & 0x3F


def test_loadvm_goes_back_in_time(counting: Callable[..., Machine], qemu: Path, tmp_path: Path) -> None:
    image = tmp_path / "nand.qcow2"
    blank = NandImage.blank(tmp_path / "nand.img").path
    subprocess.run([qemu.parent / "qemu-img", "convert", "-O", "qcow2", blank, image], check=True)
    machine = counting("-drive", f"if=mtd,format=qcow2,file={image}")
    first, _ = counts(machine, 1)
    assert machine.monitor("savevm before") == ""
    machine.uarts[1].send(b"abc")
    machine.uarts[1].wait_for(b"abc")
    later, echoed = counts(machine, 2)
    assert later > first and echoed == 3
    assert machine.monitor("loadvm before") == ""
    again, echoed = counts(machine, 3)
    assert again >= first and echoed == 0
