# SPDX-License-Identifier: GPL-3.0-or-later
"""The pins of our Linux driver: generated, and the same in the driver's header."""

import re
from pathlib import Path

from trees import ROOT

from nuc980.pins.chip import load_chip, pin_order
from nuc980.pins.cli import main
from nuc980.pins.generate import linux_table

CHIP = load_chip()
FILE = "board/nuc980/linux/drivers/pinctrl/nuvoton/pinctrl-nuc980-pins.h"
ENTRY = re.compile(r'NUC980_PIN\((\d+), "(P[A-G]\d+)", (.*?)\),', re.DOTALL)


def test_the_driver_has_what_the_chip_data_say() -> None:
    assert (ROOT / FILE).read_text() == linux_table(CHIP)


def test_the_table_reads_as_the_chip_data() -> None:
    read = {}
    for number, pin, functions in ENTRY.findall(linux_table(CHIP)):
        bank, index = pin_order(pin)
        assert int(number) == 16 * bank + index
        names = [name.strip().strip('"') for name in functions.split(",")]
        read[pin] = {value: name for value, name in enumerate(names) if name != "NULL"}
    assert read == CHIP.pins


def test_no_line_is_too_wide_for_the_kernel() -> None:
    assert [line for line in linux_table(CHIP).splitlines() if len(line.expandtabs(8)) > 80] == []


def test_generate_writes_it_and_checks_it(tmp_path: Path) -> None:
    file = tmp_path / "pinctrl-nuc980-pins.h"
    assert main(["generate", "--check", "--linux", str(file)]) == 1
    assert main(["generate", "--linux", str(file)]) == 0
    assert file.read_text() == linux_table(CHIP)
    assert main(["generate", "--check", "--linux", str(file)]) == 0
    file.write_text(linux_table(CHIP).replace("UART1_RXD", "UART1_RDX", 1))
    assert main(["generate", "--check", "--linux", str(file)]) == 1
