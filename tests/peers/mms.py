# SPDX-License-Identifier: GPL-3.0-or-later
"""A client of MMS of the tests' own, octet by octet: for what foreign clients would never send."""

from __future__ import annotations

import os
import socket
import ssl
from dataclasses import dataclass, field
from typing import Self

from rig.capture import Connection

RECORD: list[Connection] = []  # of this process, for the session's last fixture
VISIBLE_STRING, INTEGER, SEQUENCE = 0x1A, 0x02, 0x30
NAME_LIST, READ, WRITE, TYPE, LIST_ATTRIBUTES = 0xA1, 0xA4, 0xA5, 0xA6, 0xAC
LIST_DEFINE, LIST_DELETE = 0xAB, 0xAD
STATUS, IDENTIFY, CONCLUDE = 0x80, 0x82, 0x8B
FILE_OPEN, FILE_READ, FILE_CLOSE, FILE_DIRECTORY = 0xBF48, 0x9F49, 0x9F4A, 0xBF4D
RESPONSE, ERROR, REPORT, REJECT = 0xA1, 0xA2, 0xA3, 0xA4
DONE = (0x81, b"")  # of a Write
CONNECT_TRANSPORT = bytes.fromhex("0300001611e00000000100c0010dc2020001c1020001")
ACSE, MMS = bytes.fromhex("52010001"), bytes.fromhex("28ca220201")


def element(tag: int, *parts: bytes) -> bytes:
    content = b"".join(parts)
    size = len(content)
    length = bytes([size]) if size < 128 else bytes([0x82]) + size.to_bytes(2, "big")
    return tag.to_bytes(1 + (tag > 0xFF), "big") + length + content


def elements(octets: bytes) -> list[tuple[int, bytes]]:
    """Tags and contents, one after the other."""
    found = []
    while octets:
        tag, size, at = octets[0], octets[1], 2
        if tag & 0x1F == 0x1F:
            tag, size, at = int.from_bytes(octets[:2], "big"), octets[2], 3
        if size & 0x80:
            count = size & 0x7F
            size, at = int.from_bytes(octets[at : at + count], "big"), at + count
        assert at + size <= len(octets), octets.hex(" ")
        found.append((tag, octets[at : at + size]))
        octets = octets[at + size :]
    return found


def refusal(answer: tuple[int, list[tuple[int, bytes]]]) -> tuple[int, bytes]:
    """Class and code of a ServiceError."""
    tag, ((_, error),) = answer
    assert tag == ERROR
    ((_, content),) = elements(error)
    ((kind, code),) = elements(content)
    return kind, code


def tpkt(payload: bytes, end: bool = True) -> bytes:
    return (
        (7 + len(payload)).to_bytes(4, "big").replace(b"\0", b"\3", 1)
        + bytes([2, 0xF0, 0x80 if end else 0])
        + payload
    )


def spdu(kind: int, *parameters: bytes) -> bytes:
    content = b"".join(parameters)
    size = len(content)
    return bytes([kind]) + (bytes([size]) if size < 255 else b"\xff" + size.to_bytes(2, "big")) + content


def initiate(max_pdu: int = 65000) -> bytes:
    detail = element(
        0xA4,
        element(0x80, b"\1"),
        element(0x81, bytes.fromhex("05f100")),
        element(0x82, bytes.fromhex("03ee1c00000408000079ef18")),
    )
    proposed = max_pdu.to_bytes(4, "big")
    return element(
        0xA8,
        element(0x80, proposed),
        element(0x81, b"\5"),
        element(0x82, b"\5"),
        element(0x83, b"\5"),
        detail,
    )


def associate(mms: bytes, contexts: tuple[tuple[int, bytes], ...] = ((1, ACSE), (3, MMS))) -> bytes:
    """The session's CONNECT around an AARQ."""
    numbers = {syntax: number for number, syntax in contexts}
    external = element(0x28, element(INTEGER, bytes([numbers.get(MMS, 3)])), element(0xA0, mms))
    aarq = element(0x60, element(0xA1, element(6, bytes.fromhex("28ca220203"))), element(0xBE, external))
    listed = [
        element(
            SEQUENCE,
            element(INTEGER, bytes([number])),
            element(6, syntax),
            element(SEQUENCE, element(6, b"\x51\1")),
        )
        for number, syntax in contexts
    ]
    user = element(
        0x61, element(SEQUENCE, element(INTEGER, bytes([numbers.get(ACSE, 1)])), element(0xA0, aarq))
    )
    normal = element(
        0xA2, element(0x81, b"\0\0\0\1"), element(0x82, b"\0\0\0\1"), element(0xA4, *listed), user
    )
    cp = element(0x31, element(0xA0, element(0x80, b"\1")), normal)
    options = bytes.fromhex("0506130100160102") + bytes.fromhex("140200023302000134020001")
    return spdu(13, options, spdu(0xC1, cp))


def data(mms: bytes, context: int = 3) -> bytes:
    list_ = element(SEQUENCE, element(INTEGER, bytes([context])), element(0xA0, mms))
    return bytes.fromhex("01000100") + element(0x61, list_)


def name(domain: str, item: str) -> bytes:
    return element(0xA1, element(VISIBLE_STRING, domain.encode()), element(VISIBLE_STRING, item.encode()))


def request(number: int, *service: bytes) -> bytes:
    return element(0xA0, element(INTEGER, number.to_bytes(4, "big")), *service)


def read(*variables: tuple[str, str]) -> bytes:
    listed = [element(SEQUENCE, element(0xA0, name(*variable))) for variable in variables]
    return element(READ, element(0xA1, element(0xA0, *listed)))


def file_name(*parts: str) -> bytes:
    return element(0xA0, *[element(0x19, part.encode()) for part in parts])


def file_open(name: str, position: int = 0) -> bytes:
    return element(FILE_OPEN, file_name(name), element(0x81, position.to_bytes(5, "big")))


def name_list(class_: int, domain: str | None = None, after: str | None = None) -> bytes:
    scope = element(0x80) if domain is None else element(0x81, domain.encode())
    more = [] if after is None else [element(0x82, after.encode())]
    return element(NAME_LIST, element(0xA0, element(0x80, bytes([class_]))), element(0xA1, scope), *more)


def report_of(pdu: bytes) -> list[tuple[int, bytes]]:
    """The elements of an information report."""
    ((_, report),) = elements(pdu)
    (_, variable), (_, results) = elements(report)
    assert variable == element(0x80, b"RPT")
    return elements(results)


def variable_names(listed: bytes) -> list[str]:
    """Of an information report: those of the VMD as they are, of a domain what is in it."""
    found = []
    for _, specification in elements(listed):
        ((_, named),) = elements(specification)
        ((tag, content),) = elements(named)
        found.append((content if tag == 0x80 else elements(content)[1][1]).decode())
    return found


# What a command carries besides its value.
def command(value: bytes, number: int = 1, who: bytes = b"tests", test: bool = False) -> list[bytes]:
    """ctlVal, origin, ctlNum, T, Test: of a Cancel. Others have Check behind."""
    origin = element(0xA2, element(0x85, b"\2"), element(0x89, who))
    flag = element(0x83, b"\xff" if test else b"\0")
    return [value, origin, element(0x86, bytes([number])), element(0x91, bytes(8)), flag]


CHECK = bytes.fromhex("84020600")


@dataclass
class Client:
    """A TCP connection, and what a client says on it."""

    port: int
    max_pdu: int = 65000
    timeout_s: float = 20.0
    socket: socket.socket = field(init=False)
    connection: Connection = field(init=False)
    number: int = 0
    reports: list[list[tuple[int, bytes]]] = field(default_factory=list)  # that came between answers
    # LastApplError, CommandTermination: names and values.
    information: list[tuple[list[str], list[tuple[int, bytes]]]] = field(default_factory=list)
    source: str = "127.0.0.1"
    tls: ssl.SSLContext | None = None

    def __post_init__(self) -> None:
        self.socket = socket.create_connection(("127.0.0.1", self.port), self.timeout_s, (self.source, 0))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self.tls:
            self.socket = self.tls.wrap_socket(self.socket)
        self.connection = Connection(os.environ.get("PYTEST_CURRENT_TEST", "?"))
        RECORD.append(self.connection)

    def __enter__(self) -> Self:
        self.send(CONNECT_TRANSPORT)
        assert self.packet()[5] == 0xD0
        self.send(tpkt(associate(initiate(self.max_pdu))))
        assert self.message()[0] == 14
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def send(self, octets: bytes) -> None:
        self.socket.sendall(octets)
        self.connection.pieces.append((False, octets))

    def octets(self, count: int) -> bytes:
        """So many. EOFError: the server has closed before."""
        received = b""
        while len(received) < count:
            piece = self.socket.recv(count - len(received))
            if not piece:
                raise EOFError(received)
            received += piece
        self.connection.pieces.append((True, received))
        return received

    def packet(self) -> bytes:
        header = self.octets(4)
        assert header[0] == 3
        return header + self.octets(int.from_bytes(header[2:], "big") - 4)

    def message(self) -> bytes:
        """What is above the transport, of as many packets as it takes."""
        whole = b""
        while True:
            packet = self.packet()
            assert packet[4:6] == b"\2\xf0"
            whole += packet[7:]
            if packet[6] & 0x80:
                return whole

    def mms(self) -> tuple[int, bytes]:
        """The next PDU: its tag and content."""
        message = self.message()
        assert message[:4] == bytes.fromhex("01000100")
        ((_, user),) = elements(message[4:])
        ((_, list_),) = elements(user)
        (_, (_, content)) = elements(list_)
        ((tag, pdu),) = elements(content)
        return tag, pdu

    def ask(self, service: bytes) -> tuple[int, list[tuple[int, bytes]]]:
        """The kind of the answer, and what it has behind the number of the request."""
        self.number += 1
        self.send(tpkt(data(request(self.number, service))))
        while (told := self.mms())[0] == REPORT:
            self.keep(told[1])
        tag, pdu = told
        (_, number), *rest = elements(pdu)
        assert int.from_bytes(number, "big") == self.number
        return tag, rest

    def keep(self, pdu: bytes) -> None:
        """What comes without being asked for."""
        ((_, told),) = elements(pdu)
        (tag, variables), (_, results) = elements(told)
        if tag == 0xA1:
            self.reports.append(report_of(pdu))
        else:
            self.information.append((variable_names(variables), elements(results)))

    def termination(self) -> tuple[list[str], list[tuple[int, bytes]]]:
        """The next LastApplError or CommandTermination."""
        while not self.information:
            tag, pdu = self.mms()
            assert tag == REPORT
            self.keep(pdu)
        return self.information.pop(0)

    def report(self) -> list[tuple[int, bytes]]:
        """The next report's elements."""
        while not self.reports:
            tag, pdu = self.mms()
            assert tag == REPORT
            self.keep(pdu)
        return self.reports.pop(0)

    def write(self, domain: str, *items: tuple[str, bytes]) -> list[tuple[int, bytes]]:
        listed = [element(SEQUENCE, element(0xA0, name(domain, item))) for item, _ in items]
        values = [value for _, value in items]
        tag, ((_, results),) = self.ask(element(WRITE, element(0xA0, *listed), element(0xA0, *values)))
        assert tag == RESPONSE
        return elements(results)

    def is_closed(self) -> bool:
        """Waits for it."""
        try:
            while self.socket.recv(65536):
                pass
        except ConnectionResetError:
            pass
        return True

    def names(self, class_: int, domain: str | None = None) -> list[str]:
        """All, with as many requests as it takes."""
        found: list[str] = []
        while True:
            tag, ((_, content),) = self.ask(name_list(class_, domain, found[-1] if found else None))
            assert tag == RESPONSE
            (_, listed), (_, more) = elements(content)
            found += [text.decode() for _, text in elements(listed)]
            if more == b"\0":
                return found

    def values(self, *variables: tuple[str, str]) -> list[tuple[int, bytes]]:
        tag, ((_, content),) = self.ask(read(*variables))
        assert tag == RESPONSE, tag
        ((_, results),) = elements(content)
        return elements(results)

    def members(self, domain: str, list_name: str) -> list[str]:
        """Of a data set that no client has made; all are of its domain."""
        tag, ((_, content),) = self.ask(element(LIST_ATTRIBUTES, name(domain, list_name)))
        assert tag == RESPONSE
        (_, deletable), (_, listed) = elements(content)
        assert deletable == b"\0"
        found = []
        for _, variable in elements(listed):
            ((_, named),) = elements(variable)
            ((_, specific),) = elements(named)
            (_, of), (_, item) = elements(specific)
            assert of.decode() == domain
            found.append(item.decode())
        return found
