# SPDX-License-Identifier: GPL-3.0-or-later
"""The gateway's device tree with a test's own lines behind it."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
GATEWAY = ROOT / "dts/nuvoton/nuc980-gateway.dts"


def gateway_dts(folder: Path, more: str) -> Path:
    """A source that includes the gateway's and goes on."""
    source = folder / "board.dts"
    source.write_text(f'#include "{GATEWAY}"\n{more}\n', encoding="utf-8")
    return source


def gateway_dtb(folder: Path, more: str) -> Path:
    """The same, compiled whatever dtc says: a tree with a mistake has to get as far as the board."""
    dtb = folder / "board.dtb"
    source = subprocess.run(
        ["cpp", "-nostdinc", "-undef", "-D__DTS__", "-x", "assembler-with-cpp", "-I", GATEWAY.parent,
         gateway_dts(folder, more)],
        capture_output=True, check=True,
    ).stdout  # fmt: skip
    subprocess.run(["dtc", "-q", "-f", "-I", "dts", "-O", "dtb", "-o", dtb, "-"], input=source, check=True)
    return dtb
