# SPDX-License-Identifier: GPL-3.0-or-later
"""nuc980-netboot as it is typed: what it says, how it ends, and that a dry run says what a run does."""

import argparse
import json
import os
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import pytest

from netboot.double import BLOCK, FACTORY_ENVIRONMENT, Board, Double, faults
from nuc980.netboot.cli import _parser, main
from nuc980.netboot.environment import load
from nuc980.netboot.report import board_of
from nuc980.netboot.transport import Line

SCRIPTS = Path(__file__).parents[2] / "scripts"
COMMANDS = ("probe", "boot", "flash", "install", "slots", "restore-env")
SECONDS = 20.0


def network(port: int) -> list[str]:
    """The double's datagrams come from this host, whatever it takes its own address to be."""
    return [
        "--server-ip", "127.0.0.1", "--listen", "127.0.0.1", "--seen-as", "127.0.0.1",
        "--tftp-port", str(port),
    ]  # fmt: skip


def typed_in(shown: str) -> list[str]:
    """What a dry run says that would be typed."""
    return re.findall(r"^    => (.*)$", shown, re.MULTILINE)


# ---- help and wrong use


@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS)], ids=["all", *COMMANDS])
def test_help_is_complete(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*command, "--help"])
    output = capsys.readouterr().out
    assert ended.value.code == 0
    assert "examples:" in output and "nuc980-netboot" in output
    for name in COMMANDS if not command else ():
        assert re.search(rf"^    {name}\s+\w", output, re.MULTILINE)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_is_explained(name: str) -> None:
    (commands,) = (each for each in _parser()._actions if isinstance(each, argparse._SubParsersAction))
    assert set(commands.choices) == set(COMMANDS)
    assert [action.dest for action in commands.choices[name]._actions if not action.help] == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["probe"], "no --port is given"),
        (["probe", "--port", "/dev/no-such-port"], "/dev/no-such-port"),
        (["probe", "--port", "/dev/null", "--junit", "no/such/folder.xml"], "no folder no/such"),
        (["probe", "--port", "/dev/null", "--as", "x.json"], "--as is for --dry-run"),
        (["probe", "--port", "/dev/null", "--all-lines"], "--all-lines is for --dry-run"),
        (["probe", "--dry-run", "--as", "no.json"], "no.json: No such file"),
        (["restore-env", "--dry-run", "no.txt"], "no.txt: No such file"),
        (["restore-env", "--dry-run", "/dev/null", "--as", __file__], "not a report of nuc980-netboot probe"),
        (["boot", "--dry-run", "no-kernel", "no-tree"], "no-kernel: No such file"),
        (["flash", "--dry-run"], "name what to write"),
    ],
)
def test_unusable_input_is_said_in_a_line_or_two(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("nuc980-netboot: ") and message in error
    assert "Traceback" not in error and len(error.splitlines()) <= 4


def test_unknown_words_are_argparses() -> None:
    with pytest.raises(SystemExit) as ended:
        main(["boot", "--nonsense"])
    assert ended.value.code == 2


# ---- a dry run and a run


@pytest.mark.slow
def test_dry_probe_is_what_a_probe_types(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = tmp_path / "board.json"
    with Double("factory") as double:
        assert main(["probe", "--port", double.port, "--json", str(report)]) == 0
    shown = capsys.readouterr().out
    assert re.search("^U-Boot +U-Boot 2016.11", shown, re.MULTILINE) and "- No ethaddr" in shown
    assert main(["probe", "--dry-run"]) == 0
    assert typed_in(capsys.readouterr().out) == double.lines
    assert main(["probe", "--dry-run", "--as", str(report)]) == 0
    assert typed_in(capsys.readouterr().out) == double.lines
    assert board_of(report).environment == FACTORY_ENVIRONMENT
    assert json.loads(report.read_text())["command"] == "probe"


@pytest.mark.slow
def test_dry_boot_is_what_a_boot_types(
    images: list[str], site: Path, udp_port: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["boot", *images, "--site", str(site), *network(udp_port)]
    assert main([*command, "--dry-run"]) == 0
    shown = capsys.readouterr().out
    junit = tmp_path / "boot.xml"
    with Double("factory", tftp=("127.0.0.1", udp_port)) as double:
        assert main([*command, "--port", double.port, "--junit", str(junit)]) == 0
    assert typed_in(shown) == double.lines
    serves = f"Serve files by TFTP at UDP port {udp_port} of 127.0.0.1 (lo), to 127.0.0.1 alone"
    assert serves in shown
    assert double.nand.journal == [] and double.kernels_started == 1
    assert load(site / "environment.txt").variables == FACTORY_ENVIRONMENT
    output = capsys.readouterr().out
    assert serves in output
    assert "environment is kept in" in output and re.search(r"^ +\d+\.\d\d s  Linux$", output, re.MULTILINE)
    check_junit(junit, failed=None)


@pytest.mark.slow
def test_dry_restore_is_what_a_restore_types(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = tmp_path / "saved.txt"
    saved.write_text("baudrate=115200\nbootcmd=it's \\\\ new; $x\nbootdelay=3\nextra=1\n")
    command = ["restore-env", str(saved), "--save", "--site", str(site)]
    assert main([*command, "--dry-run"]) == 0
    shown = capsys.readouterr().out
    with Double("factory") as double:
        assert main([*command, "--port", double.port]) == 0
        stored = double.stored_environment()
    assert typed_in(shown) == double.lines
    assert "+ extra=1" in shown and "- bootcmd=nand read" in shown
    assert stored and stored["bootcmd"] == "it's \\ new; $x" and stored["extra"] == "1"
    assert load(site / "environment.txt").variables == FACTORY_ENVIRONMENT


@pytest.mark.slow
def test_restore_is_in_ram_only_unless_asked(site: Path, tmp_path: Path) -> None:
    saved = tmp_path / "saved.txt"
    saved.write_text("".join(f"{name}={value}\n" for name, value in FACTORY_ENVIRONMENT.items()) + "x=1\n")
    with Double("factory") as double:
        assert main(["restore-env", str(saved), "--site", str(site), "--port", double.port]) == 0
        assert double.stored_environment() == FACTORY_ENVIRONMENT
    assert double.nand.journal == []


class Forgets(faults.Fault):
    """U-Boot says that it has set a variable, and has not."""

    def command(self, board: Board, words: list[str]) -> None:
        if words[0] == "printenv":
            board.variables.pop("extra", None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (Forgets(), "differs from what was written: extra"),
        (faults.Refuses("setenv extra", "## Error: read-only\n"), "read-only"),
        (faults.Misprints("printenv", "extra=1\n", "", times=0), "cannot be read"),
        (faults.Misprints("printenv", r"size: \d+", "size: 1", times=0), "cannot be read"),
    ],
)
def test_what_does_not_come_back_is_not_saved(
    fault: faults.Fault, message: str, site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = tmp_path / "saved.txt"
    saved.write_text("extra=1\n")
    command = ["restore-env", str(saved), "--site", str(site), "--save"]
    with Double("factory", faults=[fault]) as double:
        assert main([*command, "--port", double.port]) == 1
    assert message in capsys.readouterr().err
    assert not [line for line in double.lines if "saveenv" in line]


@pytest.mark.slow
def test_the_environment_is_kept_before_anything_is_set(images: list[str], site: Path, udp_port: int) -> None:
    double = Double("factory", faults=[faults.Refuses("setenv", "## Error: no\n", times=0)])
    with double:
        assert main(["boot", *images, "--site", str(site), *network(udp_port), "--port", double.port]) == 1
    assert load(site / "environment.txt").variables == FACTORY_ENVIRONMENT


@pytest.mark.slow
def test_dry_flash_is_what_a_flash_types(
    images: list[str], site: Path, udp_port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    kernel, tree = images
    command = [
        *("flash", "--kernel", kernel, "--dtb", tree, "--no-backup", "the double's flash is empty"),
        *("--site", str(site), *network(udp_port)),
    ]
    assert main([*command, "--dry-run", "--all-lines"]) == 0
    shown = capsys.readouterr().out
    with Double("factory", tftp=("127.0.0.1", udp_port)) as double:
        assert main([*command, "--port", double.port]) == 0, capsys.readouterr()
    assert typed_in(shown) == double.lines
    assert double.block(0x200000 // BLOCK).startswith(Path(kernel).read_bytes()[:1000])


def test_dry_run_writes_nothing(images: list[str], tmp_path: Path, udp_port: int) -> None:
    """Nor MAC addresses and a lock; the board's are drawn when it is worked with."""
    kernel, tree = images
    site = tmp_path / "new"
    common = ["--dry-run", "--site", str(site), "--board-ip", "192.168.1.20/24", *network(udp_port)]
    for command in (["boot", *images], ["flash", "--kernel", kernel, "--dtb", tree]):
        assert main([*command, *common]) == 0
        assert not site.exists()


@pytest.mark.parametrize("port", ["0", "-1", "65536", "\N{SUPERSCRIPT TWO}", "tftp"])
def test_udp_port_is_one(port: str, images: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["boot", *images, "--tftp-port", port])
    assert ended.value.code == 2
    assert "is not a UDP port" in capsys.readouterr().err


# ---- the report of a failure


ALLOWED = {
    "testsuites": (set(), {"testsuite"}),
    "testsuite": (
        {"name", "tests", "failures", "errors", "skipped", "time", "timestamp"},
        {"properties", "testcase"},
    ),
    "properties": (set(), {"property"}),
    "property": ({"name", "value"}, set()),
    "testcase": ({"classname", "name", "time"}, {"failure"}),
    "failure": ({"type", "message"}, set()),
}  # the part of jenkins-junit.xsd that a report needs; order as there


def check_junit(path: Path, failed: str | None) -> ElementTree.Element:
    root = ElementTree.parse(path).getroot()
    for element in root.iter():
        attributes, children = ALLOWED[element.tag]
        assert set(element.attrib) == attributes
        assert {child.tag for child in element} <= children
        assert not ({"time"} & attributes) or float(element.attrib["time"]) >= 0
    (suite,) = root
    cases = suite.findall("testcase")
    assert int(suite.attrib["tests"]) == len(cases) > 0
    assert int(suite.attrib["failures"]) == len(suite.findall("testcase/failure")) == bool(failed)
    assert [case.attrib["name"] for case in cases if case.find("failure") is not None] == (
        [failed] if failed else []
    )
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d", suite.attrib["timestamp"])
    return root


@pytest.mark.slow
def test_a_failure_is_reported_with_its_text(
    images: list[str], site: Path, udp_port: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    junit, report = tmp_path / "boot.xml", tmp_path / "boot.json"
    command = ["boot", *images, "--site", str(site), *network(udp_port)]
    with Double("factory", tftp=("127.0.0.1", udp_port), linux="panic") as double:
        files = ["--junit", str(junit), "--json", str(report)]
        assert main([*command, *files, "--port", double.port]) == 1
    output = capsys.readouterr().err
    root = check_junit(junit, failed="Linux")
    failure = next(root.iter("failure"))
    assert failure.attrib["type"] == "KernelPanic"
    assert failure.text and failure.text.strip() in output.replace("nuc980-netboot: ", "")
    found = json.loads(report.read_text())
    assert found["error"]["phase"] == "Linux" and "not syncing" in found["error"]["text"]
    assert board_of(report).version.startswith("U-Boot 2016.11")


def test_a_report_does_not_take_the_place_of_a_device(tmp_path: Path) -> None:
    """As /dev/null would be a plain file after it, for root."""
    pipe, link, kept = tmp_path / "pipe", tmp_path / "link", tmp_path / "kept"
    os.mkfifo(pipe)
    link.symlink_to(kept)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        assert main(["probe", "--json", str(pipe), "--junit", str(link)]) == 2
        assert json.loads(os.read(reader, 10_000))["error"]["kind"] == "UnusableInput"
    finally:
        os.close(reader)
    assert pipe.is_fifo() and link.is_symlink()
    check_junit(kept, "prepare")


@pytest.mark.parametrize("report", ["--json", "--junit"])
@pytest.mark.parametrize("name", ["", "/", "/tmp"])
def test_a_report_is_no_folder(report: str, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["probe", f"{report}={name}"]) == 2
    assert "is a folder" in capsys.readouterr().err


def test_a_failure_before_any_phase_is_reported(tmp_path: Path) -> None:
    junit = tmp_path / "x.xml"
    assert main(["probe", "--port", "/dev/no-such-port", "--junit", str(junit)]) == 2
    check_junit(junit, failed="prepare")


@pytest.mark.slow
def test_a_report_survives_what_a_board_says(images: list[str], site: Path, tmp_path: Path) -> None:
    junit = tmp_path / "x.xml"
    noise = faults.Refuses("setenv", "\x1b[31m\x00\x07 <&> ]]> \ufffe\n", times=0)
    with Double("factory", faults=[noise]) as double:
        command = ["boot", *images, "--site", str(site), *network(6969), "--junit", str(junit)]
        assert main([*command, "--port", double.port]) == 1
    check_junit(junit, failed="set-up")


# ---- ended by a signal


def started(arguments: Sequence[str], folder: Path) -> subprocess.Popen[str]:
    temporary = folder / "tmp"
    temporary.mkdir(exist_ok=True)
    return subprocess.Popen(
        [sys.executable, "-m", "nuc980.netboot", *arguments],
        env={**os.environ, "PYTHONPATH": str(SCRIPTS), "TMPDIR": str(temporary)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for(happened: object, what: str) -> None:
    deadline = time.monotonic() + SECONDS
    while not happened():  # type: ignore[operator]
        assert time.monotonic() < deadline, what
        time.sleep(0.01)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda n: n.name)
def test_a_signal_in_the_middle_of_a_transfer_leaves_nothing(
    number: signal.Signals, images: list[str], site: Path, udp_port: int, tmp_path: Path
) -> None:
    deaf = faults.StopsHearing(block=20)
    log, junit = tmp_path / "log", tmp_path / "boot.xml"
    with Double("factory", faults=[deaf], tftp=("127.0.0.1", udp_port), second=5.0) as double:
        command = ["boot", *images, "--site", str(site), *network(udp_port), "--port", double.port]
        run = started([*command, "--log", str(log), "--junit", str(junit)], tmp_path)
        wait_for(lambda: log.exists() and "Loading: " in log.read_text(), "no transfer began")
        run.send_signal(number)
        output, error = run.communicate(timeout=SECONDS)
        assert run.returncode == 128 + number, (output, error)
        assert "Traceback" not in error and "port and server are closed" in error
        assert list((tmp_path / "tmp").iterdir()) == []
        assert not [path for path in tmp_path.rglob("*") if path.name.startswith(".")]
        check_junit(junit, failed="load kernel")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
            server.bind(("127.0.0.1", udp_port))
        Line(double.port).close()  # no lock is left

        deaf.block = 1 << 16
        run = started(command, tmp_path)
        output, error = run.communicate(timeout=60)
        assert run.returncode == 0, (output, error)


@pytest.mark.slow
def test_ctrl_c_ends_what_the_board_does(
    images: list[str], site: Path, udp_port: int, tmp_path: Path
) -> None:
    """It is at its prompt again, not in a transfer that nobody serves."""
    log = tmp_path / "log"
    hears_little = faults.StopsHearing(block=20)
    with Double("factory", faults=[hears_little], tftp=("127.0.0.1", udp_port), second=5.0) as double:
        command = ["boot", *images, "--site", str(site), *network(udp_port), "--port", double.port]
        run = started([*command, "--log", str(log)], tmp_path)
        wait_for(lambda: log.exists() and "Loading: " in log.read_text(), "no transfer began")
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=SECONDS)
    assert re.findall(r" > '(.*)'", log.read_text())[-1] == r"\x03"


@pytest.mark.slow
def test_a_reader_that_goes_away_is_no_traceback(tmp_path: Path) -> None:
    with Double("factory") as double:
        run = started(["probe", "--port", double.port, "--site", str(tmp_path)], tmp_path)
        assert run.stdout
        run.stdout.close()
        assert run.wait(SECONDS) == 1
        assert run.stderr
        assert run.stderr.read() == ""


# ---- power hook


@pytest.mark.slow
def test_power_hook_brings_the_board(capsys: pytest.CaptureFixture[str]) -> None:
    with Double("factory", state="off") as double:
        hook = f'sh -c "{double.power_hook}"'
        assert main(["probe", "--port", double.port, "--power-cycle", hook]) == 0
        assert double.power_ups == 1


# ---- the terminal, handed over


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["login", "panic"])
def test_console_is_handed_over_in_the_end(
    ending: str, images: list[str], site: Path, udp_port: int, tmp_path: Path
) -> None:
    """Also after a failure, whose exit code stays."""
    keyboard, terminal = pty.openpty()
    with Double("factory", tftp=("127.0.0.1", udp_port), linux=ending) as double:
        command = ["boot", *images, "--site", str(site), *network(udp_port), "--port", double.port]
        run = subprocess.Popen(
            [sys.executable, "-m", "nuc980.netboot", *command, "--console"],
            env={**os.environ, "PYTHONPATH": str(SCRIPTS)},
            stdin=terminal,
            stdout=terminal,
            stderr=subprocess.PIPE,
        )
        received = b""
        while b"Ctrl-] leaves it" not in received:
            assert select.select([keyboard], [], [], SECONDS)[0], received
            received += os.read(keyboard, 4096)
        if ending == "login":
            os.write(keyboard, b"root\r")
            while b"Password: " not in received:
                assert select.select([keyboard], [], [], SECONDS)[0], received
                received += os.read(keyboard, 4096)

        def ends() -> bool:
            os.write(keyboard, b"\x1d")
            if select.select([keyboard], [], [], 0)[0]:
                os.read(keyboard, 4096)  # it waits until somebody has read what it said
            return run.poll() is not None

        wait_for(ends, "Ctrl-] does not lead back")
        _, error = run.communicate(timeout=SECONDS)
    assert run.returncode == (0 if ending == "login" else 1)
    assert (b"panicked" in error and b"panicked" in received) == (ending == "panic")
    os.close(keyboard)
    os.close(terminal)


@pytest.mark.slow
def test_console_needs_a_terminal(tmp_path: Path) -> None:
    run = started(["probe", "--port", "/dev/null", "--console"], tmp_path)
    assert "--console needs a terminal" in run.communicate(timeout=SECONDS)[1]
    assert run.returncode == 2
