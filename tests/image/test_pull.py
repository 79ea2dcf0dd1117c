# SPDX-License-Identifier: GPL-3.0-or-later
"""How the board fetches its updates: the script of the board with curl and jq of this machine, a server of
updates over HTTPS, and a stand-in for `rtu-update`. tests/linux has the board itself."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from peers.ddi import BASE, TOKEN, Authority, UpdateServer

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).resolve().parents[2] / "board/nuc980/rootfs-overlay/usr/sbin/rtu-pull"
CONTENT = bytes(range(256)) * 1000
BOARD = "station-7-020000000001"
# Stand-ins: what comes is kept; what it says and how it ends is in files.
RTU_UPDATE = """#!/bin/sh
case $1 in
install)
	cat >{root}/installed
	cat {root}/says
	exit $(cat {root}/code)
	;;
status) cat {root}/status ;;
esac
"""
# What reads the network is to be the user rtu-pull.
SETUIDGID = '#!/bin/sh\n[ "$1" = rtu-pull ] || exit 99\nshift\nCONFINED=1 exec "$@"\n'
CONFINED = '#!/bin/sh\n[ -n "$CONFINED" ] || exit 99\nexec {program} "$@"\n'
STATUS = "running  {slot}, version 1\nbase     A\ntrial    none\nthe next start takes A\n"
TAKEN = "The update is in slot B, read back, and on trial at the next start.\n"


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority(tmp_path_factory.mktemp("ca"))


@pytest.fixture(scope="module")
def certificate(authority: Authority) -> tuple[Path, Path]:
    return authority.server("127.0.0.1")


@pytest.fixture
def server(certificate: tuple[Path, Path]) -> Iterator[UpdateServer]:
    with UpdateServer(certificate) as server:
        yield server


@dataclass
class Board:
    root: Path

    def starts(self) -> None:
        """Another start of Linux."""
        boot = self.root / "proc/sys/kernel/random/boot_id"
        boot.write_text(f"{int(boot.read_text() or 0) + 1}\n")

    def runs(self, slot: str, trial: bool = False) -> None:
        (self.root / "status").write_text(STATUS.format(slot=slot + (", on trial" if trial else "")))

    def refuses(self, why: str) -> None:
        (self.root / "says").write_text(why)
        (self.root / "code").write_text("1")

    def pull(self, command: str = "once") -> subprocess.CompletedProcess[str]:
        text = re.sub(r"(?<![\w.])/(data|etc|proc|run|sys)/", rf"{self.root}/\1/", SCRIPT.read_text())
        environment = os.environ | {"PATH": f"{self.root}/bin:{os.environ['PATH']}"}
        return subprocess.run(
            ["sh", "-c", text, "rtu-pull", command],
            env=environment, capture_output=True, text=True, check=False, timeout=120,
        )  # fmt: skip

    @property
    def installed(self) -> bytes:
        return (self.root / "installed").read_bytes() if (self.root / "installed").exists() else b""

    @property
    def restarted(self) -> bool:
        return (self.root / "rebooted").exists()


@pytest.fixture
def board(tmp_path: Path, server: UpdateServer, authority: Authority) -> Board:
    texts = {
        "etc/openrtu/update-server": server.settings,
        "etc/openrtu/update-server.pem": authority.certificate.read_text(),
        "etc/hwrevision": "nuc980-gateway station-7\n",
        "etc/os-release": "NAME=OpenRTU\nIMAGE_VERSION=1.2.3\n",
        "proc/mounts": "ubi0:data /data ubifs rw 0 0\n",
        "proc/sys/kernel/random/boot_id": "1\n",
        "sys/class/net/eth0/address": "02:00:00:00:00:01\n",
        "bin/rtu-update": RTU_UPDATE.format(root=tmp_path),
        "bin/setuidgid": SETUIDGID,
        **{f"bin/{name}": CONFINED.format(program=shutil.which(name)) for name in ("curl", "jq")},
        "bin/reboot": f"#!/bin/sh\ntouch {tmp_path}/rebooted\n",
        "bin/logger": "#!/bin/sh\n",
        "bin/sync": "#!/bin/sh\n",
        "bin/sleep": f'#!/bin/sh\necho "$1" >>{tmp_path}/slept\n[ -z "$ROUNDS" ] || kill $PPID\n',
        "says": TAKEN,
        "code": "0",
    }
    for path, text in texts.items():
        file = tmp_path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        file.chmod(0o755)
    board = Board(tmp_path)
    board.runs("A")
    return board


def offer(server: UpdateServer) -> None:
    server.action, server.content = "12", CONTENT


def test_nothing_to_do(board: Board, server: UpdateServer) -> None:
    done = board.pull()
    assert (done.returncode, done.stderr) == (0, "")
    assert server.seen == [f"GET {BASE}/{BOARD}", f"PUT {BASE}/{BOARD}/configData"]
    assert server.attributes == {"version": "1.2.3", "site": "station-7"}
    assert not board.installed


def test_installed_and_reported_once_it_is_confirmed(board: Board, server: UpdateServer) -> None:
    offer(server)
    assert board.pull().returncode == 0
    assert board.installed == CONTENT
    assert board.restarted
    assert server.results == [("12", "proceeding", "none")]
    for _ in range(2):  # the restart is still ahead; then it is on trial
        assert board.pull().returncode == 0
        assert len(server.reports) == 1
        board.starts()
        board.runs("B", trial=True)
    board.runs("B")
    assert board.pull().returncode == 0
    assert server.results[1:] == [("12", "closed", "success")]
    seen = len(server.seen)
    assert board.pull().returncode == 0
    assert len(server.seen) == seen + 2, "it is not reported twice"


def test_failure_when_the_old_version_is_back(board: Board, server: UpdateServer) -> None:
    offer(server)
    board.pull()
    board.starts()
    assert board.pull().returncode == 0
    assert server.results[1:] == [("12", "closed", "failure")]
    assert "returned to the old version" in server.reports[-1]["status"]["details"][0]


@pytest.mark.parametrize(
    "why",
    [
        "refused, and slot B is as it was: it is not signed by a certificate of this board",
        "refused, and slot B is as it was: it is older than version 1.2.3, which runs",
        "failed, and slot B holds nothing that boots: it does not fit the slot",
    ],
    ids=["another signature", "older", "no space"],
)
def test_refusal_is_reported_with_its_reason(why: str, board: Board, server: UpdateServer) -> None:
    offer(server)
    board.refuses(f"rtu-update: {why}")
    assert board.pull().returncode == 0
    assert server.results[1:] == [("12", "closed", "failure")]
    assert server.reports[-1]["status"]["details"] == [f"rtu-update: {why}"]
    assert not board.restarted


def test_not_now_is_no_failure(board: Board, server: UpdateServer) -> None:
    offer(server)
    board.refuses(
        "rtu-update: rtud does not run here, so a new version could not be told from a broken one\n"
    )
    done = board.pull()
    assert (done.returncode, server.results) == (1, [("12", "proceeding", "none")])
    assert "rtud does not run" in done.stderr


def test_download_goes_on_where_it_broke(board: Board, server: UpdateServer) -> None:
    offer(server)
    server.cuts = [1000, 0, 100_000]
    assert board.pull().returncode == 0
    assert board.installed == CONTENT
    froms = [seen.rpartition(" ")[2] for seen in server.seen if "/file" in seen]
    assert froms == ["0", "1000", "1000", "101000"]


def test_download_that_breaks_for_good_is_tried_later(board: Board, server: UpdateServer) -> None:
    offer(server)
    server.cuts = [1000] + [0] * 10
    board.refuses("rtu-update: refused, and slot B is as it was: its content is not what was signed\n")
    done = board.pull()
    assert done.returncode == 1
    assert "the download broke off" in done.stderr
    assert server.results == [("12", "proceeding", "none")]


def test_server_that_cannot_go_on_gives_no_mixture(board: Board, server: UpdateServer) -> None:
    offer(server)
    server.cuts, server.ranges = [1000], False
    board.refuses("rtu-update: refused, and slot B is as it was: its content is not what was signed\n")
    assert board.pull().returncode == 1
    assert board.installed == CONTENT[:1000]


@pytest.mark.parametrize("what", ["another authority", "another name", "a wrong token"])
def test_server_that_is_not_ours(what: str, board: Board, server: UpdateServer, tmp_path: Path) -> None:
    offer(server)
    settings = board.root / "etc/openrtu/update-server"
    if what == "another authority":
        other = Authority(tmp_path, "other")
        (board.root / "etc/openrtu/update-server.pem").write_text(other.certificate.read_text())
    elif what == "another name":
        settings.write_text(settings.read_text().replace("127.0.0.1", "localhost"))
    else:
        settings.write_text(settings.read_text().replace("d1d2d3", "d1d2d4"))
    done = board.pull()
    assert done.returncode == 1
    assert "no answer of https://" in done.stderr
    assert not board.installed
    if what != "a wrong token":
        assert not server.seen


@pytest.mark.sample(4)
@pytest.mark.parametrize(
    "elsewhere", ["https://127.0.0.1:1", "http://127.0.0.1", "file:///etc/passwd?", "-o/x"]
)
def test_links_elsewhere_are_not_followed(elsewhere: str, board: Board, server: UpdateServer) -> None:
    offer(server)
    server.elsewhere = elsewhere
    done = board.pull()
    assert done.returncode == 1
    assert "which is not below https://127.0.0.1" in done.stderr
    assert not board.installed


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    "answer",
    [
        {},
        {"config": {"polling": {"sleep": 3}}, "_links": []},
        {"_links": {"deploymentBase": {"href": {"a": 1}}}},
    ],
)
def test_odd_answers_install_nothing(answer: dict, board: Board, server: UpdateServer) -> None:
    server.answer = answer
    board.pull()
    assert not board.installed
    assert not server.reports


def test_large_answer_is_cut(board: Board, server: UpdateServer) -> None:
    server.answer = {"x": "x" * 1_000_000}
    done = board.pull()
    assert done.returncode == 1
    assert "no answer" in done.stderr


def test_what_is_to_wait_waits(board: Board, server: UpdateServer) -> None:
    offer(server)
    server.update = "skip"
    assert board.pull().returncode == 0
    assert not board.installed
    assert not server.reports


def test_file_of_another_kind_fails(board: Board, server: UpdateServer) -> None:
    offer(server)
    server.filename = "image.bin"
    assert board.pull().returncode == 0
    assert server.results == [("12", "closed", "failure")]
    assert "ends with .swu" in server.reports[0]["status"]["details"][0]


def test_cancelled_before_it_was_begun(board: Board, server: UpdateServer) -> None:
    server.cancelled = "11"
    assert board.pull().returncode == 0
    assert server.results == [("11", "closed", "success")]


def test_result_is_kept_until_the_server_takes_it(board: Board, server: UpdateServer) -> None:
    offer(server)
    board.pull()
    board.starts()
    board.runs("B")
    settings = board.root / "etc/openrtu/update-server"
    text = settings.read_text()
    settings.write_text(text.replace("d1d2d3", "d1d2d4"))
    done = board.pull()
    assert done.returncode == 1
    assert "did not take a report" in done.stderr
    settings.write_text(text)
    server.gone = True
    assert board.pull().returncode == 0
    server.gone = False
    seen = len(server.reports)
    server.action = ""
    assert board.pull().returncode == 0
    assert len(server.reports) == seen, "an action that the server no longer knows is forgotten"


def test_without_a_volume_for_data_nothing_is_begun(board: Board, server: UpdateServer) -> None:
    (board.root / "proc/mounts").write_text("none / rootfs rw 0 0\n")
    done = board.pull()
    assert done.returncode == 1
    assert "rtu-data create" in done.stderr
    assert not server.seen


def test_follow_waits_as_long_as_the_server_wants(
    board: Board, server: UpdateServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROUNDS", "1")
    server.polling = "01:02:04"
    board.pull("follow")
    assert 3724 <= int((board.root / "slept").read_text()) <= 3724 * 5 / 4


def test_follow_backs_off(board: Board, server: UpdateServer, monkeypatch: pytest.MonkeyPatch) -> None:
    sleep = board.root / "bin/sleep"
    sleep.write_text(sleep.read_text().replace("[ -z", f'[ "$(wc -l <{board.root}/slept)" -lt 9 ] || [ -z'))
    monkeypatch.setenv("ROUNDS", "1")
    (board.root / "etc/openrtu/update-server").write_text(f"url https://127.0.0.1:1{BASE}\ntoken {TOKEN}\n")
    board.pull("follow")
    waited = list(map(int, (board.root / "slept").read_text().split()))
    for shortest, seconds in zip([60, 120, 240, 480, 960, 1920, 1920, 1920, 1920], waited, strict=True):
        assert shortest <= seconds <= shortest * 5 / 4
