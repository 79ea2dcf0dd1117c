# SPDX-License-Identifier: GPL-3.0-or-later
"""Areas of the map, and distances on it. An area is a circle or a polygon; it does not cross 180 degrees."""

from __future__ import annotations

import math
from dataclasses import dataclass

from openrtu_tools.centre.errors import CentreError

EARTH_M = 6_371_008.8  # its mean radius

Corner = tuple[float, float]  # latitude, longitude


def distance_m(a: Corner, b: Corner) -> float:
    """Of two places, on a sphere.

    >>> round(distance_m((0, 0), (0, 1)))
    111195
    """
    north, east = math.radians(b[0] - a[0]), math.radians(b[1] - a[1])
    half = (
        math.sin(north / 2) ** 2
        + math.cos(math.radians(a[0])) * math.cos(math.radians(b[0])) * math.sin(east / 2) ** 2
    )
    return 2 * EARTH_M * math.asin(min(1.0, math.sqrt(half)))


@dataclass(frozen=True)
class Area:
    """Of the vehicles of a group, or of all; the alarm is of a vehicle inside, outside, or there is none."""

    name: str
    corners: tuple[Corner, ...]  # of a polygon; the middle of a circle
    radius_m: float = 0.0
    alarm: str = ""
    group: str = ""
    priority: int = 2

    def __post_init__(self) -> None:
        if not self.radius_m and len({*self.corners}) < 3:
            raise CentreError(f"area {self.name}: a polygon has at least 3 corners")

    @property
    def box(self) -> tuple[float, float, float, float]:
        """South, west, north, east."""
        latitudes, longitudes = zip(*self.corners, strict=True)
        north = math.degrees(self.radius_m / EARTH_M)
        east = north / max(0.01, math.cos(math.radians(max(map(abs, latitudes)) + north)))
        return min(latitudes) - north, min(longitudes) - east, max(latitudes) + north, max(longitudes) + east

    def holds(self, latitude: float, longitude: float) -> bool:
        """A place on the border of a polygon is in one of the two areas that it divides.

        >>> square = Area("square", ((0, 0), (0, 2), (2, 2), (2, 0)))
        >>> [square.holds(1, 1), square.holds(1, 3), Area("round", ((1, 1),), 1000).holds(1, 1.01)]
        [True, False, False]
        """
        if self.radius_m:
            return distance_m(self.corners[0], (latitude, longitude)) <= self.radius_m
        inside = False
        for a, b in zip(self.corners, self.corners[1:] + self.corners[:1], strict=True):
            if (a[0] > latitude) != (b[0] > latitude) and longitude < a[1] + (b[1] - a[1]) * (
                latitude - a[0]
            ) / (b[0] - a[0]):
                inside = not inside
        return inside


class Areas:
    """Those that raise alarms for one station, with what rules them out fast."""

    def __init__(self, areas: tuple[Area, ...], group: str) -> None:
        self._of_station = [
            (area, area.box) for area in areas if area.alarm and (not area.group or area.group == group)
        ]

    def alarms(self, latitude: float, longitude: float) -> list[tuple[Area, bool]]:
        """Each area, and whether a vehicle at that place is an alarm."""
        judged = []
        for area, (south, west, north, east) in self._of_station:
            inside = (
                south <= latitude <= north and west <= longitude <= east and area.holds(latitude, longitude)
            )
            judged.append((area, inside == (area.alarm == "inside")))
        return judged
