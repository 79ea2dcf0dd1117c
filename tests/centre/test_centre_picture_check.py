# SPDX-License-Identifier: GPL-3.0-or-later
"""A process picture is read: what is bound, what is wrong and where, what is refused."""

import doctest
import json
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from hostile_pictures import HOSTILE, ODD, PLAIN, SVG
from lab.centre_show import PICTURES, PLANTS
from lab.process import named
from lab.show import configuration
from openrtu_tools.centre import drawing
from openrtu_tools.centre.bindings import ATTRIBUTES, COLOURS, FIELDS, QUALITIES, BindingError, read_binding
from openrtu_tools.centre.drawing import DEPTH_MOST, ELEMENTS_MOST, OCTETS_MOST, Drawing, read_drawing
from openrtu_tools.cli import main

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "process-pictures.md").read_text()
BOUND_JS, CODES_JS = (
    (ROOT / "centre" / "page" / "js" / name).read_text() for name in ("bound.js", "codes.js")
)
# What Inkscape 1.2 writes around a shape: its own elements and attributes, styles with properties of its own.
INKSCAPE = """<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<svg width="210mm" height="148mm" viewBox="0 0 210 148" version="1.1" id="svg5"
   inkscape:version="1.2.2 (b0a8486541, 2022-12-01)" sodipodi:docname="bay.svg"
   xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"
   xmlns:sodipodi="http://sodipodi.sourceforge.net/DTD/sodipodi-0.dtd"
   xmlns="http://www.w3.org/2000/svg" xmlns:svg="http://www.w3.org/2000/svg">
  <sodipodi:namedview id="namedview7" pagecolor="#ffffff">
    <inkscape:grid type="xygrid" id="grid1"/>
  </sodipodi:namedview>
  <defs id="defs2">
    <linearGradient id="shine"><stop offset="0" style="stop-color:#fff;stop-opacity:1"/></linearGradient>
  </defs>
  <g inkscape:label="Layer 1" inkscape:groupmode="layer" id="layer1">
    <rect id="tank" data-point="plant/level" data-level="0: 0; 4: 1" width="20" height="40" x="10" y="10"
       style="fill:url(#shine);stroke:#000000;-inkscape-stroke:none;paint-order:stroke fill markers" />
    <text xml:space="preserve" x="10" y="60" id="text9" data-point="plant/level" data-text="{value:2} {unit}"
       style="font-size:5px;line-height:1.25;-inkscape-font-specification:'sans-serif, Normal'"
       ><tspan sodipodi:role="line" x="10" y="60">1.50 m</tspan></text>
  </g>
</svg>
"""


def read(body: str) -> Drawing:
    return read_drawing(f"{PLAIN}{body}</svg>".encode())


def mistakes(body: str) -> list[str]:
    return [mistake.text for mistake in read(body).mistakes]


def octets(picture: str | bytes) -> bytes:
    return picture if isinstance(picture, bytes) else picture.encode()


# ---- what is taken -------------------------------------------------------------------------------


def test_a_drawing_of_inkscape_is_taken_without_what_is_its_own() -> None:
    drawing = read_drawing(INKSCAPE.encode())
    assert drawing.mistakes == []
    assert not re.search("inkscape|sodipodi|namedview| style=", drawing.markup)
    assert "fill:url(#p-shine);stroke:#000000;paint-order:stroke fill markers" in drawing.markup
    assert [binding["point"] for binding in drawing.bound] == ["plant/level"] * 2
    assert drawing.bound[0]["level"] == [[0, 0], [4, 1]]
    ElementTree.fromstring(drawing.markup)


def test_a_part_of_a_group_is_of_the_groups_point() -> None:
    drawing = read(
        '<g data-point="plant/pump"><rect data-fill="1: #0a0"/><g><path data-visible="1, invalid"/></g></g>'
        '<g data-picture="other"><text>more</text></g>'
    )
    assert [binding["owner"] for binding in drawing.bound] == [0, 0, 0, None]
    assert drawing.bound[2]["visible"] == [[1, 1], "invalid"]


def test_rules_keep_what_is_drawn_and_name_its_own_ids() -> None:
    drawing = read(
        "<style>/* x */ .bar, #a > path { stroke: #123; position: fixed; fill: none !important }</style>"
    )
    assert drawing.css == ".bar,#p-a > path{stroke:#123;fill:none}"
    assert drawing.mistakes == []


@pytest.mark.parametrize("name", ODD)
def test_what_only_looks_like_markup_stays_text(name: str) -> None:
    drawing = read_drawing(octets(ODD[name]))
    assert drawing.mistakes == []
    for element in ElementTree.fromstring(drawing.markup).iter():
        assert element.tag.startswith("{http://www.w3.org/2000/svg}")
        assert not [key for key in element.keys() if key.startswith("on") or "href" in key]  # noqa: SIM118


# ---- what is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", HOSTILE)
def test_an_attack_is_refused_and_nothing_of_it_is_served(name: str) -> None:
    drawing = read_drawing(octets(HOSTILE[name]))
    assert drawing.is_refused
    assert (drawing.markup, drawing.css, drawing.bound) == ("", "", [])


@pytest.mark.parametrize(
    "picture",
    [
        PLAIN + "<g/>" * ELEMENTS_MOST + "</svg>",
        PLAIN + "<g>" * DEPTH_MOST + "</g>" * DEPTH_MOST + "</svg>",
        PLAIN + " " * OCTETS_MOST + "</svg>",
        "",
        "<html/>",
        "<svg viewBox='0 0 1 1'/>",
        '<svg xmlns="http://www.w3.org/2000/svg"/>',
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 -1 nan"/>',
        "\0\xff",
    ],
)
def test_what_is_too_large_or_no_picture_is_refused(picture: str) -> None:
    assert read_drawing(picture.encode("latin-1")).is_refused


LONG = 200_000


@pytest.mark.parametrize(
    "picture",
    [
        f"{PLAIN}<style>{'a' * LONG}</style></svg>",
        f"{PLAIN}<style>{'/*' * LONG}</style></svg>",
        f"{PLAIN}<style>{'a ' * LONG}!{{fill:red}}</style></svg>",
        f'{PLAIN}<rect fill="{"a-" * LONG}"/></svg>',
        f'<svg {SVG} width="1{" " * LONG}x" height="1"/>',
    ],
    ids=["no rule", "comments", "selector", "function", "length"],
)
def test_a_long_text_takes_no_longer_than_it_is(picture: str) -> None:
    """The square of its length took minutes."""
    read = read_drawing(picture.encode())
    assert read.is_refused == ("fill" not in picture or "!" in picture)


def test_doctests() -> None:
    assert doctest.testmod(drawing).failed == 0


# ---- what is wrong -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "wrong"),
    [
        ('<rect data-colour="1: #fff"/>', "data-colour is none of"),
        ('<rect data-fill="1: #fff"/>', "it has no data-point"),
        ('<rect data-point="level"/>', "'level' is not STATION/POINT"),
        ('<rect data-point="a/b" data-fill="1: reddish"/>', "'reddish' is no colour"),
        ('<rect data-point="a/b" data-fill="one: #fff"/>', "'one' is no value"),
        ('<rect data-point="a/b" data-fill="9..1: #fff"/>', "9..1 ends before it begins"),
        ('<rect data-point="a/b" data-visible="else"/>', "else says nothing here"),
        ('<rect data-point="a/b" data-text="{value}"/>', "data-text and data-words are for <text>"),
        ('<text data-point="a/b" data-text="{vaule}"/>', "{vaule} is none of"),
        ('<rect data-point="a/b" data-level="0: 0; 4: 2"/>', "a level is from 0"),
        ('<rect data-point="a/b" data-rotate="0: 0"/>', "this takes two values or more"),
        ('<rect data-point="a/b" data-rotate="4: 0; 0: 90"/>', "this takes two values or more"),
        ('<rect data-point="a/b" data-move="0: 0; 1: 9"/>', "not a value and 2 numbers"),
        ('<rect data-point="a/b" data-pivot="middle"/>', "this takes two numbers"),
        ('<filter id="a"><feGaussianBlur stdDeviation="3"/></filter>', "<filter> is left out"),
        ('<rect data-command=""/>', "data-command without a name"),
        ('<defs><rect data-point="a/b"/></defs>', "<rect> is not drawn here by itself"),
    ],
)
def test_a_wrong_attribute_is_named_with_its_line(body: str, wrong: str) -> None:
    found = read(f"\n\n{body}")
    assert [mistake.line for mistake in found.mistakes] == [3]
    assert wrong in found.mistakes[0].text
    assert not found.is_refused


def test_conditions() -> None:
    cases = "1: #fff; 2..5: good; ..0: none; 80..: bad; lost: muted; else: text"
    assert read_binding("data-fill", cases) == [
        [[1, 1], "#fff"],
        [[2, 5], "good"],
        [[None, 0], "none"],
        [[80, None], "bad"],
        ["lost", "muted"],
        [None, "text"],
    ]
    with pytest.raises(BindingError):
        read_binding("data-fill", "..: #fff")


# ---- one fact, one place -------------------------------------------------------------------------


def test_the_page_of_the_documentation_has_each_attribute_and_word() -> None:
    listed = re.findall(r"^\| `(data-[a-z]+)` \|", PAGE, re.MULTILINE)
    assert listed == list(ATTRIBUTES)
    for word in (*QUALITIES, *COLOURS, *(f"{{{each}}}" for each in FIELDS)):
        assert f"`{word}`" in PAGE, word


def test_the_browser_shows_each_attribute() -> None:
    shown = set(re.findall(r"^  (\w+): \(one", BOUND_JS, re.MULTILINE))
    whom = {"data-point", "data-pivot", "data-command", "data-picture"}
    assert {f"data-{name}" for name in shown} == ATTRIBUTES.keys() - whom
    bits = re.search(r"QUALITY = {(.*?)}", CODES_JS, re.DOTALL)
    assert bits
    words = {name.lower().replace("_", "-") for name in re.findall(r"(\w+):", bits[1])}
    assert set(QUALITIES) == words | {"lost", "never", "good"}
    for word in ("lost", "never", "good"):
        assert f'"{word}"' in BOUND_JS


# ---- the command ---------------------------------------------------------------------------------

POINTS = """ca,ioa,type,command_type,name
1,2,M_SP_NA_1,C_SC_NA_1,pump
1,4,M_ME_NC_1,,level
1,5,M_ME_NC_1,,twin
1,6,M_ME_NC_1,,twin
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "points.csv").write_text(POINTS)
    stations = [
        {"name": "plant", "address": "127.0.0.1", "common_addresses": [1], "points": "points.csv"},
        {"name": "bare/one", "address": "127.0.0.1", "common_addresses": [7]},
    ]
    (tmp_path / "centre.json").write_text(json.dumps({"stations": stations}))
    return tmp_path


def check(folder: Path, *files: str, **environment: str) -> tuple[int, str, str]:
    done = subprocess.run(
        [sys.executable, "-m", "openrtu_tools", "centre", "centre.json", "check", *files],
        cwd=folder,
        env={"PYTHONPATH": str(ROOT / "scripts"), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.slow
def test_check_knows_the_points_of_the_stations(folder: Path) -> None:
    names = ("plant/level", "plant/1.2", "plant/1.5", "bare/one/7.30001")
    body = "".join(f'<g data-point="{name}"/>' for name in names)
    (folder / "good.svg").write_text(f'{PLAIN}{body}<g data-command="plant/pump"/></svg>')
    assert check(folder, "good.svg") == (0, "", "")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("attribute", "wrong"),
    [
        ('data-point="plant/lavel"', "plant has no point lavel"),
        ('data-point="plant/1.9"', "plant has no point 1.9"),
        ('data-point="plent/level"', "there is no station for plent/level"),
        ('data-point="bare/one/8.30001"', "bare/one has no point 8.30001"),
        ('data-point="plant/twin"', "plant/twin is there 2 times: name it by its address, CA.IOA"),
        ('data-command="plant/level"', "plant/level takes no commands"),
        ('data-picture="elsewhere"', "there is no picture elsewhere beside it"),
        ('data-command="bare/one/7.1"', "bare/one/7.1 takes no commands: bare/one has no list of points"),
    ],
)
def test_check_names_what_is_no_point(folder: Path, attribute: str, wrong: str) -> None:
    (folder / "bad.svg").write_text(f"{PLAIN}\n<g {attribute}/></svg>")
    assert check(folder, "bad.svg") == (1, f"bad.svg:2: {wrong}\n", "")


@pytest.mark.slow
def test_check_says_that_an_attack_is_not_shown(folder: Path) -> None:
    (folder / "evil.svg").write_bytes(octets(HOSTILE["script"]))
    assert check(folder, "evil.svg") == (
        1,
        "evil.svg:1: <script> is not taken: a picture runs nothing\nevil.svg: it is not shown\n",
        "",
    )


@pytest.mark.slow
def test_check_takes_the_folder_of_the_file(folder: Path) -> None:
    assert check(folder)[0] == 2
    (folder / "pictures").mkdir()
    assert check(folder) == (0, "", "")
    (folder / "pictures" / "a.svg").write_text(f'{PLAIN}<g data-point="plant/none"/></svg>')
    assert check(folder)[:2] == (1, f"{folder}/pictures/a.svg:1: plant has no point none\n")


@pytest.mark.slow
def test_the_examples_are_bound_to_points_of_the_show(programs: Path, tmp_path: Path) -> None:
    (tmp_path / "gateway.json").write_text(json.dumps(named(configuration())))
    keys = {"address": "127.0.0.1", "common_addresses": [1], "points": "gateway.json"}
    content = {"stations": [{"name": name, **keys} for name in PLANTS], "centre": {"pictures": f"{PICTURES}"}}
    (tmp_path / "centre.json").write_text(json.dumps(content))
    assert check(tmp_path, OPENRTU_RTUD=f"{programs / 'rtud' / 'rtud'}") == (0, "", "")


@pytest.mark.parametrize("words", [["check", "good.svg"], ["check"], ["serve"]])
def test_who_begins_with_the_command_is_told_that_the_file_comes_first(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["centre", *words])
    assert ended.value.code == 2
    assert f"the centre's file comes first: openrtu centre FILE {words[0]} ..." in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("text", [None, "{", '{"stations": 1}'])
def test_a_centres_file_that_cannot_be_used_is_named(folder: Path, text: str | None) -> None:
    file = folder / "centre.json"
    file.unlink() if text is None else file.write_text(text)
    code, out, error = check(folder)
    assert (code, out) == (2, "")
    assert error.startswith("openrtu centre: centre.json: ")
    assert "Traceback" not in error
    assert "Errno" not in error


@pytest.mark.slow
@pytest.mark.parametrize("word", ["missing.svg", "."])
def test_what_cannot_be_read_is_unusable(folder: Path, word: str) -> None:
    code, out, error = check(folder, word)
    assert (code, out) == (2, "")
    assert error.startswith(f"openrtu centre: {word}: ")
