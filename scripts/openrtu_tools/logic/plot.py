# SPDX-License-Identifier: GPL-3.0-or-later
"""What a run did, as a picture: a strip for each point over the time; red where the value is not good."""

from __future__ import annotations

import math
from collections.abc import Iterator
from html import escape

from openrtu_tools.logic.desk import NOT_GOOD, Value

WIDTH, STRIP, LEFT, RIGHT, TOP = 900, 64, 150, 30, 16


def tick(end: float) -> float:
    """1, 2 or 5 times a power of ten, so that at most ten fit."""
    power = 10.0 ** math.floor(math.log10(end / 10))
    return next(step * power for step in (1, 2, 5, 10) if step * power * 10 >= end * 0.999)


def runs(values: list[Value]) -> Iterator[tuple[int, int, bool]]:
    """The first and the last index of each run of values that are all good, or all not; and which."""
    first = 0
    for i in range(1, len(values) + 1):
        good = not values[first].quality & NOT_GOOD
        if i == len(values) or good != (not values[i].quality & NOT_GOOD):
            yield first, i - 1, good
            first = i


def across(time: float, end: float) -> float:
    return LEFT + (WIDTH - LEFT - RIGHT) * time / end


def svg(times_s: list[float], traces: dict[str, list[Value]]) -> str:
    """Each trace has a value for each time."""
    end = times_s[-1] or 1.0
    height = TOP + STRIP * len(traces) + 30
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{height}" fill="white"/>',
        *scale(end, height),
    ]
    for number, (name, values) in enumerate(traces.items()):
        parts += strip(TOP + STRIP * number, name, values, [across(time, end) for time in times_s])
    return "\n".join([*parts, "</svg>", ""])


def strip(top: int, name: str, values: list[Value], places: list[float]) -> list[str]:
    """One trace; places: where each value begins."""
    numbers = [float(value.value) for value in values]
    low, high = min(numbers), max(numbers)
    if all(isinstance(value.value, bool) for value in values):
        low, high = 0.0, 1.0
    span = high - low or 1.0

    def up(value: float) -> float:
        return top + STRIP - 12 - (STRIP - 24) * (value - low) / span

    parts = [f'<text x="8" y="{top + STRIP / 2 + 4}">{escape(name)}</text>']
    for value in sorted({low, high}):
        parts.append(
            f'<text x="{LEFT - 6}" y="{up(value) + 4:.1f}" text-anchor="end" fill="#777">{value:g}</text>'
        )
    parts.append(f'<path d="M{LEFT} {top + STRIP - 4}H{WIDTH - RIGHT}" stroke="#ddd"/>')
    for first, last, good in runs(values):
        way = [f"M{places[first]:.1f} {up(numbers[first]):.1f}"]
        for i in range(first, min(last + 1, len(values) - 1)):
            if i == last or numbers[i + 1] != numbers[i]:
                way.append(f"H{places[i + 1]:.1f}V{up(numbers[i + 1]):.1f}")
        if last + 1 == len(values):
            way.append(f"H{places[-1]:.1f}")
        colour = "#047" if good else "#c00"
        parts.append(f'<path d="{"".join(way)}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
    return parts


def scale(end: float, height: int) -> list[str]:
    parts, step = [], tick(end)
    for number in range(math.floor(end / step * 1.001) + 1):
        x = across(number * step, end)
        parts.append(f'<path d="M{x:.1f} {TOP}V{height - 28}" stroke="#eee"/>')
        label = f"{number * step:g} s"
        parts.append(f'<text x="{x:.1f}" y="{height - 10}" text-anchor="middle" fill="#777">{label}</text>')
    return parts
