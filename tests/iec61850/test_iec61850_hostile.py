# SPDX-License-Identifier: GPL-3.0-or-later
"""Single packets of kinds that have ended servers of others, and clients that take places: nobody notices."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from test_iec61850_lists import DOMAIN, configuration, definition

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from peers import mms
from peers.mms import Client, element, spdu, tpkt

PLACES = 8
DEEP = b"".join([b"\xa2\x82" + (4 * i).to_bytes(2, "big") for i in range(900, -1, -1)])
BLOCK = "LLN0$RP$urcbParts01"


@pytest.fixture(scope="module")
def gateway(programs: Path) -> Iterator[Gateway]:
    directory = run_directory()
    config = configuration(free_port())
    try:
        with Gateway(listening_on(config, free_port()), directory, programs) as running:
            yield running
            assert running.modules()["rtu-iec61850"]["restarts"] == 0
    finally:
        remove(directory)


@pytest.fixture
def port(gateway: Gateway) -> int:
    number: int = gateway.configuration()["iec61850"]["port"]
    return number


def is_served(port: int) -> bool:
    with Client(port) as client:
        return client.names(9) == [DOMAIN, "OpenRTUCA1006"]


# ---- before an association --------------------------------------------------------------------------

CONNECTIONS = {
    "a TPDU of 2^162 octets": bytes.fromhex("0300000e09e00000000100c001a2"),
    "a TPDU of one octet": bytes.fromhex("0300000e09e00000000100c00100"),
    "a TPDU size without a value": bytes.fromhex("0300000d08e00000000100c000"),
    "a selector longer than the packet": bytes.fromhex("0300000e09e00000000100c1ff00"),
    "a length indicator beyond the packet": bytes.fromhex("0300000bffe00000000100"),
    "a length indicator of nothing": bytes.fromhex("0300000b00e00000000100"),
}


@pytest.mark.parametrize("octets", CONNECTIONS.values(), ids=CONNECTIONS.keys())
def test_no_connection_of_a_strange_transport(port: int, octets: bytes) -> None:
    client = Client(port)
    client.send(octets)
    client.socket.shutdown(1)
    assert client.is_closed()
    assert is_served(port)


def connect(user: bytes) -> bytes:
    return tpkt(spdu(13, spdu(0xC1, user)))


def normal_mode(*parts: bytes) -> bytes:
    return element(0x31, element(0xA0, element(0x80, b"\1")), element(0xA2, *parts))


ASSOCIATIONS = {
    "no user data": tpkt(spdu(13)),
    "user data that end too early": tpkt(bytes.fromhex("0d04c1ff0000")),
    "no mode": connect(element(0x31)),
    "no normal mode parameters": connect(element(0x31, b"\xff\x08" + 8 * b"\xbb")),
    "empty normal mode parameters": connect(normal_mode()),
    "no context list": connect(normal_mode(element(0x61, element(mms.SEQUENCE)))),
    "a context without a name": connect(normal_mode(element(0xA4, element(mms.SEQUENCE, element(2, b"\1"))))),
    "no AARQ": tpkt(mms.associate(mms.initiate()).replace(b"\x60", b"\x61", 1)),
    "no Initiate": tpkt(mms.associate(b"")),
    "an Initiate without content": tpkt(mms.associate(element(0xA8))),
    "a request instead": tpkt(mms.associate(mms.request(1, mms.read((DOMAIN, "LLN0"))))),
    "a PDU of less than none": tpkt(
        mms.associate(mms.element(0xA8, mms.element(0x80, b"\xff"), mms.element(0x82, b"\5")))
    ),
    "data": tpkt(mms.data(mms.request(1, mms.read((DOMAIN, "LLN0"))))),
    "an end": tpkt(spdu(9)),
    "nothing": tpkt(b""),
}


@pytest.mark.parametrize("octets", ASSOCIATIONS.values(), ids=ASSOCIATIONS.keys())
def test_no_association_of_a_part_of_one(port: int, octets: bytes) -> None:
    client = Client(port)
    client.send(mms.CONNECT_TRANSPORT)
    client.packet()
    client.send(octets)
    assert client.is_closed()
    assert is_served(port)


# ---- in an association ------------------------------------------------------------------------------


def name_list(scope: bytes, *more: bytes) -> bytes:
    kind = element(0xA0, element(0x80, b"\0"))
    return element(mms.NAME_LIST, kind, element(0xA1, scope), *more)


def write(name: str, value: bytes) -> bytes:
    variable = element(mms.SEQUENCE, element(0xA0, mms.name(DOMAIN, name)))
    return element(mms.WRITE, element(0xA0, variable), element(0xA0, value))


LONG = b"\x84\xff\xff\xff\xff"
REQUESTS = {
    "a domain's name of 2 GiB": name_list(b"\x81\x84\x7f\xff\xff\xff" + b"X" * 8),
    "a domain's name of no length": name_list(b"\x81"),
    "names after one of 4 GiB": name_list(element(0x81, DOMAIN.encode()), b"\x82" + LONG),
    "names after one of no length": name_list(element(0x81, DOMAIN.encode()), b"\x82"),
    "names after $": name_list(element(0x81, DOMAIN.encode()), element(0x82, b"$")),
    "names after none": name_list(element(0x81, DOMAIN.encode()), element(0x82)),
    "no scope": element(mms.NAME_LIST, element(0xA0, element(0x80, b"\0")), element(0xA1)),
    "types of $": element(mms.TYPE, element(0xA0, mms.name(DOMAIN, "$"))),
    "types of $$$$": element(mms.TYPE, element(0xA0, mms.name(DOMAIN, "$$$$"))),
    "types of no name": element(mms.TYPE, element(0xA0, element(0xA1))),
    "types of half a name": element(mms.TYPE, element(0xA0, element(0xA1, element(0x1A, DOMAIN.encode())))),
    "members of $": element(mms.LIST_ATTRIBUTES, mms.name(DOMAIN, "$")),
    "no list is deleted": element(mms.LIST_DELETE),
    "a list without a name is deleted": element(mms.LIST_DELETE, element(0xA1, element(0xA1))),
    "a list is deleted and NULL": element(mms.LIST_DELETE, element(0xA1, element(0x80), element(5))),
    "a list of nothing": element(mms.LIST_DEFINE),
    "a list of a variable without a name": element(
        mms.LIST_DEFINE, mms.name(DOMAIN, "LLN0$X"), element(0xA0, element(mms.SEQUENCE))
    ),
    "a list of $": definition("LLN0$X", "$"),
    "a reading that is none is closed": element(mms.FILE_CLOSE, b"\x7f\x4a\1"),
    "a reading without a number": element(mms.FILE_READ),
    "a reading with a long number": element(mms.FILE_READ, bytes(9)),
    "a file without a name": element(mms.FILE_OPEN, element(0xA0)),
    "a file at -1": element(mms.FILE_OPEN, mms.file_name("OpenRTU.cid"), element(0x81, b"\xff")),
    "a directory within another": element(mms.FILE_DIRECTORY, mms.file_name("..", "..", "etc")),
    "a file is obtained": element(0xBF2E, mms.file_name("x"), mms.file_name("y")),
    "bits with nine that are unused": write(f"{BLOCK}$OptFlds", bytes.fromhex("8403090000")),
    "bits without the count of the unused": write(f"{BLOCK}$OptFlds", bytes.fromhex("8400")),
    "a number of no octet": write(f"{BLOCK}$BufTm", bytes.fromhex("8600")),
    "a number of nine": write(f"{BLOCK}$IntgPd", element(0x86, bytes(9))),
    "a text of zeros": write(f"{BLOCK}$RptID", element(0x8A, bytes(129))),
    "a text that is too long": write(f"{BLOCK}$RptID", element(0x8A, b"X" * 130)),
    "a time of no octets": write("LLN0$BR$brcbParts01$TimeofEntry", bytes.fromhex("8c00")),
    "an entry of a short number": write("LLN0$BR$brcbParts01$EntryID", bytes.fromhex("890401020304")),
    "a value within 900 others": write(f"{BLOCK}$BufTm", DEEP),
    "a value of no octets": element(mms.WRITE, element(0xA0), element(0xA0, b"\x83")),
    "more values than variables": element(mms.WRITE, element(0xA0), element(0xA0, bytes.fromhex("830100"))),
    "more variables than one request has": element(
        mms.READ, element(0xA1, element(0xA0, 1025 * element(mms.SEQUENCE, element(0xA0))))
    ),
    "a service of no octets": b"",
    "a service of an endless tag": b"\xbf\xff\xff\xff\x7f\0",
    "a service of an open length": b"\xa4\x80\0\0",
}


@pytest.mark.parametrize("service", REQUESTS.values(), ids=REQUESTS.keys())
def test_a_strange_request_is_answered(port: int, service: bytes) -> None:
    """And so is what comes behind it."""
    with Client(port) as client:
        client.send(tpkt(mms.data(mms.request(1, service))))
        assert client.mms()[0] in (mms.RESPONSE, mms.ERROR, mms.REJECT)
        assert client.names(9)


PDUS = {
    "nothing": b"",
    "a second Initiate": mms.initiate(),
    "a response": element(mms.RESPONSE, element(2, b"\1")),
    "a request without a number": element(0xA0),
    "a request of the number -1": element(0xA0, element(2, b"\xff"), element(mms.IDENTIFY)),
    "a request of a long number": element(0xA0, element(2, b"\1" * 9), element(mms.IDENTIFY)),
    "a cancellation": element(0x85, b"\1"),
    "two of them": 2 * mms.request(1, element(mms.IDENTIFY)),
}


@pytest.mark.parametrize("pdu", PDUS.values(), ids=PDUS.keys())
def test_a_strange_pdu_harms_nobody(port: int, pdu: bytes) -> None:
    client = Client(port)
    with client:
        client.send(tpkt(mms.data(pdu)))
        client.socket.shutdown(1)
        assert client.is_closed()
    assert is_served(port)


# ---- places -----------------------------------------------------------------------------------------


def test_clients_that_associate_and_sleep_keep_their_places_and_no_other(port: int) -> None:
    """One more than there are places is turned away at once; the others are served when they wake up."""
    sleepers = [Client(port).__enter__() for _ in range(PLACES)]
    turned_away = Client(port)
    assert turned_away.is_closed()
    for client in sleepers:
        assert client.names(9)
    sleepers.pop().socket.close()
    with Client(port) as client:
        assert client.names(9)
    for client in sleepers:
        client.socket.close()
