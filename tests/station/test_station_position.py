# SPDX-License-Identifier: GPL-3.0-or-later
"""The position of type 201 on the wire: tshark with the dissector in Lua, and its size beside others."""

import re
import struct
from pathlib import Path

import pytest

from rig.dissector import BITS, FIELDS, ROOT, dissected

pytestmark = pytest.mark.slow

PAGE = ROOT / "docs" / "positioning.md"

# The octets of test_geoposition.c.
HEAD = bytes((0x68, 33, 0, 0, 0, 0))
IDENTIFIER = bytes((201, 1, 5, 0, 0xFB, 0x0B))
TIME = bytes((0xCA, 0x08, 38, 9, 16, 3, 5))


def element(latitude: float, longitude: float, altitude: int, fix: int = 0xA2, quality: int = 0) -> bytes:
    """By the figure of docs/positioning.md."""
    place = struct.pack("<ii", round(latitude * 1e7), round(longitude * 1e7))
    return place + altitude.to_bytes(3, "little", signed=True) + bytes((fix, quality)) + TIME


WARSAW = element(52.219065, 21.0108517, 1372)
CHATHAM = element(-43.9508, -176.5611, -5, 0xF6, 0xE1)


def i_frame(asdu: bytes, number: int = 0) -> bytes:
    return struct.pack("<BBHH", 0x68, len(asdu) + 4, number << 1, 0) + asdu


def test_tshark_reads_a_position(tmp_path: Path) -> None:
    apdu = HEAD + IDENTIFIER + bytes((1, 0, 0)) + WARSAW
    assert len(apdu) == 35
    ((ioa, *values, wrong),) = dissected(apdu, tmp_path)
    assert ioa == "1"
    assert dict(zip(FIELDS, values, strict=True)) == {
        "latitude": "52.219065",
        "longitude": "21.0108517",
        "altitude": "137.2",
        "fix": "2",
        "satellites": "10",
        "time": "2005-03-16 09:38:02.250",
        **dict.fromkeys([*BITS, "time_invalid"], "0"),
    }
    assert wrong == ""


def test_tshark_reads_all_of_a_segment(tmp_path: Path) -> None:
    """Three APDUs, of them one with two objects and one with a sequence."""
    segment = i_frame(IDENTIFIER + bytes((1, 0, 0)) + WARSAW)
    segment += i_frame(bytes((201, 2, 3, 0, 1, 0, 7, 0, 0)) + CHATHAM + bytes((9, 1, 0)) + WARSAW, 1)
    segment += i_frame(bytes((201, 0x82, 3, 0, 1, 0, 7, 0, 0)) + CHATHAM + WARSAW, 2)
    ((ioa, *values, wrong),) = dissected(segment, tmp_path)
    found = dict(zip(FIELDS, values, strict=True))
    assert ioa == "1,7,265,7,8"
    assert found["latitude"] == "52.219065,-43.9508,52.219065,-43.9508,52.219065"
    assert found["longitude"] == "21.0108517,-176.5611,21.0108517,-176.5611,21.0108517"
    assert found["altitude"] == "137.2,-0.5,137.2,-0.5,137.2"
    assert [found[bit] for bit in BITS] == ["0,1,0,1,0"] * 3 + ["0,0,0,0,0", "0,1,0,1,0"]
    assert wrong == ""


@pytest.mark.sample(3)
@pytest.mark.parametrize("octets", [WARSAW[:-1], WARSAW + b"\0", b""], ids=["short", "long", "empty"])
def test_tshark_says_what_has_a_wrong_size(octets: bytes, tmp_path: Path) -> None:
    ((ioa, *_, wrong),) = dissected(i_frame(IDENTIFIER + bytes((1, 0, 0)) + octets), tmp_path)
    assert (ioa, wrong) == ("", "1")


def test_another_type_of_the_private_range(tmp_path: Path) -> None:
    apdu = i_frame(bytes((150,)) + IDENTIFIER[1:] + bytes((1, 0, 0)) + WARSAW)
    assert dissected(apdu, tmp_path)[0][0] == ""
    assert dissected(apdu, tmp_path, "-o", "asdu201.type:150")[0][0] == "1"


# ---- the page ------------------------------------------------------------------------------------


def block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert found is not None
    return found[1].rstrip("\n")


def test_what_the_page_compares_on_the_wire() -> None:
    """The octets of the page's own messages are those of its table."""
    request, answer = block("http").split("\n\n\n")
    head, _, body = request.partition("\n\n")
    length = re.search(r"^Content-Length: (\d+)$", head, re.MULTILINE)
    assert length is not None
    assert int(length[1]) == len(body)
    http = len(head.replace("\n", "\r\n")) + 4 + len(body)
    http_answer = len(answer.replace("\n", "\r\n")) + 4
    topic, payload = block("mqtt").split("\n")
    mqtt = 2 + 2 + len(topic) + 2 + len(payload)  # QoS 1
    assert mqtt - 2 < 128, "its length would take two octets"
    rows = dict(re.findall(r"^\| (\w[^|]*?) \| (\d+ \+ \d+) \|", PAGE.read_text(), re.MULTILINE))
    assert rows == {
        "type 201, spontaneous": "35 + 6",
        "type 201, polled": "35 + 15",
        "JSON over MQTT, QoS 1": f"{mqtt} + 4",
        "GPX over HTTP": f"{http} + {http_answer}",
    }
