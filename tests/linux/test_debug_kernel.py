# SPDX-License-Identifier: GPL-3.0-or-later
"""The kernel that watches itself: everything at once and not a word of it, and the faults that it does see.

The other tests run on it too: OPENRTU_KERNEL=build/linux-debug pytest tests/linux.
"""

import dataclasses
import json
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lab.board import ETHERNET, PORTS, SILENCE_US, lines_at
from lab.gateway import remove, run_directory
from lab.linesim import LineSim
from nuc980.twin.linux import TROUBLE, Kernel, Linux
from nuc980.twin.machine import INSTRUCTION_TIME
from nuc980.twin.nand import NandImage
from rig.desk import CHAPTER_5, chapter_5

pytestmark = pytest.mark.soak  # its own kernel and boots take half an hour: make test-debug-kernel

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PROGRAMS = HERE / "programs"
CROSS = os.environ.get("CROSS_COMPILE", "arm-linux-gnueabi-")

LOAD_SECONDS = 40
SLOW = 600.0  # seconds for what takes 40 on an idle host and a kernel that does not watch
TFTP_FILE = 300_000  # bytes

# A volume for the load. rtu-data would read the whole partition first, to see that it is empty.
FLASH = """\
mtd=$(sed -n 's/^mtd\\([0-9]*\\):.* "rootfs"$/\\1/p' /proc/mtd)
ubiattach -m "$mtd" /dev/ubi_ctrl && ubimkvol /dev/ubi0 -N load -s 16MiB &&
mkdir /tmp/flash && mount -t ubifs ubi0:load /tmp/flash
"""

# Line processes come before all else, and on a kernel that watches itself they leave little to others:
# nothing is typed while they run.
LOAD = """\
mount -o remount,rw / && mkdir -p /etc/openrtu && cp /gateway.json /etc/openrtu/ || exit
/etc/init.d/S80rtud start
until [ $(pidof rtu-modbus | wc -w) = 2 ]; do sleep 1; done
sh /load.sh {seconds} {hosts}; status=$?
rtuctl --json modules
/etc/init.d/S80rtud stop
exit $status
"""

# What the kernel says of each fault of faults.c. The lock checks fall silent with the first that they see,
# and when memory is found broken: those come last in their boot.
FAULTS = {
    "dma": "device driver tries to free DMA memory it has not allocated",
    "sleep": "sleeping function called from invalid context",
    "timer": "ODEBUG: free active",
    "order": "possible circular locking dependency detected",
    "nesting": "Invalid wait context",
    "freed": "Poison overwritten",
}
BOOTS = (("dma", "sleep", "timer", "order"), ("nesting", "freed"))
SIGBUS = 128 + 7  # a shell's status


@pytest.fixture(scope="session")
def folder() -> Path:
    """What `make linux-debug` made, or the folder that OPENRTU_DEBUG_KERNEL names."""
    folder = Path(os.environ.get("OPENRTU_DEBUG_KERNEL", ROOT / "build/linux-debug")).resolve()
    if not (folder / "zImage").exists():
        pytest.fail(f"{folder / 'zImage'} is not there: `make linux-debug`", pytrace=False)
    return folder


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path | str]:
    """What the load needs on the board, by its paths there."""
    folder = tmp_path_factory.mktemp("programs")
    names = ("gpio-lines", "load-module", "unaligned")
    for name in names:
        subprocess.run(
            [f"{CROSS}gcc", "-std=c11", "-D_GNU_SOURCE", "-O2", "-static", "-march=armv5te", "-marm",
             "-Wall", "-Wextra", "-Werror", "-o", folder / name, PROGRAMS / f"{name}.c"], check=True
        )  # fmt: skip
    return {f"/{name}": folder / name for name in names} | {"/load.sh": PROGRAMS / "load.sh"}


@pytest.fixture(scope="session")
def faults(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """faults.c as a module of the debug kernel."""
    source = tmp_path_factory.mktemp("module") / "faults"
    shutil.copytree(HERE / "faults", source)
    make = ["make", "--silent", f"--directory={folder / 'build'}", "ARCH=arm", f"CROSS_COMPILE={CROSS}"]
    for target in (["modules_prepare"], [f"M={source}", "modules"]):
        done = subprocess.run([*make, *target], capture_output=True, text=True)
        if done.returncode:
            pytest.fail(f"the faults do not build:\n{done.stderr}", pytrace=False)
    return source / "faults.ko"


def configuration() -> dict[str, object]:
    """Chapter 5, on all of the board's addresses."""
    config = chapter_5()
    del config["iec104"]["address"]
    return config


@pytest.fixture(scope="module")
def lines(linesim_program: Path) -> Iterator[LineSim]:
    """Devices at the six lines, at one speed: a pty has none of its own."""
    directory = run_directory()
    config = configuration()
    for port in config["port"]:
        port.update(baud_rate=9600, parity=0, stop_bits=1)
    file = directory / "linesim.json"
    file.write_text(json.dumps(config))
    with LineSim(
        file, CHAPTER_5 / "values.json", directory / "dev", silence_us=SILENCE_US, program=linesim_program
    ) as lines:
        yield lines
    remove(directory)


@pytest.fixture(scope="module", params=["GATEWAY_PDMA=0", "GATEWAY_PDMA=1"])
def linux(
    request: pytest.FixtureRequest,
    boot: Callable[..., Linux],
    kernel: Kernel,
    folder: Path,
    programs: dict[str, Path | str],
    lines: LineSim,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Linux]:
    """The image on the debug kernel, with all that the board can have."""
    directory = tmp_path_factory.mktemp("board")
    dtb, tftp = directory / "board.dtb", directory / "tftp"
    subprocess.run(
        [ROOT / "scripts/build-dtb.sh", ROOT / "dts/nuvoton/nuc980-gateway.dts", dtb, request.param,
         "GATEWAY_RTC=1"], check=True
    )  # fmt: skip
    tftp.mkdir()
    (tftp / "load").write_bytes(bytes(TFTP_FILE))
    nand = NandImage.blank(directory / "nand")
    networks = []
    for network in ETHERNET:
        option, value = network.arguments({})
        networks += [option, f"{value},tftp={tftp}"]
    with boot(
        *networks, "-drive", f"if=mtd,format=raw,file={nand.path}",
        kernel=dataclasses.replace(kernel, image=folder / "zImage", dtb=dtb),
        chardevs=lines_at(lines.directory), files=programs | {"/gateway.json": json.dumps(configuration())},
    ) as linux:  # fmt: skip
        linux.run("mount -t debugfs debugfs /sys/kernel/debug; test -d /sys/kernel/debug/dma-api", SLOW)
        linux.run(FLASH, SLOW)
        yield linux


def traffic(linux: Linux) -> dict[int, tuple[int, int]]:
    """Of each line the characters sent and received."""
    counts = re.findall(
        r"^(\d+): .* tx:(\d+) rx:(\d+)", linux.run("cat /proc/tty/driver/*", SLOW), re.MULTILINE
    )
    return {int(line): (int(sent), int(received)) for line, sent, received in counts if int(line) in PORTS}


def unaligned_accesses(linux: Linux) -> dict[str, str]:
    """What /proc/cpu/alignment counts, but its setting."""
    lines = linux.run("cat /proc/cpu/alignment", SLOW).splitlines()
    counts = dict(re.split(r":\s*", line, maxsplit=1) for line in lines)
    assert counts.pop("User faults") == "5 (signal+warn)"
    return counts


def test_everything_at_once_without_a_word(linux: Linux) -> None:
    hosts = " ".join(network.host for network in ETHERNET)
    output = linux.run(LOAD.format(seconds=LOAD_SECONDS, hosts=hosts), SLOW)
    table = re.search(r"^\[\s*\{.*\}\s*\]", output, re.MULTILINE | re.DOTALL)
    assert table is not None, output
    restarts = [row["restarts"] for row in json.loads(table[0]) if row["name"].startswith("rtu-modbus")]
    assert sum(restarts) > 0, "none was killed, or rtud did not see it"
    characters = traffic(linux)
    assert set(characters) == set(PORTS)
    assert all(sent and received for sent, received in characters.values())
    assert TROUBLE.findall(linux.run("dmesg", SLOW)) == []
    assert re.search(r"debug_locks: +1$", linux.run("cat /proc/lockdep_stats", SLOW), re.MULTILINE)
    assert linux.run("cd /sys/kernel/debug/dma-api; cat disabled error_count", SLOW).split() == ["N", "0"]


def test_no_program_reads_a_word_where_none_begins(linux: Linux) -> None:
    before = unaligned_accesses(linux)
    assert {count.split()[0] for count in before.values()} == {"0"}
    assert linux.try_to("/unaligned", SLOW)[0] == SIGBUS
    assert unaligned_accesses(linux)["User"] == "1"


@pytest.mark.parametrize("kinds", BOOTS, ids="-".join)
def test_each_kind_of_fault_is_seen(
    boot: Callable[..., Linux],
    kernel: Kernel,
    folder: Path,
    faults: Path,
    programs: dict[str, Path | str],
    kinds: tuple[str, ...],
) -> None:
    alone = dataclasses.replace(kernel, image=folder / "zImage").without_services()
    with boot(*INSTRUCTION_TIME, kernel=alone, files=programs | {"/faults.ko": faults}) as linux:
        linux.run("dmesg -n 1")  # all of it is read by dmesg: the console is the shell's alone
        for kind in kinds:
            linux.run("dmesg -c > /dev/null")
            start = len(linux.log)
            assert "Operation canceled" in linux.try_to(f"/load-module /faults.ko fault={kind}")[1]
            linux.run("dmesg", SLOW)
            log = linux.log[start:]
            assert FAULTS[kind] in log
            assert TROUBLE.search(log)
        linux.troubles.clear()
