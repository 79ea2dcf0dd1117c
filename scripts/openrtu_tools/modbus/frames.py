# SPDX-License-Identifier: GPL-3.0-or-later
"""Modbus requests and answers without what a link puts around them: MODBUS Application Protocol V1.1b3."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from openrtu_tools.modbus.made import TABLES

BROADCAST = 0
EXCEPTION_BIT = 0x80
EXCEPTION_LENGTH = 2
PDU_MOST = 253
BITS_MOST = 2000  # of one read
REGISTERS_MOST = 125

READ_FUNCTIONS = dict(zip(TABLES, (1, 2, 4, 3), strict=True))
WRITE_COIL, WRITE_REGISTER, WRITE_COILS, WRITE_REGISTERS = 5, 6, 15, 16
ECHOES = (WRITE_COIL, WRITE_REGISTER)  # the answer is the request
REPORT_SERVER_ID, ENCAPSULATED = 17, 43
DEVICE_IDENTIFICATION = 14  # of function 43
BASIC, MORE_FOLLOWS = 1, 0xFF
MORE_AT = 4  # in an identification; the next object behind it
OBJECTS_BEGIN = 7
COIL_ON = 0xFF00
BIT_TABLES = TABLES[:2]
COILS, _, _, HOLDING_REGISTERS = TABLES


@dataclass(frozen=True)
class Request:
    """What a unit is asked, and how a message calls it: `the read of holding register 16`."""

    unit: int
    pdu: bytes
    what: str

    @property
    def function(self) -> int:
        return self.pdu[0]


def crc(octets: bytes) -> bytes:
    """MODBUS over Serial Line V1.02, 6.2.2.

    >>> crc(bytes.fromhex("020701")).hex()
    '1041'
    """
    register = 0xFFFF
    for octet in octets:
        register ^= octet
        for _ in range(8):
            register = register >> 1 ^ (0xA001 if register & 1 else 0)
    return register.to_bytes(2, "little")


def places(table: str, address: int, count: int) -> str:
    """`holding register 16`, `coils 3 to 5`."""
    words = table.replace("_", " ")
    return (
        f"{words.removesuffix('s')} {address}"
        if count == 1
        else f"{words} {address} to {address + count - 1}"
    )


# ---- requests ------------------------------------------------------------------------------------


def read(unit: int, table: str, address: int, count: int) -> Request:
    pdu = bytes([READ_FUNCTIONS[table]]) + address.to_bytes(2) + count.to_bytes(2)
    return Request(unit, pdu, f"the read of {places(table, address, count)}")


def write_bits(unit: int, address: int, bits: Sequence[int], multiple: bool) -> Request:
    what = f"the write of {places(COILS, address, len(bits))}"
    if len(bits) == 1 and not multiple:
        value = COIL_ON if bits[0] else 0
        return Request(unit, bytes([WRITE_COIL]) + address.to_bytes(2) + value.to_bytes(2), what)
    data = sum(bit << place for place, bit in enumerate(bits)).to_bytes((len(bits) + 7) // 8, "little")
    return Request(unit, _many(WRITE_COILS, address, len(bits), data), what)


def write_registers(unit: int, address: int, words: Sequence[int], multiple: bool) -> Request:
    what = f"the write of {places(HOLDING_REGISTERS, address, len(words))}"
    data = b"".join(word.to_bytes(2) for word in words)
    if len(words) == 1 and not multiple:
        return Request(unit, bytes([WRITE_REGISTER]) + address.to_bytes(2) + data, what)
    return Request(unit, _many(WRITE_REGISTERS, address, len(words), data), what)


def _many(function: int, address: int, count: int, data: bytes) -> bytes:
    return bytes([function]) + address.to_bytes(2) + count.to_bytes(2) + bytes([len(data)]) + data


def identify(unit: int, first: int = 0) -> Request:
    """Function 43/14: the device's maker, product and version."""
    pdu = bytes([ENCAPSULATED, DEVICE_IDENTIFICATION, BASIC, first])
    return Request(unit, pdu, "the read of its identification")


# ---- answers -------------------------------------------------------------------------------------


def answer_length(pdu: bytes) -> int | None:
    """Of the whole answer that begins so; None: too little has come; 0: of no known function."""
    if not pdu:
        return None
    if pdu[0] & EXCEPTION_BIT:
        return EXCEPTION_LENGTH
    if pdu[0] in (*READ_FUNCTIONS.values(), REPORT_SERVER_ID):
        return 2 + pdu[1] if len(pdu) > 1 else None
    if pdu[0] in (WRITE_COIL, WRITE_REGISTER, WRITE_COILS, WRITE_REGISTERS):
        return 5
    return _identification_length(pdu) if pdu[0] == ENCAPSULATED else 0


def _identification_length(pdu: bytes) -> int | None:
    if len(pdu) < OBJECTS_BEGIN:
        return None
    at = OBJECTS_BEGIN
    for _ in range(pdu[OBJECTS_BEGIN - 1]):
        if len(pdu) < at + 2:
            return None
        at += 2 + pdu[at + 1]
    return at if at <= PDU_MOST else 0


def fits(request: Request, pdu: bytes) -> bool:
    """Whether an answer is one to this request: of its function and, as far as that shows, its size."""
    if pdu[0] & ~EXCEPTION_BIT != request.function or len(pdu) < EXCEPTION_LENGTH:
        return False
    if pdu[0] & EXCEPTION_BIT:
        return True
    if request.function in READ_FUNCTIONS.values():
        count = int.from_bytes(request.pdu[3:5])
        bits = request.function in (1, 2)
        return pdu[1] == ((count + 7) // 8 if bits else 2 * count) and len(pdu) == 2 + pdu[1]
    if request.function in (WRITE_COIL, WRITE_REGISTER, WRITE_COILS, WRITE_REGISTERS):
        return pdu == request.pdu[:5]
    return True


def bits_of(pdu: bytes, count: int) -> list[int]:
    return [pdu[2 + place // 8] >> place % 8 & 1 for place in range(count)]


def words_of(pdu: bytes) -> list[int]:
    return [int.from_bytes(pdu[at : at + 2]) for at in range(2, len(pdu) - 1, 2)]


def objects_of(pdu: bytes) -> Iterator[tuple[int, str]]:
    """Of an identification: their numbers and texts."""
    at = OBJECTS_BEGIN
    for _ in range(pdu[OBJECTS_BEGIN - 1]):
        size = pdu[at + 1]
        text = pdu[at + 2 : at + 2 + size].decode("latin-1")
        yield pdu[at], "".join(sign for sign in text if sign.isprintable()).strip()
        at += 2 + size
