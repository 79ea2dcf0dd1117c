# SPDX-License-Identifier: GPL-3.0-or-later
"""The pins of our Linux driver: generated, and the same in the patch that brings them."""

import re
from pathlib import Path

from trees import ROOT

from nuc980.pins.chip import load_chip, pin_order
from nuc980.pins.cli import main
from nuc980.pins.generate import linux_table

CHIP = load_chip()
FILE = "drivers/pinctrl/nuvoton/pinctrl-nuc980-pins.h"
ENTRY = re.compile(r'NUC980_PIN\((\d+), "(P[A-G]\d+)", (.*?)\),', re.DOTALL)


def file_in_patches(name: str) -> str:
    """A file that a patch of the series creates."""
    patches = "".join(path.read_text() for path in sorted((ROOT / "patches/linux/6.1").glob("*.patch")))
    after = patches.split(f"--- /dev/null\n+++ b/{name}\n")[1].splitlines()[1:]
    lines = iter(after)
    added = []
    while (line := next(lines, "")).startswith("+"):
        added.append(line[1:])
    return "\n".join(added) + "\n"


def test_the_patch_has_what_the_chip_data_say() -> None:
    assert file_in_patches(FILE) == linux_table(CHIP), (
        f"run: scripts/nuc980-pins generate --linux FILE, and bring it into the patch as {FILE}"
    )


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
