# SPDX-License-Identifier: GPL-3.0-or-later
"""rtud against what it meets: wrong folders, programs that cannot run, a log that nobody reads."""

import contextlib
import fcntl
import grp
import itertools
import json
import os
import pty
import re
import resource
import shutil
import signal
import socket
import subprocess
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from rig.desk import chapter_5, errors_of
from rig.rights import SUPERUSER, needed

STATION = "rtu-iec104"
LINES = ("rtu-modbus-1", "rtu-modbus-2")
MODULES_GROUP = 61200
NO_FILTER = "the modules run without a filter of system calls: "
READ_A_PERIOD = 6 * 16  # a bell is heard so often, and other things are looked at besides
FLOOD = 20_000  # rings
FIRST_PAUSE_S = 0.1  # after a life shorter than a second
EXECVE = 59  # of x86-64


def command(gateway: Gateway, **changed: Path) -> list[str | Path]:
    options = {"map": gateway.map, "dev": gateway.dev, "modules": gateway.build / "modules"} | changed
    words = [word for name, value in options.items() for word in (f"--{name}", value)]
    return [gateway.build / "rtud" / "rtud", *words, gateway.config_file]


@contextlib.contextmanager
def rtud(gateway: Gateway, **popen: Any) -> Iterator[subprocess.Popen[bytes]]:
    """rtud as a child with a log file, started in another way than Gateway does; ended by SIGKILL."""
    with gateway.log_file.open("ab") as log:
        options = {"stdin": subprocess.DEVNULL, "stderr": log} | popen
        process = subprocess.Popen(options.pop("args", command(gateway)), **options)
    gateway.process = process
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        gateway.process = None


def wait_running(gateway: Gateway) -> dict[str, dict[str, Any]]:
    """Until all modules run. Their rows of the table."""

    def running() -> bool:
        with contextlib.suppress(Exception):
            return all(gateway.modules()[name]["state"] == "running" for name in (STATION, *LINES))
        return False

    gateway.wait_for(running, 60.0, "all modules run")
    return gateway.modules()


def wait_gone(pid: int) -> None:
    deadline = time.monotonic() + 60
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        while Path(f"/proc/{pid}/stat").read_text().rsplit(") ", 1)[1][0] != "Z":
            assert time.monotonic() < deadline, f"process {pid} is still there"
            time.sleep(0.01)


@pytest.fixture
def gateway(programs: Path) -> Iterator[Gateway]:
    """Chapter 5 without its devices, not yet started."""
    directory = run_directory()
    try:
        yield Gateway(listening_on(chapter_5(), free_port()), directory, programs)
    finally:
        remove(directory)


# ---- what a module has -----------------------------------------------------------------------


def status_of(pid: int) -> dict[str, list[str]]:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return {key: value.split() for key, _, value in (line.partition(":") for line in lines)}


def test_modules_have_what_they_need_and_no_more(gateway: Gateway) -> None:
    with Path(__file__).open() as leaked, rtud(gateway, pass_fds=[leaked.fileno()]):
        modules = wait_running(gateway)
        for name in (STATION, *LINES):
            pid = modules[name]["pid"]
            status = status_of(pid)
            files = [str(entry.readlink()) for entry in Path(f"/proc/{pid}/fd").iterdir()]
            assert __file__ not in files
            assert not [file for file in files if file.endswith(".seg")]  # mapped, and let go of
            assert Path(f"/proc/{pid}/environ").read_bytes() == b"PATH=/usr/bin:/bin\0"
            assert status["NoNewPrivs"] == ["1"]
            assert status["Seccomp"] == ["0" if is_sanitized(gateway) else "2"]
            assert_limited(gateway, pid)
            if os.geteuid() == 0:
                assert len(set(status["Uid"])) == 1
                assert status["Uid"][0] != "0"
                for kind in ("CapInh", "CapPrm", "CapEff", "CapBnd", "CapAmb"):
                    assert int(status[kind][0], 16) == 0
        if os.geteuid() == 0:
            users = {status_of(modules[name]["pid"])["Uid"][0] for name in (STATION, *LINES)}
            assert len(users) == 3
            assert status_of(modules[STATION]["pid"])["Groups"] == []  # the network cannot reach a line
    assert (NO_FILTER in gateway.log(1000)) is is_sanitized(gateway)


def is_sanitized(gateway: Gateway) -> bool:
    """Its calls, processes and mappings are others: such a build does without filters and limits."""
    return b"__asan_init" in (gateway.build / "modules" / "rtu-modbus").read_bytes()


def assert_limited(gateway: Gateway, pid: int) -> None:
    limits = Path(f"/proc/{pid}/limits").read_text()
    hard = dict(re.findall(r"^Max (.+?)  +\S+ +(\S+)", limits, re.MULTILINE))
    assert hard["core file size"] == "0"
    assert int(hard["open files"]) < 128
    assert int(hard["realtime timeout"]) == 5_000_000
    if is_sanitized(gateway):
        return
    assert hard["processes"] == "0"
    assert hard["file size"] == "0"
    assert int(hard["address space"]) < 64 << 20


@pytest.mark.slow
def test_module_that_executes_something_is_ended_and_restarted(gateway: Gateway) -> None:
    """The station's process, in somebody else's hands; the log names what it tried, and the lines go on."""
    if is_sanitized(gateway):
        pytest.skip("no filters in a build with a sanitizer, which the test above sees")
    modules = gateway.directory / "modules"
    modules.mkdir(mode=0o755)
    (modules / "rtu-modbus").symlink_to(gateway.build / "modules" / "rtu-modbus")
    (modules / STATION).symlink_to(gateway.build / "modules" / "planted")
    ended = f"{STATION} was killed for a forbidden system call: "
    with rtud(gateway, args=command(gateway, modules=modules)):
        gateway.wait_for(
            lambda: gateway.log(1000).count(ended) >= 3, 60.0, "it is restarted, and ended again"
        )
        log = gateway.log(1000)
        assert log.count(ended) == log.count(f"{ended}{EXECVE} (execve)")
        assert f"{STATION} info: works" in log
        assert "execve has returned" not in log
        assert [gateway.modules()[name]["restarts"] for name in LINES] == [0, 0]


def test_files_of_the_map_are_nobody_elses(gateway: Gateway) -> None:
    with rtud(gateway, umask=0o077):
        wait_running(gateway)  # modules reach it, whatever rtud's umask
        assert gateway.map.stat().st_mode & 0o777 == 0o711
        for segment in gateway.map.glob("*.seg"):
            assert segment.stat().st_uid == os.geteuid()
            assert segment.stat().st_mode & 0o777 == (0o640 if os.geteuid() == 0 else 0o600)
            assert os.geteuid() != 0 or segment.stat().st_gid == MODULES_GROUP


@needed(SUPERUSER, "other users take root to become")
def test_map_is_shown_to_its_group_alone(gateway: Gateway) -> None:
    def rtuctl(group: int, *words: str) -> subprocess.CompletedProcess[str]:
        who = ["setpriv", "--reuid=65534", f"--regid={group}", "--clear-groups", "--"]
        call = [*who, gateway.build / "rtuctl" / "rtuctl", "--map", gateway.map, *words]
        return subprocess.run(call, capture_output=True, text=True, timeout=10)

    with rtud(gateway):
        wait_running(gateway)
        assert STATION in rtuctl(MODULES_GROUP, "modules").stdout
        stranger = rtuctl(65534, "modules")
        assert stranger.returncode != 0
        assert "cannot open rtud.seg: Permission denied (rtud's user may write it" in stranger.stderr
        reader = rtuctl(MODULES_GROUP, "set", next(iter(gateway.points())), "1")
        assert reader.returncode != 0
        assert "cannot open rtuctl.seg: Permission denied" in reader.stderr


# A group of the system, no matter which, and the modules' own.
GROUPS = [
    next(group for group in grp.getgrall() if group.gr_name not in ("root", "dialout")),
    grp.getgrnam("dialout"),
]
ACCOUNT = 1000


@contextlib.contextmanager
def serial_port(group: int, mode: int) -> Iterator[str]:
    """A pseudo-terminal that belongs to a group, as udev makes serial ports."""
    master, slave = pty.openpty()
    try:
        path = os.ttyname(slave)
        os.chown(path, 0, group)
        Path(path).chmod(mode)
        yield path
    finally:
        os.close(master)
        os.close(slave)


def denied(gateway: Gateway, path: str, user: int) -> str:
    """What the log says behind "Permission denied"."""
    config = json.loads(gateway.config_file.read_text())
    config["port"] = [dict(config["port"][0], device=path)]
    gateway.config_file.write_text(json.dumps(config))
    who = [] if user == 0 else ["setpriv", f"--reuid={user}", f"--regid={user}", "--clear-groups", "--"]
    for folder in (gateway.directory, gateway.dev):
        folder.mkdir(exist_ok=True)
        os.chown(folder, user, user)
    with rtud(gateway, args=[*who, *command(gateway)]):
        said = f"{path} cannot be opened: Permission denied; trying again in 1 s\n"
        gateway.wait_for(
            lambda: "its group" in gateway.log(1000).partition(said)[2], 60.0, "the group is named"
        )
    return next(line for line in gateway.log(1000).splitlines() if "its group" in line)


@needed(SUPERUSER, "a port is given to a group by root")
@pytest.mark.parametrize("group", GROUPS, ids=("another", "dialout"))
def test_a_port_that_is_denied_names_its_group(gateway: Gateway, group: grp.struct_group) -> None:
    with serial_port(group.gr_gid, 0o660) as path:
        name = group.gr_name
        advice = f": its group is {name}; join it: sudo usermod -aG {name} $USER, and log in again"
        assert denied(gateway, path, ACCOUNT).endswith(advice)


@needed(SUPERUSER, "a port is given to a group by root")
def test_nobody_is_told_to_join_the_group_of_root(gateway: Gateway) -> None:
    with serial_port(0, 0o660) as path:
        assert denied(gateway, path, ACCOUNT).endswith(f": its group is root: sudo chgrp dialout {path}")


@needed(SUPERUSER, "rtud gives its modules users of their own only as root")
def test_a_port_that_modules_of_root_may_not_open_is_given_to_their_group(gateway: Gateway) -> None:
    with serial_port(GROUPS[0].gr_gid, 0o660) as path:
        assert denied(gateway, path, 0).endswith(
            f": its group is {GROUPS[0].gr_name}: sudo chgrp dialout {path}"
        )


@needed(SUPERUSER, "a port is given to a group by root")
def test_a_port_that_no_group_may_open_says_its_mode(gateway: Gateway) -> None:
    with serial_port(GROUPS[1].gr_gid, 0o620) as path:
        assert denied(gateway, path, 0).endswith("its group, dialout, may not read and write it (mode 0620)")


def anonymous_kib(pid: int) -> int:
    """Heap, stack and data that no other process shares."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("Anonymous:"))


def test_the_parsed_file_is_given_back(gateway: Gateway) -> None:
    config = json.loads(gateway.config_file.read_text())
    config["port"][0]["slaves"][0]["coils"] = [{"address": address} for address in range(5000)]
    gateway.config_file.write_text(json.dumps(config))
    with rtud(gateway) as process:
        modules = wait_running(gateway)
        assert anonymous_kib(process.pid) < 512
        for name in (STATION, *LINES):  # who would lock it in memory for a rounding
            assert "/libm." not in Path(f"/proc/{modules[name]['pid']}/maps").read_text()


@pytest.mark.slow
def test_rings_close_together_are_heard_together(gateway: Gateway) -> None:
    with rtud(gateway):
        pid = wait_running(gateway)[STATION]["pid"]
        with (gateway.map / f"{STATION}.bell").open("wb", buffering=0) as bell:
            begun = time.monotonic()
            before = int(status_of(pid)["voluntary_ctxt_switches"][0])
            while time.monotonic() - begun < 0.5:
                bell.write(b"\0")
                os.sched_yield()
            wakes = int(status_of(pid)["voluntary_ctxt_switches"][0]) - before
            passed = time.monotonic() - begun
        assert 2 <= wakes < 550 * passed  # one in 2 ms


def reads(pid: int) -> int:
    """System calls that read, so far."""
    return int(re.findall(r"^syscr: (\d+)$", Path(f"/proc/{pid}/io").read_text(), re.MULTILINE)[0])


@pytest.mark.parametrize(("name", "period_s"), [("rtud", 0.05), (LINES[0], 0.025)])
def test_flooded_bell_is_heard_a_few_times_a_period(gateway: Gateway, name: str, period_s: float) -> None:
    """At real-time priority each ring would take the core from others."""
    with rtud(gateway) as process:
        modules = wait_running(gateway)
        pid = process.pid if name == "rtud" else modules[name]["pid"]
        with (gateway.map / f"{name}.bell").open("wb", buffering=0) as bell:
            before, begun = reads(pid), time.monotonic()
            for _ in range(FLOOD):
                bell.write(b"\0")
            heard = reads(pid) - before
        periods = (time.monotonic() - begun) / period_s + 2  # begun before the first, ended in the last
        assert heard < READ_A_PERIOD * periods


def granted(pid: int) -> dict[str, Any]:
    fifo = os.sched_getscheduler(pid) == os.SCHED_FIFO
    locked_kib = int(status_of(pid)["VmLck"][0])
    priority = os.sched_getparam(pid).sched_priority
    return {"running": True, "fifo": fifo, "priority": priority, "locked_kib": locked_kib}


def wait_serving(gateway: Gateway) -> dict[str, dict[str, Any]]:
    """Until the line processes have all that they get, and try to open their ports, which are not there."""
    modules = wait_running(gateway)
    gateway.wait_for(lambda: all(line["port_errors"] for line in gateway.query("lines")), 60.0, "lines work")
    return modules


def log_count(gateway: Gateway, module: str, text: str) -> int:
    """How often a module has said it in its log."""
    lines = map(json.loads, gateway.ctl("--json", "log").splitlines())
    return sum(line["module"] == module and line["text"].startswith(text) for line in lines)


NO_PRIORITY = "cannot give the line processes a real-time priority: "
NOT_LOCKED = "cannot lock memory: "


def test_histogram_says_what_the_kernel_has_given(gateway: Gateway) -> None:
    with rtud(gateway):
        modules = wait_serving(gateway)
        lines = gateway.query("lines", "--histogram")
        assert {line["process"]["name"] for line in lines} == set(LINES)
        for line in lines:
            name, process = line["process"]["name"], line["process"]
            given = granted(modules[name]["pid"])
            assert process == given | {"name": name}
            realtime = line["realtime_kernel"] and given["fifo"] and given["locked_kib"] > 0
            assert line["realtime"] is realtime
            assert line["verdict"].startswith("none: ") is not realtime
            assert log_count(gateway, name, NOT_LOCKED) == (given["locked_kib"] == 0)
        assert log_count(gateway, "rtud", NO_PRIORITY) == (not all(line["process"]["fifo"] for line in lines))


def test_what_the_kernel_refuses_is_said_once(gateway: Gateway) -> None:
    """rtud without the rights that real time takes: everything works, and nothing is called real-time."""
    refuse: list[str | Path] = ["prlimit", "--rtprio=0:0", "--memlock=0:0"]
    if os.geteuid() == 0:
        refuse += ["setpriv", "--bounding-set", "-sys_nice,-ipc_lock,-sys_resource"]
    with rtud(gateway, args=refuse + command(gateway)):
        wait_serving(gateway)
        lines = gateway.query("lines", "--histogram")
        for line in lines:
            process = line["process"]
            assert (process["fifo"], process["priority"], process["locked_kib"]) == (False, 0, 0)
            assert not line["realtime"]
            assert line["verdict"].startswith("none: ")
        table = gateway.ctl("lines", "--histogram")
        assert table.count("ordinary scheduling, memory not locked\nverdict: none: ") == len(lines)
        assert log_count(gateway, "rtud", NO_PRIORITY) == 1
        assert [log_count(gateway, name, NOT_LOCKED) for name in LINES] == [1, 1]


# ---- where it is started ------------------------------------------------------------------------


def refused(gateway: Gateway, **changed: Path) -> str:
    run = subprocess.run(
        command(gateway, **changed), stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=10
    )
    assert run.returncode == 1
    return run.stderr


@pytest.mark.slow
def test_second_rtud_is_refused_and_the_first_goes_on(gateway: Gateway) -> None:
    with rtud(gateway):
        before = wait_running(gateway)
        assert "another rtud runs on the map" in refused(gateway)
        assert wait_running(gateway)[STATION]["pid"] == before[STATION]["pid"]


def test_map_folder_that_is_not_ours_is_refused(gateway: Gateway) -> None:
    writable = gateway.directory / "writable"
    writable.mkdir()
    writable.chmod(0o777)
    link = gateway.directory / "link"
    link.symlink_to("/etc")
    assert "another user owns the map's folder" in refused(gateway, map=writable)
    assert "cannot open the map's folder" in refused(gateway, map=link)
    assert "cannot open the map's folder" in refused(gateway, map=gateway.config_file)
    assert "cannot create the map's folder" in refused(gateway, map=gateway.directory / "no" / "map")
    assert not list(writable.iterdir())


@pytest.mark.parametrize(
    ("device", "reason"),
    [("/dev/watchdog-that-is-not-there", "No such file or directory"), ("/dev/null", "Inappropriate ioctl")],
)
def test_what_is_no_watchdog_is_said(gateway: Gateway, device: str, reason: str) -> None:
    assert f"rtud: cannot use {device} as a watchdog: {reason}" in refused(gateway, watchdog=Path(device))
    assert not list(gateway.map.iterdir())  # the modules that were started have ended


def test_watchdog_is_not_opened_for_a_bad_configuration(gateway: Gateway) -> None:
    """It would reset the board for ever."""
    gateway.config_file.write_text(json.dumps({"port": [{"value": 1, "active": 1}]}))
    assert "watchdog" not in refused(gateway, watchdog=Path("/dev/watchdog-that-is-not-there"))


def test_full_file_system_is_said(gateway: Gateway) -> None:
    """As by a full tmpfs: now, and not by SIGBUS later."""

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    run = subprocess.run(
        command(gateway),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=10,
        preexec_fn=limit,
    )
    assert run.returncode == 1
    assert re.search(r"cannot give the map's segment \S+ \d+ bytes: File too large", run.stderr)


def test_runs_without_standard_streams(gateway: Gateway) -> None:
    def close_all() -> None:
        for number in range(3):
            os.close(number)

    with rtud(gateway, preexec_fn=close_all) as process:
        modules = wait_running(gateway)
        for pid in (process.pid, modules[STATION]["pid"], modules[LINES[0]]["pid"]):
            for number in range(3):
                assert str(Path(f"/proc/{pid}/fd/{number}").readlink()) == "/dev/null"


def test_end_of_the_logs_reader_is_not_the_gateways(gateway: Gateway) -> None:
    read_end, write_end = os.pipe()
    with rtud(gateway, stderr=write_end) as process:
        os.close(write_end)
        pid = wait_running(gateway)[STATION]["pid"]
        os.close(read_end)
        os.kill(pid, signal.SIGKILL)  # which rtud says in its log
        gateway.wait_for(lambda: gateway.modules()[STATION]["pid"] not in (0, pid), 60.0, "a new station")
        process.terminate()
        assert process.wait(10) == 0


def test_deaths_are_seen_though_sigchld_was_ignored(gateway: Gateway) -> None:
    def ignore() -> None:
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)

    with rtud(gateway, preexec_fn=ignore):
        pid = wait_running(gateway)[STATION]["pid"]
        os.kill(pid, signal.SIGKILL)
        gateway.wait_for(lambda: gateway.modules()[STATION]["pid"] not in (0, pid), 60.0, "a new station")
        assert gateway.modules()[STATION]["restarts"] == 1


def test_closed_terminal_stops_nothing(gateway: Gateway) -> None:
    """The kernel sends SIGHUP to the session's leader, rtud, and to all in the foreground, the modules."""
    master, slave = pty.openpty()

    def take_terminal() -> None:
        os.setsid()
        fcntl.ioctl(slave, termios.TIOCSCTTY, 0)

    with rtud(gateway, stdin=slave, stdout=slave, stderr=slave, preexec_fn=take_terminal) as process:
        os.close(slave)
        before = wait_running(gateway)
        os.close(master)
        gateway.wait_for(
            lambda: log_count(gateway, "rtud", "SIGHUP: reads the configuration again") > 0,
            60.0,
            "SIGHUP is logged",
        )
        gateway.kill(LINES[1])  # what rtud says of it goes to a terminal that is gone
        gateway.wait_for(
            lambda: gateway.modules()[LINES[1]]["pid"] not in (0, before[LINES[1]]["pid"]),
            10,
            "a new process",
        )
        after = wait_running(gateway)
        assert [after[name]["pid"] for name in (STATION, LINES[0])] == [
            before[name]["pid"] for name in (STATION, LINES[0])
        ]
        process.terminate()
        assert process.wait(10) == 0


def test_sighup_is_said_under_nohup_too(gateway: Gateway) -> None:
    def ignore() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    with rtud(gateway, preexec_fn=ignore) as process:
        before = wait_running(gateway)
        process.send_signal(signal.SIGHUP)
        gateway.wait_for(
            lambda: log_count(gateway, "rtud", "SIGHUP: reads the configuration again") == 1,
            60.0,
            "SIGHUP is logged",
        )
        assert wait_running(gateway)[STATION]["pid"] == before[STATION]["pid"]


# ---- how it ends --------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_stops_cleanly_with_a_stopped_module(gateway: Gateway, number: signal.Signals) -> None:
    with rtud(gateway) as process:
        os.kill(wait_running(gateway)[LINES[0]]["pid"], signal.SIGSTOP)
        begin = time.monotonic()
        process.send_signal(number)
        assert process.wait(10) == 0
        assert time.monotonic() - begin < 2.5
        assert not list(gateway.map.iterdir())


def test_a_hanging_module_does_not_outlive_a_killed_rtud(gateway: Gateway) -> None:
    """It would stay on its line beside the next rtud's process."""
    with rtud(gateway) as process:
        pid = wait_running(gateway)[LINES[0]]["pid"]
        os.kill(pid, signal.SIGSTOP)
        process.kill()
        wait_gone(pid)


# ---- programs that cannot run --------------------------------------------------------------------


def exits_of(gateway: Gateway, name: str) -> list[float]:
    """The times at which the log says that a module exited, in seconds of its day."""
    stamps = re.findall(rf"T(\d+):(\d+):([\d.]+)Z rtud error: {name} exited", gateway.log_file.read_text())
    return [int(hours) * 3600 + int(minutes) * 60 + float(seconds) for hours, minutes, seconds in stamps]


def wait_exits(gateway: Gateway, name: str, count: int) -> list[float]:
    gateway.wait_for(lambda: len(exits_of(gateway, name)) >= count, 60.0, f"{name} exited {count} times")
    return exits_of(gateway, name)[:count]


def assert_ever_rarer(times: list[float]) -> None:
    """The pauses double. A busy host makes what is between two exits longer, and never shorter."""
    gaps = [(later - earlier) % 86400 for earlier, later in itertools.pairwise(times)]
    for number, gap in enumerate(gaps):
        assert gap > FIRST_PAUSE_S * 2**number - 0.002, gaps  # each time is cut off at a millisecond


@pytest.mark.slow
def test_station_whose_port_is_taken_tries_ever_more_rarely(gateway: Gateway) -> None:
    with contextlib.ExitStack() as stack:
        taken = stack.enter_context(socket.create_server(gateway.address))
        stack.enter_context(rtud(gateway))
        assert_ever_rarer(wait_exits(gateway, STATION, 5))
        assert "Address already in use" in gateway.log()
        taken.close()
        wait_running(gateway)


@pytest.mark.slow
def test_module_that_cannot_run_is_tried_ever_more_rarely(gateway: Gateway) -> None:
    """A program that knows nothing of the map."""
    modules = modules_of(gateway)
    (modules / "rtu-modbus").unlink()
    (modules / "rtu-modbus").symlink_to("/bin/false")
    with rtud(gateway, args=command(gateway, modules=modules)) as process:
        assert_ever_rarer(wait_exits(gateway, LINES[0], 5))
        assert "module down" not in gateway.ctl("events")  # none was up
        process.terminate()
        assert process.wait(10) == 0


def modules_of(gateway: Gateway) -> Path:
    """A folder of the programs, to take some away."""
    modules = gateway.directory / "modules"
    modules.mkdir(mode=0o755)
    for program in ("rtu-modbus", "rtu-iec104"):
        (modules / program).symlink_to(gateway.build / "modules" / program)
    return modules


def test_program_that_has_gone_meanwhile_leaves_the_lines_alone(gateway: Gateway) -> None:
    modules = modules_of(gateway)
    with rtud(gateway, args=command(gateway, modules=modules)) as process:
        rows = wait_running(gateway)
        (modules / "rtu-iec104").unlink()
        os.kill(rows[STATION]["pid"], signal.SIGKILL)
        gateway.wait_for(lambda: "cannot start rtu-iec104" in gateway.log(), 10, "it was tried again")
        assert [gateway.modules()[name]["restarts"] for name in LINES] == [0, 0]
        process.terminate()
        assert process.wait(10) == 0


def refused_start(gateway: Gateway, program: Path, *options: str | Path) -> str:
    """What rtud says when it ends at once, without the map it was to make."""
    words = [program, "--map", gateway.map, *options, gateway.config_file]
    done = subprocess.run(words, capture_output=True, text=True, timeout=10, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert not list(gateway.map.iterdir())
    return errors_of(done.stderr)


def test_programs_of_which_none_is_there_end_rtud_at_once(gateway: Gateway) -> None:
    """It says where it looked, and what to add when the folder that has them can be seen from its own."""
    modules, built = modules_of(gateway), (gateway.build / "modules").resolve()
    for program in modules.iterdir():
        program.unlink()
    missing = f"rtud: cannot use the module {modules}/rtu-modbus: No such file or directory\n"
    rtud_built = gateway.build / "rtud/rtud"
    said = refused_start(gateway, rtud_built, "--modules", modules)
    assert f"{missing}rtud: there is one in {built}: add --modules {built}\n" in said
    alone = gateway.directory / "rtud"
    shutil.copy(rtud_built, alone)
    said = refused_start(gateway, alone, "--modules", modules)
    assert f"{missing}rtud: name the folder of the module programs with --modules, or install them" in said
    (modules / "rtu-modbus").touch(mode=0o644)
    assert "/rtu-modbus: Permission denied\n" in refused_start(gateway, alone, "--modules", modules)


@pytest.mark.parametrize("program", ["rtu-modbus", "rtu-iec104"])
def test_program_that_is_not_there_costs_its_points_alone(gateway: Gateway, program: str) -> None:
    """As of an image that was built without it. Said at once, and again with each try."""
    modules = modules_of(gateway)
    (modules / program).unlink()
    missing = [name for name in (STATION, *LINES) if (name == STATION) == (program == "rtu-iec104")]
    with rtud(gateway, args=command(gateway, modules=modules)) as process:
        for name in missing:
            said = f"runs without {name}: there is no {program} in {modules}"
            gateway.wait_for(lambda said=said: said in gateway.log(), 60.0, said)
        gateway.wait_for(
            lambda: all(
                (row["state"] == "running") == (name not in missing)
                for name, row in gateway.modules().items()
                if name in (STATION, *LINES)
            ),
            60.0,
            "all others run",
        )
        process.terminate()
        assert process.wait(10) == 0


# ---- a configuration without lines -------------------------------------------------------------------


def test_runs_without_lines(gateway: Gateway) -> None:
    """As before the first device is connected: a station with no points."""
    gateway.config_file.write_text(json.dumps(listening_on({"port": []}, gateway.address[1])))
    with rtud(gateway) as process:
        gateway.wait_for(lambda: accepts(gateway.address), 60.0, "the station listens")
        assert json.loads(gateway.ctl("--json", "points")) == []
        process.terminate()
        assert process.wait(10) == 0


def accepts(address: tuple[str, int]) -> bool:
    with contextlib.suppress(OSError), socket.create_connection(address, timeout=1.0):
        return True
    return False
