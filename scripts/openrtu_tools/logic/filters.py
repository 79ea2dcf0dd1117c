# SPDX-License-Identifier: GPL-3.0-or-later
"""Digital filters: SciPy designs them, and they become a function block of second-order sections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from openrtu_tools.logic.errors import LogicError

KINDS = {"butterworth": "butter", "chebyshev": "cheby1", "elliptic": "ellip"}
BANDS = {"low": "lowpass", "high": "highpass", "pass": "bandpass", "stop": "bandstop"}


@dataclass(frozen=True)
class Design:
    """A filter of the kinds and bands above. Edges in Hz; ripple and attenuation in dB; period in ms."""

    kind: str
    band: str
    order: int
    edges: tuple[float, ...]
    period_ms: int
    ripple_db: float
    attenuation_db: float

    def check(self) -> None:
        """Raises LogicError for what no filter can be."""
        if self.band in ("low", "high") and len(self.edges) != 1:
            raise LogicError(f"a filter for the band {self.band!r} has one edge: --edges 1.5")
        if self.band in ("pass", "stop") and (len(self.edges) != 2 or self.edges[0] >= self.edges[1]):
            raise LogicError(
                f"a filter for the band {self.band!r} has a lower and an upper edge: --edges 1,2"
            )
        half = 500 / self.period_ms
        if not all(0 < edge < half for edge in self.edges):
            raise LogicError(
                f"an edge must be above 0 and below half of the scans a second, {half:g} Hz; "
                "scan more often, or filter lower"
            )

    def sections(self) -> list[list[float]]:
        """b0, b1, b2, 1, a1, a2 of each section."""
        from scipy import signal  # half a second; no other command needs it

        edge = self.edges if len(self.edges) > 1 else self.edges[0]
        return signal.iirfilter(
            self.order, edge, rp=self.ripple_db, rs=self.attenuation_db, btype=BANDS[self.band],
            ftype=KINDS[self.kind], fs=1000 / self.period_ms, output="sos",
        ).tolist()  # fmt: skip


def block(design: Design, name: str) -> str:
    """The text of a FUNCTION_BLOCK with IN and OUT that is this filter."""
    design.check()
    sections = design.sections()
    edges = " and ".join(f"{edge:g}" for edge in design.edges)
    scans = f"a scan each {design.period_ms} ms"
    described = f"{design.kind}, band {design.band}, order {design.order}, {edges} Hz, {scans}"
    return "\n".join(
        [
            f"(* {described} *)",
            f"FUNCTION_BLOCK {name}",
            "VAR_INPUT IN : LREAL; END_VAR",
            "VAR_OUTPUT OUT : LREAL; END_VAR",
            f"VAR {', '.join(f's{n}' for n in range(1, len(sections) + 1))} : BIQUAD; END_VAR",
            *(_call(n, section) for n, section in enumerate(sections, 1)),
            f"OUT := s{len(sections)}.OUT;",
            "END_FUNCTION_BLOCK",
            "",
        ]
    )


def _call(number: int, section: Sequence[float]) -> str:
    b0, b1, b2, _, a1, a2 = (_decimal(value) for value in section)
    source = "IN" if number == 1 else f"s{number - 1}.OUT"
    return f"s{number}(IN := {source}, B0 := {b0}, B1 := {b1}, B2 := {b2}, A1 := {a1}, A2 := {a2});"


def _decimal(value: float) -> str:
    """As the language writes it: with a point also before an exponent."""
    mantissa, mark, exponent = repr(value).partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + (f"E{exponent}" if mark else "")
