# SPDX-License-Identifier: GPL-3.0-or-later
"""What `make test-changed` chooses, and that what the tests read and import is in its table."""

import ast
import doctest
import subprocess
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
from test_tree import FILES, targets

import areas
import changed
from areas import ALL, AREAS, REACH, ROOT, TARGETS, TREE, area_of, parts, reach

TESTS = [str(path) for path in FILES if area_of(str(path))]
NAMES = {str(path) for path in FILES}


def targets_of(path: str) -> set[str]:
    """Each target of which the change runs something."""
    return set(parts([path]))


def test_each_file_reaches_something_that_is_there() -> None:
    assert set(ALL.split()) <= targets()
    possible = {*ALL.split(), *TESTS}
    assert [path for path in FILES if not {"lint", TREE} <= reach(str(path)) <= possible] == []


def test_no_pattern_is_left_over() -> None:
    used = {
        next((pattern for pattern, _ in REACH if fnmatchcase(str(path), pattern)), None) for path in FILES
    }
    assert [pattern for pattern, _ in REACH if pattern not in used] == []


def test_each_test_is_in_an_area_with_a_target() -> None:
    assert {area_of(test) for test in TESTS} == set(AREAS)
    assert set(TARGETS.values()) <= targets()


@pytest.mark.parametrize(
    ("path", "reached", "not_reached"),
    [
        (
            "package/openrtu/src/iec104/session.c",
            {"unit", "test-station", "fuzzers"},
            {"test-pins", "test-twin"},
        ),
        ("package/openrtu/src/modbus/period.c", {"asan", "test-lines", "test-linux"}, {"test-netboot"}),
        ("scripts/nuc980/pins/rules/flash.py", {"test-pins"}, {"test-station", "unit"}),
        ("scripts/nuc980/netboot/tftp.py", {"test-netboot"}, {"test-lines", "test-pins"}),
        ("board/nuc980/qemu/hw/arm/nuc980.c", {"test-twin", "test-netboot", "test-linux"}, {"test-station"}),
        ("tests/pins/test_cli.py", {"lint", "test-pins"}, {"test-image"}),
        ("tests/rig/capture.py", {"test-station", "test-linux"}, {"test-pins"}),
        ("tests/rig/packaged.py", {"test-packages", "test-centre"}, {"test-station"}),
        ("README.md", {"lint", "test-house", "test-modules"}, {"test-station"}),
        ("Makefile", set(ALL.split()), set()),
        ("a/new/place", set(ALL.split()), set()),
    ],
)
def test_change_reaches_its_area(path: str, reached: set[str], not_reached: set[str]) -> None:
    assert reached <= targets_of(path)
    assert not not_reached & targets_of(path)


def test_file_of_tests_reaches_itself_alone() -> None:
    assert parts(["tests/pins/test_picture.py"])["test-pins"] == {
        "tests/pins/test_picture.py": ["tests/pins/test_picture.py"]
    }


def test_whole_area_includes_its_files() -> None:
    both = parts(["tests/pins/test_cli.py", "scripts/nuc980/pins/cli.py"])
    assert both["test-pins"] == {"": ["scripts/nuc980/pins/cli.py"]}


# ---- what tests read and import


def named(tree: ast.AST) -> Iterator[str]:
    """The files that a file's words name: imported, or in a text."""
    for node in ast.walk(tree):
        modules = []
        if isinstance(node, ast.Import):
            modules = [name.name for name in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            modules = [node.module, *(f"{node.module}.{name.name}" for name in node.names)]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        for module in modules:
            for folder in ("scripts", "tests"):
                yield f"{folder}/{module.replace('.', '/')}.py"


# make test-debug-kernel and test-offline, which no change chooses
BY_ITS_TARGET = ("tests/linux/test_debug_kernel.py", "tests/linux/test_image_offline.py")


@pytest.mark.slow
def test_what_a_test_names_reaches_it() -> None:
    missing = [
        f"{test}: {name}"
        for test in TESTS
        if test not in (TREE, "tests/house/test_changed.py", *BY_ITS_TARGET)
        for name in NAMES.intersection(named(ast.parse((ROOT / test).read_text())))
        if not {test, TARGETS[area_of(test)]} & reach(name)
    ]
    assert missing == []


# ---- git, and what is run


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository of two commits with a Makefile that notes what it is asked for; test-pins fails."""
    monkeypatch.setattr(changed, "ROOT", tmp_path)
    (tmp_path / "Makefile").write_text(
        "FILES :=\n%:\n\t@echo '$@ $(FILES)' >> $(CURDIR)/../ran\n\t@test $@ != test-pins\n"
    )
    (tmp_path / "README.md").write_text("A page that is long enough for git to see that it was renamed.\n")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "--quiet", "-m", "one")
    git(tmp_path, "commit", "--quiet", "--allow-empty", "-m", "two")
    return tmp_path


def git(folder: Path, *words: str) -> None:
    author = ["-c", "user.name=x", "-c", "user.email=x@example.org", "-c", "commit.gpgsign=false"]
    subprocess.run(["git", *author, *words], cwd=folder, check=True, capture_output=True)


def put(file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("new\n")


def ran(tree: Path) -> list[str]:
    return [line.strip() for line in (tree.parent / "ran").read_text().splitlines()]


def test_nothing_changed_runs_nothing(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert changed.main([]) == 0
    assert "nothing differs from HEAD~" in capsys.readouterr().out
    assert not (tree.parent / "ran").exists()


def test_changed_are_committed_and_new_and_renamed_files(tree: Path) -> None:
    put(tree / "docs/committed.md")
    git(tree, "add", ".")
    git(tree, "commit", "--quiet", "-m", "three")
    git(tree, "mv", "README.md", "docs/moved.md")
    put(tree / "docs/new and strange.md")
    assert changed.changed("HEAD~") == [
        "README.md", "docs/committed.md", "docs/moved.md", "docs/new and strange.md",
    ]  # fmt: skip


@pytest.mark.slow
def test_all_parts_run_and_the_failed_are_named(tree: Path, capfd: pytest.CaptureFixture[str]) -> None:
    put(tree / "scripts/nuc980/pins/rules/flash.py")
    put(tree / "docs/new.md")
    assert changed.main(["HEAD"]) == 1
    captured = capfd.readouterr()
    assert "\ntest-pins: scripts/nuc980/pins/rules/flash.py changed\n" in captured.out
    assert f"\n{TREE}: docs/new.md, scripts/nuc980/pins/rules/flash.py changed\n" in captured.out
    assert "failed: test-pins" in captured.err
    assert ran(tree) == [
        "lint",
        f"test-house tests/house/test_pages.py {TREE} tests/house/test_docs_commands.py",
        "test-linux",
        "test-netboot",
        "test-pins",
        "test-twin",
    ]


def test_unknown_base_is_said(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert changed.main(["nowhere"]) == 2
    assert "git knows no commit 'nowhere': choose another with BASE=" in capsys.readouterr().err


def test_areas_example() -> None:
    assert doctest.testmod(areas).failed == 0
