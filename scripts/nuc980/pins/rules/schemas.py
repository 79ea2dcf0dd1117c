# SPDX-License-Identifier: GPL-3.0-or-later
"""The rule that the kernel's own bindings are."""

from __future__ import annotations

from collections.abc import Iterator

from nuc980.pins.findings import Finding
from nuc980.pins.rules.context import Context, rule


@rule(
    "schema",
    "A node is not as its binding in the kernel says (with --schemas).",
    "The bindings are what drivers are written against: types, values, properties that belong together. "
    "dt-validate of dtschema finds it.",
)
def schema(context: Context) -> Iterator[Finding]:
    yield from context.validated


RULES = (schema,)
