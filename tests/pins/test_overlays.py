# SPDX-License-Identifier: GPL-3.0-or-later
"""Overlays: put on a base as fdtoverlay does it, checked alone and together, refused if they do not fit."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from program import DONE, FOUND, UNUSABLE, run, write
from trees import CHIP, content, gateway, soc

from nuc980.errors import UnusableInput
from nuc980.pins.dtb import read_dtb
from nuc980.pins.overlays import applied, check_overlays
from nuc980.pins.rules import check
from nuc980.pins.source import read_any, read_source
from nuc980.pins.tree import Tree

PLUGIN = "/dts-v1/;\n/plugin/;\n"
CLOCK = """
&i2c1 { status = "okay"; pinctrl-names = "default"; pinctrl-0 = <&clock_pins>;
    rtc: rtc@51 { compatible = "nxp,pcf8563"; reg = <0x51>;
        interrupt-parent = <&gpio>; interrupts = <139 2>; }; };
&pinctrl { i2c1 { clock_pins: i2c1-pins { nuvoton,pins = <1 4 2 0>, <1 6 2 0>; }; }; };
&{/} { leds { compatible = "gpio-leds"; a { gpios = <&gpio 138 0>; }; }; };
"""
TYPED = 'target = <&uart1>; __overlay__ { status = "disabled"; };'
KEY = """
&{/} { keys-front { compatible = "gpio-keys"; stop { gpios = <&gpio 139 1>; linux,code = <28>; }; }; };
"""
SD_CARD = """
&pinctrl { sdh { sd: sdh-pins { nuvoton,pins =
    <5 6 2 0>, <5 0 2 0>, <5 1 2 0>, <5 2 2 0>, <5 3 2 0>, <5 4 2 0>, <5 5 2 0>; }; }; };
&sdh { pinctrl-names = "default"; pinctrl-0 = <&sd>; status = "okay"; };
"""


def compiled(folder: Path, name: str, source: str) -> Path:
    """With labels for overlays."""
    dtb = folder / name
    subprocess.run(["dtc", "-q", "-@", "-O", "dtb", "-o", dtb, "-"], input=source.encode(), check=True)
    return dtb


@pytest.fixture
def base(tmp_path: Path) -> Path:
    (tmp_path / "soc.dtsi").write_text(soc())
    return compiled(tmp_path, "base.dtb", gateway().replace('#include "soc.dtsi"', soc()))


def overlay(folder: Path, name: str, text: str) -> Path:
    return compiled(folder, name, PLUGIN + text)


def findings(base: Tree, *overlays: Tree) -> list[list[str]]:
    return [[one.rule for one in checked.findings]
            for checked in check_overlays(base, overlays, lambda tree: check(tree, CHIP))]  # fmt: skip


@pytest.mark.parametrize("texts", [(CLOCK,), (KEY,), (CLOCK, "&rtc { wakeup-source; };", KEY)], ids=str)
def test_they_become_what_fdtoverlay_makes_of_them(
    base: Path, tmp_path: Path, texts: tuple[str, ...]
) -> None:
    files = [overlay(tmp_path, f"{number}.dtbo", text) for number, text in enumerate(texts)]
    subprocess.run(["fdtoverlay", "-i", base, "-o", tmp_path / "judge.dtb", *files], check=True)
    tree = read_dtb(base)
    for file in files:
        tree = applied(tree, read_dtb(file))
    assert content(tree.root) == content(read_dtb(tmp_path / "judge.dtb").root)


def test_each_has_its_own_findings_and_the_base_stays_as_it_was(base: Path, tmp_path: Path) -> None:
    tree = read_dtb(base)
    before = content(tree.root)
    card, key = (read_any(overlay(tmp_path, *one)) for one in (("card.dtbo", SD_CARD), ("key.dtbo", KEY)))
    assert findings(tree, card, key) == [[], ["pin-conflict"], []]
    assert content(tree.root) == before


def test_what_only_their_sum_does_wrong_names_the_others(base: Path, tmp_path: Path) -> None:
    clock, key = overlay(tmp_path, "clock.dtbo", CLOCK), overlay(tmp_path, "key.dtbo", KEY)
    done = run("check", "--chip-only", "--overlay", base, clock, key)
    assert done.returncode == FOUND
    [line] = [line for line in done.stdout.splitlines() if ": gpio-conflict: " in line]
    assert line.startswith(f"{key}: ")
    assert line.endswith(f"(together with {clock})")
    assert f"{clock}: no findings" in done.stdout


def test_an_overlay_that_needs_an_earlier_one_is_checked_behind_it(base: Path, tmp_path: Path) -> None:
    labelled = KEY.replace("keys-front {", "front: keys-front {")
    front = overlay(tmp_path, "front.dtbo", labelled)
    more = overlay(tmp_path, "more.dtbo", "&front { go { gpios = <&gpio 139 1>; linux,code = <29>; }; };")
    done = run("check", "--chip-only", "--overlay", base, front, more)
    assert done.returncode == FOUND
    [line] = [line for line in done.stdout.splitlines() if ": gpio-conflict: " in line]
    assert line.startswith(f"{more}: ") and line.endswith(f"(together with {front})")
    assert f"{more} (behind {front}): 1 finding" in done.stdout
    done = run("check", "--chip-only", "--overlay", base, more, front)
    assert (done.returncode, "has no such label" in done.stderr) == (UNUSABLE, True)


@pytest.mark.parametrize("path", ["", "apb", "serial9", "nosuch/x"])
def test_a_target_path_is_whole_or_begins_with_an_alias(base: Path, tmp_path: Path, path: str) -> None:
    fragment = f'fragment@0 {{ target-path = "{path}"; __overlay__ {{ a; }}; }};'
    done = run("check", "--overlay", base, overlay(tmp_path, "x.dtbo", f"/ {{ {fragment} }};"))
    assert (done.returncode, "the target-path of fragment@0" in done.stderr) == (UNUSABLE, True)


def test_a_target_path_of_an_alias(base: Path, tmp_path: Path) -> None:
    subprocess.run(["fdtput", "-p", "-t", "s", base, "/aliases", "port", "/apb/serial@b0071000"], check=True)
    fragment = 'fragment@0 { target-path = "port"; __overlay__ { mark; }; };'
    tree = applied(read_dtb(base), read_dtb(overlay(tmp_path, "x.dtbo", f"/ {{ {fragment} }};")))
    port = tree.find("/apb/serial@b0071000")
    assert port and "mark" in port.properties


def test_a_finding_knows_the_line_of_an_overlays_source(tmp_path: Path) -> None:
    source = tmp_path / "card.dtso"
    source.write_text(PLUGIN + SD_CARD)
    done = run("check", "--chip-only", "--overlay", write(tmp_path / "board.dts", ""), source)
    assert done.returncode == FOUND
    assert f"{source}:6: pin-conflict: " in done.stdout


def test_good_overlay(tmp_path: Path, base: Path) -> None:
    done = run("check", "--chip-only", "--overlay", base, overlay(tmp_path, "key.dtbo", KEY))
    assert (done.returncode, done.stderr) == (DONE, "")


def without_notes(folder: Path, name: str, source: str) -> Path:
    dtb = folder / name
    subprocess.run(["dtc", "-q", "-O", "dtb", "-o", dtb, "-"], input=source.encode(), check=True)
    return dtb


def raw(text: str) -> str:
    return f"/dts-v1/;\n/ {{ {text} }};\n"


@pytest.mark.parametrize(
    ("source", "says"),
    [
        (PLUGIN + '&i2c11 { status = "okay"; };', "i2c11, but {base} has no such label; did you mean i2c1"),
        (
            PLUGIN + '&{/apb/none} { status = "okay"; };',
            "the target-path of fragment@0, /apb/none, is not in {base}",
        ),
        (
            PLUGIN + "/ { fragment@0 { target = <&uart1>; }; };",
            "fragment@0 has no __overlay__ node; write what",
        ),
        (raw("fragment@0 { __overlay__ { }; };"), "fragment@0 has no target; give it target = <&LABEL>"),
        (
            raw("fragment@0 { target = <0xffffffff>; __overlay__ { }; };"),
            "handle 0xffffffff, which nothing has",
        ),
        (raw('model = "x";'), "is no overlay: it has no fragment; write /plugin/; behind /dts-v1/;"),
        (
            raw("fragment@0 { target = <0>; __overlay__ { }; };")
            + raw('__fixups__ { uart1 = "/fragment@0:target:2"; };').removeprefix("/dts-v1/;"),
            "a reference that is not there (/fragment@0: target, 2); compile it again: dtc -@",
        ),
        (
            raw('fragment@0 { target = <0>; __overlay__ { }; }; __fixups__ { uart1 = "x"; };'),
            "which is no place",
        ),
    ],
)
def test_wrong_overlay_is_refused_with_what_to_do(base: Path, tmp_path: Path, source: str, says: str) -> None:
    file = without_notes(tmp_path, "x.dtbo", source)
    done = run("check", "--overlay", base, file)
    assert (done.returncode, done.stdout) == (UNUSABLE, "")
    assert says.format(base=base) in done.stderr
    assert str(file) in done.stderr


def test_base_without_labels_is_refused(base: Path, tmp_path: Path) -> None:
    subprocess.run(["dtc", "-q", "-I", "dtb", "-O", "dtb", "-o", tmp_path / "n.dtb", base], check=True)
    subprocess.run(["fdtput", "-r", tmp_path / "n.dtb", "/__symbols__"], check=True)
    done = run("check", "--overlay", tmp_path / "n.dtb", overlay(tmp_path, "x.dtbo", KEY))
    assert done.returncode == UNUSABLE
    assert "has no labels (no __symbols__); compile" in done.stderr
    assert "again with dtc -@" in done.stderr


def test_overlay_without_labels_needs_none_in_the_base(tmp_path: Path, base: Path) -> None:
    subprocess.run(["fdtput", "-r", base, "/__symbols__"], check=True)
    by_path = overlay(tmp_path, "x.dtbo", '&{/apb/serial@b0071000} { status = "disabled"; };')
    assert findings(read_dtb(base), read_dtb(by_path)) == [[], []]


@pytest.mark.parametrize("length", [0, 30, 200, -1])
def test_overlay_that_is_cut_off(base: Path, tmp_path: Path, length: int) -> None:
    file = overlay(tmp_path, "x.dtbo", CLOCK)
    file.write_bytes(file.read_bytes()[:length])
    done = run("check", "--overlay", base, file)
    assert (done.returncode, done.stdout) == (UNUSABLE, "")
    assert str(file) in done.stderr
    assert "Traceback" not in done.stderr


def test_an_overlay_is_no_base_and_a_base_alone_no_sum(base: Path, tmp_path: Path) -> None:
    file = overlay(tmp_path, "x.dtbo", KEY)
    assert f"check --overlay BASE {file}" in run("check", file).stderr
    assert "is the base; name the overlays behind it" in run("check", "--overlay", base).stderr


def test_a_label_of_an_overlay_leaves_the_bases_handle(base: Path, tmp_path: Path) -> None:
    """Old fdtoverlays overwrite it: then who refers to the node of the base refers to nothing."""
    mine = "fragment@0 { target = <&gpio>; mine: __overlay__ { lamp { gpios = <&mine 139 0>; }; }; };"
    tree = applied(read_dtb(base), read_dtb(overlay(tmp_path, "x.dtbo", f"/ {{ {mine} }};")))
    gpio = read_dtb(base).find("/apb/gpio@b0004000")
    lamp = tree.find("/apb/gpio@b0004000/lamp")
    assert gpio and lamp
    assert tree.by_phandle[gpio.cells("phandle")[0]].name == "gpio@b0004000"
    assert lamp.cells("gpios")[0] == gpio.cells("phandle")[0]


def test_source_of_a_base_has_its_labels(tmp_path: Path) -> None:
    file = write(tmp_path / "board.dts", "")
    with pytest.raises(UnusableInput, match="is no overlay"):
        applied(read_source(file), read_source(file))
