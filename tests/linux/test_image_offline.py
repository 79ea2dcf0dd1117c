# SPDX-License-Identifier: GPL-3.0-or-later
"""The gateway's image of `make image-offline`, for the site of `make run`, in the emulated board's flash.

What of this directory boots a root of its own runs on this image's root too: make test-offline.
"""

import fnmatch
import os
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from lab.board import ETHERNET, MACS, PORTS, SILENCE_US, SSH_PORT, STATION_PORT, Board, Ssh, lines_at
from lab.board_show import BOARD_STEPS, KEY
from lab.boots import Image, boot_from_flash, flash_for
from lab.gateway import GatewayError, free_port
from lab.linesim import LineSim
from lab.master import Master
from lab.patience import Deadline
from lab.show import CHAPTER_5, STATION, all_read
from linux.test_realtime import documented
from linux.test_run import ended, start
from linux.test_system import assert_confined, status
from nuc980.twin.linux import TROUBLE, Linux
from nuc980.twin.machine import INSTRUCTION_TIME, Machine
from release.version import swupdate, tree_version

pytestmark = pytest.mark.soak  # its image is an hour's build: make test-offline

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(os.environ.get("OPENRTU_IMAGE", ROOT / "build/nuc980_gateway_lts-offline"))
PATIENCE_S = 300.0
WATCHDOG_S = 30
FAR = 2208988800  # 2040, which a time of 32 bits cannot tell
USERS = {"rtu-iec104": ["61201"], "rtu-modbus": ["61203", "61204"]}  # two processes share the six lines


@dataclass(frozen=True)
class Rig:
    """The board, and the way into it."""

    board: Board
    ssh: Ssh

    def wait_until_read(self) -> None:
        self.board.wait_for(self.ssh.answers, PATIENCE_S, "the log-in by ssh succeeds")
        self.board.wait_for(lambda: all_read(self.board), PATIENCE_S, "every device has been read")

    def wait_for_restart(self) -> None:
        """Which a command before has caused."""
        deadline = Deadline(PATIENCE_S)
        while not self.board.machine.events("RESET"):
            assert not deadline.over, "the board did not start anew"
            time.sleep(0.1)
        self.ssh.close()
        self.wait_until_read()


@pytest.fixture(scope="module")
def image() -> Image:
    image = Image(FOLDER)
    if missing := image.missing():
        pytest.skip(f"{missing} is not there: make test-offline")
    return image


@pytest.fixture(scope="module")
def console(folder: Path) -> Path:
    """What the debug UART has said."""
    return folder / "console.log"


@pytest.fixture(scope="module")
def rig(qemu: Path, uboot: Path, image: Image, folder: Path, console: Path) -> Iterator[Rig]:
    """Flashed as nuc980-netboot flashes a board, started by its own boot command, all devices read."""
    flash = flash_for(image, qemu, uboot, folder)
    station, ssh_port = free_port(), free_port()
    ways = ETHERNET[0].arguments({station: STATION_PORT, ssh_port: SSH_PORT})
    arguments = [*INSTRUCTION_TIME, "-bios", uboot, *ways, *ETHERNET[1].arguments({}), *flash]
    config, values = CHAPTER_5 / "gateway.json", CHAPTER_5 / "values.json"
    with LineSim(config, values, folder / "dev", silence_us=SILENCE_US):
        chardevs = {0: f"pty,logfile={console}", **lines_at(folder / "dev")}
        with Machine(qemu, *arguments, uarts=(), chardevs=chardevs) as machine:
            boot_from_flash(machine)
            with Ssh(ssh_port, KEY, folder) as ssh:
                rig = Rig(Board(machine, ssh.run, ("127.0.0.1", station)), ssh)
                rig.wait_until_read()
                yield rig


@pytest.fixture
def board(rig: Rig) -> Board:
    return rig.board


@pytest.fixture(autouse=True)
def no_trouble(console: Path) -> Iterator[None]:
    """A panic, an oops or a warning of the kernel fails the test that saw it."""
    yield
    assert not console.exists() or not TROUBLE.findall(console.read_text(errors="replace"))


# ---- processes


def test_modules_have_users_of_their_own_and_no_capability(board: Board) -> None:
    linux = cast(Linux, SimpleNamespace(run=board.inside))
    for program, users in USERS.items():
        processes = status(linux, program)
        assert sorted(process["Uid"].split()[0] for process in processes) == users
        for process in processes:
            assert_confined(process)


def test_nothing_runs_but_what_the_gateway_needs(board: Board) -> None:
    """Neither chronyd without servers, nor crond, nor an agent of Net-SNMP's."""
    names = set(
        board.inside("for p in /proc/[0-9]*; do [ -e $p/exe ] && readlink $p/exe; done || true").split()
    )
    programs = {Path(name).name for name in names}
    assert programs <= {"busybox", "rtud", "rtu-iec104", "rtu-modbus", "sshd"}, programs
    assert {"rtud", "sshd"} <= programs


def test_who_listens(board: Board) -> None:
    listening = set(re.findall(r":(\d+) ", "\n".join(board.inside("netstat -lntu").splitlines()[2:])))
    assert listening == {str(SSH_PORT), str(STATION_PORT)}


def test_threads_have_the_documented_priorities(board: Board) -> None:
    output = board.inside("for p in /proc/[0-9]*; do cat $p/comm; chrt -p ${p#/proc/}; done")
    found = re.findall(r"^(\S.*)\n.*policy.*\n.*priority: (\d+)$", output, re.MULTILINE)
    seen = {}
    for name, priority in found:
        for pattern, wanted in documented():
            if fnmatch.fnmatchcase(name, pattern):
                seen[pattern] = True
                assert int(priority) == wanted, name
                break
    assert {"irq/*-ttyS[1-9]*", "watchdogd", "ktimers/*", "rtud", "rtu-modbus-*", "rtu-iec104"} <= set(seen)


def test_report_finds_no_fault_but_what_the_image_cannot_measure(board: Board) -> None:
    report = board.inside("rt-report --emulator --seconds 3 || true")
    failed = re.findall(r"FAIL.*", report)
    assert [line for line in failed if "lacks cyclictest" not in line] == [], report
    assert "PREEMPT_RT" in report


# ---- files


@pytest.mark.parametrize("file", ["/new", "/etc/passwd", "/usr/sbin/rtud", "/root/.ssh/authorized_keys"])
def test_root_is_not_writable(board: Board, file: str) -> None:
    with pytest.raises(GatewayError, match="Read-only file system"):
        board.inside(f"echo x >> {file}")


@pytest.mark.parametrize("folder", ["/dev/shm", "/run", "/tmp", "/var/log", "/var/tmp"])
def test_what_is_written_in_memory_is_bounded(board: Board, folder: str) -> None:
    row = board.inside(f"df -k {folder}").splitlines()[-1].split()
    assert 0 < int(row[-5]) <= 8 * 1024


def test_root_is_the_ubi_volume(board: Board) -> None:
    rows = {row.split()[1]: row.split() for row in board.inside("cat /proc/mounts").splitlines()}
    assert rows["/"][0:3:2] == ["ubi0:root_a", "ubifs"]
    assert rows["/data"][0:3:2] == ["ubi0:data", "ubifs"]
    assert "ro" in rows["/"][3].split(",")


def test_files_belong_to_root_and_nobody_else_writes_them(board: Board) -> None:
    assert set(board.inside("find / -xdev ! -type l -perm -002").split()) <= {"/tmp"}
    assert board.inside("find / -xdev -perm -4000").split() == []
    others = board.inside("find / -xdev ! -user root").split()
    assert set(others) <= {"/var/lib/chrony", "/var/www"}  # the latter is Buildroot's own, empty


def test_nobody_has_a_password(board: Board) -> None:
    words = {line.split(":")[1] for line in board.inside("cat /etc/shadow").splitlines()}
    assert words <= {"*", "!", "!!"}, words


def test_image_says_which_it_is(board: Board) -> None:
    said = board.inside("cat /etc/os-release").splitlines()
    number = (ROOT / "build/site/field/update-number").read_text().strip()
    assert f"IMAGE_VERSION={swupdate(tree_version(), int(number))}" in said


# ---- networks, lines, time


def test_both_ports_have_addresses_and_reach_their_hosts(board: Board) -> None:
    for number, network in enumerate(ETHERNET):
        shown = board.inside(f"ip address show dev eth{number}")
        assert f"inet {network.board}" in shown
        assert f"link/ether {MACS[number]}" in shown
        assert "0% packet loss" in board.inside(f"ping -c 2 -w 20 {network.host}")


def test_all_six_lines_are_read_and_told(board: Board) -> None:
    _, _, devices = board.machine.info("nuc980-pins").replace("\r", "").partition("\n\n")
    for number in PORTS:
        assert re.search(rf"^uart{number} .*connected", devices, re.MULTILINE)
    with Master(*board.address) as master:
        reports = master.interrogate(STATION)
        assert reports
        assert all(report.good for report in reports)


def test_time_goes_on_after_2038(rig: Rig) -> None:
    board = rig.board
    now = board.inside("date +%s").strip()
    board.inside(f"date -u -s @{FAR}")
    assert board.inside("date -u +%Y").strip() == "2040"
    board.inside("touch /data/late && rtuctl modules")
    year = board.inside("date -u -r /data/late +%Y").strip()
    board.inside(f"rm /data/late; date -u -s @{now}")
    rig.wait_until_read()
    assert year == "2040"


# ---- what lasts


def test_data_and_the_hosts_key_survive_a_restart(rig: Rig) -> None:
    board = rig.board
    key = board.inside("sha256sum /data/ssh/*").split()
    assert len(key) == 2  # one key alone
    assert board.inside("find /data/ssh -perm 700").split() == ["/data/ssh"]
    assert board.inside("find /data/ssh -perm 600").split() == key[1:]
    board.inside("echo kept > /data/note && sync")
    board.machine.events("RESET")
    board.inside("(sleep 1; reboot) > /dev/null 2>&1 &")
    rig.wait_for_restart()
    assert board.inside("cat /data/note").strip() == "kept"
    assert board.inside("sha256sum /data/ssh/*").split() == key


def test_rtud_that_hangs_resets_the_board(rig: Rig) -> None:
    board = rig.board
    attribute = "cat /sys/class/watchdog/watchdog0/"
    board.wait_for(lambda: board.inside(f"{attribute}state").strip() == "active", PATIENCE_S, "it is fed")
    assert board.inside(f"{attribute}timeout").strip() == str(WATCHDOG_S)
    board.machine.events("RESET")
    board.inside("kill -STOP $(pidof rtud)")
    rig.wait_for_restart()


# ---- make run


@pytest.mark.usefixtures("qemu", "uboot")
def test_show_succeeds_on_it(image: Image) -> None:
    show = start("lab.board_show", "--port", str(free_port()), "--image", image.folder)
    out, err = ended(show)
    assert (show.returncode, err) == (0, ""), out[-3000:]
    assert f"All {len(BOARD_STEPS)} steps succeeded." in out
