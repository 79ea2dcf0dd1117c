# SPDX-License-Identifier: GPL-3.0-or-later
"""nuc980-pins as a user types it: what it prints where, and its exit codes."""

import json
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from program import DONE, FOUND, SD_HOST_ON, UNUSABLE, compiled, run, write
from trees import ROOT

from nuc980.pins.rules import RULES

PROGRAM = ROOT / "scripts" / "nuc980-pins"


@pytest.fixture
def good(tmp_path: Path) -> Path:
    return write(tmp_path / "good.dts", "")


@pytest.fixture
def bad(tmp_path: Path) -> Path:
    return write(tmp_path / "bad.dts", SD_HOST_ON)


def test_good_tree(good: Path) -> None:
    done = run("check", good, compiled(good))
    assert (done.returncode, done.stderr) == (DONE, "")
    assert done.stdout.splitlines() == [f"{good}: no findings", f"{good.with_suffix('.dtb')}: no findings"]


def test_finding_names_a_line_that_an_editor_can_follow(bad: Path) -> None:
    done = run("check", "--chip-only", "bad.dts", cwd=bad.parent)
    assert done.returncode == FOUND
    file, line, rule = done.stdout.splitlines()[0].split(":")[:3]
    assert rule == " pin-conflict"
    assert "sdh" in (bad.parent / file).read_text().splitlines()[int(line) - 1]


def test_findings_in_a_dtb_name_the_node(bad: Path) -> None:
    done = run("check", compiled(bad))
    assert done.returncode == FOUND
    assert f"{bad.with_suffix('.dtb')}: /ahb/sdh@b0018000: pin-conflict: " in done.stdout


def test_chip_only_leaves_the_pin_table_out(bad: Path) -> None:
    rules = {
        words: [finding["rule"] for file in json.loads(done.stdout)["files"] for finding in file["findings"]]
        for words in ((), ("--chip-only",))
        if (done := run("check", "--format", "json", *words, bad))
    }
    assert rules[("--chip-only",)] == ["pin-conflict"]
    assert set(rules[()]) > {"pin-conflict"}


@pytest.mark.parametrize("form", ["json", "sarif"])
def test_machine_forms_are_json_also_beside_an_unusable_file(bad: Path, form: str) -> None:
    done = run("check", "--format", form, bad, "none.dts")
    assert done.returncode == UNUSABLE
    assert "none.dts: No such file or directory" in done.stderr
    assert "pin-conflict" in json.dumps(json.loads(done.stdout))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("check", "none.dts"), "none.dts: No such file or directory"),
        (("check", "--table", "none.yml", "x.dts"), "none.yml: No such file or directory"),
        (("check", "--part", "NUC980DK61YC", "x.dts"), "--part goes with --chip-only"),
        (
            ("check", "--chip-only", "--part", "NUC970", "x.dts"),
            "--part NUC970: known parts are NUC980DR61YC",
        ),
        (("map", "-o", "map.pdf"), "map.pdf: the name must end in .svg or .html"),
        (("map", "-o", "none/map.svg"), "none/map.svg: No such file or directory; name another file"),
        (("explain", "UART8_TDX"), "UART8_TXD"),
        (("diff", "none.dtb", "none.dtb"), "none.dtb: No such file or directory"),
        (("import", "none.dtb"), "none.dtb: No such file or directory"),
        (("import", "--part", "NUC970", "none.dtb"), "--part NUC970: known parts are"),
        ((), "usage: nuc980-pins"),
        (("paint",), "usage: nuc980-pins"),
    ],
)
def test_unusable_input_is_told_and_no_traceback(
    tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    done = run(*words, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (UNUSABLE, "")
    assert message in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_map_draws_picture_and_page(tmp_path: Path, bad: Path) -> None:
    for name in ("table.svg", "table.html"):
        assert run("map", "-o", name, cwd=tmp_path).returncode == DONE
    assert run("map", bad, "-o", tmp_path / "bad.svg").returncode == DONE
    assert "<svg" in (tmp_path / "table.svg").read_text()
    assert (tmp_path / "table.html").read_text().rstrip().endswith("</html>")
    assert "in conflict" in (tmp_path / "bad.svg").read_text()


def test_github_has_nothing_to_say_of_a_good_tree(good: Path) -> None:
    done = run("check", "--format", "github", good)
    assert (done.returncode, done.stdout) == (DONE, "")


def test_ending_of_a_map_may_be_in_capitals(tmp_path: Path) -> None:
    assert run("map", "-o", "MAP.SVG", cwd=tmp_path).returncode == DONE
    assert (tmp_path / "MAP.SVG").is_file()


def without_line_numbers(text: str) -> str:
    return re.sub(r":\d+(?=[:)])", "", text)


@pytest.mark.parametrize("command", ["explain", "check"])
def test_documentation_shows_what_is_printed(command: str) -> None:
    page = (ROOT / "docs" / "device-tree.md").read_text()
    [(words, shown)] = re.findall(rf"\$ scripts/nuc980-pins ({command} .*)\n((?:.*\n)*?)```", page)
    assert without_line_numbers(run(*shlex.split(words)).stdout) == without_line_numbers(shown)


def test_documentation_has_every_rule() -> None:
    page = (ROOT / "docs" / "device-tree.md").read_text()
    assert re.findall(r"^\| `([a-z-]+)` \|", page, re.MULTILINE) == list(RULES)


def test_explain_takes_several_words() -> None:
    done = run("explain", "PA0", "<4 7 1 0>")
    assert done.returncode == DONE
    assert "UART1_RXD" in done.stdout
    assert "PE7 as RMII0_TXD0" in done.stdout


def test_diff(good: Path, bad: Path) -> None:
    same, different = run("diff", good, good), run("diff", good, bad)
    assert (same.returncode, same.stdout) == (DONE, "")
    assert different.returncode == FOUND
    assert {line.split()[0] for line in different.stdout.splitlines()} == {f"PF{pin}" for pin in range(7)}


@pytest.mark.slow
def test_imported_table_checks_its_tree(tmp_path: Path, good: Path) -> None:
    table = tmp_path / "mine.yml"
    assert run("import", good, "-o", table).returncode == DONE
    assert run("check", "--table", table, good).returncode == DONE
    again = run("import", good, "-o", table)
    assert again.returncode == UNUSABLE
    assert "exists already and is not overwritten" in again.stderr


@pytest.mark.slow
def test_accepted_finding_comes_with_its_reason(tmp_path: Path, good: Path, bad: Path) -> None:
    table = tmp_path / "mine.yml"
    run("import", good, "-o", table)
    found = json.loads(run("check", "--table", table, "--format", "json", bad).stdout)["files"][0]["findings"]
    entries = [{"rule": one["rule"], "node": one["node"], "reason": "on the bench only"} for one in found]
    text = table.read_text().replace("accepted: []", f"accepted: {json.dumps(entries)}")
    table.write_text(text)
    done = run("check", "--table", table, bad)
    assert done.returncode == DONE
    assert "pin-conflict: accepted: on the bench only" in done.stdout
    assert f"no findings, {len(entries)} accepted" in done.stdout


@pytest.mark.slow
def test_works_from_any_folder_and_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "pins").symlink_to(PROGRAM)
    done = subprocess.run([tmp_path / "pins", "explain", "PA0"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == DONE


def test_without_its_packages_it_says_what_to_type(tmp_path: Path) -> None:
    (tmp_path / "scripts").mkdir()
    shutil.copy(PROGRAM, tmp_path / "scripts")
    environment = {**os.environ, "LC_ALL": "C"}
    done = subprocess.run(
        [tmp_path / "scripts" / "nuc980-pins", "check"], env=environment, capture_output=True, text=True
    )
    assert done.returncode == UNUSABLE
    assert f"make -C {tmp_path} tools" in done.stderr


def test_a_reader_that_has_seen_enough(good: Path) -> None:
    done = subprocess.run(
        f"{shlex.quote(str(PROGRAM))} explain PA0 PA1 PA2 | head -1",
        shell=True,
        capture_output=True,
        text=True,
    )
    assert (done.stderr, len(done.stdout.splitlines())) == ("", 1)


def test_what_a_tree_says_commands_no_terminal(tmp_path: Path) -> None:
    more = r'/ { chosen { bootargs = "a\x1b]0;pwn\x07 consle=\x1b[31m"; }; };' + "\n"
    done = run("check", "--chip-only", write(tmp_path / "board.dts", more))
    assert "consle" in done.stdout
    assert not {"\x1b", "\x07"} & {*done.stdout}
