# SPDX-License-Identifier: GPL-3.0-or-later
"""Sources: the values that dtc makes, the lines a person wrote, and what is said when it does not compile."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from trees import ROOT

from nuc980.errors import UnusableInput
from nuc980.pins.dtb import read_dtb
from nuc980.pins.source import MISSING_PHANDLE, read_source, read_tree
from nuc980.pins.tree import Node, Place, Tree

CHIP = """\
#include <bank.h>
/ {
    apb {
        group: group-PA {
            pins =
                <BANK 0 4 0
                 BANK 1 4 0>;
        };
        uart1: serial1: serial@b0071000 {
            reg = <0xb0071000 0x1000>;
            status = "disabled";
        };
    };
};
"""
BOARD = """\
/dts-v1/;
#include "chip.dtsi"

/ {
    model = "a /* b */ { };";
};

&uart1 {
    pinctrl-0 = <&group>;
    status = "okay";
};

&uart1 {
    status = "okay";
};
"""


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], Path]:
    monkeypatch.chdir(tmp_path)

    def written(name: str, text: str) -> Path:
        file = Path(name)
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
        return file

    return written


@pytest.fixture
def board(write: Callable[[str, str], Path]) -> Path:
    write("include/bank.h", "#define BANK 0\n")
    write("dts/chip.dtsi", CHIP)
    return write("dts/board.dts", BOARD)


def content(tree: Tree) -> list[tuple[str, list[tuple[str, bytes]]]]:
    return [(n.path, [(p.name, p.raw) for p in n.properties.values()]) for n in tree.root.walk()]


def node(tree: Tree, path: str) -> Node:
    found = tree.find(path)
    assert found is not None
    return found


def refusal(file: Path, *arguments: list[Path]) -> str:
    with pytest.raises(UnusableInput) as raised:
        read_tree(file, *arguments)
    message = str(raised.value)
    assert message.startswith(str(file))
    return message


def test_values_are_those_of_the_dtb(board: Path, tmp_path: Path) -> None:
    preprocessed = subprocess.run(
        ["cpp", "-nostdinc", "-undef", "-x", "assembler-with-cpp", "-Iinclude", board],
        capture_output=True,
        check=True,
    ).stdout
    dtb = tmp_path / "board.dtb"
    subprocess.run(["dtc", "-q", "-O", "dtb", "-o", dtb, "-"], input=preprocessed, check=True)
    assert content(read_tree(board, [Path("include")])) == content(read_dtb(dtb))


def test_places_of_merged_nodes_and_of_properties(board: Path) -> None:
    uart = node(read_tree(board, [Path("include")]), "/apb/serial@b0071000")
    assert uart.places == (
        Place("dts/chip.dtsi", 9),
        Place("dts/board.dts", 8),
        Place("dts/board.dts", 13),
    )
    assert uart.place_of("reg") == Place("dts/chip.dtsi", 10)
    assert uart.place_of("pinctrl-0") == Place("dts/board.dts", 9)
    assert uart.place_of("status") == Place("dts/board.dts", 14)


def test_property_of_several_lines_begins_at_its_first(board: Path) -> None:
    group = node(read_tree(board, [Path("include")]), "/apb/group-PA")
    assert group.place_of("pins") == Place("dts/chip.dtsi", 5)
    assert group.cells("pins") == [0, 0, 4, 0, 0, 1, 4, 0]
    assert group.place_of("phandle") is None, "dtc made it"


def test_strings_that_look_like_source_have_their_place(write: Callable[[str, str], Path]) -> None:
    awkward = r'a = "/* x.dts:7:1-2 */", "y {\n"; b* = "};"; c = l: <1 m: 2>;'
    tree = read_tree(write("x.dts", "/dts-v1/;\n/ {\n" + awkward.replace("; ", ";\n") + "\nn { }; };\n"))
    assert [str(p.place) for p in tree.root.properties.values()] == ["x.dts:3", "x.dts:4", "x.dts:5"]
    assert node(tree, "/n").places == (Place("x.dts", 6),)


def test_labels(board: Path) -> None:
    tree = read_tree(board, [Path("include")])
    assert tree.from_source
    assert set(node(tree, "/apb/serial@b0071000").labels) == {"uart1", "serial1"}
    assert tree.root.labels == ()
    assert tree.find("/__symbols__") is None


def test_absolute_name_below_this_folder_is_told_relative_to_it(board: Path, tmp_path: Path) -> None:
    tree = read_tree(tmp_path / board, [tmp_path / "include"])
    assert node(tree, "/apb/serial@b0071000").places[1] == Place("dts/board.dts", 8)


def test_absolute_name_elsewhere_is_kept(
    board: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path / "include")
    tree = read_tree(tmp_path / board, [Path()])
    assert tree.root.places[-1] == Place(str(tmp_path / "dts" / "board.dts"), 4)


def test_dtc_s_own_include_and_macros(write: Callable[[str, str], Path]) -> None:
    write("more/part.dtsi", "/ { part; };\n")
    file = write("x.dts", '/dts-v1/;\n/include/ "part.dtsi"\n/ { value = <VALUE>; };\n')
    tree = read_source(file, [Path("more")], ["VALUE=7"])
    assert tree.root.cells("value") == [7]
    assert tree.root.place_of("part") == Place("more/part.dtsi", 1)


def test_the_first_bytes_tell_what_a_file_is(write: Callable[[str, str], Path]) -> None:
    source = write("named.dtb", '/dts-v1/;\n/ { model = "m"; };\n')
    subprocess.run(["dtc", "-q", "-I", "dts", "-O", "dtb", "-o", "named.dts", source], check=True)
    assert read_tree(source).from_source
    compiled = read_tree(Path("named.dts"))
    assert not compiled.from_source and compiled.root.strings("model") == ["m"]


def test_missing_include_names_its_line_and_the_option(board: Path) -> None:
    message = refusal(board)
    assert "dts/chip.dtsi:1:10: fatal error: bank.h: No such file" in message
    assert "-I FOLDER" in message


@pytest.mark.parametrize(
    ("line", "expected_text"),
    [
        ("/ { model = ; };", "x.dts:2.13-14 syntax error"),
        ("&nowhere { };", "x.dts:2.10-14 Label or path nowhere not found"),
        ("/ { a { }; a { }; };", "ERROR (duplicate_node_names): /a: Duplicate node name"),
        ("/ { gpios = <&nowhere 1 0>; };", 'non-existent node or label "nowhere"'),
        ("/ { path = &nowhere; };", "nowhere"),
        ("/ { l: a { }; l: b { }; };", "Duplicate label 'l'"),
        ("\x7fELF\x01", "syntax error"),
        ("#error not yet", "not yet"),
    ],
)
def test_what_does_not_compile(line: str, expected_text: str, write: Callable[[str, str], Path]) -> None:
    file = write("x.dts", f"/dts-v1/;\n{line}\n")
    message = refusal(file)
    assert expected_text in message and "correct the first of these lines" in message


def test_group_that_is_missing_is_left_to_the_check(write: Callable[[str, str], Path]) -> None:
    file = write("x.dts", "/dts-v1/;\n/ { u: serial {\n pinctrl-0 = <&g>, <&nowhere>; };\n g: g { }; };\n")
    serial = node(read_tree(file), "/serial")
    assert serial.cells("pinctrl-0")[1] == MISSING_PHANDLE
    assert serial.place_of("pinctrl-0") == Place("x.dts", 3)
    file.write_text(file.read_text() + "/ { keys { gpios = <&gone 1 1>; }; };\n")
    assert '"gone"' in refusal(file)


def test_overlays_are_refused(write: Callable[[str, str], Path]) -> None:
    file = write("x.dts", '/dts-v1/;\n/plugin/;\n&uart1 { status = "okay"; };\n')
    assert "overlay" in refusal(file)
    subprocess.run(["dtc", "-q", "-@", "-O", "dtb", "-o", "x.dtbo", file], check=True)
    assert "overlay" in refusal(Path("x.dtbo"))


def test_name_that_looks_like_an_option(write: Callable[[str, str], Path]) -> None:
    assert read_tree(write("-E.dts", "/dts-v1/;\n/ { };\n")).root.places == (Place("-E.dts", 2),)


def test_missing_file_and_folder(tmp_path: Path) -> None:
    for file in (tmp_path / "missing.dts", tmp_path):
        assert "name a device tree that can be read" in refusal(file)


def test_missing_compiler(board: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UnusableInput, match="cpp is missing; install cpp"):
        read_tree(board)
    (tmp_path / "cpp").write_text("#!/bin/sh\n")
    (tmp_path / "cpp").chmod(0o755)
    with pytest.raises(UnusableInput, match="dtc is missing; install device-tree-compiler"):
        read_tree(board)


def test_include_without_end(write: Callable[[str, str], Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nuc980.pins.source.PATIENCE", 0.2)
    file = write("x.dts", '/dts-v1/;\n#include "pipe"\n')
    os.mkfifo("pipe")
    assert "cpp did not end within 0.2 s; check the #include lines of the file" in refusal(file)


@pytest.mark.slow
def test_a_mistake_before_much_else_is_told(write: Callable[[str, str], Path]) -> None:
    file = write("x.dts", "/dts-v1/;\n/ { = };\n" + "/ { node { }; };\n" * 20000)
    done = subprocess.run(
        [ROOT / "scripts" / "nuc980-pins", "check", "--chip-only", file], capture_output=True, text=True
    )
    assert (done.returncode, "x.dts:2" in done.stderr) == (2, True)


def test_a_pipe_is_refused_before_it_is_opened(write: Callable[[str, str], Path]) -> None:
    os.mkfifo("x.dts")
    assert "is not a regular file" in refusal(Path("x.dts"))


@pytest.mark.slow
def test_memory_has_an_end(write: Callable[[str, str], Path]) -> None:
    file = write("x.dts", '/dts-v1/;\n#include "/dev/zero"\n')
    assert "cpp says\n  cc1: out of memory" in refusal(file).replace("  \n", "")


def test_what_is_quoted_does_not_reach_the_terminal(write: Callable[[str, str], Path]) -> None:
    told = refusal(write("x.dts", '#error "\x1b[31mboo"\n'))
    assert "boo" in told and "\x1b" not in told


@pytest.mark.parametrize("odd", ["\u00a0", "\u0085", "\u2028"])
def test_a_byte_that_ends_dtcs_reading_is_refused(write: Callable[[str, str], Path], odd: str) -> None:
    file = write(
        "x.dts",
        f'/dts-v1/;\n/ {{ }};\n#define A "é" /* é */\n{odd}\n/ {{ x = <\'"\'>; model = "ü", A; }}; // é\n',
    )
    told = refusal(file)
    assert f"x.dts:4 has U+{ord(odd):04X}, outside comments and strings" in told
    file.write_text(file.read_text().replace(odd, ""))
    assert read_tree(file).root.strings("model") == ["ü", "é"]


def test_such_a_byte_in_an_included_file(write: Callable[[str, str], Path]) -> None:
    more = write("more.dtsi", "/* é */\n\u00a0\n/ { };\n")
    for include in ("#include", "/include/"):
        file = write("x.dts", f'/dts-v1/;\n/ {{ }};\n{include} "{more}"\n')
        assert f"{more}:2 has U+00A0, outside" in refusal(file)
    for byte, said in ((b"\xff", "byte 0xff"), (b"\0", "U+0000")):
        more.write_bytes(byte)
        assert f"{more}:1 has {said}, outside" in refusal(file)


def test_a_missing_group_leaves_the_paths_of_others(write: Callable[[str, str], Path]) -> None:
    aliases = (
        "/ { aliases { serial0 = &port; }; port: port { pinctrl-0 = <&none>; pinctrl-1 = <&port>; }; };\n"
    )
    file = write("x.dts", f"/dts-v1/;\n{aliases}")
    tree = read_tree(file, symbols=True)
    port, names = tree.find("/port"), tree.find("/aliases")
    assert port and names
    assert names.strings("serial0") == ["/port"]
    assert port.cells("pinctrl-0") == [MISSING_PHANDLE]
    assert port.cells("pinctrl-1") == port.cells("phandle")
    assert [node.name for node in tree.root] == ["aliases", "port", "__symbols__"]
    assert [*tree.root.children[-1].properties] == ["port"]
    file.write_text(file.read_text() + "/ { chosen { stdout-path = &gone; }; };\n")
    assert "gone" in refusal(file)


def test_a_missing_group_by_its_path(write: Callable[[str, str], Path]) -> None:
    port = read_tree(write("x.dts", "/dts-v1/;\n/ { port { pinctrl-0 = <&{/none}>; }; };\n")).find("/port")
    assert port and port.cells("pinctrl-0") == [MISSING_PHANDLE]
