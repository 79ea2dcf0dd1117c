# SPDX-License-Identifier: GPL-3.0-or-later
"""
The map of the pins as one HTML file that needs nothing else: picture, search, all about each pin; and a try
of other functions, with the conflicts and the pin table that comes of it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import jinja2

from nuc980.pins.chip import Chip, Package, gpio_number, pin_order
from nuc980.pins.picture import Use, by_pin, draw_map, family

TEMPLATE = Path(__file__).parent / "templates" / "map.html.j2"


def draw_page(chip: Chip, package: Package, uses: Iterable[Use], title: str) -> str:
    """The page as HTML. What it shows is in its address too: map.html#q=uart3&pin=PD3&try=PE11:1."""
    uses = list(uses)
    svg = draw_map(chip, package, uses, title, table=False)
    # "<" cannot end the script element when it is written as an escape.
    data = json.dumps(page_data(chip, package, uses), separators=(",", ":")).replace("<", "\\u003c")
    return _template().render(title=title, package=package.name, svg=svg.partition("\n")[2], data=data)


def page_data(chip: Chip, package: Package, uses: Iterable[Use]) -> list[dict]:
    """What the page knows of each pin, in the chip's order; last the used ones that do not exist."""
    used = by_pin(uses)
    names = sorted(chip.pins, key=pin_order) + [pin for pin in used if pin not in chip.pins]
    return [_pin_data(chip, package, pin, used.get(pin, [])) for pin in names]


def _pin_data(chip: Chip, package: Package, pin: str, uses: list[Use]) -> dict:
    data = {
        "pin": pin,
        "number": package.bonded.get(pin),
        "family": family(uses),
        "functions": chip.pins.get(pin, {}),
        "owners": {
            signal: owners[0].label
            for signal in chip.pins.get(pin, {}).values()
            if (owners := chip.owners(signal))
        },
        "uses": [{"owner": use.owner, "signal": use.signal, "purpose": use.purpose} for use in uses],
    }
    if pin in chip.pins:
        register, shift = chip.register_of(pin)
        data |= {"register": f"{register:#x}", "shift": shift, "gpio": gpio_number(pin)}
    return data


@cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, autoescape=True, keep_trailing_newline=True
    )
    return environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
