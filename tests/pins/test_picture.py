# SPDX-License-Identifier: GPL-3.0-or-later
"""The map of the pins: what is in the picture and the page, where, and that nothing lies on anything else."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from itertools import combinations, pairwise
from pathlib import Path
from xml.etree import ElementTree

import pytest

from nuc980.pins.board import load_board
from nuc980.pins.chip import GPIO, load_chip
from nuc980.pins.claims import claims
from nuc980.pins.page import draw_page
from nuc980.pins.picture import Use, by_pin, draw_map, uses_of_board, uses_of_claims
from nuc980.pins.rules import check
from nuc980.pins.source import read_tree

ROOT = Path(__file__).resolve().parents[2]
CHIP = load_chip()
BOARD = load_board(ROOT / "board/nuc980/boards/gateway/pins.yml", CHIP)
SD = [
    Use(pin, "sdh", signal)
    for signal, (pin, _) in ((signal, places[0]) for signal, places in CHIP.signals.items())
    if signal.startswith("SD1_")
]
# Every pin in conflict, with the longest of its names: nothing needs more room.
CROWDED = [
    Use(pin, f"/a-long-path/device{which}", signal, "a purpose that nobody would put into so many words")
    for pin, functions in CHIP.pins.items()
    for which, signal in enumerate(sorted(functions.values(), key=len)[-2:])
]
USES = {"empty": [], "board": uses_of_board(BOARD), "with-sd": uses_of_board(BOARD) + SD, "crowded": CROWDED}
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(params=CHIP.packages)
def package(request: pytest.FixtureRequest) -> str:
    return request.param


def drawn(package: str, uses: list[Use], title: str = "board") -> ElementTree.Element:
    return ElementTree.fromstring(draw_map(CHIP, CHIP.packages[package], uses, title))


def classes(element: ElementTree.Element) -> list[str]:
    return element.get("class", "").split()


def pins_of(svg: ElementTree.Element) -> list[ElementTree.Element]:
    return [group for group in svg.iter(f"{SVG}g") if "pin" in classes(group)]


def number_of(pin: ElementTree.Element) -> int:
    return next(int(text.text) for text in pin.iter(f"{SVG}text") if "number" in classes(text))


def labels_of(pin: ElementTree.Element) -> list[str]:
    return [text.text for text in pin.iter(f"{SVG}text") if "label" in classes(text)]


def place(transform: str | None) -> tuple[float, float, bool]:
    """Where a transform moves the origin, and whether it turns."""
    x, y = re.match(r"translate\((\S+) (\S+)\)", transform or "translate(0 0)").groups()
    return float(x), float(y), "rotate(-90)" in (transform or "")


# ---- pins ------------------------------------------------------------------------------------------------


def test_each_pin_of_the_package_is_there_once_and_each_port_pin_has_its_number(package: str) -> None:
    pins = pins_of(drawn(package, USES["board"]))
    assert [number_of(pin) for pin in pins] == list(range(1, CHIP.packages[package].pins + 1))
    named = {pin.get("id").removeprefix("pin-"): number_of(pin) for pin in pins if pin.get("id")}
    assert named == CHIP.packages[package].bonded
    assert all(labels_of(pin)[0] == pin.get("id").removeprefix("pin-") for pin in pins if pin.get("id"))
    assert not any(labels_of(pin) for pin in pins if not pin.get("id"))


def test_pins_go_round_anticlockwise_from_the_dot_a_quarter_on_each_side(package: str) -> None:
    svg = drawn(package, USES["board"])
    places = [place(pin.get("transform"))[:2] for pin in pins_of(svg)]
    assert len(set(places)) == len(places)

    body = next(rect for rect in svg.iter(f"{SVG}rect") if "body" in classes(rect))
    left, top, size = (float(body.get(name)) for name in ("x", "y", "width"))
    edges = [
        [x == left for x, _ in places],
        [y == top + size for _, y in places],
        [x == left + size for x, _ in places],
        [y == top for _, y in places],
    ]
    quarter = len(places) // 4
    for side, on_side in enumerate(edges):
        assert [index // quarter == side for index in range(len(places))] == on_side

    # The picture's y runs down: turning from x to -y is anticlockwise.
    angles = [math.atan2(top + size / 2 - y, x - left - size / 2) for x, y in places]
    turns = [(after - before) % math.tau for before, after in pairwise(angles)]
    assert all(0 < turn < math.pi / 4 for turn in turns)
    assert sum(turns) < math.tau

    dot = next(svg.iter(f"{SVG}circle"))
    middle = float(dot.get("cx")), float(dot.get("cy"))
    nearest = min(range(len(places)), key=lambda index: math.dist(places[index], middle))
    assert nearest in (0, len(places) - 1)
    assert abs(places[0][1] - middle[1]) < size / 10


def test_a_pin_says_what_it_is_and_has_the_colour_of_its_kind() -> None:
    pins = {pin.get("id"): pin for pin in pins_of(drawn("LQFP128", USES["board"]))}
    expected = {
        "PA0": ("uart", ["PA0", "UART1_RXD"]),
        "PF9": ("ethernet", ["PF9", "RMII1_MDC"]),
        "PC1": ("memory", ["PC1", "NAND_nCS0"]),
        "PG0": ("reserved", ["PG0", "reserved"]),
        "PA1": ("unused", ["PA1"]),
    }
    for name, (kind, labels) in expected.items():
        assert classes(pins[f"pin-{name}"]) == ["pin", kind]
        assert labels_of(pins[f"pin-{name}"]) == labels


def test_conflicts_are_marked_with_both_names_and_no_other_pin_is() -> None:
    svg = drawn("LQFP128", USES["with-sd"])
    marked = {pin.get("id"): labels_of(pin)[1] for pin in pins_of(svg) if "conflict" in classes(pin)}
    assert sorted(marked) == [f"pin-PF{index}" for index in range(7)]
    for use in SD:
        assert use.signal in marked[f"pin-{use.pin}"]
    assert "RMII1_RXERR / SD1_CMD" in marked.values()
    wrong = [text.text for text in svg.iter(f"{SVG}text") if "wrong" in classes(text)]
    assert wrong.count("PF0") == 2  # in the table, for emac1 and for sdh
    assert "PF7" not in wrong
    assert "49 of 92 port pins in use, 7 pins in conflict" in svg.find(f"{SVG}desc").text
    assert "no conflict" in drawn("LQFP128", USES["board"]).find(f"{SVG}desc").text


def test_the_same_use_twice_is_no_conflict_and_two_signals_of_one_owner_are() -> None:
    use = Use("PA0", "uart1", "UART1_RXD")
    assert by_pin([use, use]) == {"PA0": [use]}
    assert len(by_pin([use, Use("PA0", "uart1", GPIO)])["PA0"]) == 2


def test_a_used_pin_that_the_package_does_not_bring_out_is_said() -> None:
    svg = drawn("LQFP64", USES["board"])
    wrong = [text.text for text in svg.iter(f"{SVG}text") if "wrong" in classes(text)]
    lost = {use.pin for use in USES["board"]} - CHIP.packages["LQFP64"].bonded.keys()
    assert {text for text in wrong if text in CHIP.pins} == lost
    assert wrong.count("none") == len(lost)
    assert f"{len(lost)} used but not brought out" in svg.find(f"{SVG}desc").text


def test_the_table_has_every_use() -> None:
    svg = drawn("LQFP128", USES["board"])
    rows = [text.text for text in svg.iter(f"{SVG}text") if "row" in classes(text)]
    for label, device in BOARD.devices.items():
        assert device.purpose[:20] in " ".join(rows)
        for signal, pin in device.pins.items():
            at = rows.index(signal)
            number, value = BOARD.package.bonded[pin], CHIP.value(pin, signal)
            assert rows[at : at + 4] == [signal, pin, str(number), str(value)], label


# ---- layout ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Box:
    text: str
    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: Box) -> bool:
        across = self.left < other.right and other.left < self.right
        return across and self.top < other.bottom and other.top < self.bottom


def boxes(svg: ElementTree.Element) -> list[Box]:
    """All texts, as large as in DejaVu Sans: narrow letters 0.35 em, others 0.63 em, bold a tenth more."""
    style = svg.find(f"{SVG}style").text
    sizes = {
        name: float(size)
        for names, size in re.findall(r"^\s*([.\w, -]+) \{[^}]*font-size: ([\d.]+)px", style, re.MULTILINE)
        for name in names.replace(".", "").split(", ")
    }
    bold = set(re.findall(r"\.([\w-]+) \{[^}]*font-weight: bold", style))
    found = []

    def visit(element: ElementTree.Element, x: float, y: float, turned: bool) -> None:
        moved_x, moved_y, turns = place(element.get("transform"))
        x, y, turned = x + moved_x, y + moved_y, turned or turns
        if element.tag == f"{SVG}text":
            found.append(box(element, x, y, turned))
        for child in element:
            visit(child, x, y, turned)

    def box(text: ElementTree.Element, x: float, y: float, turned: bool) -> Box:
        names = classes(text)
        size = next((sizes[name] for name in names if name in sizes), sizes["text"])
        letters = sum(0.35 if letter in "fijlt:.,/ " else 0.63 for letter in text.text)
        width = letters * size * (1.1 if bold & set(names) else 1)
        along, base = float(text.get("x")), float(text.get("y"))
        start = along - {"start": 0, "middle": width / 2, "end": width}[text.get("text-anchor", "start")]
        low, high = base + 0.05 * size, base - 0.75 * size  # capitals and digits, no more
        if turned:
            return Box(text.text, x + high, y - start - width, x + low, y - start)
        return Box(text.text, x + start, y + high, x + start + width, y + low)

    visit(svg, 0, 0, False)
    return found


@pytest.mark.sample(6)
@pytest.mark.parametrize("uses", USES)
def test_no_text_lies_on_another_or_outside(package: str, uses: str) -> None:
    svg = drawn(package, USES[uses], "A board with a rather long name that somebody gave it " * 3)
    found = boxes(svg)
    assert len(found) > CHIP.packages[package].pins
    assert [(one.text, other.text) for one, other in combinations(found, 2) if one.meets(other)] == []
    _, _, width, height = map(float, svg.get("viewBox").split())
    outside = [box for box in found if min(box.left, box.top) < 0 or box.right > width or box.bottom > height]
    assert outside == []


def test_it_is_as_wide_as_can_be_read_at_1200_pixels() -> None:
    width = float(drawn("LQFP128", USES["board"]).get("viewBox").split()[2])
    assert 1200 / width * 10.5 > 9


def test_it_needs_nothing_that_rsvg_convert_lacks() -> None:
    picture = draw_map(CHIP, BOARD.package, USES["with-sd"], "board")
    assert "foreignObject" not in picture
    assert "var(" not in picture
    assert set(re.findall(r"font-family: ([^;}]+)", picture)) == {"sans-serif"}


def test_any_title_goes() -> None:
    title = '<b> & "quotes" </svg></script>'
    assert drawn("LQFP64", [], title).find(f"{SVG}title").text.startswith(title)


def test_the_figure_in_the_documentation_is_fresh() -> None:
    picture = draw_map(CHIP, BOARD.package, uses_of_board(BOARD), BOARD.name)
    assert (ROOT / "docs" / "figures" / "pins.svg").read_text(encoding="utf-8") == picture, (
        "run: scripts/nuc980-pins map -o docs/figures/pins.svg"
    )


def test_the_figure_of_a_conflict_is_fresh() -> None:
    file = ROOT / "docs" / "examples" / "sd-host-on.dts"
    uses = uses_of_claims(claims(read_tree(file, [ROOT / "dts" / "nuvoton"]), CHIP), CHIP)
    picture = draw_map(CHIP, BOARD.package, uses, file.name)
    assert (ROOT / "docs" / "figures" / "pins-conflict.svg").read_text(encoding="utf-8") == picture, (
        "run: scripts/nuc980-pins map -I dts/nuvoton "
        "docs/examples/sd-host-on.dts -o docs/figures/pins-conflict.svg"
    )


# ---- uses of a device tree -------------------------------------------------------------------------------

TREE = """
/dts-v1/;
/ {
    #address-cells = <1>; #size-cells = <1>;
    apb {
        compatible = "simple-bus"; #address-cells = <1>; #size-cells = <1>; ranges;
        pinctrl@b0000000 {
            compatible = "nuvoton,nuc980-pinctrl"; reg = <0xb0000000 0x200>;
            f {
                sd: sdh { nuvoton,pins = <5 0 2 0  5 1 2 0>; };
                mac: emac1 { nuvoton,pins = <5 0 1 0>; };
                i2c: i2c0 { nuvoton,pins = <0 0 3 0  0 1 3 0>; };
                freed: i2c0-gpio { nuvoton,pins = <0 0 0 0  0 1 0 0>; };
                led: leds { nuvoton,pins = <1 0 0 0>; };
                odd: odd { nuvoton,pins = <5 11 9 0>; };
            };
        };
        gpio: gpio@b0004000 {
            compatible = "nuvoton,nuc980-gpio"; reg = <0xb0004000 0x1000>; gpio-controller; #gpio-cells = <2>;
        };
        i2c0@b0080000 {
            compatible = "nuvoton,nuc980-i2c0"; reg = <0xb0080000 0x1000>;
            pinctrl-names = "default", "gpio"; pinctrl-0 = <&i2c>; pinctrl-1 = <&freed>;
            scl-gpios = <&gpio 1 0>;
        };
        serial@b0070000 {
            compatible = "nuvoton,nuc980-uart"; reg = <0xb0070000 0x1000>;
            pinctrl-names = "default"; pinctrl-0 = <&odd>;
        };
    };
    ahb {
        compatible = "simple-bus"; #address-cells = <1>; #size-cells = <1>; ranges;
        sdh@b0018000 {
            compatible = "nuvoton,nuc980-sdh"; reg = <0xb0018000 0x1000>;
            pinctrl-names = "default"; pinctrl-0 = <&sd>;
        };
        emac1@b0022000 {
            compatible = "nuvoton,nuc980-emac1"; reg = <0xb0022000 0x1000>;
            pinctrl-names = "default"; pinctrl-0 = <&mac>;
        };
    };
    leds {
        compatible = "gpio-leds"; pinctrl-names = "default"; pinctrl-0 = <&led>;
        run: run { gpios = <&gpio 32 0>; };
        fail { gpios = <&gpio 129 0>; };
    };
};
"""


def test_uses_of_a_device_tree(tmp_path: Path) -> None:
    file = tmp_path / "board.dts"
    file.write_text(TREE)
    pins = by_pin(uses_of_claims(claims(read_tree(file), CHIP), CHIP))
    assert pins == {
        "PF0": [Use("PF0", "sdh", "SD1_CMD", "group sdh"), Use("PF0", "emac1", "RMII1_RXERR", "group emac1")],
        "PF1": [Use("PF1", "sdh", "SD1_CLK", "group sdh")],
        # The bus takes turns with itself: its state "gpio" and scl-gpios free a bus that hangs.
        "PA0": [Use("PA0", "i2c0", "I2C0_SDA", "group i2c0")],
        "PA1": [Use("PA1", "i2c0", "I2C0_SCL", "group i2c0")],
        "PF11": [Use("PF11", "uart0", "function 9", "group odd")],
        # A group that makes a pin the GPIO that a LED then uses is no second use.
        "PB0": [Use("PB0", "run", GPIO, "gpios")],
        "PE1": [Use("PE1", "/leds/fail", GPIO, "gpios")],
    }


def test_the_picture_and_the_check_see_the_same_conflicts(tmp_path: Path) -> None:
    file = tmp_path / "board.dts"
    # PE2 is a line of two, PF1 a line of a LED besides sdh's clock.
    file.write_text(
        TREE + "&run { gpios = <&gpio 161 0>, <&gpio 130 0>; }; &{/leds/fail} { gpios = <&gpio 130 0>; };"
    )
    tree = read_tree(file)
    pins = by_pin(uses_of_claims(claims(tree, CHIP), CHIP))
    conflicts = {"pin-conflict", "mux-and-gpio", "gpio-conflict"}
    found = {pin for one in check(tree, CHIP, None, None) if one.rule in conflicts for pin in one.pins}
    assert {pin for pin, its in pins.items() if len(its) > 1} == found == {"PF0", "PF1", "PE2"}


# ---- page ------------------------------------------------------------------------------------------------


def data_of(page: str) -> list[dict]:
    return json.loads(
        re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1]
    )


def test_the_pages_data_are_the_chips(package: str) -> None:
    pins = data_of(draw_page(CHIP, CHIP.packages[package], USES["with-sd"], "board"))
    assert {
        pin["pin"]: {int(value): signal for value, signal in pin["functions"].items()} for pin in pins
    } == CHIP.pins
    assert {pin["pin"]: pin["number"] for pin in pins if pin["number"]} == CHIP.packages[package].bonded
    assert {pin["pin"]: (int(pin["register"], 16), pin["shift"]) for pin in pins} == {
        name: CHIP.register_of(name) for name in CHIP.pins
    }
    uses = [
        Use(pin["pin"], use["owner"], use["signal"], use["purpose"]) for pin in pins for use in pin["uses"]
    ]
    assert set(uses) == set(USES["with-sd"])


def test_a_used_pin_that_does_not_exist_is_in_the_page() -> None:
    [pin] = [
        pin
        for pin in data_of(draw_page(CHIP, BOARD.package, [Use("PB14", "spi1", "function 4")], "board"))
        if pin["pin"] == "PB14"
    ]
    assert pin["functions"] == {}
    assert pin["number"] is None
    assert pin["uses"][0]["owner"] == "spi1"


def test_the_page_needs_no_other_file() -> None:
    page = draw_page(CHIP, BOARD.package, USES["board"], "board")
    assert set(re.findall(r"https?://[^\"' ]+", page)) == {"http://www.w3.org/2000/svg"}
    assert not re.search(r"<link|<img|\bsrc=|@import|url\(", page)


def test_text_from_a_table_cannot_end_the_pages_script() -> None:
    uses = [Use("PA0", "uart1", "UART1_RXD", "</script><script>alert(1)</script>")]
    page = draw_page(CHIP, BOARD.package, uses, "</title><script>alert(2)</script>")
    assert page.count("<script") == 2
    assert page.count("</script>") == 2
    assert data_of(page)[0]["uses"][0]["purpose"] == uses[0].purpose
