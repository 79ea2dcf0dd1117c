# SPDX-License-Identifier: GPL-3.0-or-later
"""Which templates fit a device: by its identification, and by registers that it alone has so.

A template's key `identification` says both. Each register is read once of a device, with functions 3 and 4.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from openrtu_tools.devices import HOLDING, Device
from openrtu_tools.modbus import frames
from openrtu_tools.modbus.errors import Damaged, Exceptional, NoAnswer, NotAsked
from openrtu_tools.modbus.links import Link
from openrtu_tools.modbus.made import ADDRESS_LAST, IDENTIFICATION

REGISTERS = ("input_registers", HOLDING)
SUNSPEC_MARK, SUNSPEC_BEGIN = (0x5375, 0x6E53), 40000  # "SunS"
SUNSPEC_END, SUNSPEC_MOST = 0xFFFF, 50  # the last model's number; models of a device
HEAD = 2  # registers of a model: its number and its length


@dataclass
class Registers:
    """Of one device, as far as they were asked for."""

    link: Link
    unit: int
    functions: Sequence[int]  # that it knows
    silent: bool = False  # it is not asked again: silence takes time
    _read: dict[tuple[str, int, int], tuple[int, ...]] = field(default_factory=dict)

    def get(self, table: str, address: int, count: int) -> tuple[int, ...]:
        """None at all where it has not all of these."""
        place = (table, address, count)
        if place not in self._read:
            self._read[place] = self._ask(*place)
        return self._read[place]

    def _ask(self, table: str, address: int, count: int) -> tuple[int, ...]:
        if self.silent or frames.READ_FUNCTIONS[table] not in self.functions:
            return ()
        try:
            return tuple(frames.words_of(self.link.ask(frames.read(self.unit, table, address, count))))
        except (NoAnswer, Damaged, NotAsked):
            self.silent = True
        except Exceptional:
            pass
        return ()


def runs(known: Sequence[Sequence[int]]) -> Iterator[list[Sequence[int]]]:
    """Registers that stand one behind the other, which some devices give together alone."""
    run: list[Sequence[int]] = []
    for one in sorted(known):
        if run and one[0] != run[-1][0] + 1:
            yield run
            run = []
        run.append(one)
    if run:
        yield run


def fits(identification: Mapping[str, Any], says: Mapping[int, str], registers: Registers) -> bool:
    """Whether a device is what a template says, in all. Registers are read when all before is so."""
    objects = all(
        identification.get(key, says.get(number)) == says.get(number)
        for number, key in enumerate(IDENTIFICATION)
    )
    known = ((table, run) for table in REGISTERS for run in runs(identification.get(table, ())))
    return bool(identification) and objects and all(_has(registers, table, run) for table, run in known)


def _has(registers: Registers, table: str, run: Sequence[Sequence[int]]) -> bool:
    values = registers.get(table, run[0][0], len(run))
    return bool(values) and all(value in one[1:] for value, one in zip(values, run, strict=True))


def fitting(templates: Sequence[Device], says: Mapping[int, str], registers: Registers) -> list[Device]:
    return [one for one in templates if fits(one.template.get("identification", {}), says, registers)]


def sunspec_models(registers: Registers) -> list[tuple[int, int]]:
    """The numbers of a device's models, each with the address that has it."""
    models: list[tuple[int, int]] = []
    if registers.get(HOLDING, SUNSPEC_BEGIN, HEAD) != SUNSPEC_MARK:
        return models
    address = SUNSPEC_BEGIN + len(SUNSPEC_MARK)
    while len(models) < SUNSPEC_MOST and address < ADDRESS_LAST:
        head = registers.get(HOLDING, address, HEAD)
        if not head or head[0] == SUNSPEC_END:
            break
        models.append((head[0], address))
        address += HEAD + head[1]
    return models
