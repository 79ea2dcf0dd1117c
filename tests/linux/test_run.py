# SPDX-License-Identifier: GPL-3.0-or-later
"""`make run`: the emulated board from reset to the control room's table, as a process of its own."""

import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from update_board import ubi_image

from lab.board_show import BOARD_STEPS
from lab.gateway import free_port
from lab.kept import record
from lab.master import Master
from rig.desk import chapter_5, values

ROOT = Path(__file__).resolve().parents[2]
SYSTEM = ROOT / "build/system-lab"
STORY_SECONDS = 1200  # against hangs only: the shows have deadlines that a busy host moves
# What differs most easily between machines: rounding that a loop carries from scan to scan, and the C
# library's functions.
LOOP = """\
PROGRAM loop
VAR_EXTERNAL
  level, valve, wave : REAL;
END_VAR
VAR
  control : PID;
  smooth : LAG;
END_VAR
smooth(IN := level, T := T#2s);
control(SP := 50.0, PV := smooth.OUT, KP := 1.3, TI := T#7s, TD := T#300ms, LOW := -100.0, HIGH := 100.0);
valve := LREAL_TO_REAL(control.OUT);
wave := LREAL_TO_REAL(EXP(SIN(REAL_TO_LREAL(level))) / 3.0);
END_PROGRAM
"""
LEVELS = "time,level\n0,20.1\n5,47.3\n9,81.7\n15,33.3\n"
# logic-desk there, with the program that it is given here.
DESK_ON_BOARD = """\
#!/bin/sh
{ssh} 'cat > /tmp/loop.rtul' < "$1" && exec {ssh} /tmp/logic-desk /tmp/loop.rtul
"""
# A row of the control room's table: address, CA, value, type.
ROW = re.compile(r"^ {5}(\d{7}) +(\d+) +(\S+)(?: on| off)? +(M_\w+)", re.MULTILINE)
IOA = {"coils": 1, "discrete_inputs": 10001, "input_registers": 30001, "holding_registers": 40001}


def start(program: str, *arguments: str | Path) -> subprocess.Popen[str]:
    if not (SYSTEM / "uImage").exists():
        pytest.fail(f"{SYSTEM}/uImage is not there: `make lab`", pytrace=False)
    return subprocess.Popen(
        [sys.executable, "-m", program, *arguments],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT / "scripts")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ended(show: subprocess.Popen[str]) -> tuple[str, str]:
    """What it has printed. One that hangs is not killed: that would leave its board behind."""
    try:
        return show.communicate(timeout=STORY_SECONDS)
    except subprocess.TimeoutExpired:
        show.terminate()
        show.communicate()
        raise


@dataclass(frozen=True)
class Story:
    """What the show printed until it waits for its user's Ctrl-C."""

    show: subprocess.Popen[str]
    port: int
    out: str


@pytest.fixture(scope="module")
def story(qemu: Path, uboot: Path) -> Iterator[Story]:
    port = free_port()
    show = start("lab.board_show", "--port", str(port), "--keep")
    assert show.stdout is not None
    printed = []
    for line in show.stdout:
        printed.append(line)
        if "Ctrl-C" in line:
            break
    else:
        pytest.fail(f"it ended instead: {''.join(printed)[-3000:]} {show.communicate()}")
    yield Story(show, port, "".join(printed))
    show.terminate()  # not killed: that would leave its board behind
    show.communicate()


def test_all_of_it_is_seen(story: Story) -> None:
    assert f"All {len(BOARD_STEPS)} steps succeeded." in story.out


@pytest.mark.parametrize(
    "words",
    [
        r"^Load uImage, \d+ bytes, to 0x7fc0\.$",
        r"^Load nuc980\.dtb, \d+ bytes, to 0xa00000\.$",
        r"^  \| Starting kernel \.\.\.$",
        r"^  \| .*Machine model: BLIIoT gateway",
        r"^  \| \S+ login: ",
        r"^ +Linux .* PREEMPT_RT ",
        r"^ +rtu-iec104 .*running",
        r"^ +uart8 .*connected$",
        r"^ +board +kill -9 \d+ ",
        r"^ +rtuctl +reload with a limit of 80$",
        r"^ +log +a command of order was refused: interlock$",
        r"^ +rtu-centre +CA 9001 IOA 200: .* N .* E, .* m, good$",
        r"^ +libiec61850 +report of urcbStatus01, data change: ",
        r"^ +snmptrapd +inform \d+: executedCommand, ",
        r"^ +Verdict: ",
    ],
)
def test_it_shows(story: Story, words: str) -> None:
    assert re.search(words, story.out, re.MULTILINE)


def devices_values() -> dict[tuple[int, int], int]:
    """What the simulated devices have in the end, for objects that come as they are."""
    cells = values()
    cells["3.67"]["coils"]["3"] = 1
    cells["5.50"]["coils"]["1"] = 1
    cells["3.67"]["discrete_inputs"]["0"] = 0
    cells["3.67"]["input_registers"]["2"] = 70
    cells["3.67"]["holding_registers"]["2"] = 255
    cells["3.67"]["input_registers"]["0"] = 1510
    found = {}
    for port in chapter_5()["port"]:
        for slave in port["slaves"]:
            if slave["id"] == 0:  # the broadcast is only written
                continue
            own = cells.get(f"{port['value']}.{slave['id']}", {})
            for table, first in IOA.items():
                for each in slave.get(table, []):
                    if plain(each):
                        ioa = each.get("ioa", first + each["address"])
                        value = own.get(table, {}).get(str(each["address"]), 0)
                        found[1000 * port["value"] + slave["id"], ioa] = value
    return found


def plain(point: dict[str, Any]) -> bool:
    return not {"type", "scale", "offset", "signed", "bit", "inverted"} & point.keys()


def test_table_has_the_devices_values(story: Story) -> None:
    last = story.out[story.out.rindex(f"{len(BOARD_STEPS)}. ") :]
    table = {(int(ca), int(ioa)): float(value) for ioa, ca, value, _ in ROW.findall(last) if numeric(value)}
    wanted = devices_values()
    assert len(wanted) > 40
    assert {place: table.get(place) for place in wanted} == wanted


def numeric(text: str) -> bool:
    return re.fullmatch(r"-?\d+(\.\d+)?(e[+-]\d+)?", text) is not None


def traced(program: Path, inputs: Path, desk: Path) -> str:
    words = ["scripts/openrtu", "logic", "run", program, inputs]
    return subprocess.run(
        words,
        cwd=ROOT,
        env=os.environ | {"OPENRTU_LOGIC_DESK": shlex.quote(str(desk))},
        capture_output=True,
        text=True,
        check=True,
        timeout=STORY_SECONDS,
    ).stdout


def test_a_program_does_on_the_board_what_it_does_on_the_desk(
    story: Story, programs: Path, tmp_path: Path
) -> None:
    ssh = json.loads(record(story.port).read_text())["rtuctl"][:-1]
    with (ROOT / "build/arm/logic/logic-desk").open("rb") as desk:
        subprocess.run([*ssh, "cat > /tmp/logic-desk && chmod +x /tmp/logic-desk"], stdin=desk, check=True)
    program, inputs, on_board = tmp_path / "loop.st", tmp_path / "levels.csv", tmp_path / "desk"
    program.write_text(LOOP)
    inputs.write_text(LEVELS)
    on_board.write_text(DESK_ON_BOARD.format(ssh=shlex.join(ssh)))
    on_board.chmod(0o755)
    trace = traced(program, inputs, programs / "logic/logic-desk")
    assert len({line.partition(",")[2] for line in trace.splitlines()}) > 140  # nearly all scans differ
    assert traced(program, inputs, on_board) == trace


def test_it_stays_up_for_the_users_own_master_until_ctrl_c(story: Story) -> None:
    with Master("127.0.0.1", story.port) as master:
        assert len(master.interrogate(3067)) == 13
    command = next(re.finditer(r"^ +(scripts/kept .*rtuctl modules)$", story.out, re.MULTILINE))[1]
    inside = subprocess.run(
        f"{command} --json", shell=True, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True
    )
    assert {module["name"] for module in json.loads(inside.stdout)} >= {"rtud", "rtu-iec104"}
    story.show.send_signal(signal.SIGINT)
    _, err = story.show.communicate(timeout=60)
    assert (story.show.returncode, err) == (0, "")


def test_who_has_the_port_is_named_before_the_board_is_switched_on() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        show = start("lab.board_show", "--port", str(other.getsockname()[1]))
        out, err = ended(show)
    assert (show.returncode, out) == (1, "")
    assert f"(pid {os.getpid()}) listens there" in err
    assert re.search(r"make run PORT=\d+", err)


@pytest.mark.usefixtures("qemu", "uboot")
def test_image_of_a_folder_comes_up() -> None:
    """`make run IMAGE=`, here with our own system as the image."""
    show = start("lab.image", SYSTEM)
    out, err = ended(show)
    assert (show.returncode, err) == (0, ""), out[-3000:]
    facts = dict(re.findall(r"^(U-Boot|kernel|board|log-in) +(.+)$", out[out.rindex("\n\n") :], re.MULTILINE))
    assert facts["U-Boot"].startswith("U-Boot 20")
    assert "PREEMPT_RT" in facts["kernel"]
    assert facts["log-in"].endswith("login:")


@pytest.fixture
def flash_image(tmp_path: Path) -> Path:
    """As Buildroot makes nuc980_gateway_lts, of our own system: Linux alone, and its root as a UBI image."""
    folder, root = tmp_path / "image", tmp_path / "root"
    folder.mkdir()
    root.mkdir()
    fragment = (ROOT / "board/nuc980/linux/root-ubi.fragment").read_text()
    arguments = re.findall(r'^CONFIG_CMDLINE="(.*)"$', fragment, re.MULTILINE)
    dtb = shutil.copy(SYSTEM / "nuc980-gateway.dtb", folder)
    subprocess.run(["fdtput", "-t", "s", dtb, "/chosen", "bootargs", *arguments], check=True)
    kernel = ROOT / "build/linux/zImage"
    subprocess.run(
        ["mkimage", "-A", "arm", "-O", "linux", "-T", "kernel", "-C", "none", "-a", "0x8000", "-e", "0x8000",
         "-d", kernel, folder / "uImage"], check=True, capture_output=True
    )  # fmt: skip
    with (ROOT / "build/system-lab.parts/initramfs.cpio").open("rb") as archive:
        subprocess.run(["cpio", "-idf", "--quiet", "dev/*"], stdin=archive, cwd=root, check=True)
    ubi_image(root, folder)
    return folder


@pytest.mark.usefixtures("qemu", "uboot")
def test_image_with_its_root_in_the_flash_comes_up(flash_image: Path) -> None:
    show = start("lab.image", flash_image)
    out, err = ended(show)
    assert (show.returncode, err) == (0, ""), out[-3000:]
    facts = dict(re.findall(r"^(arguments|/data|log-in) +(.+)$", out[out.rindex("\n\n") :], re.MULTILINE))
    assert "root=ubi0:root_a" in facts["arguments"]
    assert facts["/data"] == "UBI device 0, volume 1"
    assert facts["log-in"].endswith("login:")
    assert "trouble" not in out


def test_folder_without_an_image_is_wrong_usage(tmp_path: Path) -> None:
    show = start("lab.image", tmp_path)
    _, err = show.communicate(timeout=60)
    assert show.returncode == 2
    assert f"{tmp_path}/uImage does not exist; type: make image-buildroot" in err
