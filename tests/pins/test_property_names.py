# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of properties: what is one letter off, and that what our bindings describe is known."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import yaml
from trees import CHIP, ROOT

from nuc980.pins.rules.properties import is_one_off, known_properties


@pytest.mark.parametrize(
    ("written", "meant", "is_near"),
    [
        ("label", "label", False),
        ("labl", "label", True),
        ("labell", "label", True),
        ("alabel", "label", True),
        ("lable", "label", True),
        ("lebel", "label", True),
        ("lebal", "label", False),
        ("lab", "label", False),
        ("", "l", True),
    ],
)
def test_one_letter_off(written: str, meant: str, is_near: bool) -> None:
    assert is_one_off(written, meant) is is_near


def property_names(schema: object) -> Iterator[str]:
    """All that a binding describes, of its node and of those below."""
    for key, value in schema.items() if isinstance(schema, dict) else ():
        if key == "properties":
            yield from value
        if key in ("properties", "patternProperties"):
            for inner in value.values():
                yield from property_names(inner)


def test_what_our_bindings_describe_is_known() -> None:
    files = sorted((ROOT / "dts" / "bindings").rglob("*.yaml"))
    names = {name for file in files for name in property_names(yaml.safe_load(file.read_text()))}
    assert len(names) > 60
    assert names - known_properties(CHIP) - {"$nodename", "cs-gpios"} == set()
