# SPDX-License-Identifier: GPL-3.0-or-later
"""Trends by HTTP and in a browser: zoom, cursor, gaps, the live end, the address, a file of what is seen."""

import contextlib
import csv
import io
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, Route, expect

from browser import LIMIT_MS, faultless, log_in
from control_room import PAGE, PASSWORD, Site, Stations, described, until
from lab.centre_client import AnswerError
from lab.vehicles import M_ME_TF_1, M_SP_TB_1, POSITION, Station, measured, position, single
from openrtu_tools.centre import rollup
from openrtu_tools.centre.codes import Content
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.intake import TRACK_COLUMNS
from openrtu_tools.centre.settings import load
from openrtu_tools.centre.store import Database, EventRow

pytestmark = pytest.mark.slow

NOW = time.time_ns()
HOUR_NS, DAY_MS = 3600 * 10**9, 86400 * 1000
DAYS = 400
BAD = (NOW - 200 * 24 * HOUR_NS, NOW - 150 * 24 * HOUR_NS)  # not valid between
expect.set_options(timeout=LIMIT_MS)


def seed(database: Database) -> None:
    """The level of more than a year, each quarter of an hour, as the intake stores it."""
    database.execute("INSERT INTO stations (name) VALUES ('north')")
    database.insert("points", ["id", "station", "ca", "ioa"], [(1, 1, 1, 4)])
    rows = []
    for at in range(NOW - DAYS * 24 * HOUR_NS, NOW - HOUR_NS, HOUR_NS // 4):
        quality = 128 if BAD[0] <= at < BAD[1] else 0
        rows.append(EventRow(1, at, 2 + math.sin(at / HOUR_NS), quality, at, 3, 1))
    database.insert("history", EventRow._fields, rows)
    rollup.mark(database, ((row.point, row.at_ns) for row in rows))
    database.insert("points", ["id", "station", "ca", "ioa", "content"], [(2, 1, 1, 1, Content.POSITION)])
    database.insert("track", TRACK_COLUMNS, [*track(NOW - 2 * HOUR_NS)])


def track(begin_ns: int) -> Iterator[tuple[int, ...]]:
    """It stands for 10 min, drives 10 km to the east at 20 m/s, and stands for 10 min."""
    for second in range(0, 1700):
        metres = 20 * min(max(second - 600, 0), 500)
        yield 2, begin_ns + second * 10**9, 0, round(metres / 111195.08 * 1e7), 1170, 0, 1


@pytest.fixture(scope="module")
def site(
    programs: Path, stations: Stations, north: Station, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Site]:
    assert PAGE.is_dir(), "the page is not built: make centre-page"
    folder = tmp_path_factory.mktemp("trends")
    made = Site(programs, folder, [described(north, folder)], PAGE)
    with contextlib.closing(open_store(load(made.file).database, alone=True)) as store:
        store.transaction(seed)
    with made:
        stations.say(north, 4, M_ME_TF_1, measured(NOW // 10**6, 2.5))
        stations.say(north, 5, M_SP_TB_1, single(NOW // 10**6, True))
        stations.say(north, 1, POSITION, position(NOW // 10**6, 0.0, 0.09, 117))
        client = made.client("vera")
        until(lambda: len([each for each in client.get("/api/points") if each["at"]]) >= 3, "the points")
        yield made


def ids(site: Site) -> dict[str, int]:
    return {point["name"]: point["id"] for point in site.client("vera").get("/api/points")}


def test_file_has_what_the_page_is_told(site: Site) -> None:
    client, of = site.client("vera"), ids(site)
    for span, columns in ((DAYS * DAY_MS, 300), (2 * DAY_MS, 1000)):
        query = f"points={of['level']},{of['fire']}&columns={columns}"
        query += f"&from={NOW // 10**6 - span}&to={NOW // 10**6}"
        told = client.get(f"/api/trends?{query}")["trends"]
        assert [(each["name"], each["unit"], each["exact"]) for each in told] == [
            ("level", "m", span < 10 * DAY_MS), ("fire", "", True),
        ]  # fmt: skip
        text = client.raw("GET", f"/api/trends?{query}&format=csv")[1].decode()
        rows = list(csv.DictReader(io.StringIO(text)))
        numbers: list[Any] = [
            [
                row["point"],
                *(
                    float(row[key]) if row[key] else None
                    for key in ("low", "high", "last", "quality", "rows")
                ),
            ]
            for row in rows
        ]
        assert numbers == [[each["name"], *column[1:]] for each in told for column in each["columns"]]
        assert {row["station"] for row in rows} == {"north"}


@pytest.mark.parametrize(
    "query",
    [
        "",
        "points=",
        "points=x",
        "points=1&columns=9",
        "points=1&columns=4001",
        "points=1&from=2&to=1",
        "points=" + ",".join("1" * 13),
    ],
)
def test_nonsense_is_refused(site: Site, query: str) -> None:
    with pytest.raises(AnswerError, match="400"):
        site.client("vera").get(f"/api/trends?{query}")


def test_point_that_is_not_there_is_not_there(site: Site) -> None:
    with pytest.raises(AnswerError, match="404"):
        site.client("vera").get("/api/trends?points=9999")


@pytest.fixture
def page(browser: Browser, site: Site) -> Iterator[Page]:
    with faultless(browser, viewport={"width": 1200, "height": 800}) as made:
        log_in(made, site.port, "vera", PASSWORD, "trends")
        yield made


def span_of(page: Page) -> tuple[float, float]:
    """From and to of the address."""
    said = page.evaluate("Object.fromEntries(new URLSearchParams(location.hash.slice('#trends/'.length)))")
    return float(said["from"]), float(said["to"])


def legend(page: Page, point: int) -> list[str]:
    return page.locator(f"tr[data-point='{point}'] td").all_inner_texts()


def test_points_are_chosen_zoomed_and_read(site: Site, page: Page) -> None:
    of = ids(site)
    expect(page.locator(".page")).to_contain_text("No point is chosen")
    page.locator(".side .list button", has_text="north").click()
    for name in ("level", "fire"):
        page.locator(".side .list .inner button", has_text=name).click()
    expect(page.locator(f"tr[data-point='{of['fire']}']")).to_contain_text("north · fire")
    expect(page.locator(f"tr[data-point='{of['level']}']")).to_contain_text("2.5 m")
    assert page.url.endswith(f"#trends/points={of['level']},{of['fire']}&span=3600000")
    page.get_by_role("button", name="Year").click()
    expect(page.get_by_role("button", name="Year")).to_have_attribute("aria-pressed", "true")
    canvas = page.locator(".u-over")
    box = canvas.bounding_box()
    assert box
    # The time is on the axis: 175 days ago nothing was valid.
    there = box["x"] + box["width"] * (1 - 175 / 365.25)
    page.mouse.move(there, box["y"] + 100)
    expect(page.locator(f"tr[data-point='{of['level']}']")).to_contain_text("invalid")
    assert legend(page, of["level"])[1] == "\N{EN DASH}"
    page.mouse.move(box["x"] + box["width"] * (1 - 90 / 365.25), box["y"] + 100)
    expect(page.locator(f"tr[data-point='{of['level']}']")).to_contain_text("good")
    assert "…" in legend(page, of["level"])[2]  # a column of many values
    # By the wheel, around the pointer.
    page.mouse.wheel(0, -100)
    page.wait_for_function("location.hash.includes('from=')")
    begin, end = span_of(page)
    assert end - begin < 0.85 * 365.25 * DAY_MS
    # By dragging.
    page.mouse.move(box["x"] + 100, box["y"] + 50)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 60)
    page.mouse.up()
    page.wait_for_function("(was) => !location.hash.includes(`from=${was}`)", arg=round(begin))
    narrow = span_of(page)
    assert abs((narrow[1] - narrow[0]) / (end - begin) - 200 / box["width"]) < 0.02
    # By keys alone.
    page.locator(".trend").focus()
    page.keyboard.press("+")
    twice = span_of(page)
    assert abs((twice[1] - twice[0]) / (narrow[1] - narrow[0]) - 0.5) < 0.01
    page.keyboard.press("PageUp")
    assert abs(span_of(page)[1] - twice[0]) < 2
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("-")
    page.keyboard.press("End")
    page.wait_for_function("location.hash.includes('span=')")


def test_address_brings_the_same_back(site: Site, page: Page) -> None:
    of = ids(site)
    end = NOW // 10**6 - 100 * DAY_MS
    address = f"#trends/points={of['fire']},{of['level']}&from={end - 30 * DAY_MS}&to={end}"
    page.evaluate("(address) => { location.hash = address; }", address)
    expect(page.locator("tr[data-point]")).to_have_count(2)
    assert page.url.endswith(address)
    with page.expect_download() as got:
        page.get_by_role("link", name="CSV").click()
    rows = list(csv.DictReader(io.StringIO(Path(got.value.path()).read_text())))
    assert {row["point"] for row in rows} == {"level"}  # fire had not said anything yet
    times = [row["time"] for row in rows]
    assert (
        times == sorted(times)
        and times[0] <= time.strftime("%Y-%m-%dT", time.gmtime(end / 1000 - 30 * 86400)) + "24"
    )


def test_live_end_goes_on(site: Site, page: Page, stations: Stations, north: Station) -> None:
    of = ids(site)
    page.evaluate(f"location.hash = '#trends/points={of['level']}&span=60000'")
    expect(page.locator("tr[data-point]")).to_have_count(1)
    stations.say(north, 4, M_ME_TF_1, measured(time.time_ns() // 10**6, 3.25))
    expect(page.locator("tr[data-point]")).to_contain_text("3.25 m")
    stations.say(north, 4, M_ME_TF_1, measured(time.time_ns() // 10**6, 0.75))
    expect(page.locator("tr[data-point]")).to_contain_text("0.75 m")


LOOK = """({colour, from, to, top, bottom}) => {
  const canvas = document.querySelector(".trend canvas"), all = canvas.getBoundingClientRect();
  const plot = document.querySelector(".u-over").getBoundingClientRect(), scale = canvas.width / all.width;
  const probe = new OffscreenCanvas(1, 1).getContext("2d");
  probe.fillStyle = colour;
  probe.fillRect(0, 0, 1, 1);
  const wanted = [...probe.getImageData(0, 0, 1, 1).data].slice(0, 3);
  const x = (part) => Math.round((plot.left - all.left + plot.width * part) * scale);
  const y = (pixels) => Math.round((plot.bottom - all.top - pixels) * scale);
  const { data } = canvas.getContext("2d").getImageData(x(from), y(top), x(to) - x(from), y(bottom) - y(top));
  const columns = new Set();
  for (let n = 0; n < data.length; n += 4) {
    const near = wanted.every((part, k) => Math.abs(part - data[n + k]) < 16);
    if (data[n + 3] > 40 && near) columns.add((n / 4) % (x(to) - x(from)));
  }
  return columns.size / (x(to) - x(from));
}"""


def coloured(page: Page, colour: str, begin: float, end: float, top: int, bottom: int) -> float:
    """Which part of the chart's width, between two parts of it and two heights, has a colour somewhere."""
    place = {"colour": colour, "from": begin, "to": end, "top": top, "bottom": bottom}
    return float(page.evaluate(LOOK, place))


def test_span_that_is_not_valid_is_seen_and_not_joined(site: Site, page: Page) -> None:
    of = ids(site)
    begin, end = (NOW - DAYS * 24 * HOUR_NS) // 10**6 + 40 * DAY_MS, NOW // 10**6 - DAY_MS
    page.evaluate(f"location.hash = '#trends/points={of['level']}&from={begin}&to={end}'")
    expect(page.locator("tr[data-point]")).to_have_count(1)
    bad = page.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--bad')")
    left, right = ((at / 10**6 - begin) / (end - begin) for at in BAD)
    until(lambda: abs(coloured(page, bad, 0, 1, 5, 1) - (right - left)) < 0.02, "the span is drawn")
    line = "#0a7bd6"
    assert coloured(page, line, left + 0.02, right - 0.02, 300, 8) == 0
    assert coloured(page, line, 0, left - 0.02, 300, 8) > 0.9


def test_file_that_is_made_is_seen_and_ended(site: Site, page: Page) -> None:
    """How far it is; a file of this history is made too soon to be seen. A centre that is away for a moment
    ends nothing."""
    file = {"id": "f00", "name": "events.csv", "octets": 3 * 2**20, "begun": 1, "fault": ""}
    told: list[dict[str, Any]] = [{**file, "state": "waits", "part": 0}]
    away = 0  # questions that had no answer

    def answer(route: Route) -> None:
        nonlocal away
        if told:
            route.fulfill(json=told)
        else:
            away += 1
            route.abort()

    def end(route: Route) -> None:
        told[:] = [{**file, "state": "ended", "part": 0.425}]
        route.fulfill(json={})

    page.route("**/api/files", answer)
    page.route("**/api/files/f00/end", end)
    page.reload()
    panel = page.locator(".files")
    expect(panel).to_contain_text("waits for its turn")
    told.clear()
    until(lambda: page.wait_for_timeout(50) or away > 1, "it is asked for again")
    expect(panel).to_contain_text("waits for its turn")
    told[:] = [{**file, "state": "made", "part": 0.425}]
    expect(panel).to_contain_text("42 %, 3 MiB")
    assert panel.locator("progress").evaluate("bar => bar.value") == 0.425
    with page.expect_request("**/api/files/f00/end") as ended:
        panel.get_by_role("button", name="Not wanted any more").click()
    assert ended.value.method == "POST"
    expect(panel).to_be_hidden()


def test_trips_of_a_vehicle(site: Site, page: Page) -> None:
    """By HTTP, as CSV, and on the page, with a profile of the speeds of one."""
    client, place = site.client("vera"), ids(site)["place"]
    kinds = [part["kind"] for part in client.get(f"/api/trips?point={place}")]
    assert kinds[:3] == ["stop", "trip", "stop"]
    text = client.raw("GET", f"/api/trips?point={place}&format=csv")[1].decode()
    trip = list(csv.DictReader(io.StringIO(text)))[1]
    assert trip["kind"] == "trip" and abs(float(trip["metres"]) - 10_000) < 1
    for wrong, status in (
        ("point=9999", 404),
        (f"point={ids(site)['level']}", 404),
        (f"point={place}&format=x", 400),
    ):
        with pytest.raises(AnswerError, match=str(status)):
            client.get(f"/api/trips?{wrong}")
    page.evaluate("location.hash = '#map'")
    page.locator(".list button", has_text="north").click()
    page.locator(".about").get_by_role("button", name="Trips").click()
    dialogue = page.locator("dialog")
    expect(dialogue).to_contain_text("10.00 km")
    expect(dialogue.locator("tr.trip").first).to_contain_text("72 km/h")
    dialogue.locator("tr.trip").last.get_by_role("button", name="trip").click()
    expect(dialogue.locator(".u-legend")).to_contain_text("km/h")
    page.keyboard.press("Escape")
    expect(dialogue).to_have_count(0)
