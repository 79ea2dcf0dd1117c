# SPDX-License-Identifier: GPL-3.0-or-later
"""What a show says that fails, and who listens on a TCP port."""

import os
import re
import socket
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import TimeoutExpired

import pytest

import search_path
from lab import ports, verdict
from lab.errors import LabError
from lab.gateway import Gateway, GatewayError, listening_on, remove, run_directory
from lab.verdict import NO_CAUSE, Verdict, run
from nuc980.netboot.errors import NoOutput


@pytest.fixture
def show(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Verdict:
    """Of a show on an idle machine, whose file is the test's own."""
    monkeypatch.setattr(verdict, "REPOSITORY", tmp_path)
    monkeypatch.setattr(os, "getloadavg", lambda: (0.0, 0.0, 0.0))
    return Verdict("make run PORT=2405", "run", "step 3: The pins")


def fails(show: Verdict, error: Exception, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """The lines on the terminal."""

    def act() -> None:
        with show.watched():
            raise error

    assert run(show, act) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    file = f" (details: {os.path.relpath(show.file)})"
    assert captured.err.endswith(f"{file}\n")
    return captured.err.strip().replace(file, "").split("\n")


def test_what_an_error_knows_is_said(show: Verdict, capsys: pytest.CaptureFixture[str]) -> None:
    error = LabError("long\n" * 50, expected="a point", seen="another", advice="a wire; type: make twin")
    assert fails(show, error, capsys) == [
        "expected: a point (step 3: The pins)",
        "seen:     another",
        "probably: a wire; type: make twin",
    ]
    assert "long\nlong\n" in show.file.read_text()


def test_without_advice_the_show_looks_for_the_cause(
    show: Verdict, capsys: pytest.CaptureFixture[str]
) -> None:
    show.causes += [lambda: "", lambda: "rtu-modbus-1 does not run", lambda: "never asked"]
    assert fails(show, LabError("no answer\nand 100 lines"), capsys) == [
        "expected: step 3: The pins",
        "seen:     no answer",
        "probably: rtu-modbus-1 does not run; to try again, type: make run PORT=2405",
    ]


@pytest.fixture
def busy(show: Verdict, monkeypatch: pytest.MonkeyPatch) -> Verdict:
    """Of a show on a machine with more to do than it can."""
    monkeypatch.setattr(os, "getloadavg", lambda: (12.2, 0.0, 0.0))
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    return show


@pytest.mark.parametrize("error", [LabError("x", late=True), TimeoutError(), TimeoutExpired(["x"], 1)])
def test_busy_machine_is_a_cause_where_time_ran_out(
    busy: Verdict, error: Exception, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "this machine is too busy (load 12 on 2 processors)" in fails(busy, error, capsys)[2]


def start(program: str) -> None:
    subprocess.run([program], check=True)


def listen_twice() -> None:
    with socket.create_server(("127.0.0.1", 0)) as first:
        socket.create_server(first.getsockname())


@pytest.mark.parametrize(
    ("act", "cause"),
    [
        (
            lambda: start("no-such-program"),
            "no-such-program is not installed; type: rm build/packages*.done",
        ),
        (lambda: start(__file__), f"this user may not use {__file__}"),
        (listen_twice, "another program has this port"),
        (lambda: Path("/no/such/file").read_text(), NO_CAUSE),
    ],
)
def test_what_the_machine_refuses_is_the_cause_not_its_load(
    busy: Verdict, act: Callable[[], None], cause: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(OSError) as caught:
        act()
    assert (
        fails(busy, caught.value, capsys)[2] == f"probably: {cause}; to try again, type: make run PORT=2405"
    )


@pytest.mark.parametrize(
    ("path", "completed"),
    [
        ("/usr/local/bin:/usr/bin:/bin:/usr/games", "/usr/local/bin:/usr/bin:/bin:/usr/games:{}"),
        ("/usr/sbin:/usr/bin", "/usr/sbin:/usr/bin:/usr/local/sbin:/sbin"),
        ("", "{}"),
    ],
)
def test_programs_are_found_where_debian_puts_them(path: str, completed: str) -> None:
    """Debian gives a user the first of these."""
    assert search_path.complete(path) == completed.format("/usr/local/sbin:/usr/sbin:/sbin")


def test_cause_and_next_step_of_netboot_are_said(show: Verdict, capsys: pytest.CaptureFixture[str]) -> None:
    _, seen, probably = fails(show, NoOutput("Nothing came within 5 s."), capsys)
    assert seen == "seen:     Nothing came within 5 s."
    assert probably == f"probably: {NoOutput.cause}; {NoOutput.next_step}"


def test_defect_of_the_show_has_its_traceback_in_the_file(
    show: Verdict, capsys: pytest.CaptureFixture[str]
) -> None:
    show.sources["rtud's log"] = lambda: "line 1"
    show.sources["rtuctl modules"] = lambda: str(1 / 0)
    lines = fails(show, KeyError("iec104"), capsys)
    assert len(lines) == 3 and "'iec104'" in lines[1]
    file = show.file.read_text()
    assert "==== rtud's log\nline 1\n" in file
    assert "==== rtuctl modules\nit does not answer: division by zero\n" in file
    assert "Traceback" in file and "KeyError" in file


def test_show_that_succeeds_takes_the_old_file_away(show: Verdict) -> None:
    show.file.parent.mkdir(parents=True)
    show.file.write_text("of yesterday")
    assert run(show, lambda: None) == 0
    assert not show.file.exists()


# ---- who listens


def test_listener_is_who_has_the_socket() -> None:
    with socket.create_server(("127.0.0.1", 0)) as own:
        place = own.getsockname()
        assert ports.is_listened_on_by(place, [os.getpid()])
        assert not ports.is_listened_on_by(place, [os.getppid()])
        assert f"(pid {os.getpid()})" in ports.holders(place)
    assert not ports.is_listened_on_by(place, [os.getpid()])
    assert ports.holders(place) == ""


@pytest.mark.parametrize(("address", "reached"), [("0.0.0.0", True), ("127.0.0.2", False)])
def test_listener_counts_where_a_connection_reaches_it(address: str, reached: bool) -> None:
    with socket.create_server((address, 0)) as own:
        place = ("127.0.0.1", own.getsockname()[1])
        assert ports.is_listened_on_by(place, [os.getpid()]) == reached


@pytest.mark.parametrize(
    ("address", "sockets"),
    [("0" * 32, {7}), ("0" * 16 + "FFFF00000100007F", {7}), ("0" * 24 + "01000000", set())],
)
def test_listener_of_both_families_counts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, address: str, sockets: set[int]
) -> None:
    row = f"   0: {address}:0964 {'0' * 32}:0000 0A 00000000:00000000 00:00000000 00000000     0        0 7 1"
    (tmp_path / "net").mkdir()
    (tmp_path / "net/tcp6").write_text(f"  sl  local_address remote_address st\n{row}\n")
    monkeypatch.setattr(ports, "PROC", tmp_path)
    assert ports.sockets_at(("127.0.0.1", 2404)) == sockets


@pytest.fixture
def late(programs: Path) -> Iterator[tuple[Gateway, socket.socket]]:
    """A gateway, and somebody who takes its port after it was seen free."""
    directory = run_directory()
    with socket.create_server(("127.0.0.1", 0)) as other:
        config = listening_on({"port": []}, other.getsockname()[1])
        other.setblocking(False)
        yield Gateway(config, directory, programs), other
    remove(directory)


@pytest.mark.slow
def test_no_octet_goes_to_a_station_of_somebody_else(late: tuple[Gateway, socket.socket]) -> None:
    gateway, other = late
    with pytest.raises(GatewayError, match="rtu-iec104 does not stay up"):
        gateway.start()
    with pytest.raises(BlockingIOError):
        other.accept()


def test_master_is_kept_from_a_station_of_somebody_else(
    late: tuple[Gateway, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway, _ = late
    monkeypatch.setattr(gateway, "processes", lambda: [])
    with pytest.raises(GatewayError, match=rf"\(pid {os.getpid()}\) listens on TCP port"):
        gateway.check_ours()


def test_privileged_port_is_refused_with_another(monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(socket, "create_server", denied)
    with pytest.raises(ports.PortError) as caught:
        ports.check_free(104, "make run-native")
    assert caught.value.seen == "Permission denied"
    assert re.search(r"type: make run-native PORT=24\d\d$", caught.value.advice)
