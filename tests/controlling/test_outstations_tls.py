# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-104m-tls: outstations with TLS after IEC 62351-3."""

import json
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from peers.authority import OUTSTATIONS_USER, Identity, give_to_station
from peers.outstation import INTERROGATED, LIMIT_S, Outstation, asdu
from peers.tls_gateway import STATION, Pki, gateway_with, public_keys

pytestmark = pytest.mark.slow

CA, THERE = 501, 47
GOOD = b"\x00\x00\x20\x40\x00"  # 2.5
Config = dict[str, Any]
Run = Callable[..., Gateway]


@pytest.fixture(scope="module")
def pki() -> Iterator[Pki]:
    folder = run_directory()
    made = public_keys(folder)
    give_to_station(made.centre.key, OUTSTATIONS_USER)
    give_to_station(made.stranger.key, OUTSTATIONS_USER)
    yield made
    remove(folder)


def secured(pki: Pki, identity: Identity | None = None, **keys: Any) -> Config:
    mine = identity or pki.centre
    files = {"certificate": mine.certificate, "key": mine.key, "ca": pki.ours.certificate}
    return {"outstations_tls": {name: str(path) for name, path in files.items()} | keys}


def outstation(name: str, port: int, ca: int, remote_ca: int, ioa: int, **keys: Any) -> Config:
    points = [{"name": f"{name}.power", "type": "float", "ioa": ioa, "command": True}]
    quick = {"retry_ms": 50, "retry_max_ms": 200}
    sets = [{"ca": ca, "remote_ca": remote_ca, "points": points}]
    return {"name": name, "addresses": ["127.0.0.1"], "port": port, "sets": sets, **quick, **keys}


@pytest.fixture
def gateway(programs: Path) -> Iterator[Run]:
    with ExitStack() as ends:

        def start(tls: Config, *outstations: Config) -> Gateway:
            directory = run_directory()
            ends.callback(remove, directory)
            config = listening_on({"port": [], "outstations": list(outstations), **tls}, free_port())
            return ends.enter_context(Gateway(config, directory, programs))

        yield start


@pytest.fixture
def town() -> Iterator[Outstation]:
    """Without TLS."""
    with Outstation() as made:
        made.interrogated = [asdu(13, INTERROGATED, THERE, (7, GOOD))]
        yield made


def counter(gateway: Gateway, name: str) -> int:
    """0 before the module is there."""
    return int({row["counter"]: row["value"] for row in gateway.query("counters", "rtu-104m")}.get(name, 0))


def wait_good(gateway: Gateway, name: str) -> Any:
    gateway.wait_for(lambda: gateway.points(name)[name]["quality"] == "good", LIMIT_S, f"{name} is good")
    return gateway.points(name)[name]["value"]


def wait_said(gateway: Gateway, text: str) -> None:
    gateway.wait_for(lambda: text in gateway.log_file.read_text(), LIMIT_S, text)


def test_lib60870s_server_on_tls_beside_one_without(gateway: Run, pki: Pki, town: Outstation) -> None:
    security = c104.TransportSecurity(validate=True, only_known=False)
    security.set_certificate(cert=str(pki.station.certificate), key=str(pki.station.key))
    security.set_ca_certificate(cert=str(pki.ours.certificate))
    server = c104.Server(ip="127.0.0.1", port=free_port(), tick_rate_ms=100, transport_security=security)
    station = server.add_station(common_address=THERE)
    station.add_point(io_address=7, type=c104.Type.M_ME_NC_1).value = 1.5
    done: list[object] = []

    def on_command(
        point: c104.Point, previous_info: c104.Information, message: c104.IncomingMessage
    ) -> c104.ResponseState:
        done.append(point.value)
        return c104.ResponseState.SUCCESS

    station.add_point(io_address=8, type=c104.Type.C_SE_NC_1).on_receive(callable=on_command)
    server.start()
    try:
        secure = outstation(
            "c104",
            server.port,
            CA,
            THERE,
            7,
            secure=True,
            certificate=pki.station.fingerprint,
            terminates=False,
        )
        secure["sets"][0]["points"][0]["command_ioa"] = 8
        one = gateway(secured(pki), secure, outstation("plain", town.port, CA + 1, THERE, 7))
        assert wait_good(one, "c104.power") == 1.5
        assert wait_good(one, "plain.power") == 2.5
        assert json.loads(one.ctl("--json", "set", "c104.power", "3.5"))["result"] == "done"
        assert done == [3.5]
    finally:
        server.stop()


@pytest.mark.parametrize("version", ["1.2", "1.3"])
def test_our_own_station(gateway: Run, programs: Path, pki: Pki, version: str) -> None:
    """More than a record of TLS holds. A connection that is lost is made again."""
    with gateway_with(pki, programs, masters=["centre 1"]) as below:
        secure = outstation(
            "town", below.address[1], CA, STATION, 30001, secure=True, certificate="substation 7"
        )
        secure["sets"][0]["points"] = [{"type": "scaled", "ioa": 30001, "count": 1000}]
        one = gateway(secured(pki, versions=[version]), secure)
        one.wait_for(lambda: counter(one, "town.objects") >= 1000, LIMIT_S, "its points have come")
        below.wait_log(rf"TLSv{version}, \"centre 1\"")
        below.kill("rtu-iec104")
        one.wait_for(lambda: counter(one, "town.starts") == 2, LIMIT_S, "there is data transfer again")


@pytest.mark.parametrize(
    ("tls", "keys", "message"),
    [
        ({}, {"certificate": "substation 8"}, "not the certificate of this station"),
        ({"ca": "theirs/ca.pem"}, {}, "certificate is not from a known CA"),
    ],
)
def test_station_that_is_another_is_refused(
    gateway: Run, programs: Path, pki: Pki, town: Outstation, tls: Config, keys: Config, message: str
) -> None:
    folder = pki.ours.folder.parent
    with gateway_with(pki, programs) as below:
        secure = outstation("other", below.address[1], CA, STATION, 30001, secure=True, **keys)
        plain = outstation("plain", town.port, CA + 1, THERE, 7)
        one = gateway(secured(pki, **{key: str(folder / file) for key, file in tls.items()}), secure, plain)
        wait_said(one, message)
        wait_said(one, "other: 127.0.0.1 made no secure connection")
        assert wait_good(one, "plain.power") == 2.5
        assert counter(one, "other.started") == 0


def test_outstation_without_tls_is_none(gateway: Run, pki: Pki, town: Outstation) -> None:
    secure = outstation("secure", town.port, CA, THERE, 7, secure=True)
    one = gateway(secured(pki), secure, outstation("plain", town.port, CA + 1, THERE, 7))
    assert wait_good(one, "plain.power") == 2.5
    assert counter(one, "secure.started") == 0


def test_gateway_that_the_outstation_does_not_know(gateway: Run, programs: Path, pki: Pki) -> None:
    with gateway_with(pki, programs) as below:
        secure = outstation("town", below.address[1], CA, STATION, 30001, secure=True)
        one = gateway(secured(pki, pki.stranger), secure)
        below.wait_log("refused, certificate is not from a known CA")
        one.wait_for(lambda: counter(one, "town.failures") > 0, LIMIT_S, "it failed")
        assert one.points("town.power")["town.power"]["quality"] == "invalid"


@pytest.mark.parametrize(
    ("keys", "tls", "message"),
    [
        (
            {"secure": True},
            False,
            "secure: needs the certificate of this gateway, expected an object outstations_tls",
        ),
        ({"certificate": "a"}, True, 'certificate: is of an outstation with TLS, expected "secure": true'),
        (
            {"secure": True, "certificate": "x" * 65},
            True,
            "is neither a common name nor a SHA-256 fingerprint",
        ),
    ],
)
def test_mistakes(programs: Path, tmp_path: Path, pki: Pki, keys: Config, tls: bool, message: str) -> None:
    file = tmp_path / "gateway.json"
    wanted = {"outstations": [outstation("town", 2404, CA, THERE, 7) | keys], **(secured(pki) if tls else {})}
    file.write_text(json.dumps(wanted))
    command = [programs / "rtud" / "rtud", "--check", file]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert (done.returncode, message in done.stdout + done.stderr) == (1, True), done.stdout + done.stderr
