# SPDX-License-Identifier: GPL-3.0-or-later
"""What a change of a source of ours makes QEMU's build do again: what it must."""

import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TABLE = "include/hw/misc/nuc980_pins_table.h"
LONG_AGO = 1_000_000_000


def written(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    os.utime(path, (LONG_AGO, LONG_AGO))


def test_a_moved_pin_rebuilds_one_object(qemu_source: Path) -> None:
    """Of all objects, as their compiler told ninja."""
    deps = subprocess.run(
        ["ninja", "-C", qemu_source.parent / "build", "-t", "deps"],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    objects = [each.splitlines() for each in deps.split("\n\n")]
    of_table = [each[0].split(":")[0] for each in objects if any(line.endswith(TABLE) for line in each)]
    assert of_table == ["libcommon.fa.p/hw_misc_nuc980_pins.c.o"]


def test_a_prepared_source_is_touched_where_ours_has_changed(tmp_path: Path) -> None:
    debian, overlay, source = (tmp_path / name for name in ("debian", "overlay", "source"))
    written(debian / "hw/Kconfig", "config NAND\n")
    written(debian / "hw/nand.c", "int nand;\n")
    written(overlay / "hw/ours.c", "int ours;\n")
    written(overlay / "pins.h", "moved\n")
    patch = tmp_path / "hook.patch"
    patch.write_text("--- a/hw/Kconfig\n+++ b/hw/Kconfig\n@@ -1 +1,2 @@\n config NAND\n+config OURS\n")
    prepare = [ROOT / "scripts/patched-source.sh", debian, overlay, source, patch]
    subprocess.run(prepare, check=True)
    files = [path for path in source.rglob("*") if path.is_file()]
    assert {str(path.relative_to(source)) for path in files} == {
        "hw/Kconfig",
        "hw/nand.c",
        "hw/ours.c",
        "pins.h",
    }
    for path in files:
        os.utime(path, (LONG_AGO, LONG_AGO))
    written(overlay / "pins.h", "back!\n")  # as long, and as old
    subprocess.run(prepare, check=True)
    assert [path.name for path in files if path.stat().st_mtime != LONG_AGO] == ["pins.h"]
    assert (source / "pins.h").read_text() == "back!\n"
