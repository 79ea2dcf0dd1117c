# SPDX-License-Identifier: GPL-3.0-or-later
"""The tree itself: licences, layout, front door, links. What a reader would otherwise find out too late."""

import fnmatch
import itertools
import os
import re
import shutil
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

from house import git_files

ROOT = Path(__file__).resolve().parents[2]
THIS = Path("tests/house/test_tree.py")
TAG = "SPDX-License-Identifier"

# The first pattern that fits a path names its licence.
LICENCES = [
    ("patches/linux/*", "GPL-2.0-only"),
    ("board/nuc980/linux/*/*", "GPL-2.0-only"),
    ("board/nuc980/u-boot/*", "GPL-2.0-or-later"),
    ("tests/linux/faults/*", "GPL-2.0-only"),
    ("patches/*", "GPL-2.0-or-later"),
    ("board/nuc980/qemu/*", "GPL-2.0-or-later"),
    ("dts/bindings/*", "GPL-2.0-only OR BSD-2-Clause"),
    ("dts/*", "GPL-2.0-only OR MIT"),
    ("scripts/lab/boat.nmea", "BSD-2-Clause"),
    ("package/openrtu/src/templates/sunspec/*", "Apache-2.0"),
    ("*", "GPL-3.0-or-later"),
]
NO_COMMENT = {".csv", ".json", ".pcap", ".png", ".seed", "VERSION", "copyright", "format"}

# A registry's host or one machine's path ties the tree to where it was written; a mkdtemp template does not,
# nor the board's own /root/.ssh, nor its /tmp in the tests that run there.
PLACE = re.compile(
    r"(?<![\w./-])/(?:work|home|root(?!/\.ssh)|tmp(?!/[\w.-]*XXXXXX))/"
    r"|/opt/(?:wheels|pypi)"
    r"|\b(?:pypi\.org|pythonhosted\.org|(?:deb|security|snapshot|ftp)\.debian\.org)\b"
    r"|\b(?:registry\.npmjs\.org|crates\.io|docker\.io|ghcr\.io|proxy\.golang\.org)\b"
)
ON_BOARD = Path("tests/linux")


FILES = git_files(ROOT)
PAGES = [path for path in FILES if path.suffix == ".md"]
LICENSED = [path for path in FILES if path.parent != Path("LICENSES")]


@cache
def text_of(path: Path) -> str:
    return (ROOT / path).read_text(encoding="utf-8", errors="replace")


def expected_licence(path: Path) -> str:
    return next(licence for pattern, licence in LICENCES if fnmatch.fnmatch(str(path), pattern))


def declared_licence(path: Path) -> str | None:
    """From the SPDX line at the file's head, or from REUSE.toml for a file that cannot hold one."""
    head = "".join(text_of(path).splitlines(keepends=True)[:30])
    found = re.search(rf"{TAG}: \(?([\w.\- ]+?)\)?\s*(?:\*/|-->|#}}|$)", head, re.MULTILINE)
    return found[1] if found else table_licence(path)


def table_licence(path: Path) -> str | None:
    tables = tomllib.loads(text_of(Path("REUSE.toml")))["annotations"]
    licences = [table[TAG] for table in tables if TAG in table and fnmatch.fnmatch(str(path), table["path"])]
    return licences[-1] if licences else None


def test_a_tarball_has_the_files_of_its_clone(tmp_path: Path) -> None:
    """Without .git, built and run in, below another clone's folder or not."""
    for file in FILES:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).symlink_to(ROOT / file)
    (tmp_path / ".gitignore").unlink()  # which git reads from no link
    shutil.copy(ROOT / ".gitignore", tmp_path)
    for made in ("build/log/x.log", ".venv/pyvenv.cfg", "tests/__pycache__/x.pyc"):
        (tmp_path / made).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / made).touch()
    assert git_files(tmp_path) == FILES


def test_each_python_package_of_a_list_is_pinned_once() -> None:
    """scripts/python*.txt name them, requirements.txt their versions, and those of what they import."""
    pins = [
        line.partition("==")[0] for line in text_of(Path("requirements.txt")).splitlines() if "==" in line
    ]
    lists = [path for path in FILES if path.match("scripts/python*.txt")]
    named = [line for path in lists for line in text_of(path).splitlines() if not line.startswith("#")]
    assert len(lists) > 4 and len(named) == len(set(named))
    assert set(named) <= set(pins) and len(pins) == len({pin.lower() for pin in pins})


@pytest.mark.slow
def test_nothing_is_installed_that_is_not_pinned() -> None:
    pins = {line for line in text_of(Path("requirements.txt")).splitlines() if "==" in line}
    frozen = subprocess.run(
        [sys.executable, "-m", "pip", "freeze"], check=True, capture_output=True, text=True
    ).stdout
    installed = {line for line in frozen.splitlines() if "==" in line}
    assert {spelled(line) for line in installed} <= {spelled(line) for line in pins}


def spelled(pin: str) -> str:
    """As PEP 503 compares names."""
    return re.sub(r"[-_.]+", "-", pin).lower()


def test_licence_is_the_folders() -> None:
    wrong = {
        str(path): declared_licence(path)
        for path in LICENSED
        if declared_licence(path) != expected_licence(path)
    }
    assert wrong == {}


@pytest.mark.slow
def test_table_is_only_for_files_without_comments() -> None:
    in_table = [path for path in LICENSED if table_licence(path)]
    assert [path for path in in_table if (path.suffix or path.name) not in NO_COMMENT] == []


def test_every_licence_has_its_text() -> None:
    named = {name for _, licence in LICENCES for name in licence.split(" OR ")}
    assert {path.stem for path in FILES if path.parent == Path("LICENSES")} == named


def test_layout_is_the_documented_one() -> None:
    block = re.search(r"```text\n(.*?)```", text_of(Path("docs/development.md")), re.DOTALL)
    assert block is not None
    documented = {line.split("/")[0] for line in block[1].splitlines() if re.match(r"[\w.-]+/", line)}
    present = {path.parts[0] for path in FILES if len(path.parts) > 1 and not path.parts[0].startswith(".")}
    assert present == documented


@pytest.mark.slow
def test_no_place_of_one_machine() -> None:
    found = []
    for path in LICENSED:
        text = text_of(path).replace("/tmp/", "") if ON_BOARD in path.parents else text_of(path)
        if path != THIS and PLACE.search(text):  # of the whole text it is quick
            found += [f"{path}: {line.strip()}" for line in text.splitlines() if PLACE.search(line)]
    assert found == []


def test_what_is_not_there_lies_below_a_file() -> None:
    """As root, a library made the folder that was to be none. Below /dev/null not even root makes one."""
    assert [path for path in FILES if path != THIS and "/nonexistent" in text_of(path)] == []


def test_no_merge_is_half_done() -> None:
    """Conflict markers: a page that nobody builds has kept them unseen."""
    marker = re.compile(r"^(<<<<<<<|>>>>>>>) ", re.MULTILINE)
    assert [path for path in FILES if marker.search(text_of(path))] == []


# What a reader of this tree alone cannot look up: the number of an issue, a document outside the tree.
ELSEWHERE = re.compile(r"\bissue #?\d+|\b(?:seed|report) 0\d\d\b|\bshared/\w", re.IGNORECASE)
MADE_BY_A_TEST = Path("tests/house/test_changed.py")  # its pages are of a tree that it makes


@pytest.mark.slow
def test_no_reference_leads_out_of_the_tree() -> None:
    pages = {page.name for page in PAGES}
    found = []
    for path in LICENSED:
        if path in {THIS, MADE_BY_A_TEST}:
            continue
        for number, line in enumerate(text_of(path).splitlines(), 1):
            names = re.findall(r"(?<!\w)[\w-]+\.md\b", line)
            if ELSEWHERE.search(line) or set(names) - pages:
                found.append(f"{path}:{number}: {line.strip()}")
    assert found == []


# ---- the front door ------------------------------------------------------------------------------


HELP_GROUPS = ["See it", "Build", "A board", "Test", "Maintain"]


def makefiles() -> str:
    return "".join(text_of(file) for file in (Path("Makefile"), *sorted(Path("mk").glob("*.mk"))))


def targets() -> set[str]:
    return set(re.findall(r"^([a-z][a-z0-9-]*):", makefiles(), re.MULTILINE))


def test_no_two_modules_of_tests_have_one_name() -> None:
    """pytest stops at the second: `conftest.py` alone may be in several folders."""
    names = sorted(file.name for file in (ROOT / "tests").rglob("test_*.py"))
    assert [name for name, other in itertools.pairwise(names) if name == other] == []


def test_conftest_is_not_imported() -> None:
    """There are several: which one the name means depends on what pytest collected before."""
    importing = re.compile(r"^(from|import) conftest\b", re.MULTILINE)
    assert [file for file in (ROOT / "tests").rglob("*.py") if importing.search(file.read_text())] == []


def test_make_help_lists_every_target_once_by_audience() -> None:
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))
    }
    done = subprocess.run(
        ["make", "--no-print-directory"],
        cwd=ROOT,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    lines = done.stdout.splitlines()
    assert sorted(re.findall(r"^  make (\S+) +\S", done.stdout, re.MULTILINE)) == sorted(targets())
    assert [line for line in lines if line and not line.startswith("  make ")] == HELP_GROUPS
    assert [line for line in lines if len(line) > 100] == []
    assert lines[1].startswith("  make run-native ")


def test_every_target_is_phony() -> None:
    """What is named as one is no file: else nothing would be made."""
    done = subprocess.run(["make", "-pnq", "help"], cwd=ROOT, check=False, capture_output=True, text=True)
    phony = re.findall(r"^\.PHONY: (.*)$", done.stdout, re.MULTILINE)
    assert targets() <= set(" ".join(phony).split())


def test_ci_types_what_the_readme_says() -> None:
    commands = [line for line in text_of(Path(".ci/run")).splitlines() if line.startswith("make")]
    assert commands == ["make test", "make test-user"]
    assert "make test" in code_of(Path("README.md"))
    typed = re.search(r'set -- "(.*)" "(.*)"', text_of(Path("tests/run/as-user.sh")))
    assert typed and "\n".join(typed.groups()) in code_of(Path("README.md"))


# ---- pages ---------------------------------------------------------------------------------------


def code_of(page: Path) -> str:
    """Fenced blocks and inline code: where a page says what to type."""
    text = text_of(page)
    fenced = re.findall(r"^```.*?\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    return "\n".join(fenced + re.findall(r"`([^`\n]+)`", text))


def anchors(page: Path) -> set[str]:
    """Headings as GitHub names them."""
    headings = re.findall(r"^#+ (.*)$", text_of(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_commands_of_a_page_exist(page: Path) -> None:
    typed = code_of(page)
    made = " ".join(re.findall(r"^make ([a-z -]+)", typed, re.MULTILINE)).split()
    assert set(made) - targets() == set()
    programs = re.findall(r"(?<![\w/])((?:scripts|tests|\.ci)/[\w./-]+)", typed)
    assert [name for name in programs if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_links_of_a_page_resolve(page: Path) -> None:
    broken = []
    for target, anchor in re.findall(r"\]\((?!\w+:)([^)#\s]*)(?:#([^)\s]+))?\)", text_of(page)):
        linked = (ROOT / page.parent / target).resolve() if target else ROOT / page
        if not linked.exists() or (anchor and anchor not in anchors(linked.relative_to(ROOT))):
            broken.append(f"{target}#{anchor}" if anchor else target)
    assert broken == []


def test_each_trap_has_its_tests() -> None:
    """docs/traps.md names a test as `file:function`, from the folders below."""
    page = text_of(Path("docs/traps.md"))
    assert re.findall(r"^\| \*\*(\d+)\*\*", page, re.MULTILINE) == [str(number) for number in range(1, 13)]
    rows = [line for line in page.splitlines() if line.startswith("| ")][1:]
    named = [re.findall(r"`([\w/]+)\.(c|py):(\w+)`", row) for row in rows]
    assert all(named)
    definition = {
        "c": (Path("package/openrtu/src"), r"^static void {0}\(void \*\*state\)[\s\S]*\b{0}\)"),  # and is run
        "py": (Path("tests"), r"^def {0}\("),
    }
    missing = [
        f"{name}.{suffix}:{test}"
        for name, suffix, test in itertools.chain.from_iterable(named)
        for folder, pattern in [definition[suffix]]
        if not re.search(pattern.format(test), text_of(folder / f"{name}.{suffix}"), re.MULTILINE)
    ]
    assert missing == []


SOURCES = Path("package/openrtu/src")
ROOMS = [
    "ber",
    "centre",
    "channel",
    "config",
    "foreign",
    "goose",
    "gps",
    "iec104",
    "iec61850",
    "journal",
    "lib",
    "logic",
    "map",
    "modbus",
    "modules",
    "process",
    "quality",
    "rows",
    "rtuctl",
    "rtud",
    "snmp",
    "synch",
    "web",
]
ROOMS += [
    "modules/goose",
    "modules/gps",
    "modules/iec104",
    "modules/iec104m",
    "modules/iec61850",
    "modules/logic",
    "modules/modbus",
    "modules/snmp",
    "modules/synch",
    "modules/web",
]
NOT_OF_PROGRAMS = ("test_", "fuzz_", "fake_")
COMMENT_OR_STRING = re.compile(r"/\*.*?\*/|\"(?:\\.|[^\"\\\n])*\"", re.DOTALL)
# A function or a table that other files may use stands at the beginning of a line.
DEFINITION = re.compile(
    r"^(?!static|typedef|extern)[a-z_][\w *]*?\b(\w+)(?:\([^;{}]*\)\n\{|(?:\[\w*\])* = )", re.MULTILINE
)
INCLUDED = re.compile(r'^#include "(\w+)/', re.MULTILINE)
# What rtud alone puts together: these know of no other room than their own, config and the map.
OF_IEC_61850 = ["goose", "iec61850"]
ON_CHANNELS = ["iec104", "iec61850"]  # connections with or without TLS
OF_ONE_KIND = ["goose", "gps", "iec104", "iec61850", "journal", "logic", "modbus", "snmp", "synch", "web"]


def uses_of(room: Path) -> dict[str, set[str]]:
    """Of each C file of a room: the files of the room whose functions and tables it names."""
    words, defined = {}, {}
    for path in sorted(room.glob("*.c")):
        if not path.name.startswith(NOT_OF_PROGRAMS):
            text = COMMENT_OR_STRING.sub("", path.read_text())
            words[path.name] = set(re.findall(r"\w+", text))
            defined[path.name] = set(DEFINITION.findall(text))
    # What a file defines itself it does not use of another: channel: plain.c and tls.c.
    return {
        name: {other for other in words if (words[name] - defined[name]) & defined[other]} for name in words
    }


def circles(uses: dict[str, set[str]]) -> list[set[str]]:
    """The largest sets of files of which each reaches each other."""
    reached = {name: set(others) for name, others in uses.items()}
    for _ in uses:
        for others in reached.values():
            others.update(*(uses[other] for other in others))
    found = {frozenset(other for other in reached[name] if name in reached[other]) for name in uses}
    return sorted((set(circle) for circle in found if len(circle) > 1), key=sorted)


def test_c_tests_are_named_as_such() -> None:
    """`name` and `test` are parameters of macros around them."""
    entry = re.compile(r"\b(?:cmocka_unit_test\w*|TEST)\(\s*(\w+)")
    names = {name for path in FILES if path.suffix == ".c" for name in entry.findall(text_of(path))}
    assert [name for name in sorted(names - {"name", "test"}) if not name.startswith("test_")] == []


def test_circles_are_found() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set(), "e": {"a"}}) == [{"b", "c"}]


@pytest.mark.parametrize("room", ROOMS)
def test_files_of_a_room_use_each_other_in_no_circle(room: str) -> None:
    uses = uses_of(ROOT / SOURCES / room)
    assert sum(map(len, uses.values())) >= len(uses) // 3, "hardly a file uses another: are they read?"
    assert circles(uses) == [], f"{room}: put what they share into a file below them"


@pytest.mark.parametrize(
    ("room", "below"),
    [
        ("map", set()),
        ("config", {"map"}),
        ("channel", {"config", "map"}),
        ("process", {"map"}),
        *(
            (
                room,
                {"config", "map"}
                | ({"ber", "quality"} if room in OF_IEC_61850 else set())
                | ({"channel"} if room in ON_CHANNELS else set()),
            )
            for room in OF_ONE_KIND
        ),
    ],
)
def test_a_room_includes_only_itself_and_what_is_below(room: str, below: set[str]) -> None:
    files = [
        path for path in (ROOT / SOURCES / room).glob("*.[ch]") if not path.name.startswith(NOT_OF_PROGRAMS)
    ]
    included = {path.name: set(INCLUDED.findall(path.read_text())) - {room} - below for path in files}
    assert len(files) > 5
    assert {name: rooms for name, rooms in included.items() if rooms} == {}
