# SPDX-License-Identifier: GPL-3.0-or-later
"""APDUs of IEC 60870-5-104 in words, as tshark tells them: for an engineer who looks at a connection."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from openrtu_tools.centre.codes import LETTERS

START = 0x68
U_FRAMES = {
    0x07: "STARTDT act", 0x0B: "STARTDT con", 0x13: "STOPDT act", 0x23: "STOPDT con",
    0x43: "TESTFR act", 0x83: "TESTFR con",
}  # fmt: skip
CAUSES = {
    1: "per/cyc", 2: "back", 3: "spont", 4: "init", 5: "req", 6: "act", 7: "actcon", 8: "deact",
    9: "deactcon", 10: "actterm", 11: "retrem", 12: "retloc", 13: "file", 20: "inrogen", 37: "reqcogen",
    44: "unknown type", 45: "unknown cause", 46: "unknown CA", 47: "unknown IOA",
    **{20 + group: f"inro{group}" for group in range(1, 17)},
    **{37 + group: f"reqco{group}" for group in range(1, 5)},
}  # fmt: skip
POSITION = 201  # docs/positioning.md

# The parts of an information element, by type (IEC 60870-5-101, 7.3).
ELEMENTS = {
    1: "SIQ", 3: "DIQ", 5: "VTI QDS", 7: "BSI QDS", 9: "NVA QDS", 11: "SVA QDS", 13: "R32 QDS", 15: "BCR",
    2: "SIQ T24", 4: "DIQ T24", 6: "VTI QDS T24", 8: "BSI QDS T24", 10: "NVA QDS T24", 12: "SVA QDS T24",
    14: "R32 QDS T24", 16: "BCR T24", 17: "SEP T16 T24", 18: "SPE QDP T16 T24", 19: "OCI QDP T16 T24",
    20: "SCD QDS", 21: "NVA",
    30: "SIQ T56", 31: "DIQ T56", 32: "VTI QDS T56", 33: "BSI QDS T56", 34: "NVA QDS T56", 35: "SVA QDS T56",
    36: "R32 QDS T56", 37: "BCR T56", 38: "SEP T16 T56", 39: "SPE QDP T16 T56", 40: "OCI QDP T16 T56",
    45: "SCO", 46: "DCO", 47: "RCO", 48: "NVA QOS", 49: "SVA QOS", 50: "R32 QOS", 51: "BSI",
    58: "SCO T56", 59: "DCO T56", 60: "RCO T56", 61: "NVA QOS T56", 62: "SVA QOS T56", 63: "R32 QOS T56",
    64: "BSI T56", 70: "Q", 100: "Q", 101: "Q", 102: "", 103: "T56", 104: "FBP", 105: "Q", 106: "T16",
    107: "FBP T56",
    110: "NVA Q", 111: "SVA Q", 112: "R32 Q", 113: "Q",
    POSITION: "LAT LAT ALT FIX QDS T56",
}  # fmt: skip
NAMES = {
    1: "M_SP_NA_1", 2: "M_SP_TA_1", 3: "M_DP_NA_1", 4: "M_DP_TA_1", 5: "M_ST_NA_1", 6: "M_ST_TA_1",
    7: "M_BO_NA_1", 8: "M_BO_TA_1", 9: "M_ME_NA_1", 10: "M_ME_TA_1", 11: "M_ME_NB_1", 12: "M_ME_TB_1",
    13: "M_ME_NC_1", 14: "M_ME_TC_1", 15: "M_IT_NA_1", 16: "M_IT_TA_1", 17: "M_EP_TA_1", 18: "M_EP_TB_1",
    19: "M_EP_TC_1", 20: "M_PS_NA_1", 21: "M_ME_ND_1", 30: "M_SP_TB_1", 31: "M_DP_TB_1", 32: "M_ST_TB_1",
    33: "M_BO_TB_1", 34: "M_ME_TD_1", 35: "M_ME_TE_1", 36: "M_ME_TF_1", 37: "M_IT_TB_1", 38: "M_EP_TD_1",
    39: "M_EP_TE_1", 40: "M_EP_TF_1", 45: "C_SC_NA_1", 46: "C_DC_NA_1", 47: "C_RC_NA_1", 48: "C_SE_NA_1",
    49: "C_SE_NB_1", 50: "C_SE_NC_1", 51: "C_BO_NA_1", 58: "C_SC_TA_1", 59: "C_DC_TA_1", 60: "C_RC_TA_1",
    61: "C_SE_TA_1", 62: "C_SE_TB_1", 63: "C_SE_TC_1", 64: "C_BO_TA_1", 70: "M_EI_NA_1", 100: "C_IC_NA_1",
    101: "C_CI_NA_1", 102: "C_RD_NA_1", 103: "C_CS_NA_1", 104: "C_TS_NA_1", 105: "C_RP_NA_1",
    106: "C_CD_NA_1", 107: "C_TS_TA_1", 110: "P_ME_NA_1", 111: "P_ME_NB_1", 112: "P_ME_NC_1",
    113: "P_AC_NA_1", POSITION: "position",
}  # fmt: skip


def _quality(octet: int) -> str:
    return " ".join(word for bit, word in LETTERS.items() if octet & bit)


def _joined(value: Any, *more: str) -> str:
    return " ".join([str(value), *filter(None, more)])


def _select(octet: int, mask: int) -> str:
    return _joined(octet & mask, "select" if octet & 0x80 else "")


def _number(form: str) -> Callable[[bytes], str]:
    return lambda octets: f"{struct.unpack(form, octets)[0]:g}"


def _time(octets: bytes) -> str:
    """CP56Time2a, or the three octets of CP24Time2a that begin it."""
    ms, minute = struct.unpack("<HB", octets[:3])
    clock = f"{minute & 63:02}:{ms // 1000:02}.{ms % 1000:03}"
    if len(octets) == 7:
        hour, day, month, year = octets[3:]
        clock = f"20{year & 127:02}-{month & 15:02}-{day & 31:02} {hour & 31:02}:{clock}"
    return _joined(clock, "IV" if minute & 0x80 else "")


def _counter(octets: bytes) -> str:
    reading, sequence = struct.unpack("<iB", octets)
    words = (word for bit, word in ((0x20, "CY"), (0x40, "CA"), (0x80, "IV")) if sequence & bit)
    return _joined(reading, f"sq {sequence & 31}", *words)


# By part: how many octets it has, and what makes a text of them.
PARTS: dict[str, tuple[int, Callable[[bytes], str]]] = {
    "SIQ": (1, lambda octets: _joined(octets[0] & 1, _quality(octets[0] & 0xF0))),
    "DIQ": (1, lambda octets: _joined(octets[0] & 3, _quality(octets[0] & 0xF0))),
    "QDS": (1, lambda octets: _quality(octets[0])),
    "QDP": (1, lambda octets: _quality(octets[0] & 0xF0)),
    "VTI": (
        1,
        lambda octets: _joined(
            (octets[0] & 127) - (octets[0] & 64) * 2, "transient" if octets[0] & 128 else ""
        ),
    ),
    "BSI": (4, lambda octets: f"0x{int.from_bytes(octets, 'little'):08x}"),
    "NVA": (2, lambda octets: f"{struct.unpack('<h', octets)[0] / 32768:.6g}"),
    "SVA": (2, _number("<h")),
    "R32": (4, _number("<f")),
    "BCR": (5, _counter),
    "SEP": (1, lambda octets: _joined(octets[0] & 3, _quality(octets[0] & 0xF0))),
    "SPE": (1, lambda octets: f"0x{octets[0]:02x}"),
    "OCI": (1, lambda octets: f"0x{octets[0]:02x}"),
    "SCD": (4, lambda octets: f"0x{int.from_bytes(octets, 'little'):08x}"),
    "SCO": (1, lambda octets: _select(octets[0], 1)),
    "DCO": (1, lambda octets: _select(octets[0], 3)),
    "RCO": (1, lambda octets: _select(octets[0], 3)),
    "QOS": (1, lambda octets: "select" if octets[0] & 0x80 else ""),
    "Q": (1, lambda octets: str(octets[0])),
    "FBP": (2, lambda octets: f"0x{int.from_bytes(octets, 'little'):04x}"),
    "T16": (2, lambda octets: f"{int.from_bytes(octets, 'little')} ms"),
    "T24": (3, _time),
    "T56": (7, _time),
    "LAT": (4, lambda octets: f"{struct.unpack('<i', octets)[0] / 1e7:.7f}"),
    "ALT": (3, lambda octets: f"{int.from_bytes(octets, 'little', signed=True) / 10:g} m"),
    "FIX": (1, lambda octets: f"fix {octets[0] & 15}, {octets[0] >> 4} satellites"),
}


@dataclass
class Frame:
    """One APDU. What is beyond its octets, or unknown, is not told."""

    kind: str  # I, S, U
    what: str  # of an I frame its numbers; of a U frame its name
    type: str = ""
    cause: str = ""
    ca: int | None = None
    objects: list[tuple[int, str]] = field(default_factory=list)  # IOA, and what it says


def decode(apdu: bytes) -> Frame:
    """Of an APDU with its two first octets; whatever it is, something is told."""
    if len(apdu) < 6:
        return Frame("?", apdu.hex(" "))
    control = apdu[2]
    if control & 3 == 3:
        return Frame("U", U_FRAMES.get(control, apdu.hex(" ")))
    sent, received = (each >> 1 for each in struct.unpack("<HH", apdu[2:6]))
    if control & 3 == 1:
        return Frame("S", f"{received}")
    frame = Frame("I", f"{sent}, {received}")
    asdu = apdu[6:]
    if len(asdu) < 6:
        return frame
    type_, count, cause, _, frame.ca = struct.unpack("<BBBBH", asdu[:6])
    frame.type = NAMES.get(type_, str(type_))
    words = (word for bit, word in ((0x40, "negative"), (0x80, "test")) if cause & bit)
    frame.cause = _joined(CAUSES.get(cause & 63, cause & 63), *words)
    frame.objects = list(_objects(type_, count, asdu[6:]))
    return frame


def _objects(type_: int, count: int, octets: bytes) -> Iterator[tuple[int, str]]:
    parts = [PARTS[part] for part in ELEMENTS.get(type_, "").split()]
    size = sum(length for length, _ in parts)
    ioa = 0
    for number in range(count & 127):
        if number == 0 or not count & 128:
            if len(octets) < 3:
                return
            ioa, octets = int.from_bytes(octets[:3], "little"), octets[3:]
        else:
            ioa += 1
        if type_ not in ELEMENTS or len(octets) < size:
            yield ioa, octets.hex(" ")
            return
        texts = []
        for length, text_of in parts:
            texts.append(text_of(octets[:length]))
            octets = octets[length:]
        yield ioa, " ".join(filter(None, texts))
