# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`, third table: nuc980-netboot's TFTP server beside tftpd-hpa, by turns in one run. The client is
our U-Boot on the emulated board; its cable is a tap in a network namespace, apart from the host's network.
What the rows mean: docs/bench.md. No time is asserted. Exit codes: 0 done, or left out as it needs root;
1 something failed; 2 not built.
"""

from __future__ import annotations

import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from nuc980.netboot.errors import NetbootError
from nuc980.netboot.tftp import FileService
from nuc980.twin.machine import Machine, MachineError
from nuc980.twin.uboot import PROMPT, Console, text

ROOT = Path(__file__).resolve().parents[2]
QEMU, UBOOT = ROOT / "build/qemu/bin/qemu-system-arm", ROOT / "build/u-boot/u-boot.bin"
HPA = ROOT / "build/tftpd-hpa"  # unpacked, not installed: the package starts a service

ROUNDS = 7
SIZE, BLOCK_SIZE = 10_000_000, 1468
TAP, SERVER, BOARD = "bench0", "10.0.0.2", "10.0.0.15"
LOAD = 0x7FC0
SECONDS = 120.0  # for one load, on a host that does other things as well

Server = Callable[[Path], AbstractContextManager[None]]


class BenchError(Exception):
    """The board did not get the file."""


@contextmanager
def ours(file: Path) -> Iterator[None]:
    with FileService(SERVER, 69, BOARD) as service, service.offer(file.name, file):
        yield


@contextmanager
def hpa(file: Path) -> Iterator[None]:
    (library,) = HPA.glob("**/libwrap.so.0")
    command = [HPA / "usr/sbin/in.tftpd", "-L", "-a", f"{SERVER}:69", "-u", "nobody", "-s", file.parent]
    server = subprocess.Popen(command, env=os.environ | {"LD_LIBRARY_PATH": str(library.parent)})
    try:
        deadline = time.monotonic() + 10
        while ":0045 " not in Path("/proc/net/udp").read_text():  # 69
            if server.poll() is not None or time.monotonic() > deadline:
                raise BenchError(f"in.tftpd did not start: {server.poll()}")
            time.sleep(0.01)
        yield
    finally:
        server.terminate()
        server.wait()


SERVERS: dict[str, Server] = {"nuc980-netboot": ours, "tftpd-hpa": hpa}
BESIDE = "tftpd-hpa"


def keep_apart(machine: Machine) -> None:
    """The emulated processor on a core of its own: it never sleeps, and would by chance share a server's."""
    mine, *others = sorted(os.sched_getaffinity(0))
    if others:
        for thread in Path(f"/proc/{machine.process.pid}/task").iterdir():
            os.sched_setaffinity(int(thread.name), others)
        os.sched_setaffinity(0, others)
        (processor,) = machine.command("query-cpus-fast")
        os.sched_setaffinity(processor["thread-id"], [mine])


def load(console: Console, content: bytes) -> float:
    """Seconds from Enter to the prompt."""
    console.type(f"mw.b {LOAD:#x} 0 {SIZE:#x}; tftpboot {LOAD:#x} file")
    console.line.wait_for(b"Loading: ")
    begin = time.perf_counter()
    output = text(console.line.wait_for(PROMPT, SECONDS))
    seconds = time.perf_counter() - begin
    if f"{zlib.crc32(content):08x}" not in console.run(f"crc32 {LOAD:#x} {SIZE:#x}") or " T " in output:
        raise BenchError(f"the file did not come, or a block was lost: {output}")
    return seconds


def measured(folder: Path) -> dict[str, list[float]]:
    """Each server's times, by turns; a first load of each is not counted."""
    content = random.Random(980).randbytes(SIZE)
    (folder / "file").write_bytes(content)
    folder.chmod(0o755)
    times: dict[str, list[float]] = {name: [] for name in SERVERS}
    with Machine(QEMU, "-bios", UBOOT, "-nic", f"tap,ifname={TAP},script=no,downscript=no") as machine:
        keep_apart(machine)
        console = Console(machine)
        console.run(f"setenv ethaddr 02:00:00:00:00:01; setenv ipaddr {BOARD}; setenv serverip {SERVER}")
        console.run(f"setenv tftpblocksize {BLOCK_SIZE}")
        for _ in range(ROUNDS + 1):
            for name, server in SERVERS.items():
                with server(folder / "file"):
                    times[name].append(load(console, content))
    return {name: values[1:] for name, values in times.items()}


def table(times: dict[str, list[float]]) -> str:
    load_average = os.getloadavg()[0]
    beside = statistics.median(times[BESIDE])
    lines = [
        f"\n> {os.cpu_count()} cores, load {load_average:.1f}. Median (minimum..maximum) of {ROUNDS}.\n",
        f"| {SIZE} bytes in blocks of {BLOCK_SIZE}, from | seconds | MB/s | speed, of {BESIDE}'s |",
        "|---|---|---|---|",
    ]
    for name, values in times.items():
        middle = statistics.median(values)
        spread = f"{middle:.2f} ({min(values):.2f}..{max(values):.2f})"
        lines.append(f"| {name} | {spread} | {SIZE / middle / 1e6:.2f} | {beside / middle:.2f} |")
    return "\n".join(lines)


def lay_cable() -> None:
    for words in (f"tuntap add {TAP} mode tap", f"address add {SERVER}/24 dev {TAP}", f"link set {TAP} up"):
        subprocess.run(["ip", *words.split()], check=True)


def outside() -> int:
    """Brings what is missing, and starts this program anew in a namespace of its own."""
    for program, target in ((QEMU, "qemu"), (UBOOT, "uboot")):
        if not program.exists():
            print(f"{program} is not there: run make {target}", file=sys.stderr)
            return 2
    if os.geteuid():
        print(
            "TFTP table left out: in.tftpd changes its user, which takes root (a user namespace will not do)"
        )
        return 0
    if not HPA.exists():
        subprocess.run([ROOT / "scripts/debian-package.sh", HPA, "tftpd-hpa", "libwrap0"], check=True)
    return subprocess.run(["unshare", "-n", sys.executable, __file__, "inside"], check=False).returncode


def inside() -> int:
    lay_cable()
    with tempfile.TemporaryDirectory(prefix="tftp-bench-") as folder:
        print(table(measured(Path(folder))))
    return 0


def main() -> int:
    """Measures, and prints the table."""
    try:
        return inside() if sys.argv[1:] == ["inside"] else outside()
    except (BenchError, MachineError, NetbootError, subprocess.CalledProcessError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
