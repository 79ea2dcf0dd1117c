# SPDX-License-Identifier: GPL-3.0-or-later
"""The pins of our Linux driver, as generated; tests/pins/test_dts.py asks whether the tree's are fresh."""

import re

from trees import ROOT

from nuc980.pins.chip import load_chip, pin_order
from nuc980.pins.generate import LINUX_FILE

CHIP = load_chip()
TABLE = (ROOT / LINUX_FILE).read_text()
ENTRY = re.compile(r'NUC980_PIN\((\d+), "(P[A-G]\d+)", (.*?)\),', re.DOTALL)


def test_the_table_reads_as_the_chip_data() -> None:
    read = {}
    for number, pin, functions in ENTRY.findall(TABLE):
        bank, index = pin_order(pin)
        assert int(number) == 16 * bank + index
        names = [name.strip().strip('"') for name in functions.split(",")]
        read[pin] = {value: name for value, name in enumerate(names) if name != "NULL"}
    assert read == CHIP.pins


def test_no_line_is_too_wide_for_the_kernel() -> None:
    assert [line for line in TABLE.splitlines() if len(line.expandtabs(8)) > 80] == []
