# SPDX-License-Identifier: GPL-3.0-or-later
"""A receiver sets the board's clock: rtu-gps reads its lines, chronyd gets its time, the gateway follows."""

import json
import re
import shlex
import threading
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import remove, run_directory
from lab.receiver import Receiver, burst
from nuc980.twin.linux import Linux

CLOCK = "/run/gps/clock"
UART, BAUD_RATE = 8, 9600
PIECE = 16  # octets that the UART takes at once: it has room for four
RECEIVER = {"name": "van", "device": f"ttyS{UART}", "baud_rate": BAUD_RATE, "ca": 901, "clock_socket": CLOCK}
SITE_FILE, USED = "/data/site/ntp", "/etc/chrony/site.conf"
SOURCE = f"refclock SOCK {CLOCK} refid GPS poll 0 filter 1 delay 0.5 precision 0.1 offset 0.3"
PLACE = (44.8125, 20.4612)
WAITS_S = 300.0
NEAR_S = 60.0  # a busy host delays the lines; the board's clock begins in 1970


@pytest.fixture(scope="module")
def receiver() -> Iterator[Receiver]:
    """It says again and again where it is, and what time it is here, no faster than the line."""
    folder = run_directory()
    ended = threading.Event()

    def speak() -> None:
        while not ended.wait(0.7):
            octets = burst(datetime.now(UTC), *PLACE)
            for at in range(0, len(octets), PIECE):
                receiver.say(octets[at : at + PIECE])
                ended.wait(PIECE * 10 / BAUD_RATE)

    with Receiver(folder / "line") as receiver:
        speaker = threading.Thread(target=speak)
        speaker.start()
        yield receiver
        ended.set()
        speaker.join()
    remove(folder)


@pytest.fixture(scope="module")
def board_chardevs(receiver: Receiver) -> dict[int, str]:
    return {UART: f"serial,path={receiver.path}"}


@pytest.fixture(scope="module")
def extra_files() -> dict[str, Path | str]:
    return {"/etc/openrtu/gateway.json": json.dumps({"iec104": {}, "port": [], "gps": [RECEIVER]})}


def use(linux: Linux, *lines: str) -> str:
    """Has S15data take the site's file, as at a start; what it logs of that."""
    text = "".join(f"{line}\n" for line in lines)
    linux.run(f"mkdir -p /data/site && printf %s {shlex.quote(text)} > {SITE_FILE}")
    linux.run("mount -o remount,rw / && sed '/^case/,$d' /etc/init.d/S15data > /tmp/settings")
    linux.run(f". /tmp/settings; use ntp 644 {USED}")
    return linux.run(f"grep {SITE_FILE} /var/log/messages | tail -n 1")


def clock(linux: Linux) -> dict[str, Any]:
    (row,) = json.loads(linux.run("rtuctl --json clock"))
    return row  # type: ignore[no-any-return]


def trouble(linux: Linux) -> str:
    return linux.run(
        f"chronyc -n sources; ls -l {CLOCK}; rtuctl gps; rtuctl log; tail -n 20 /var/log/messages"
    )


@pytest.mark.parametrize(
    "line", ["refclock SHM 0", "refclock SOCK /run/other", "refclock SOCK /run/gps/clock refid", "allow"]
)
def test_what_is_no_source_of_time_is_not_used(linux: Linux, line: str) -> None:
    assert "is not used" in use(linux, SOURCE, line)
    assert linux.try_to(f"test -e {USED}")[0] != 0


def test_a_receiver_sets_the_clock(linux: Linux) -> None:
    row = clock(linux)
    assert (row["source"], row["valid"], row["time"][:4]) == ("none", False, "1970")
    assert "is used as" in use(linux, SOURCE)
    linux.run("/etc/init.d/S45chronyd start")
    deadline = time.monotonic() + WAITS_S
    while not re.search(r"^#,\*,GPS,0,0,[1-9]", linux.run("chronyc -n -c sources"), re.MULTILINE):
        assert time.monotonic() < deadline, trouble(linux)
    while (row := clock(linux))["source"] != "system, synchronised":
        assert time.monotonic() < deadline, f"{row}\n{trouble(linux)}"
    assert row["valid"]
    assert abs(datetime.fromisoformat(row["time"]).timestamp() - time.time()) < NEAR_S
    assert linux.run(f"stat -c '%G %a' {CLOCK}") == "dialout 660"
