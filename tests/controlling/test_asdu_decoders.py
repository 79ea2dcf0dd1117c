# SPDX-License-Identifier: GPL-3.0-or-later
"""The decoder of the trace and that of rtu-centre, held by one set of ASDUs: words here, numbers there."""

import json
import random
import re
import struct
import subprocess
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from codes import ASDU, Tree
from openrtu_tools.centre.apdu import CAUSES, ELEMENTS, NAMES, PARTS, decode
from openrtu_tools.centre.codes import LETTERS, Content

ROOT = Path(__file__).resolve().parents[2]
INITIALISATION = 70
MONITORED = [type_ for type_ in ELEMENTS if type_ <= 40 or type_ == INITIALISATION]
OBJECTS = 8  # of an ASDU
NOW = datetime(2026, 3, 29, 0, 41, 7, tzinfo=UTC)
# What the position of bits 1 to 3 of a quality means depends on the type: protection has EI among them.
QUALITY_BITS = 0xF1
INVALID_TIME = re.compile(r"(\d{4}-\d\d-\d\d \d\d:)?\d\d:\d\d\.\d{3} IV$")  # rtu-centre takes none from it


def time56(chance: random.Random) -> bytes:
    """A moment that is one, in the hour around NOW, so that three octets tell it as well."""
    ms, minute = chance.randrange(60_000), chance.randrange(12, 60) | chance.choice((0, 0, 0x80))
    return struct.pack("<HB4B", ms, minute, NOW.hour, NOW.day, NOW.month, NOW.year - 2000)


def octets_of(part: str, chance: random.Random) -> bytes:
    if part in ("T24", "T56"):
        return time56(chance)[: PARTS[part][0]]
    if part == "R32":  # no NaN: its words are none
        return struct.pack("<f", chance.choice((0.0, -1.5, 1e-20, 3.25e7, chance.uniform(-1e6, 1e6))))
    return chance.randbytes(PARTS[part][0])


def asdus() -> Iterator[bytes]:
    """Of each type in monitoring direction, objects one by one and in a sequence."""
    chance = random.Random(104)
    for type_ in MONITORED:
        parts = ELEMENTS[type_].split()
        for sequence in (0, 0x80):
            head = struct.pack("<BBBBH", type_, OBJECTS | sequence, 3, 0, 47)
            body = b""
            for ioa in range(300, 300 + OBJECTS):
                if not sequence or ioa == 300:
                    body += ioa.to_bytes(3, "little")
                body += b"".join(octets_of(part, chance) for part in parts)
            yield head + body


def worded(type_: int, found: dict[str, Any]) -> str:
    """What the trace is to say of what rtu-centre's decoder has found."""
    content, unsigned, signed = Content(found["content"]), found["u"], found["i"]
    quality = " ".join(word for bit, word in LETTERS.items() if found["quality"] & bit & QUALITY_BITS)
    words: list[str] = []
    match content:
        case Content.SINGLE | Content.DOUBLE | Content.PROTECTION_EVENT:
            words = [str(unsigned), quality]
        case Content.STEP:
            words = [str(signed), "transient" if found["detail"] else "", quality]
        case Content.BITS | Content.PACKED_SINGLES:
            words = [f"0x{unsigned:08x}", quality]
        case Content.NORMALIZED:
            words = [f"{signed / 32768:.6g}", quality]
        case Content.SCALED:
            words = [str(signed), quality]
        case Content.FLOAT:
            words = [f"{struct.unpack('<f', struct.pack('<I', unsigned))[0]:g}", quality]
        case Content.TOTAL:
            flags = [word for bit, word in ((0x20, "CY"), (0x40, "CA")) if found["detail"] & bit]
            words = [str(signed), f"sq {found['detail'] & 31}", *flags, quality]
        case Content.PROTECTION_START | Content.PROTECTION_OUTPUT:
            words = [f"0x{unsigned:02x}", quality]
        case Content.INITIALISATION:
            words = [str(unsigned)]
        case Content.POSITION:
            raise AssertionError("rtu-centre's decoder tells no position so")
    if "T16" in ELEMENTS[type_]:
        words.append(f"{found['elapsed_ms']} ms")
    if found["tagged"]:
        at = datetime.fromtimestamp(found["wall_ns"] // 10**9, UTC)
        short = f"{at:%M:%S}.{found['wall_ns'] // 10**6 % 1000:03}"
        clock = f"{at:%Y-%m-%d %H}:{short}" if "T56" in ELEMENTS[type_] else short
        words.append("IV" if found["time_invalid"] else clock)
    return " ".join(filter(None, words))


def test_both_decoders_say_the_same(programs: Path) -> None:
    sent = list(asdus())
    command = [programs / "iec104" / "iec104-decode", str(int(NOW.timestamp()) * 10**9)]
    octets = b"".join(b"%d\n" % len(asdu) + asdu for asdu in sent)
    done = subprocess.run(command, input=octets, capture_output=True, check=True)
    found = [json.loads(line) for line in done.stdout.splitlines()]
    in_c = [(each["type"], each["ioa"], worded(each["type"], each)) for each in found]
    traced = []
    for asdu in sent:
        frame = decode(bytes((0x68, len(asdu) + 4, 0, 0, 0, 0)) + asdu)
        traced += [(asdu[0], ioa, INVALID_TIME.sub("IV", text)) for ioa, text in frame.objects]
    assert len(traced) == 2 * OBJECTS * len(MONITORED)
    assert traced == in_c


def test_the_trace_knows_each_number_of_c() -> None:
    tree = Tree(ROOT)
    types = {code.number: code.name for code in tree.enumeration(ASDU, "iec104_type", "IEC104_")}
    assert types.items() <= NAMES.items()
    assert types.keys() <= ELEMENTS.keys()
    assert {code.number for code in tree.enumeration(ASDU, "iec104_cause", "IEC104_")} <= CAUSES.keys()


def test_what_is_cut_is_not_told() -> None:
    for type_ in MONITORED:
        size = sum(PARTS[part][0] for part in ELEMENTS[type_].split())
        asdu = struct.pack("<BBBBH", type_, 1, 3, 0, 47) + bytes(3 + size - 1)
        frame = decode(bytes((0x68, len(asdu) + 4, 0, 0, 0, 0)) + asdu)
        assert frame.objects == [(0, bytes(size - 1).hex(" "))]
