# SPDX-License-Identifier: GPL-3.0-or-later
"""File services of MMS: clients read the SCL file of the server, and nothing else, nor change it."""

import copy
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_iec61850_scl import DEVICE, site_config

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from peers import mms
from peers.mms import Client, element
from rig.capture import Connection, Relay, dissect_mms
from rig.rights import SUPERUSER, lacks, need

TESTS = Path(__file__).resolve().parents[1]
PATHS = os.environ | {"PYTHONPATH": str(TESTS.parent / "scripts")}
NAME = "OpenRTU.cid"
PUBLISHED = {
    "name": "bay",
    "control_block": f"{DEVICE}/LLN0$GO$bay",
    "data_set": f"{DEVICE}/LLN0$bay",
    "app_id": 0x1004,
    "conf_rev": 7,
    "points": ["feeder10.breaker-command"],
}
NO_FILE, NO_POSITION, NO_NUMBER = (0x8B, b"\7"), (0x8B, b"\5"), (0x87, b"\2")


@pytest.fixture(scope="module")
def gateway(programs: Path) -> Iterator[Gateway]:
    directory = run_directory()
    config = site_config(free_port())
    config["iec61850"]["max_pdu"] = 16000
    if not lacks(SUPERUSER):  # rtu-goose would not stay up without its socket
        config["goose"] = {"interface": "lo", "publish": [PUBLISHED]}
    try:
        with Gateway(listening_on(config, free_port()), directory, programs) as running:
            yield running
    finally:
        remove(directory)


@pytest.fixture(scope="module")
def file(gateway: Gateway, programs: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """What rtud says of the configuration."""
    path = tmp_path_factory.mktemp("files") / "gateway.json"
    path.write_text(json.dumps(gateway.configuration()))
    command = [programs / "rtud/rtud", "--scl", "--cid", path]
    return subprocess.run(command, capture_output=True, check=True).stdout


def port_of(gateway: Gateway) -> int:
    port: int = gateway.configuration()["iec61850"]["port"]
    return port


def opened(client: Client, position: int = 0) -> tuple[bytes, int]:
    """The number of the reading, and the file's size."""
    tag, ((_, content),) = client.ask(mms.file_open(NAME, position))
    assert tag == mms.RESPONSE
    (_, number), (_, attributes) = mms.elements(content)
    return number, int.from_bytes(mms.elements(attributes)[0][1], "big")


def part(client: Client, number: bytes) -> tuple[bytes, bool]:
    tag, ((_, content),) = client.ask(element(mms.FILE_READ, number))
    assert tag == mms.RESPONSE
    (_, octets), (_, more) = mms.elements(content)
    return octets, more != b"\0"


def rest(client: Client, number: bytes) -> bytes:
    octets, more = part(client, number)
    while more:
        piece, more = part(client, number)
        octets += piece
    return octets


def listed(client: Client, *request: bytes) -> list[tuple[str, int]]:
    tag, ((_, content),) = client.ask(element(mms.FILE_DIRECTORY, *request))
    assert tag == mms.RESPONSE
    ((_, entries),) = mms.elements(content)
    found = []
    for _, entry in mms.elements(mms.elements(entries)[0][1]):
        (_, name), (_, attributes) = mms.elements(entry)
        (_, size), (_, changed) = mms.elements(attributes)
        assert len(changed) == len("20000101000000Z") and changed.endswith(b"Z")
        found.append((mms.elements(name)[0][1].decode(), int.from_bytes(size, "big")))
    return found


@pytest.mark.parametrize("max_pdu", [1000, 16000])
def test_the_file_is_what_rtud_says(gateway: Gateway, file: bytes, max_pdu: int) -> None:
    """From the first octet, from the middle, and from behind the last."""
    with Client(port_of(gateway), max_pdu) as client:
        for position in (0, len(file) // 2, len(file)):
            number, size = opened(client, position)
            assert size == len(file)
            assert rest(client, number) == file[position:]
            assert part(client, number) == (b"", False)
            assert client.ask(element(mms.FILE_CLOSE, number)) == (mms.RESPONSE, [(0x9F4A, b"")])


def test_it_is_the_only_one(gateway: Gateway, file: bytes) -> None:
    with Client(port_of(gateway)) as client:
        only = [(NAME, len(file))]
        for directory in (
            [],
            [mms.file_name()],
            [mms.file_name("")],
            [mms.file_name("/")],
            [mms.file_name(NAME)],
        ):
            assert listed(client, *directory) == only
        assert listed(client, element(0xA1, element(0x19, NAME.encode()))) == []
        for name in ("/etc/passwd", "..", "../" + NAME, NAME + "x", NAME[:-1], "\0"):
            assert mms.refusal(client.ask(mms.file_open(name))) == NO_FILE
            assert mms.refusal(client.ask(element(mms.FILE_DIRECTORY, mms.file_name(name)))) == NO_FILE
        assert client.ask(mms.file_open("/" + NAME))[0] == mms.RESPONSE


def test_what_is_no_reading_is_refused(gateway: Gateway, file: bytes) -> None:
    """A client has one reading at a time, which nobody else has."""
    with Client(port_of(gateway)) as client, Client(port_of(gateway)) as other:
        for position in (len(file) + 1, 0xFFFFFFFF):
            assert mms.refusal(client.ask(mms.file_open(NAME, position))) == NO_POSITION
        first, _ = opened(client)
        number, _ = opened(client)
        wrong = (first, bytes(1), b"\x7f", b"\xff\xff\xff\xff")
        for service in (mms.FILE_READ, mms.FILE_CLOSE):
            for each in wrong:
                assert mms.refusal(client.ask(element(service, each))) == NO_NUMBER
            assert mms.refusal(other.ask(element(service, number))) == NO_NUMBER
        assert rest(client, number) == file
        assert client.ask(element(mms.FILE_CLOSE, number))[0] == mms.RESPONSE
        for service in (mms.FILE_READ, mms.FILE_CLOSE):
            assert mms.refusal(client.ask(element(service, number))) == NO_NUMBER
            assert client.ask(element(service))[0] == mms.ERROR  # without a number
        assert client.ask(element(mms.FILE_OPEN))[0] == mms.REJECT
        assert client.ask(element(mms.FILE_OPEN, mms.file_name(NAME, NAME)))[0] == mms.REJECT
        assert client.ask(element(mms.FILE_DIRECTORY, mms.file_name(NAME, NAME)))[0] == mms.REJECT


def test_a_reading_ends_with_its_client(gateway: Gateway, file: bytes) -> None:
    """More clients than there are places, none of which closes its reading."""
    for _ in range(20):
        with Client(port_of(gateway)) as client:
            number, _ = opened(client)
            part(client, number)
    with Client(port_of(gateway)) as client:
        assert rest(client, opened(client)[0]) == file


@pytest.mark.slow
def test_a_changed_publication_is_in_it(gateway: Gateway) -> None:
    """Of GOOSE, whose other module goes on."""
    need(SUPERUSER, "rtu-goose has a socket on an interface's frames")
    config = gateway.configuration()
    changed = copy.deepcopy(config)
    changed["goose"]["publish"][0]["conf_rev"] = 8
    for document, revision in ((changed, 8), (config, 7)):
        gateway.ctl("reload", gateway.put(document))

        def described(wanted: bytes = f'confRev="{revision}" appID="bay"'.encode()) -> bool:
            try:
                with Client(port_of(gateway)) as client:
                    return wanted in rest(client, opened(client)[0])
            except (OSError, EOFError, AssertionError):
                return False  # it ends, or has not begun

        gateway.wait_for(described, 20, "the file has the other revision")


@pytest.mark.slow
def test_libiec61850_takes_it(gateway: Gateway, file: bytes, tmp_path: Path) -> None:
    """Its client lists and takes the file, and tshark understands each frame."""
    record: list[Connection] = []
    relay = Relay(("127.0.0.1", port_of(gateway)), record)
    command = [sys.executable, "-m", "peers.libiec61850_files", str(relay.address[1]), str(tmp_path)]
    run = subprocess.run(
        command, cwd=TESTS, env=PATHS, capture_output=True, text=True, timeout=120, check=False
    )
    relay.close()
    assert run.returncode == 0, run.stderr + run.stdout
    ((name, (size, changed_ms)),) = json.loads(run.stdout).items()
    assert (name, size) == (NAME, len(file)) and changed_ms > 1.6e12
    assert (tmp_path / NAME).read_bytes() == file
    answered, findings = dissect_mms(record, tmp_path / "mms.pcap")
    assert findings == []
    assert {"72", "73", "74", "77"} <= set(answered)
