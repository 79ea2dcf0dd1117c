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
    """The same, compiled. A mistake may well make dtc warn."""
    dtb = folder / "board.dtb"
    done = subprocess.run(
        [ROOT / "scripts/build-dtb.sh", gateway_dts(folder, more), dtb], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return dtb
