# SPDX-License-Identifier: GPL-3.0-or-later
"""Values along the track of a vehicle: where was it measured?"""

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from browser import LIMIT_MS, faultless, log_in
from control_room import PAGE, PASSWORD, Site, Stations, now_ms, until
from lab.vehicles import M_ME_TF_1, POSITION, Station, measured, position

pytestmark = pytest.mark.slow
expect.set_options(timeout=LIMIT_MS)


@pytest.fixture(scope="module")
def site(of_north: Callable[..., Site]) -> Iterator[Site]:
    assert PAGE.is_dir(), "the page is not built: make centre-page"
    with of_north(page=PAGE) as started:
        yield started


@pytest.fixture
def page(browser: Browser, site: Site) -> Iterator[Page]:
    with faultless(browser) as made:
        log_in(made, site.port, "vera", PASSWORD)
        yield made


def way(times: list[int]) -> dict[str, Any]:
    """To the east, a degree a second."""
    return {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": [[at, 45] for at in times]},
        "properties": {"times": [f"1970-01-01T00:00:{at:02}.000Z" for at in times]},
    }


def along(page: Page, features: list[dict[str, Any]], *held: tuple[int, float | None]) -> dict[str, Any]:
    """What the page makes of them; the values hold from these seconds on."""
    columns = [[1000 * at, None, None, value, 0, 1] for at, value in held]
    found = page.evaluate(
        "async ([features, columns]) => (await import('./js/along.js')).along({ features }, columns)",
        [features, columns],
    )
    assert isinstance(found, dict)
    return found


def pieces(found: dict[str, Any]) -> list[tuple[float | None, list[int]]]:
    return [
        (each["properties"].get("shade"), [at for at, _ in each["geometry"]["coordinates"]])
        for each in found["ways"]["features"]
    ]


def test_each_piece_has_what_held_where_it_begins(page: Page) -> None:
    found = along(page, [way([0, 1, 2, 3, 4, 5])], (0, 10.0), (2, 30.0), (4, 20.0))
    assert pieces(found) == [(0, [0, 1, 2]), (1, [2, 3, 4]), (0.5, [4, 5])]
    assert (found["low"], found["high"]) == (10, 30)


def test_what_is_not_known_is_no_value(page: Page) -> None:
    """Before the first value, and while it is not valid; a gap stays one."""
    found = along(page, [way([0, 1, 2, 3]), way([6, 7])], (1, 5.0), (2, None))
    assert pieces(found) == [(-1, [0, 1]), (0, [1, 2]), (-1, [2, 3]), (-1, [6, 7])]
    assert (found["low"], found["high"]) == (5, 5)


def test_without_any_value_all_is_unknown(page: Page) -> None:
    mark = {"type": "Feature", "geometry": {"type": "Point", "coordinates": [9, 45]}, "properties": {}}
    found = along(page, [way([0, 1]), mark])
    assert pieces({"ways": {"features": found["ways"]["features"][:1]}}) == [(-1, [0, 1])]
    assert found["ways"]["features"][1] == mark
    assert (found["low"], found["high"]) == (None, None)


def test_a_track_is_coloured_by_a_point(page: Page, site: Site, stations: Stations, north: Station) -> None:
    begin = now_ms() - 600_000
    places = [position(begin + 1000 * second, 44 + second / 1000, 20.5) for second in range(10)]
    stations.keep(north, 1, POSITION, places)
    stations.keep(
        north, 4, M_ME_TF_1, [measured(begin + 1000 * at, value) for at, value in ((1, 1.5), (5, 4.0))]
    )
    client = site.client("vera")
    until(
        lambda: sum(len(each["properties"]["times"]) for each in client.get("/api/tracks")["features"]) >= 10,
        "the way is stored",
    )
    page.locator(".list button", has_text="north").click()
    choice = page.get_by_label("Values along it")
    choice.select_option("level")
    scale = page.locator("#scale")
    expect(scale).to_contain_text("1.5 m")
    expect(scale).to_contain_text("4 m")
    choice.select_option("pump")
    expect(scale).to_contain_text("nothing valid")
    choice.select_option("")
    expect(scale).to_be_hidden()
