# SPDX-License-Identifier: GPL-3.0-or-later
"""A compiled program, and the file of it: package/openrtu/src/logic/format.h describes it."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field

from openrtu_tools.logic.errors import LogicError
from openrtu_tools.logic.types import machine_type

VERSION = 3  # LOGIC_VERSION
NO_SLOT = 0xFFFF
SLOTS_MAX = 0xFFFE
CODE_MAX = 0x7FFF
FUNCTIONS = ["SQRT", "LN", "LOG", "EXP", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN"]
OPERATIONS = [
    "MOVE",
    "BLOCK",
    "LOAD",
    "STORE",
    "ADD",
    "SUB",
    "MUL",
    "DIV",
    "MOD",
    "NEG",
    "ABS",
    "EQ",
    "NE",
    "LT",
    "LE",
    "AND",
    "OR",
    "XOR",
    "NOT",
    "SHL",
    "SHR",
    "ROL",
    "ROR",
    "RADD",
    "RSUB",
    "RMUL",
    "RDIV",
    "RNEG",
    "RABS",
    "REQ",
    "RNE",
    "RLT",
    "RLE",
    "DADD",
    "DSUB",
    "DMUL",
    "DDIV",
    "DNEG",
    "DABS",
    "DEQ",
    "DNE",
    "DLT",
    "DLE",
    "EXPT",
    "MATH",
    "CONVERT",
    "BITS",
    "I2R",
    "I2D",
    "R2D",
    "D2R",
    "ROUND",
    "TRUNC",
    "JUMP",
    "IF",
    "ELSIF",
    "CLEAN",
    "SPREAD",
    "CALL",
    "RETURN",
    "QUALITY",
    "GOOD",
    "AS_GOOD",
    "MESSAGE",
    "TEXT",
    "JOIN",
    "HEAD",
    "TAIL",
    "LAST",
    "LENGTH",
    "FIND",
    "COMPARE",
    "FORMAT",
]


@dataclass(eq=False)
class Slot:
    """A cell of the machine's memory; its number is known when all are."""

    type: str
    variable: bool  # not a temporary result, nor a constant
    number: int = -1


@dataclass(eq=False)
class String:
    slots: list[Slot]  # its length, and its octets
    octets: int  # at most

    @property
    def type(self) -> str:
        return "STRING"


@dataclass(eq=False)
class Array:
    slots: list[Slot]  # each as far from the one before
    type: str
    low: int

    @property
    def stride(self) -> int:
        return self.slots[1].number - self.slots[0].number if len(self.slots) > 1 else 1


@dataclass(eq=False)
class Instruction:
    operation: str
    type: str
    operands: list[
        object
    ]  # slots, arrays, routines, texts, numbers, and of jumps the instruction's number in its routine
    line: int
    covers: list[Slot] = field(default_factory=list)  # the variables that a BLOCK writes


@dataclass(eq=False)
class Routine:
    code: list[Instruction] = field(default_factory=list)
    library: bool = False
    writes: set[Slot] = field(default_factory=set)  # the variables that outlive the call


@dataclass
class Point:
    name: str
    type: str
    slot: Slot
    written: bool = False
    time: Slot | None = None


@dataclass
class Command:
    name: str
    slots: list[Slot]  # execute, value, select, state, result


@dataclass
class Request:
    name: str
    slots: list[Slot]  # active, value, refuse, state, result


@dataclass
class Debug:
    """What no file has: the names of the machine's memory, for the tool that has the text."""

    variables: dict[str, Slot | String] = field(default_factory=dict)
    outputs: dict[str, list[str]] = field(default_factory=dict)  # of each instance of a block
    enumerations: dict[str, dict[int, str]] = field(default_factory=dict)  # of its values
    # Of each unit of the text its first line, and the paths that what it names begins with.
    units: list[tuple[int, list[str]]] = field(default_factory=list)


@dataclass
class Program:
    name: str
    constants: dict[tuple[str, int], Slot] = field(default_factory=dict)
    slots: list[Slot] = field(default_factory=list)  # all but constants
    initial: dict[Slot, int] = field(default_factory=dict)
    arrays: list[Array] = field(default_factory=list)
    routines: list[Routine] = field(default_factory=list)
    points: list[Point] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    requests: list[Request] = field(default_factory=list)
    retained: list[tuple[str, list[Slot]]] = field(default_factory=list)
    remembered: list[tuple[str, list[Slot]]] = field(default_factory=list)  # of the library's blocks
    clocks: dict[str, Slot] = field(default_factory=dict)  # UPTIME, SCAN_TIME, NOW
    debug: Debug = field(default_factory=Debug)

    def add(self, slot: Slot) -> Slot:
        """A new one, with its place among those that are no constants."""
        slot.number = len(self.slots)
        self.slots.append(slot)
        return slot

    @property
    def instructions(self) -> list[Instruction]:
        return [instruction for routine in self.routines for instruction in routine.code]


def encode(program: Program) -> bytes:
    """The octets of the file."""
    everything = [*program.constants.values(), *program.slots]
    for number, slot in enumerate(everything):
        slot.number = number
    starts, code = {}, 0
    for routine in program.routines:
        starts[id(routine)] = code
        code += len(routine.code)
    if len(everything) > SLOTS_MAX or code > CODE_MAX:
        raise LogicError(
            f"the program is too large: {len(everything)} variables and constants of {SLOTS_MAX}, "
            f"{code} instructions of {CODE_MAX}"
        )
    operands = [operand for one in program.instructions for operand in one.operands]
    found = dict.fromkeys(place_of(operand) for operand in operands if isinstance(operand, String))
    texts = {place: number for number, place in enumerate(found)}
    names, places = bytearray(), {}

    def name(text: str) -> int:
        if text not in places:
            if len(names) > 0xFFFF:
                raise LogicError(
                    "the names of points and the texts of messages are longer than 65 536 octets"
                )
            places[text] = len(names)
            names.extend(text.encode() + b"\0")
        return places[text]

    own_name = name(program.name)
    initial = {slot: bits for (_, bits), slot in program.constants.items()} | program.initial
    sections = [
        filled(bytes(machine_type(slot.type) for slot in everything)),
        b"".join(struct.pack("<HHQ", slot.number, 0, bits) for slot, bits in initial.items()),
        b"".join(
            struct.pack(
                "<HHHBBi",
                array.slots[0].number,
                len(array.slots),
                array.stride,
                machine_type(array.type),
                0,
                array.low,
            )
            for array in program.arrays
        ),
        b"".join(struct.pack("<HH", starts[id(routine)], len(routine.code)) for routine in program.routines),
        b"".join(
            struct.pack(
                "<HHBBH",
                point.slot.number,
                point.time.number if point.time else NO_SLOT,
                machine_type(point.type),
                point.written,
                name(point.name),
            )
            for point in program.points
        ),
        b"".join(
            struct.pack("<6H", name(command.name), *(slot.number for slot in command.slots))
            for command in program.commands
        ),
        b"".join(
            struct.pack("<6H", name(request.name), *(slot.number for slot in request.slots))
            for request in program.requests
        ),
        b"".join(
            struct.pack("<HHHBB", name(kept), slots[0].number, len(slots), machine_type(slots[0].type), only)
            for only, all_of in enumerate((program.retained, program.remembered))
            for kept, slots in all_of
        ),
        b"".join(struct.pack("<HH", *place) for place in texts),
        b"".join(
            code_of(instruction, program, starts[id(routine)], name, texts)
            for routine in program.routines
            for instruction in routine.code
        ),
        filled(b"".join(struct.pack("<H", min(one.line, 0xFFFF)) for one in program.instructions)),
    ]
    counts = [
        len(program.constants),
        len(everything),
        len(initial),
        len(program.arrays),
        len(program.routines),
        len(program.points),
        len(program.commands),
        len(program.retained) + len(program.remembered),
        code,
        own_name,
        *(
            program.clocks[c].number if c in program.clocks else NO_SLOT
            for c in ("UPTIME", "SCAN_TIME", "NOW")
        ),
        len(program.requests),
    ]
    body = struct.pack("<14HI", *counts, len(names)) + b"".join(sections) + names
    return struct.pack("<4sHHII", b"RTUL", VERSION, len(texts), len(body) + 16, zlib.crc32(body)) + body


def place_of(text: String) -> tuple[int, int]:
    return text.slots[0].number, text.octets


def filled(octets: bytes) -> bytes:
    return octets + bytes(-len(octets) % 4)


def code_of(
    instruction: Instruction,
    program: Program,
    start: int,
    name: Callable[[str], int],
    texts: dict[tuple[int, int], int],
) -> bytes:
    numbers = []
    for operand in instruction.operands:
        if isinstance(operand, Slot):
            numbers.append(operand.number)
        elif isinstance(operand, String):
            numbers.append(texts[place_of(operand)])
        elif isinstance(operand, Array):
            numbers.append(program.arrays.index(operand))
        elif isinstance(operand, str):
            numbers.append(name(operand))
        elif isinstance(operand, Routine):
            numbers.append(program.routines.index(operand))
        else:
            numbers.append(operand)
    if instruction.operation in ("JUMP", "IF", "ELSIF", "CLEAN"):
        numbers[0 if instruction.operation == "JUMP" else 1] += start
    numbers += [0] * (3 - len(numbers))
    return struct.pack(
        "<BBHHH", OPERATIONS.index(instruction.operation), machine_type(instruction.type), *numbers
    )
