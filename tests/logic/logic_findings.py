# SPDX-License-Identifier: GPL-3.0-or-later
"""What the compiler of Structured Text says of a text, and types for such texts."""

from openrtu_tools.logic.compile import compile_text
from openrtu_tools.logic.errors import Findings

MODE = "TYPE mode : (OFF, RUN := 5, TRIP); other : (IDLE, RUN); END_TYPE "
UNIT = "TYPE unit : STRUCT n : INT; v : ARRAY[1..3] OF REAL; END_STRUCT; END_TYPE "


def findings_of(text: str) -> list[str]:
    findings = Findings()
    compile_text(text, findings)
    return [finding.shown("p") for finding in findings.sorted()]
