# SPDX-License-Identifier: GPL-3.0-or-later
"""nuc980-pins, run in the test's own process, and sources for it."""

import io
import subprocess
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from trees import ROOT, gateway, soc

from nuc980.pins.cli import main

DONE, FOUND, UNUSABLE = 0, 1, 2

# What the report's own device tree has besides: figure 3.1's pins of EMAC1, and the SD host left on.
SD_HOST_ON = """
&pinctrl { sdh { pinctrl_sdh: sdh { nuvoton,pins =
    <5 6 2 0 5 0 2 0 5 1 2 0 5 2 2 0 5 3 2 0 5 4 2 0 5 5 2 0>; }; }; };
&sdh { pinctrl-names = "default"; pinctrl-0 = <&pinctrl_sdh>; status = "okay"; };
"""


@dataclass
class Ended:
    """What the program did, as subprocess has it."""

    returncode: int | str | None
    stdout: str
    stderr: str


def run(*words: str | Path, cwd: Path = ROOT) -> Ended:
    """In this process: a start of Python takes longer than most of what is asked."""
    with chdir(cwd), redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
        try:
            code: int | str | None = main([str(word) for word in words])
        except SystemExit as end:
            code = end.code
    return Ended(code, out.getvalue(), err.getvalue())


def write(file: Path, more: str) -> Path:
    (file.parent / "soc.dtsi").write_text(soc())
    file.write_text(gateway(more))
    return file


def compiled(source: Path) -> Path:
    """With its file's name, .dtb."""
    text = subprocess.run(["cpp", "-P", "-nostdinc", "-undef", "-x", "assembler-with-cpp", source],
                          check=True, capture_output=True).stdout  # fmt: skip
    dtb = source.with_suffix(".dtb")
    subprocess.run(["dtc", "-q", "-o", dtb, "-"], input=text, check=True)
    return dtb
