# SPDX-License-Identifier: GPL-3.0-or-later
"""Trips on drives of a known length: stops, jitter, lost fixes, silences, jumps, clocks, the antimeridian."""

import math
import random
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import pytest

from openrtu_tools.centre.areas import EARTH_M
from openrtu_tools.centre.codes import INVALID
from openrtu_tools.centre.formats import Place
from openrtu_tools.centre.trips import LEAVES_S, MOVES_M, STOPS_S, Log, Stop, Trip

GAP_S = 120
DEGREE_M = EARTH_M * math.pi / 180


def at(second: float, metres: float, aside: float = 0.0, longitude: float = 0.0) -> Place:
    """On the equator: so far to the east, and aside to the north."""
    east = (longitude + metres / DEGREE_M + 180) % 360 - 180
    return Place(round(second * 1000), aside / DEGREE_M, east, None, 0)


def drive(begin: int, metres: float, speed: float, seconds: int, longitude: float = 0.0) -> list[Place]:
    """A place a second, the first one after the begin."""
    return [at(begin + n, metres + speed * n, longitude=longitude) for n in range(1, seconds + 1)]


def stand(begin: int, metres: float, seconds: int, jitter: float = 0.0, seed: int = 1) -> list[Place]:
    chance = random.Random(seed)

    def off() -> float:
        return chance.uniform(-jitter, jitter)

    return [at(begin + n, metres + off(), off()) for n in range(1, seconds + 1)]


def logged(places: Iterable[Place]) -> list[Stop | Trip]:
    log = Log(GAP_S)
    log.add(places)
    return log.end()


def kinds(done: Sequence[Stop | Trip]) -> str:
    return "".join(type(each).__name__[0] for each in done)


def trips(done: Sequence[Stop | Trip]) -> list[Trip]:
    return [each for each in done if isinstance(each, Trip)]


DAY = [
    *stand(0, 0, 600),
    *drive(600, 0, 20, 500),
    *stand(1100, 10_000, 400),
    *drive(1500, 10_000, 10, 300),
    *stand(1800, 13_000, 600),
]


def test_day_of_two_trips() -> None:
    done = logged(DAY)
    assert kinds(done) == "STSTS"
    first, second = trips(done)
    assert abs(first.metres - 10_000) < 0.1 and abs(second.metres - 3000) < 0.1
    assert first.unknown_m == second.unknown_m == 0
    # A stop is entered where its circle begins: what is driven in it is in the mileage, not in the time.
    assert first.begin.at_ms == 602_000 and 1_095_000 <= first.end.at_ms <= 1_100_000
    assert max(speed for _, speed in first.speeds) == pytest.approx(20, rel=0.01)
    assert first.view()["most"] == pytest.approx(20, abs=0.1)
    assert first.view()["mean"] == pytest.approx(20, rel=0.02)
    stop = done[2]
    assert isinstance(stop, Stop) and abs(stop.place.longitude * DEGREE_M - 10_000) < 1


@pytest.mark.parametrize("every", [1, 5, 30, 60])
def test_rarer_places_say_the_same(every: int) -> None:
    done = logged(DAY[::every])
    assert kinds(done) == "STSTS"
    assert [round(trip.metres, -2) for trip in trips(done)] == [10_000, 3000]


@pytest.mark.slow
@pytest.mark.parametrize(("jitter", "seed"), [(4, 1), (12, 2), (20, 3)])
def test_jitter_at_rest_is_no_way(jitter: float, seed: int) -> None:
    """A night; and the same before and behind a drive."""
    assert kinds(logged(stand(0, 0, 30_000, jitter, seed))) == "S"
    done = logged(
        [*stand(0, 0, 3000, jitter, seed), *drive(3000, 0, 20, 500), *stand(3500, 10_000, 3000, jitter, seed)]
    )
    assert kinds(done) == "STS"
    [trip] = trips(done)
    assert abs(trip.metres - 10_000) <= 3 * jitter + 1


def test_place_that_is_off_for_a_moment_is_no_trip() -> None:
    night = stand(0, 0, 3000)
    for n in range(1000, 1000 + LEAVES_S - 5):
        night[n] = at(n + 1, 3 * MOVES_M)
    assert kinds(logged(night)) == "S"


def test_stop_that_is_too_short_is_part_of_the_trip() -> None:
    """At a traffic light."""
    way = [
        *stand(0, 0, 300),
        *drive(300, 0, 10, 100),
        *stand(400, 1000, STOPS_S - 20),
        *drive(560, 1000, 10, 100),
    ]
    done = logged([*way, *stand(660, 2000, 300)])
    assert kinds(done) == "STS"
    assert abs(trips(done)[0].metres - 2000) < 0.1


def without_fix(places: Sequence[Place], begin: int, end: int) -> list[Place]:
    """They tell the last place again, not valid."""
    return [
        replace(places[begin], at_ms=place.at_ms, quality=INVALID) if begin < n < end else place
        for n, place in enumerate(places)
    ]


def silent(places: Sequence[Place], begin: int, end: int) -> list[Place]:
    return [place for n, place in enumerate(places) if not begin < n < end]


@pytest.mark.parametrize("lose", [without_fix, silent])
def test_way_that_nobody_knows_is_no_mileage(
    lose: Callable[[Sequence[Place], int, int], list[Place]],
) -> None:
    """A tunnel of 200 s, at 20 m/s."""
    done = logged(lose(DAY, 700, 900))
    assert kinds(done) == "STSTS"
    first, second = trips(done)
    assert abs(first.unknown_m - 4000) < 1
    assert abs(first.metres - 6000) < 1
    assert abs(second.metres - 3000) < 0.1


def test_fix_that_is_lost_at_rest_changes_nothing() -> None:
    assert kinds(logged(without_fix(stand(0, 0, 6000, 4), 1000, 3000))) == "S"
    assert kinds(logged(silent(stand(0, 0, 6000, 4), 1000, 3000))) == "S"


def test_long_silence_ends_a_trip() -> None:
    """It is switched off on the way, and on again elsewhere."""
    way = [
        *stand(0, 0, 300),
        *drive(300, 0, 20, 100),
        *drive(5000, 50_000, 20, 100),
        *stand(5100, 52_000, 300),
    ]
    done = logged(way)
    assert kinds(done) == "STTS"
    assert [round(trip.metres, -2) for trip in trips(done)] == [2000, 2000]
    assert [trip.unknown_m for trip in trips(done)] == [0, 0]


def test_place_that_nothing_drives_to_is_left_out() -> None:
    places = list(DAY)
    for n in (100, 800, 1200):
        places[n] = replace(places[n], latitude=1.0)
    done = logged(places)
    assert kinds(done) == "STSTS"
    assert abs(trips(done)[0].metres - 10_000) < 1 and trips(done)[0].unknown_m == 0


def test_vehicle_that_was_carried_is_there() -> None:
    """By a ferry, say: the places go on far away, and nobody knows the way there."""
    way = [*stand(0, 0, 300), *drive(300, 0, 20, 100), *drive(400, 90_000, 20, 100), *stand(500, 92_000, 300)]
    [trip] = trips(logged(way))
    assert abs(trip.metres - 4000) < 50
    assert abs(trip.unknown_m - 88_000) < 100


def test_clock_that_steps_makes_no_way() -> None:
    """Places of the same time, and of before, come between."""
    places = []
    for n, place in enumerate(DAY):
        places.append(place)
        if n % 50 == 0 and n:
            places += [place, DAY[n - 40]]
    done = logged(places)
    assert kinds(done) == "STSTS"
    assert [round(trip.metres, 1) for trip in trips(done)] == [10_000, 3000]


def test_antimeridian_is_no_border() -> None:
    longitude = 180 - 5000 / DEGREE_M
    way = [at(n, 0, longitude=longitude) for n in range(300)]
    way += drive(300, 0, 20, 500, longitude)
    way += [at(800 + n, 10_000, longitude=longitude) for n in range(1, 300)]
    assert {place.longitude > 0 for place in way} == {True, False}
    done = logged(way)
    assert kinds(done) == "STS"
    assert abs(trips(done)[0].metres - 10_000) < 0.1


def test_curve_is_measured_along_the_way() -> None:
    """A circle of 1 km, at 15 m/s: its length, not its width."""
    round_m, seconds = 2 * math.pi * 1000, 419
    way = [
        Place(n * 1000, 1000 * math.sin(n * 0.015) / DEGREE_M, 1000 * math.cos(n * 0.015) / DEGREE_M, None, 0)
        for n in range(seconds)
    ]
    done = logged([*[replace(way[0], at_ms=n * 1000 - 400_000) for n in range(400)], *way])
    assert kinds(done) == "ST"
    assert abs(trips(done)[0].metres - round_m) < 0.01 * round_m


def test_nothing_is_nothing() -> None:
    assert logged([]) == []
    assert logged([at(0, 0)]) == []
    assert logged([replace(at(n, 0), quality=INVALID) for n in range(500)]) == []
