# SPDX-License-Identifier: GPL-3.0-or-later
"""The map of the pins as a picture: the package from above, who has which pin, and the table beside."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from xml.sax.saxutils import escape

from nuc980.pins.board import Board
from nuc980.pins.chip import GPIO, Chip, Package, pin_order
from nuc980.pins.claims import Claim
from nuc980.pins.rules.identity import identify

RESERVED = "reserved"
NOT_CONNECTED = "not connected"
CONFLICT, UNUSED, NO_PORT = "conflict", "unused", "no-port"

# Okabe and Ito's palette, which colour-blind people can tell apart. A conflict is also bold and boxed.
FAMILIES = {
    "uart": ("UART", "#0072b2"),
    "ethernet": ("Ethernet", "#e69f00"),
    "memory": ("NAND, SD card", "#009e73"),
    "bus": ("SPI, I²C, CAN", "#56b4e9"),
    "gpio": ("GPIO", "#f0e442"),
    "other": ("other function", "#cc79a7"),
    "reserved": ("reserved, not connected", "#7b8794"),
    UNUSED: ("unused port pin", "#ffffff"),
    NO_PORT: ("no port pin", "#cbd2d9"),
    CONFLICT: ("in conflict", "#d1001f"),
}
FAMILY_OF_PREFIX = {
    "UART": "uart",
    "RMII": "ethernet",
    "NAND_": "memory",
    "SD0_": "memory",
    "SD1_": "memory",
    "QSPI": "bus",
    "SPI": "bus",
    "I2C": "bus",
    "CAN": "bus",
    GPIO: "gpio",
    RESERVED: "reserved",
    NOT_CONNECTED: "reserved",
}

# Lengths in units of the picture, which has some 1300 in its width.
MARGIN = 24
TITLE = 52
PITCH = 17  # from pin to pin
SMALLEST_BODY = 480  # the legend has its place in it
CORNER = 30  # from the body's corner to its first pin: the owners' bars of two sides do not meet
PAD = 22
PAD_WIDTH = 11
GAP = 6
NAME = 40  # column of "PG15" in bold
SUPPLY_SIZE = 8.5  # px: letters of .supply
NUMBERS = 30  # column of package pin numbers inside the body
LEGEND = 108  # half its width
LEGEND_ROW = 19
OWNER = 60  # widest name of an owner inside the body
COLUMN = 296  # of the table, with what is in it
INDENT, PIN_AT, NUMBER_AT = 16, 142, 234
ROW = 13
PURPOSE = 66  # where a device's purpose begins
WIDTHS = dict.fromkeys("fijlt()[]/:.,;'| ", 0.4) | dict.fromkeys("_-rI", 0.5)  # of narrow letters, in em
BOLD = 1.12
GROUP = 17
GROUP_GAP = 6

STYLE = """
    text { font-family: sans-serif; font-size: 11px; fill: #1f2933 }
    .page { fill: #ffffff }
    .title { font-size: 21px; font-weight: bold }
    .note { fill: #616e7c }
    .body { fill: #262c35 }
    .dot { fill: none; stroke: #cbd2d9; stroke-width: 1.5 }
    .chip { font-size: 30px; font-weight: bold; fill: #ffffff; letter-spacing: 2px }
    .inside { fill: #e4e7eb }
    .dim { fill: #9aa5b1 }
    .pad { stroke: #52606d; stroke-width: .7 }
    .number { font-size: 9px; fill: #cbd2d9 }
    .name { font-weight: bold }
    .spot { fill: none; pointer-events: all }
    .unused .name { fill: #7b8794; font-weight: normal }
    .supply { fill: #7b8794; font-size: 8.5px }
    .no-port .number { fill: #7b8794 }
    .row, .head { font-size: 10.5px }
    .head { fill: #616e7c }
    .group { font-size: 11.5px; font-weight: bold }
    .rule { stroke: #cbd2d9; stroke-width: 1 }
    .pin.conflict text.label, .wrong { fill: #b3001b; font-weight: bold }
    .pin.conflict .spot { fill: #fde8e8; stroke: #d1001f }
    .inside.conflict { fill: #ff8f8f; font-weight: bold }
"""


@dataclass(frozen=True)
class Use:
    """Somebody has a pin. Several of one pin are a conflict."""

    pin: str
    owner: str  # uart1, or whatever else names it: gpios, reserved, /leds/run
    signal: str  # UART1_RXD, GPIO; RESERVED and NOT_CONNECTED too
    purpose: str = ""


def uses_of_board(board: Board) -> list[Use]:
    """What a pin table says, in its order."""
    devices = [
        Use(pin, label, signal, device.purpose)
        for label, device in board.devices.items()
        for signal, pin in device.pins.items()
    ]
    gpios = [Use(pin, "gpios", GPIO, purpose) for pin, purpose in board.gpios.items()]
    reserved = [Use(pin, RESERVED, RESERVED, purpose) for pin, purpose in board.reserved.items()]
    nowhere = [Use(pin, NOT_CONNECTED, NOT_CONNECTED) for pin in sorted(board.not_connected, key=pin_order)]
    return devices + gpios + reserved + nowhere


def uses_of_claims(claims: Iterable[Claim], chip: Chip) -> list[Use]:
    """
    What the enabled nodes of a device tree have, pin by pin. What takes turns is one use: the states of one
    device, and a pin that a group makes the GPIO line that somebody uses.
    """
    pins: dict[str, list[Claim]] = {}
    for claim in claims:
        pins.setdefault(claim.pin, []).append(claim)
    return [_use_of_claim(claim, chip) for its in pins.values() for claim in _rivals(its)]


def _rivals(claims: Sequence[Claim]) -> list[Claim]:
    """The claims of one pin, without those that take turns with another."""
    first: dict[str, Claim] = {}  # path of a node: its first state that has the pin
    for claim in claims:
        if claim.muxed:
            first.setdefault(claim.node.path, claim)
    muxed = list(first.values())
    lines = [claim for claim in claims if not claim.muxed]
    if lines and [claim.signal for claim in muxed] == [GPIO]:
        return lines
    freed = {claim.node.path for claim in claims if claim.muxed and claim.signal == GPIO}
    return muxed + [claim for claim in lines if claim.node.path not in freed]


def _use_of_claim(claim: Claim, chip: Chip) -> Use:
    peripheral = identify(claim.node, chip)
    names = [peripheral.label] if peripheral else [*claim.node.labels, claim.node.path]
    purpose = f"group {claim.group.name}" if claim.group else claim.property
    return Use(claim.pin, names[0], claim.signal or f"function {claim.value}", purpose)


def by_pin(uses: Iterable[Use]) -> dict[str, list[Use]]:
    """The uses of each pin; who has a pin twice as the same signal has it once."""
    pins: dict[str, dict[tuple[str, str], Use]] = {}
    for use in uses:
        pins.setdefault(use.pin, {}).setdefault((use.owner, use.signal), use)
    return {pin: list(its.values()) for pin, its in pins.items()}


def family(uses: Sequence[Use]) -> str:
    """The key of FAMILIES for a port pin with these uses."""
    if not uses:
        return UNUSED
    if len(uses) > 1:
        return CONFLICT
    prefixes = (prefix for prefix in FAMILY_OF_PREFIX if uses[0].signal.startswith(prefix))
    return FAMILY_OF_PREFIX.get(next(prefixes, ""), "other")


def signals(uses: Sequence[Use]) -> str:
    """What a pin is, as its label says it: both names of a conflict, the number of further ones."""
    names = list(dict.fromkeys(use.signal for use in uses))
    more = f" +{len(names) - 2}" if len(names) > 2 else ""
    return " / ".join(names[:2]) + more


def text_width(text: str, size: float) -> float:
    """Upper estimate of a text's width: as in DejaVu Sans, the widest of the usual sans-serif fonts."""
    return sum(WIDTHS.get(letter, 0.69 if letter.isupper() else 0.64) for letter in text) * size


def draw_map(chip: Chip, package: Package, uses: Iterable[Use], title: str, *, table: bool = True) -> str:
    """
    The picture as SVG. Pins are numbered as the package is seen from above: anticlockwise from the dot.
    Uses of pins that the package does not bring out are in the table only; the table can be left out.
    """
    uses = list(uses)
    pins = by_pin(uses)
    drawing = _Package(chip, package, pins)
    columns = _columns(uses, TITLE + drawing.height) if table else []
    width = 2 * MARGIN + drawing.width + len(columns) * (COLUMN + MARGIN)
    height = 2 * MARGIN + max([TITLE + drawing.height, *map(_height, columns)])
    summary = _summary(package, pins)
    return "\n".join(
        [
            "<!-- SPDX-License-Identifier: GPL-3.0-or-later -->",
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img" '
            'aria-labelledby="map-title map-desc">',
            f'  <title id="map-title">{escape(title)}: the pins</title>',
            f'  <desc id="map-desc">{escape(summary)}</desc>',
            f"  <style>{STYLE}{_family_style()}  </style>",
            f'  <rect class="page" width="{width:g}" height="{height:g}"/>',
            _text(MARGIN, MARGIN + 18, _cut(title, drawing.width, 21 * BOLD), "title"),
            _text(MARGIN, MARGIN + 38, _cut(summary, drawing.width, 11), "note"),
            f'  <g transform="translate({MARGIN} {MARGIN + TITLE})">',
            *drawing.lines(),
            "  </g>",
            *(
                line
                for index, groups in enumerate(columns)
                for line in _draw_column(
                    groups, 2 * MARGIN + drawing.width + index * (COLUMN + MARGIN), chip, package, pins
                )
            ),
            "</svg>",
            "",
        ]
    )


def _summary(package: Package, pins: dict[str, list[Use]]) -> str:
    used = sum(family(pins.get(pin, [])) not in (UNUSED, "reserved") for pin in package.bonded)
    conflicts = sum(1 for its in pins.values() if len(its) > 1)
    count = {0: "no conflict", 1: "1 pin in conflict"}.get(conflicts, f"{conflicts} pins in conflict")
    missing = len(pins.keys() - package.bonded.keys())
    lost = f", {missing} used but not brought out" if missing else ""
    return (
        f"{package.name}, seen from above: {used} of {len(package.bonded)} port pins in use, {count}{lost}."
    )


def _family_style() -> str:
    return "".join(
        f"    .{key} .pad, .{key} .bar {{ fill: {colour} }}\n" for key, (_, colour) in FAMILIES.items()
    )


def _text(x: float, y: float, text: str, style: str, anchor: str = "start") -> str:
    where = "" if anchor == "start" else f' text-anchor="{anchor}"'
    return f'  <text class="{style}" x="{x:g}" y="{y:g}"{where}>{escape(text)}</text>'


Box = tuple[float, float, float, float]  # left, top, right, bottom


def overlap(one: Box, other: Box) -> bool:
    """Whether two boxes have an area in common."""
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


@dataclass(frozen=True)
class Spot:
    """Where a pin leaves the body. In its own frame x runs along the label, outwards is to one side."""

    x: float
    y: float
    turned: bool  # upper and lower side: the text runs upwards
    outwards: int  # -1: the text ends at the pin, 1: it begins there

    @property
    def transform(self) -> str:
        return f"translate({self.x:g} {self.y:g})" + (" rotate(-90)" if self.turned else "")

    def box(self, inner: float, outer: float, thick: float) -> Box:
        """The box, in the picture, of what lies inwards of it from inner to outer, the farther first."""
        x, y = -self.outwards * inner, -self.outwards * outer
        left, right = min(x, y), max(x, y)
        if self.turned:
            return self.x - thick / 2, self.y - right, self.x + thick / 2, self.y - left
        return self.x + left, self.y - thick / 2, self.x + right, self.y + thick / 2

    @property
    def anchor(self) -> str:
        return "start" if self.outwards > 0 else "end"


class _Package:
    """The package with its labels; its drawing's corner is at 0, 0."""

    def __init__(self, chip: Chip, package: Package, pins: dict[str, list[Use]]) -> None:
        self.chip = chip
        self.package = package
        self.pins = pins
        self.ports = {number: pin for pin, number in package.bonded.items()}
        self.a_side = package.pins // 4
        self.pitch = max(PITCH, (SMALLEST_BODY - 2 * CORNER) / self.a_side)
        self.body = self.a_side * self.pitch + 2 * CORNER
        self.left, lower, right, self.top = (self._reach(side) for side in range(4))
        self.width = self.left + self.body + right
        self.height = self.top + self.body + lower

    def _side(self, number: int) -> int:
        return (number - 1) // self.a_side

    def _reach(self, side: int) -> float:
        """How far the labels of a side go from the body: 0 left, 1 lower, 2 right, 3 upper."""
        numbers = [number for number in range(1, self.package.pins + 1) if self._side(number) == side]
        return PAD + GAP + max(map(self._label_width, numbers))

    def _label_width(self, number: int) -> float:
        if number in self.ports:
            return NAME + self._signals_width(self.ports[number])
        return text_width(self.package.names[number - 1], SUPPLY_SIZE) + GAP

    def _signals_width(self, pin: str) -> float:
        uses = self.pins.get(pin, [])
        return text_width(signals(uses), 11 * BOLD if family(uses) == CONFLICT else 11) + GAP

    def spot(self, number: float) -> Spot:
        """The spot of a package pin; of the middle of several with half a number."""
        side, index = divmod(number - 1, self.a_side)
        along = CORNER + (index + 0.5) * self.pitch
        right, lower = self.left + self.body, self.top + self.body
        if side == 0:
            return Spot(self.left, self.top + along, False, -1)
        if side == 1:
            return Spot(self.left + along, lower, True, -1)
        if side == 2:
            return Spot(right, lower - along, False, 1)
        return Spot(right - along, self.top, True, 1)

    def lines(self) -> Iterator[str]:
        """The drawing."""
        corner = f'x="{self.left:g}" y="{self.top:g}"'
        yield f'  <rect class="body" {corner} width="{self.body:g}" height="{self.body:g}" rx="7"/>'
        yield f'  <circle class="dot" cx="{self.left + 15:g}" cy="{self.top + 15:g}" r="5"/>'
        for number in range(1, self.package.pins + 1):
            yield from self._pin(number)
        yield from self._owners()
        yield from self._legend()

    def _pin(self, number: int) -> Iterator[str]:
        pin = self.ports.get(number)
        uses = self.pins.get(pin, []) if pin else []
        spot = self.spot(number)
        key = family(uses) if pin else NO_PORT
        name = f' id="pin-{pin}"' if pin else ""
        yield f'  <g class="pin {key}"{name} transform="{spot.transform}">'
        yield f"    <title>{escape(self._tooltip(number, pin, uses))}</title>"
        if pin:
            yield self._box(spot, PAD + 2, GAP + NAME + self._signals_width(pin), PITCH - 2, "spot")
        yield self._box(spot, 0, PAD, PAD_WIDTH, "pad")
        inside = "end" if spot.outwards > 0 else "start"
        yield _text(-spot.outwards * GAP, 3.3, str(number), "number", inside)
        style = "label name" if pin else "supply"
        yield _text(spot.outwards * (PAD + GAP), 4, self.package.names[number - 1], style, spot.anchor)
        if uses:
            yield _text(spot.outwards * (PAD + GAP + NAME), 4, signals(uses), "label", spot.anchor)
        yield "  </g>"

    def _box(self, spot: Spot, start: float, length: float, thick: float, style: str) -> str:
        x = start if spot.outwards > 0 else -start - length
        size = f'width="{length:g}" height="{thick:g}"'
        return f'    <rect class="{style}" x="{x:g}" y="{-thick / 2:g}" {size} rx="2"/>'

    def _tooltip(self, number: int, pin: str | None, uses: Sequence[Use]) -> str:
        if pin is None:
            return f"{number}: {self.package.names[number - 1]}, no port pin"
        what = [f"{use.signal} of {use.owner}" if use.owner != use.signal else use.owner for use in uses]
        return f"{number}: {pin}, {' and '.join(what) or 'unused'}"

    def _runs(self) -> Iterator[tuple[int, int, tuple[str, ...]]]:
        """First and last of neighbouring package pins on one side with the same owners."""

        def key(number: int) -> tuple[int, tuple[str, ...]]:
            uses = self.pins.get(self.ports.get(number, ""), ())
            return self._side(number), tuple(dict.fromkeys(use.owner for use in uses))

        for (_, owners), run in groupby(range(1, self.package.pins + 1), key):
            if owners:
                numbers = list(run)
                yield numbers[0], numbers[-1], owners

    def _owners(self) -> Iterator[str]:
        """A bar along each run, and its owner's name where no longer run's name and no legend is."""
        x, y = self.left + self.body / 2, self.top + self.body / 2
        taken = [(x - LEGEND, y - self._legend_height() / 2, x + LEGEND, y + self._legend_height() / 2)]
        for first, last, owners in sorted(self._runs(), key=lambda run: run[0] - run[1]):
            spot = self.spot((first + last) / 2)
            key = family(self.pins[self.ports[first]])
            length = (last - first + 1) * self.pitch - 4
            start = NUMBERS - 3 if spot.outwards < 0 else -NUMBERS
            yield f'  <g class="{key}" transform="{spot.transform}">'
            size = f'width="3" height="{length:g}"'
            yield f'    <rect class="bar" x="{start}" y="{-length / 2:g}" {size} rx="1.5"/>'
            name = " / ".join(_cut(owner, OWNER, 11) for owner in owners[:2])
            name += f" +{len(owners) - 2}" if len(owners) > 2 else ""
            box = spot.box(NUMBERS + GAP + text_width(name, 11 * BOLD), NUMBERS + GAP, 12)
            if not any(overlap(box, other) for other in taken):
                taken.append(box)
                style = "inside conflict" if key == CONFLICT else "inside"
                anchor = "start" if spot.outwards < 0 else "end"
                yield _text(-spot.outwards * (NUMBERS + GAP), 4, name, style, anchor)
            yield "  </g>"

    def _counts(self) -> dict[str, int]:
        counts = dict.fromkeys(FAMILIES, 0)
        for number in range(1, self.package.pins + 1):
            pin = self.ports.get(number)
            counts[family(self.pins.get(pin, [])) if pin else NO_PORT] += 1
        return {key: count for key, count in counts.items() if count or key == CONFLICT}

    def _legend_height(self) -> float:
        return 62 + LEGEND_ROW * len(self._counts())

    def _legend(self) -> Iterator[str]:
        middle = self.left + self.body / 2
        top = self.top + (self.body - self._legend_height()) / 2
        yield _text(middle, top + 22, self.chip.name, "chip", "middle")
        yield _text(middle, top + 42, f"{self.package.name}, from above", "dim", "middle")
        for row, (key, count) in enumerate(self._counts().items()):
            y = top + 74 + row * LEGEND_ROW
            yield f'  <g class="{key}">'
            yield f'    <rect class="pad" x="{middle - LEGEND:g}" y="{y - 9:g}" width="16" height="10"/>'
            style = "inside conflict" if key == CONFLICT and count else "inside"
            yield _text(middle - LEGEND + 24, y, FAMILIES[key][0], style)
            yield _text(middle + LEGEND, y, str(count), style, "end")
            yield "  </g>"


Group = tuple[str, list[Use]]


def _columns(uses: Sequence[Use], height: float) -> list[list[Group]]:
    """The uses by owner, in columns of about the height of the drawing."""
    groups: dict[str, dict[tuple[str, str], Use]] = {}
    for use in uses:
        groups.setdefault(use.owner, {}).setdefault((use.pin, use.signal), use)
    columns: list[list[Group]] = [[]]
    for owner, rows in groups.items():
        group = (owner, list(rows.values()))
        if columns[-1] and _height([*columns[-1], group]) > 1.2 * height:
            columns.append([])
        columns[-1].append(group)
    return [column for column in columns if column]


def _height(groups: Sequence[Group]) -> float:
    return ROW + sum(GROUP + GROUP_GAP + ROW * (len(rows) + len(_own_purposes(rows))) for _, rows in groups)


def _own_purposes(rows: Sequence[Use]) -> list[str]:
    """The purposes when not all are the same: of GPIOs and reserved pins each has its own."""
    purposes = [use.purpose for use in rows]
    return [] if len(set(purposes)) < 2 else [purpose for purpose in purposes if purpose]


def _draw_column(
    groups: Sequence[Group], left: float, chip: Chip, package: Package, pins: dict[str, list[Use]]
) -> Iterator[str]:
    y = MARGIN + ROW - 3
    yield from _row(left, y, ("signal", "pin", "package pin", "value"), "head")
    for owner, rows in groups:
        y += GROUP + GROUP_GAP
        own = _own_purposes(rows)
        yield from _group_head(left, y, owner, "" if own else rows[0].purpose, family(rows[:1]))
        for use in rows:
            y += ROW
            wrong = use.pin not in package.bonded or len(pins[use.pin]) > 1
            value = chip.value(use.pin, use.signal)
            number = package.bonded.get(use.pin, "none")
            texts = (use.signal, use.pin, str(number), "" if value is None else str(value))
            yield from _row(left, y + 2, texts, "row wrong" if wrong else "row")
            if own and use.purpose:
                y += ROW
                yield _text(left + INDENT, y + 2, _cut(use.purpose, COLUMN - INDENT, 10.5), "row note")


def _group_head(left: float, y: float, owner: str, purpose: str, key: str) -> Iterator[str]:
    yield f'  <g class="{key}">'
    yield f'    <rect class="pad" x="{left:g}" y="{y - 8.5:g}" width="9" height="9" rx="2"/>'
    yield "  </g>"
    owner = _cut(owner, COLUMN - INDENT, 11.5 * BOLD)
    yield _text(left + INDENT, y, owner, "group")
    start = max(PURPOSE, INDENT + text_width(owner, 11.5 * BOLD) + GAP)
    if purpose and COLUMN - start > PURPOSE:
        yield _text(left + start, y, _cut(purpose, COLUMN - start, 10.5), "row note")
    yield f'  <path class="rule" d="M{left:g} {y + 4.5:g}h{COLUMN}"/>'


def _row(left: float, y: float, texts: tuple[str, str, str, str], style: str) -> Iterator[str]:
    signal, pin, number, value = texts
    yield _text(left + INDENT, y, _cut(signal, PIN_AT - INDENT - GAP, 10.5), style)
    yield _text(left + PIN_AT, y, pin, style)
    yield _text(left + NUMBER_AT, y, number, style, "end")
    if value:
        yield _text(left + COLUMN, y, value, style, "end")


def _cut(text: str, width: float, size: float) -> str:
    """The text, shortened with … to fit."""
    if text_width(text, size) <= width:
        return text
    while text and text_width(text + "…", size) > width:
        text = text[:-1]
    return text.rstrip(" ,:") + "…"
