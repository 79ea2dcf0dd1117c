# SPDX-License-Identifier: GPL-3.0-or-later
"""check --fix: what has one right answer is mended in its line; everything else keeps its bytes."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from mutations_boot import BOOT
from program import DONE, FOUND, SD_HOST_ON, UNUSABLE, compiled, run, write

from rig.rights import SUPERUSER, needed

I2C = "&pinctrl { i2c1 { i2c1_pins: i2c1-pins { nuvoton,pins = <1 4 2 0>, <1 6 2 0>; }; }; };\n"
BUS = """&i2c1 {
    status = "okay"; /* slow */
    pinctrl-names = "default"; pinctrl-0 = <&i2c1_pins>;
    bus_freq = <100>;
};
"""
CHIP_ONLY = ("--chip-only",)

# What is written; what it becomes.
MENDED = {
    "a letter too few": ('&uart1 { pinctl-names = "default"; };', '&uart1 { pinctrl-names = "default"; };'),
    "a flag": ("&spare { read-onyl; };", "&spare { read-only; };"),
    "a value in kHz": (I2C + BUS, I2C + BUS.replace("<100>", "<100000>")),
    "status in other words": ('&uart5 {\n\tstatus = "Disabled";\n};', '&uart5 {\n\tstatus = "disabled";\n};'),
    "number of another port": ("&uart4 {\n  port-number = <3>;\n};", "&uart4 {\n  port-number = <4>;\n};"),
    "trigger": ("&uart4 { interrupts = <39 1 1>; };", "&uart4 { interrupts = <39 4 1>; };"),
    "interrupt of another": (
        "&emac1 { interrupts = <20 4 1>, <22 4 1>; };",
        "&emac1 { interrupts = <22 4 1>, <20 4 1>; };",
    ),
}  # fmt: skip
WITH_TABLE = {
    "device of the table off": ('&uart6 { status = "disabled"; };', '&uart6 { status = "okay"; };'),
    "table of bad blocks": ("&fmi {\n\tnand-on-flash-bbt;\n};", "&fmi {\n};"),
    "pins of the table": (
        "&pinctrl_uart1 { nuvoton,pins = <0 0 4 0>, <2 6 7 0>; };",
        "&pinctrl_uart1 { nuvoton,pins = <0 0 4 0>, <5 10 2 0>; };",
    ),
}


def mend(folder: Path, more: str, *words: str) -> tuple[int, str, str]:
    file = write(folder / "board.dts", more)
    before = file.read_bytes()
    shown = run("check", "--fix", *words, file)
    assert file.read_bytes() == before, "written without --write"
    done = run("check", "--fix", "--write", *words, file)
    return done.returncode, file.read_text(), shown.stdout


@pytest.mark.sample(4)
@pytest.mark.parametrize(("wrong", "right"), MENDED.values(), ids=MENDED)
def test_one_right_answer_is_shown_and_written(tmp_path: Path, wrong: str, right: str) -> None:
    code, text, shown = mend(tmp_path, BOOT + wrong, *CHIP_ONLY)
    assert text.endswith(f"{right}\n") or right in text
    assert wrong not in text
    assert code == DONE
    assert all(f"+{line}" in shown for line in set(right.splitlines()) - set(wrong.splitlines()))


@pytest.mark.slow
@pytest.mark.parametrize(("wrong", "right"), WITH_TABLE.values(), ids=WITH_TABLE)
def test_what_the_pin_table_knows(tmp_path: Path, wrong: str, right: str) -> None:
    code, text, _ = mend(tmp_path, BOOT + wrong)
    assert (code, wrong in text, right in text) == (DONE, False, True)


@pytest.mark.slow
def test_a_statement_that_is_missing_comes_into_its_node(tmp_path: Path) -> None:
    code, text, _ = mend(tmp_path, BOOT.replace(' device_type = "memory";', ""))
    assert code == DONE
    assert 'memory@0 { device_type = "memory"; reg' in text
    file = tmp_path / "board.dts"
    file.write_text(file.read_text().replace('{ device_type = "memory"; reg', "{\r\n        reg"))
    assert run("check", "--fix", "--write", file).returncode == DONE
    assert b'memory@0 {\r\n        device_type = "memory";\r\n        reg' in file.read_bytes()


def test_read_only_comes_into_a_partition_over_several_lines(tmp_path: Path) -> None:
    boot = '\t\tboot@0 {\n\t\t\tlabel = "u-boot";\n\t\t\treg = <0 0x100000>;\n\t\t};\n'
    code, text, _ = mend(tmp_path, f"&fmi {{\n\tpartitions {{\n{boot}\t}};\n}};\n")
    assert "boot@0 {\n\t\t\tread-only;\n\t\t\tlabel" in text, code


def test_a_memory_of_another_type_is_not_given_two(tmp_path: Path) -> None:
    code, text, _ = mend(tmp_path, BOOT.replace('device_type = "memory"', 'device_type = "ram"'))
    assert (code, text.count("device_type"), 'device_type = "memory"' in text) == (DONE, 1, True)


def test_a_file_that_nobody_may_write_stays(tmp_path: Path) -> None:
    file = write(tmp_path / "board.dts", '&uart5 { status = "disable"; };\n')
    file.chmod(0o444)
    before = file.read_bytes()
    done = run("check", "--chip-only", "--fix", "--write", file)
    assert (done.returncode, "is read-only; make it writable" in done.stderr) == (UNUSABLE, True)
    assert file.read_bytes() == before


def test_a_file_with_two_names_keeps_both_and_its_owner(tmp_path: Path) -> None:
    file = write(tmp_path / "board.dts", '&uart5 { status = "disable"; };\n')
    (tmp_path / "other.dts").hardlink_to(file)
    assert run("check", "--chip-only", "--fix", "--write", file).returncode == DONE
    assert file.samefile(tmp_path / "other.dts")
    assert '"disabled"' in file.read_text()


@needed(SUPERUSER, "only root gives files away")
def test_a_file_of_another_stays_his(tmp_path: Path) -> None:
    file = write(tmp_path / "board.dts", '&uart5 { status = "disable"; };\n')
    os.chown(file, 65534, 65534)
    assert run("check", "--chip-only", "--fix", "--write", file).returncode == DONE
    assert (file.stat().st_uid, file.stat().st_gid) == (65534, 65534)


def test_patch_takes_the_diff_of_a_file_with_crlf(tmp_path: Path) -> None:
    file = write(tmp_path / "board.dts", '&uart5 { status = "disable"; };\n')
    file.write_bytes(file.read_bytes().replace(b"\n", b"\r\n"))
    shown = run("check", "--chip-only", "--fix", file).stdout
    patch = shown[: shown.index(f"\n{file}:") + 1]
    subprocess.run(["patch", "--binary", file], input=patch.encode(), check=True, capture_output=True)
    assert b'"disabled"; };\r\n' in file.read_bytes()


NOT_MENDED = {
    "several answers": SD_HOST_ON,
    "a macro": "#define SLOW bus_freq = <100>;\n" + I2C + BUS.replace("bus_freq = <100>;", "SLOW"),
    "over two lines": I2C + BUS.replace("<100>", "\n\t\t<100>"),
    "the right one is there": "&fmi { nand-ecc-strenght = <4>; };",
    "twice in a line": "&uart5 { status = \"enabled\"; }; &uart7 { status = \"enabled\"; };",
}  # fmt: skip


@pytest.mark.parametrize("more", NOT_MENDED.values(), ids=NOT_MENDED)
def test_what_has_no_one_answer_keeps_its_bytes(tmp_path: Path, more: str) -> None:
    file = write(tmp_path / "board.dts", more)
    before = file.read_bytes()
    done = run("check", "--chip-only", "--fix", "--write", file)
    assert (done.returncode, file.read_bytes()) == (FOUND, before)
    assert "@@" not in done.stdout


def test_an_answer_that_brings_another_finding_is_not_taken(tmp_path: Path) -> None:
    """UART7 without pins is what somebody gets who writes its status right."""
    file = write(tmp_path / "board.dts", '&uart7 {\n\tstatus = "enabled";\n};\n')
    before = file.read_bytes()
    assert run("check", "--chip-only", "--fix", "--write", file).returncode == FOUND
    assert file.read_bytes() == before


def test_an_included_file_stays(tmp_path: Path) -> None:
    file = write(tmp_path / "board.dts", "")
    (tmp_path / "more.dtsi").write_text('&uart5 { status = "disable"; };\n')
    file.write_text(file.read_text() + '#include "more.dtsi"\n')
    assert run("check", "--fix", "--write", file).returncode == FOUND
    assert (tmp_path / "more.dtsi").read_text() == '&uart5 { status = "disable"; };\n'


def test_bytes_of_other_lines_and_a_link_stay(tmp_path: Path) -> None:
    file = write(tmp_path / "board.dts", "")
    file.write_bytes(file.read_bytes() + b'/* caf\xe9 */\r\n&uart5 { status = "disable"; };\r\n')
    file.chmod(0o640)
    link = tmp_path / "link.dts"
    link.symlink_to(file)
    before = file.read_bytes()
    assert run("check", "--chip-only", "--fix", "--write", link).returncode == DONE
    assert file.read_bytes() == before.replace(b'"disable"', b'"disabled"')
    assert (link.is_symlink(), file.stat().st_mode & 0o777) == (True, 0o640)
    assert [one.name for one in tmp_path.iterdir() if one.name.startswith(".")] == []


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--write",), "--write goes with --fix"),
        (("--fix", "--overlay"), "without --overlay"),
        (("--fix", "--format", "json"), "without --format"),
    ],
)
def test_options_that_do_not_go_together(tmp_path: Path, words: tuple[str, ...], says: str) -> None:
    done = run("check", *words, write(tmp_path / "board.dts", ""))
    assert (done.returncode, says in done.stderr) == (UNUSABLE, True)


def test_a_compiled_tree_is_not_mended(tmp_path: Path) -> None:
    dtb = compiled(write(tmp_path / "board.dts", ""))
    done = run("check", "--fix", dtb)
    assert done.returncode == UNUSABLE
    assert "is compiled: --fix changes sources; name the .dts" in done.stderr
