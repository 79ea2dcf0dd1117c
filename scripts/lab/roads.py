# SPDX-License-Identifier: GPL-3.0-or-later
"""Roads between towns of the world, generated: smooth curves through places on the way."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field

Place = tuple[float, float]  # latitude, longitude
EARTH_M = 6_371_000.0
PIECES = 24  # of the curve between two places

WAYS: dict[str, list[Place]] = {
    "Beograd-Novi Sad": [(44.82, 20.41), (44.87, 20.27), (44.98, 20.16), (45.1, 20.0), (45.26, 19.84)],
    "Niš-Kragujevac": [(43.32, 21.9), (43.53, 21.7), (43.86, 21.41), (43.98, 21.26), (44.01, 20.92)],
    "Subotica-Zrenjanin": [(46.1, 19.67), (45.97, 19.84), (45.84, 20.46), (45.62, 20.39), (45.38, 20.39)],
    "Hamburg-Bremen": [(53.55, 10.0), (53.42, 9.8), (53.29, 9.45), (53.17, 9.1), (53.08, 8.8)],
    "München-Nürnberg": [(48.14, 11.58), (48.4, 11.6), (48.76, 11.43), (49.08, 11.4), (49.45, 11.08)],
    "Sevilla-Córdoba": [(37.39, -5.98), (37.47, -5.64), (37.54, -5.08), (37.7, -4.93), (37.88, -4.78)],
    "Barcelona-Girona": [(41.39, 2.17), (41.55, 2.25), (41.69, 2.49), (41.85, 2.72), (41.98, 2.82)],
    "Kraków-Katowice": [(50.06, 19.94), (50.09, 19.74), (50.13, 19.4), (50.2, 19.16), (50.26, 19.02)],
    "Oslo-Hamar": [(59.91, 10.75), (60.05, 11.05), (60.33, 11.26), (60.61, 11.2), (60.79, 11.07)],
    "Torino-Milano": [(45.07, 7.69), (45.18, 7.9), (45.33, 8.42), (45.45, 8.62), (45.46, 9.19)],
    "Nairobi-Nakuru": [(-1.29, 36.82), (-1.09, 36.64), (-0.8, 36.5), (-0.5, 36.32), (-0.3, 36.07)],
    "Cape Town-Paarl": [(-33.92, 18.42), (-33.89, 18.6), (-33.83, 18.76), (-33.73, 18.96)],
    "Mumbai-Pune": [(19.08, 72.88), (19.03, 73.1), (18.8, 73.28), (18.75, 73.41), (18.52, 73.86)],
    "Nagoya-Kyoto": [(35.18, 136.91), (35.36, 136.62), (35.32, 136.29), (35.13, 136.1), (35.01, 135.77)],
    "Melbourne-Ballarat": [(-37.81, 144.96), (-37.7, 144.6), (-37.66, 144.4), (-37.56, 143.86)],
    "São Paulo-Campinas": [(-23.55, -46.63), (-23.35, -46.83), (-23.19, -46.9), (-22.91, -47.06)],
    "Bogotá-Tunja": [(4.71, -74.07), (4.92, -73.83), (5.2, -73.6), (5.35, -73.45), (5.53, -73.36)],
    "Denver-Fort Collins": [(39.74, -104.99), (39.99, -104.98), (40.3, -104.98), (40.59, -105.08)],
}  # fmt: skip


def metres(a: Place, b: Place) -> float:
    """Between two places that are near each other."""
    north = math.radians(b[0] - a[0])
    east = math.radians(b[1] - a[1]) * math.cos(math.radians((a[0] + b[0]) / 2))
    return EARTH_M * math.hypot(north, east)


def _between(before: float, a: float, b: float, after: float, t: float) -> float:
    """Catmull and Rom's curve: through a and b, towards where it comes from and goes."""
    return 0.5 * (
        2 * a
        + (b - before) * t
        + (2 * before - 5 * a + 4 * b - after) * t**2
        + (3 * a - before - 3 * b + after) * t**3
    )


@dataclass
class Road:
    places: list[Place]
    lengths: list[float] = field(default_factory=list)  # from its begin, in metres

    def __post_init__(self) -> None:
        ends = [self.places[0], *self.places, self.places[-1]]
        smooth = [
            (_between(*(end[0] for end in four), t / PIECES), _between(*(end[1] for end in four), t / PIECES))
            for four in zip(ends, ends[1:], ends[2:], ends[3:], strict=False)
            for t in range(PIECES)
        ]
        self.places = [*smooth, self.places[-1]]
        self.lengths = [0.0]
        for a, b in zip(self.places, self.places[1:], strict=False):
            self.lengths.append(self.lengths[-1] + metres(a, b))

    def at(self, way_m: float) -> Place:
        """Where one is who drives to and fro."""
        whole = self.lengths[-1]
        way_m %= 2 * whole
        way_m = min(way_m, 2 * whole - way_m)
        number = min(bisect_right(self.lengths, way_m), len(self.lengths) - 1)
        before, after = self.lengths[number - 1], self.lengths[number]
        share = (way_m - before) / (after - before)
        a, b = self.places[number - 1], self.places[number]
        return a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share
