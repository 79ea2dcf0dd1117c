# SPDX-License-Identifier: GPL-3.0-or-later
"""Trips, stops, mileage and speeds of a vehicle, from the places that are stored.

The rules, which docs/control-centre.md tells the user:
- A stop begins where a vehicle stays within MOVES_M for STOPS_S. It ends when it has been outside for
  LEAVES_S; what comes back sooner is a receiver's jitter.
- A trip is from one stop to the next. Its way is measured from place to place, none nearer than STEP_M to the
  last: jitter makes no way. At rest there is none.
- Where places were not valid, or none came for longer than a gap, nobody knows the way: it is no mileage, but
  `unknown_m`, as the crow flies. A trip goes on after that, unless it took longer than ENDS_S.
- A place that nothing drives to (FASTEST) is left out. If the next one is there, too, the vehicle is there,
  and the way is unknown.
- A place counts only if it is newer than the last: a clock that steps makes no way.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from openrtu_tools.centre.areas import distance_m
from openrtu_tools.centre.formats import Place
from openrtu_tools.centre.model import Json

MOVES_M, STOPS_S, LEAVES_S = 50.0, 180, 20
STEP_M = 10.0
ENDS_S = 900
FASTEST = 90.0  # m/s
PROFILE_MOST = 1000  # speeds of a trip


def between_m(a: Place, b: Place) -> float:
    return distance_m((a.latitude, a.longitude), (b.latitude, b.longitude))


@dataclass
class Stop:
    begin_ms: int
    end_ms: int
    place: Place

    def view(self) -> Json:
        return {
            "kind": "stop", "from": self.begin_ms, "to": self.end_ms,
            "latitude": self.place.latitude, "longitude": self.place.longitude,
        }  # fmt: skip


@dataclass
class Trip:
    begin: Place
    end: Place
    metres: float = 0.0
    unknown_m: float = 0.0
    speeds: list[tuple[int, float]] = field(default_factory=list)  # until when, m/s

    def view(self) -> Json:
        seconds = (self.end.at_ms - self.begin.at_ms) / 1000
        most = max((speed for _, speed in self.speeds), default=0.0)
        step = -(-len(self.speeds) // PROFILE_MOST) or 1
        return {
            "kind": "trip", "from": self.begin.at_ms, "to": self.end.at_ms,
            "metres": round(self.metres, 1), "unknown_m": round(self.unknown_m, 1),
            "mean": round(self.metres / seconds, 2) if seconds else 0.0, "most": round(most, 2),
            "speeds": [[at, round(speed, 2)] for at, speed in self.speeds[::step]],
        }  # fmt: skip


class Log:
    """Of one vehicle. Takes its places, oldest first."""

    def __init__(self, gap_s: float) -> None:
        self.gap_ms = gap_s * 1000
        self.done: list[Stop | Trip] = []
        self.last: Place | None = None  # that was valid and possible
        self.odd: Place | None = None  # after it, and nothing drives there
        self.cut = False  # there were places between that are not valid
        self.stop: Stop | None = None
        self.inside: Place | None = None  # of the stop: the last place in it
        # Since it may have left the stop, with whether the way there is known.
        self.outside: list[tuple[Place, bool]] = []
        self.trip: Trip | None = None
        self.counted: Place | None = None  # of the trip: up to which the way is measured
        self.rest: Place | None = None  # of the trip: since which it has moved no further than a stop is wide
        self.at_rest = (0.0, 0.0, 0)  # the mileage, the unknown way and the number of speeds up to there

    def add(self, places: Iterable[Place]) -> None:
        for place in places:
            self._add(place)

    def _add(self, place: Place) -> None:
        last = self.last
        if last and place.at_ms <= last.at_ms:
            return
        if not place.is_valid:
            self.cut = True
            return
        known = not self.cut
        if last:
            known &= place.at_ms - last.at_ms <= self.gap_ms
            if not self._is_possible(last, place):
                if not (self.odd and self._is_possible(self.odd, place)):
                    self.odd = place
                    return
                known = False
        self.odd, self.cut = None, False
        self.last = place
        if not last:
            self._begin(place)
        elif not known and place.at_ms - last.at_ms > ENDS_S * 1000 and between_m(last, place) > MOVES_M:
            self._break_off(last)
            self._begin(place)
        elif self.stop:
            self._stay(self.stop, place, known)
        else:
            self._drive(place, known)

    @staticmethod
    def _is_possible(a: Place, b: Place) -> bool:
        return between_m(a, b) <= max(MOVES_M, FASTEST * (b.at_ms - a.at_ms) / 1000)

    def _begin(self, place: Place) -> Trip:
        """Nobody knows yet whether it stands or drives."""
        self.trip, self.stop = Trip(place, place), None
        self.counted = self.rest = place
        self.at_rest = (0.0, 0.0, 0)
        return self.trip

    def _stay(self, stop: Stop, place: Place, known: bool) -> None:
        if between_m(stop.place, place) <= MOVES_M:
            stop.end_ms, self.inside, self.outside = place.at_ms, place, []
            return
        self.outside.append((place, known))
        if place.at_ms - self.outside[0][0].at_ms < LEAVES_S * 1000:
            return
        self.done.append(stop)
        outside, self.outside = self.outside, []
        trip = self._begin(self.inside or stop.place)
        trip.metres = between_m(stop.place, trip.begin)
        self.at_rest = (trip.metres, 0.0, 0)
        for each, its_way in outside:
            self._drive(each, its_way)

    def _drive(self, place: Place, known: bool) -> None:
        trip, counted, rest = self.trip, self.counted, self.rest
        assert trip and counted and rest
        far = between_m(counted, place)
        if not known:
            trip.unknown_m += far if far > STEP_M else 0.0
            self.counted = place
        elif far >= STEP_M:
            trip.metres += far
            trip.speeds.append((place.at_ms, far / (place.at_ms - counted.at_ms) * 1000))
            self.counted = place
        trip.end = place
        if between_m(rest, place) > MOVES_M:
            self.rest = place
            remainder = 0.0 if self.counted is place else far
            self.at_rest = (trip.metres + remainder, trip.unknown_m, len(trip.speeds))
        elif place.at_ms - rest.at_ms >= STOPS_S * 1000:
            self._come_to_rest(trip, rest, place)

    def _come_to_rest(self, trip: Trip, rest: Place, place: Place) -> None:
        metres, trip.unknown_m, speeds = self.at_rest
        trip.end = rest
        if trip.begin is not rest:
            trip.metres = metres + between_m(rest, place)
            del trip.speeds[speeds:]
            self.done.append(trip)
        self.stop, self.trip, self.inside = Stop(rest.at_ms, place.at_ms, place), None, place

    def _break_off(self, last: Place) -> None:
        """Nobody knows what comes next."""
        if self.stop:
            self.done.append(self.stop)
        elif self.trip and between_m(self.trip.begin, last) + self.trip.metres > MOVES_M:
            self.done.append(self.trip)
        self.stop = self.trip = None
        self.outside = []

    def end(self) -> list[Stop | Trip]:
        if self.last:
            self._break_off(self.last)
        return self.done
