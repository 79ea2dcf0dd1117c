# SPDX-License-Identifier: GPL-3.0-or-later
"""The image of `make image-debian` for a site: who runs, who listens, what can be written, what it takes."""

import hashlib
import json
import os
import re
import shutil
import subprocess
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from image.cpio import archive, entries_of
from lab.board import ETHERNET, SSH_PORT, STATION_PORT, Ssh
from lab.gateway import GatewayError, free_port
from lab.master import Master
from nuc980.twin.linux import Kernel, Linux
from nuc980.twin.machine import INSTRUCTION_TIME

ROOT = Path(__file__).resolve().parents[2]
POST_BUILD = ROOT / "board/nuc980/post-build.sh"
LISTEN_SECONDS = 60

# 50 devices of 100 registers: the 5 000 points of all measurements.
LINES, DEVICES, REGISTERS = 6, 50, 100
STATIONS = [1000 * (1 + at % LINES) + 1 + at // LINES for at in range(DEVICES)]
# What the board can spare.
GATEWAY_KIB = 4 * 1024
AVAILABLE_KIB = 32 * 1024
START_SECONDS = 15.0

LOG_KIB = 3 * 256  # rootfs-overlay/etc/default/syslogd: a file and the two before it
INTERFACES = """auto lo
iface lo inet loopback

auto eth0
iface eth0 inet static
	address 172.16.0.50
	netmask 255.240.0.0

auto eth1
iface eth1 inet static
	address 192.168.21.77
	netmask 255.255.255.0
"""


def configuration() -> dict[str, Any]:
    """5 000 points. The devices do not answer, and nothing asks for the points' values."""
    registers = [{"address": address} for address in range(REGISTERS)]
    ports = [
        {
            "value": line, "active": 1, "baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0,
            "slaves": [
                {
                    "id": station % 1000, "description": f"Device {station}", "coils": [],
                    "discrete_inputs": [], "input_registers": [], "holding_registers": registers,
                }
                for station in STATIONS if station // 1000 == line
            ],
        }
        for line in range(1, LINES + 1)
    ]  # fmt: skip
    return {"iec104": {"port": STATION_PORT}, "port": ports}


# ---- the board


@pytest.fixture(scope="module")
def key(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("key") / "key"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", file], check=True)
    return file


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, key: Path) -> Path:
    folder = tmp_path_factory.mktemp("site")
    (folder / "config.json").write_text(json.dumps(configuration()))
    (folder / "authorized_keys").write_text(key.with_suffix(".pub").read_text())
    (folder / "interfaces").write_text(INTERFACES)
    return folder


def root_with(site: Path | None, folder: Path) -> Path:
    """The image's root with the settings of a site, packed, as build-system.sh does it."""
    root = folder / "root"
    shutil.copytree(ROOT / "build/system.parts/root", root, symlinks=True)
    subprocess.run([POST_BUILD, root], env={**os.environ, "SITE_SETTINGS": str(site or "")}, check=True)
    packed = folder / "initramfs.cpio"
    packed.write_bytes(archive(entries_of(root)))
    return packed


@pytest.fixture(scope="module")
def kernel(kernel: Kernel, site: Path, tmp_path_factory: pytest.TempPathFactory) -> Kernel:
    return replace(kernel, root=root_with(site, tmp_path_factory.mktemp("root")))


@pytest.fixture(scope="module")
def ports() -> dict[int, int]:
    """Ports of this machine that lead to the board's."""
    return {free_port(): STATION_PORT, free_port(): SSH_PORT}


def reached(ports: dict[int, int], board: int) -> int:
    return next(here for here, there in ports.items() if there == board)


@pytest.fixture(scope="module")
def board_arguments(ports: dict[int, int]) -> tuple[str | Path, ...]:
    return (*ETHERNET[0].arguments(ports), *ETHERNET[1].arguments({}), *INSTRUCTION_TIME)


def wait_for_listener(linux: Linux, port: int) -> None:
    command = f"until netstat -lnt | grep -q ':{port} '; do sleep 0.1; done"
    linux.run(f'timeout {LISTEN_SECONDS} sh -c "{command}"', 2 * LISTEN_SECONDS)


@pytest.fixture(scope="module")
def first_answer(linux: Linux, ports: dict[int, int]) -> float:
    """Seconds of the board's time from the kernel's start to the first general interrogation answered."""
    wait_for_listener(linux, STATION_PORT)
    with Master("127.0.0.1", reached(ports, STATION_PORT)) as master:
        assert len(master.interrogate(STATIONS[0])) == REGISTERS
    return float(linux.run("cat /proc/uptime").split()[0])


# ---- time, first: the board has just started


def marks(linux: Linux) -> dict[str, float]:
    """When the kernel started its first program, and when each start script began."""
    lines = linux.run("dmesg")
    found = re.findall(
        r"^\[ *(\d+\.\d+)\] (?:start: (\S+)|Run (/init) as init process)$", lines, re.MULTILINE
    )
    return {script or init: float(seconds) for seconds, script, init in found}


def test_first_interrogation_is_answered_in_time(linux: Linux, first_answer: float) -> None:
    times = marks(linux) | {"interrogation answered": first_answer}
    print(*(f"{seconds:8.3f} s  {what}" for what, seconds in times.items()), sep="\n")
    assert list(times) == sorted(times, key=lambda what: times[what])
    assert {"/init", "S40network", "S80rtud", "done"} <= set(times)
    assert times["S80rtud"] < times["S85sshd"]
    assert first_answer <= START_SECONDS


# ---- processes


def status(linux: Linux, program: str) -> list[dict[str, str]]:
    """/proc/PID/status of each process of this program."""
    pids = linux.run(f"pidof {program}").split()
    texts = [linux.run(f"cat /proc/{pid}/status") for pid in pids]
    return [dict(line.split(":\t", 1) for line in text.splitlines() if ":\t" in line) for text in texts]


def assert_confined(process: dict[str, str]) -> None:
    assert {int(process[kind], 16) for kind in ("CapInh", "CapPrm", "CapEff", "CapBnd", "CapAmb")} == {0}
    assert process["NoNewPrivs"] == "1"
    assert process["Seccomp"] == "2"


def test_first_process_is_busybox_init(linux: Linux) -> None:
    assert linux.run("readlink /proc/1/exe").strip() == "/bin/busybox"
    assert linux.run("cat /proc/1/comm").strip() == "init"


def test_modules_have_users_of_their_own_and_no_capability(linux: Linux, first_answer: float) -> None:
    users = {}
    for program in ("rtu-iec104", "rtu-modbus"):
        for process in status(linux, program):
            assert_confined(process)
            users[process["Uid"].split()[0]] = program
    assert users == {"61201": "rtu-iec104", "61203": "rtu-modbus"}
    assert linux.run("id -u rtu-iec104; id -u rtu-modbus; id -gn rtu-iec104").split() == [
        "61201", "61203", "openrtu",
    ]  # fmt: skip


def test_only_what_was_asked_for_listens(linux: Linux, first_answer: float, reachable: Ssh) -> None:
    shown = linux.run("netstat -lntup").splitlines()
    rows = [line.split() for line in shown if line.startswith(("tcp", "udp"))]
    assert {(row[0], row[3].rsplit(":", 1)[1]) for row in rows} == {("tcp", "2404"), ("tcp", "22")}


def test_nobody_can_log_in_with_a_password(linux: Linux) -> None:
    shadow = linux.run("cat /etc/shadow").splitlines()
    assert {line.split(":")[1] for line in shadow if not line.startswith("#")} == {"*"}


def test_unaligned_words_are_faults_and_there_was_none(linux: Linux) -> None:
    output = linux.run("cat /proc/cpu/alignment")
    assert "(signal+warn)" in output
    counts = re.findall(r"^(User|Half|Word|DWord|Multi):\s+(\d+)", output, re.MULTILINE)
    assert {name: int(count) for name, count in counts} == dict.fromkeys(
        ("User", "Half", "Word", "DWord", "Multi"), 0
    )


def test_a_panic_ends_in_a_restart(linux: Linux) -> None:
    assert linux.run("sysctl -n kernel.panic kernel.panic_on_oops").split() == ["10", "1"]


def test_no_neighbour_tells_a_port_where_its_packets_go(linux: Linux, first_answer: float) -> None:
    conf = "/proc/sys/net/ipv[46]/conf/eth[01]"
    assert set(
        linux.run(f"cat {conf}/accept_redirects /proc/sys/net/ipv6/conf/eth[01]/accept_ra").split()
    ) == {"0"}


# ---- files


def test_root_is_not_writable(linux: Linux) -> None:
    for file in (
        "/new",
        "/etc/passwd",
        "/usr/sbin/rtud",
        "/root/.ssh/authorized_keys",
        "/etc/openrtu/gateway.json",
    ):
        code, output = linux.try_to(f"echo x >> {file}")
        assert code and "Read-only file system" in output, file


def test_root_belongs_to_root(linux: Linux) -> None:
    assert linux.run("stat -c '%a %u' / /root /root/.ssh /root/.ssh/authorized_keys").splitlines() == [
        "755 0", "700 0", "700 0", "600 0",
    ]  # fmt: skip
    anybodys = linux.run("find / -xdev ! -type l -perm -002").split()
    assert set(anybodys) <= {"/tmp"}
    assert linux.run("find / -xdev ! -user root").strip() == ""
    assert linux.run("find / -xdev -perm -4000").strip() == ""


@pytest.mark.parametrize("folder", ["/run", "/tmp", "/var/log", "/var/tmp", "/data"])
def test_what_is_written_lies_in_a_bounded_file_system(linux: Linux, folder: str) -> None:
    linux.run(f"echo x > {folder}/x && rm {folder}/x")
    row = linux.run(f"df -k {folder}").splitlines()[-1].split()
    assert 0 < int(row[-5]) <= 16 * 1024


def test_settings_of_the_site_are_in_force(linux: Linux, site: Path) -> None:
    assert "inet 192.168.21.77/24" in linux.run("ip address show dev eth1")
    given = hashlib.sha256((site / "config.json").read_bytes()).hexdigest()
    assert linux.run("sha256sum /etc/openrtu/gateway.json").split()[0] == given
    assert linux.run("hostname").strip() == "openrtu"


def test_log_is_bounded(linux: Linux) -> None:
    """10 MiB into the log leave no more than three files of it in the RAM."""
    line = "x" * 1000
    linux.run(f"yes {line} | head -n {10 * 2**20 // 1000} | logger -t flood; logger -t last the end", 400)
    files = linux.run("du -k /var/log/messages* | awk '{ sum += $1 } END { print sum }'")
    assert LOG_KIB / 3 < int(files) <= LOG_KIB + 16
    assert "last: the end" in linux.run("tail -n 5 /var/log/messages")


# ---- memory


def test_memory(linux: Linux, first_answer: float) -> None:
    pids = linux.run("pidof rtud rtu-iec104 rtu-modbus").split()
    assert len(pids) == 3
    pss = linux.run(f"cat {' '.join(f'/proc/{pid}/smaps_rollup' for pid in pids)} | grep ^Pss:")
    gateway = sum(int(size) for size in re.findall(r"(\d+) kB", pss))
    available = int(re.search(r"MemAvailable: +(\d+)", linux.run("cat /proc/meminfo"))[1])  # type: ignore[index]
    print(f"gateway {gateway} KiB, available {available} KiB, with {DEVICES * REGISTERS} points")
    assert sum(int(row) for row in re.findall(r"\s(\d+)\s+\d+$", points(linux), re.MULTILINE)) == (
        DEVICES * REGISTERS
    )
    assert 0 < gateway <= GATEWAY_KIB
    assert available >= AVAILABLE_KIB


def points(linux: Linux) -> str:
    """The table of `rtuctl modules`, whose last two columns are points and lost events."""
    return linux.run("rtuctl modules")


# ---- ssh


@pytest.fixture(scope="module")
def reachable(
    linux: Linux, ports: dict[int, int], key: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Ssh]:
    """The way in with the key, when the host key is made."""
    wait_for_listener(linux, SSH_PORT)
    with Ssh(reached(ports, SSH_PORT), key, tmp_path_factory.mktemp("ssh")) as ssh:
        yield ssh


def test_ssh_lets_in_with_the_key(reachable: Ssh) -> None:
    assert reachable.run("hostname; id -u").split() == ["openrtu", "0"]


def test_ssh_lets_nobody_else_in(linux: Linux, reachable: Ssh, ports: dict[int, int], tmp_path: Path) -> None:
    other = tmp_path / "other"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", other], check=True)
    with pytest.raises(GatewayError, match="Permission denied"):
        Ssh(reached(ports, SSH_PORT), other, tmp_path).run("true")


def test_ssh_offers_no_password(reachable: Ssh, ports: dict[int, int], tmp_path: Path) -> None:
    """The methods that the server names when no key is offered."""
    words = ["-F", "none", "-o", "StrictHostKeyChecking=no", "-o", f"UserKnownHostsFile={tmp_path}/known"]
    words += ["-o", "PubkeyAuthentication=no", "-o", "BatchMode=yes", "-p", str(reached(ports, SSH_PORT))]
    done = subprocess.run(
        ["ssh", *words, "root@127.0.0.1", "true"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 255
    assert re.search(r"Permission denied \(([^)]*)\)", done.stderr)[1] == "publickey"  # type: ignore[index]


def test_host_key_is_in_data_and_nobody_elses(linux: Linux, reachable: Ssh) -> None:
    assert linux.run("stat -c '%a' /data/ssh /data/ssh/*").split() == ["700", "600"]


# ---- the end


def test_reboot(linux: Linux, first_answer: float) -> None:
    linux.type("reboot\n<run 0>\n")
    linux.wait_for("Restarting system")
    linux.wait_for_shell()
    assert float(linux.run("cat /proc/uptime").split()[0]) < first_answer + START_SECONDS


def test_image_itself_without_a_site(boot: Any) -> None:
    """The uImage as it is, its own root in it; only the shell comes from outside. Nothing listens."""
    folder = ROOT / "build/system"
    linux = boot(*INSTRUCTION_TIME, kernel=Kernel(folder / "uImage", folder / "nuc980-gateway.dtb"))
    assert "rdinit=/init panic=10" in linux.run("cat /proc/cmdline")
    assert linux.run("cat /proc/sys/kernel/randomize_va_space") == "2"
    assert linux.run("netstat -lntu").splitlines()[2:] == []
    assert linux.try_to("pidof dropbear rtud")[0] != 0
    assert "172.16.0.50/12" in linux.run("ip address show dev eth0")
    assert "192.168.21.100/24" in linux.run("ip address show dev eth1")


# ---- the image


def test_image_is_reproducible(site: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    for folder in (first, second):
        folder.mkdir()
    assert root_with(site, first).read_bytes() == root_with(site, second).read_bytes()


# ---- where it was made


def test_nothing_tells_the_folder_that_it_was_made_in() -> None:
    """Else one tree makes another image in each folder. The kernel has its configuration in itself, and a
    program the ID of all that debuggers are told."""
    kernel = (ROOT / "build/linux-system/vmlinux").read_bytes()
    packed = kernel[kernel.index(b"IKCFG_ST") + len(b"IKCFG_ST") :]
    configuration = zlib.decompressobj(wbits=31).decompress(packed)
    assert b'\nCONFIG_INITRAMFS_SOURCE="../initramfs.cpio"\n' in configuration
    root, rtud = (
        (ROOT / "build" / file).read_bytes()
        for file in ("system.parts/initramfs.cpio", "arm-release/rtud/rtud")
    )
    assert [os.fsencode(ROOT) in content for content in (kernel, configuration, root, rtud)] == [False] * 4
