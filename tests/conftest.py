# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests share: the tree's root and the built programs, a gateway on a desk."""

import gc
import os
import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadFileScheduling

import search_path
from areas import area_of
from lab.turns import take_short_turns
from peers import mms
from rig import capture
from rig.desk import Desk, chapter_5, desk_of
from rig.rights import Rights
from times import Times

ROOT = Path(__file__).resolve().parent.parent


# Each of these files' tests starts a board of its own: they go to whichever worker is free.
SPREAD = {
    "tests/linux/test_data_volume.py",
    "tests/linux/test_mistakes.py",
    "tests/netboot/test_boot_twin.py",
    "tests/netboot/test_environment.py",
    "tests/netboot/test_flash_twin.py",
    "tests/netboot/test_power_cut.py",
}


# Many files of these areas, none of which waits for a gateway's lines and timers.
SHORT = {"image", "netboot", "pins"}


cases: Counter[str] = Counter()  # collected so far, of each table


def pytest_itemcollected(item: pytest.Item) -> None:
    """Of a table that is marked as sample(n), the first case and each n-th after it are quick."""
    if marker := item.get_closest_marker("sample"):
        table = item.nodeid.partition("[")[0]
        if cases[table] % marker.args[0]:
            item.add_marker(pytest.mark.slow)
        cases[table] += 1


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Files with many slow tests first, short ones and what is spread last: so the workers end together."""
    if hasattr(config, "workerinput"):  # of xdist; a worker does not know --dist
        slow = Counter(
            item.path
            for item in items
            if item.get_closest_marker("slow") and not item.get_closest_marker("sample")
        )
        items.sort(
            key=lambda item: (
                file_of(item.nodeid) in SPREAD,
                -slow[item.path],
                area_of(item.nodeid) in SHORT,
            )
        )


def pytest_collection(session: pytest.Session) -> None:
    """A search for garbage in what is collected finds none, and takes a fifth of the time."""
    gc.disable()


def pytest_collection_finish(session: pytest.Session) -> None:
    gc.freeze()
    gc.enable()


def file_of(test: str) -> str:
    return test.partition("::")[0]


class FileByFile(LoadFileScheduling):
    """A file's tests share what they start, and so a worker."""

    def _split_scope(self, nodeid: str) -> str:
        return nodeid if file_of(nodeid) in SPREAD else file_of(nodeid)


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> FileByFile | None:
    return FileByFile(config, log) if config.getoption("--dist") == "loadfile" else None


def pytest_configure(config: pytest.Config) -> None:
    search_path.complete_own()
    config.pluginmanager.register(Times())
    config.pluginmanager.register(Rights())
    take_short_turns()
    # A run in the background, or under nohup, ignores these, and so would all that the tests start.
    for number, action in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, action)


def built(variable: str, default: str) -> Path:
    """What the environment variable names, or the default below the tree's root."""
    path = Path(os.environ.get(variable, ROOT / default)).resolve()
    if not path.exists():
        pytest.fail(
            f"{path} is not there: `make build asan qemu uboot build/gpsd/done build/mibs/done`, "
            f"or set {variable}",
            pytrace=False,
        )
    return path


@pytest.fixture(scope="session")
def programs() -> Path:
    """The folder of the native build: rtud/rtud, rtuctl/rtuctl, modules/…"""
    return built("OPENRTU_BUILD", "build/native")


@pytest.fixture(scope="session")
def asan_programs() -> Path:
    """The same under AddressSanitizer and UBSan, for slow tests: `make test-quick` does not build them."""
    return built("OPENRTU_ASAN_BUILD", "build/asan")


@pytest.fixture(scope="session")
def fuzzers() -> Path:
    """The folder of `make fuzzers`."""
    return built("OPENRTU_FUZZ", "build/fuzz")


@pytest.fixture(scope="session")
def linesim_program() -> Path:
    return built("OPENRTU_LINESIM", "build/linesim/linesim")


@pytest.fixture(scope="session")
def qemu() -> Path:
    """The program of `make qemu`."""
    return built("OPENRTU_QEMU", "build/qemu/bin/qemu-system-arm")


@pytest.fixture(scope="session")
def qemu_source() -> Path:
    """What it was built from, QEMU's own tools among it."""
    return built("OPENRTU_QEMU_SOURCE", "build/qemu/source")


@pytest.fixture(scope="session")
def uboot() -> Path:
    """The program of `make uboot`."""
    return built("OPENRTU_UBOOT", "build/u-boot/u-boot.bin")


@pytest.fixture(scope="session")
def uboot_source() -> Path:
    """What it was built from, U-Boot's own tools among it."""
    return built("OPENRTU_UBOOT_SOURCE", "build/u-boot/source")


@pytest.fixture(scope="session")
def gpsd() -> Path:
    """Debian's gpsd, for slow tests: its source with recordings in debian/, its program in packages/."""
    return built("OPENRTU_GPSD", "build/gpsd")


@pytest.fixture(scope="session")
def chrony() -> Path:
    """The programs of Debian's chrony, for slow tests."""
    return built("OPENRTU_CHRONY", "build/chronyd") / "usr"


@pytest.fixture(scope="session")
def mibs() -> Path:
    """MIBs of others, for slow tests: those of Debian's erlang-snmp."""
    (folder,) = built("OPENRTU_MIBS", "build/mibs").glob("usr/lib/erlang/lib/snmp-*/mibs")
    return folder


@pytest.fixture(scope="session")
def exporter() -> Path:
    """The programs of Debian's prometheus-snmp-exporter, for slow tests."""
    return built("OPENRTU_EXPORTER", "build/exporter") / "usr/bin"


@pytest.fixture(scope="module")
def desk(programs: Path) -> Iterator[Desk]:
    """The gateway of chapter 5 between simulated devices and a controlling station; one a module."""
    with desk_of(chapter_5(), programs) as desk:
        yield desk


@pytest.fixture(scope="session", autouse=True)
def every_frame_is_dissected(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What masters, clients and stations said to each other in this session, as tshark reads it."""
    yield
    wrong: list[str] = []
    folder = tmp_path_factory.mktemp("capture")
    if capture.RECORD:
        _, findings = capture.dissect(capture.RECORD, folder / "iec104.pcap")
        wrong = [str(finding) for finding in findings if not finding.allowed]
    if mms.RECORD:
        wrong += capture.dissect_mms(mms.RECORD, folder / "mms.pcap")[1]
    assert not wrong, f"in {folder}: " + "\n".join(wrong[:20])
