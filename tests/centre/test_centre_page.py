# SPDX-License-Identifier: GPL-3.0-or-later
"""The page in a browser: all of it from here, no name that runs, each fate of a command, keys alone."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Page, Route, WebSocketRoute, expect
from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import write

from browser import LIMIT_MS, faultless, log_in, look_into, tab_to, tool
from control_room import PAGE, PASSWORD, POINTS, Site, Stations, described, now_ms, until
from lab.centre_client import AnswerError
from lab.vehicles import M_ME_TF_1, M_SP_TB_1, POSITION, Station, measured, position, single

pytestmark = pytest.mark.slow

EVIL = "<img src=x onerror=alert(1)>"
BELGRADE = (44.8125, 20.4612)
INVALID = 128  # of a quality
ANSWER_MS = 60_000  # rtu-centre waits 10 s for an answer
expect.set_options(timeout=LIMIT_MS)


def field(number: int, octets: bytes) -> bytes:
    """Of protobuf, with a length below 128."""
    return bytes([number << 3 | 2, len(octets)]) + octets


def road() -> bytes:
    """A vector tile of the whole world: a line of the layer roads along the equator."""
    geometry = bytes([9, 0, 0x80, 0x20, 10, 0x80, 0x40, 0])  # move to (0, 2048), a line by (4096, 0)
    feature = bytes([3 << 3, 2]) + field(4, geometry)
    return field(3, field(1, b"roads") + field(2, feature) + bytes([5 << 3, 0x80, 0x20, 15 << 3, 2]))


def own_map(path: Path) -> None:
    """Written by the library of others; its attribution is an attack."""
    header = {
        "tile_type": TileType.MVT, "tile_compression": Compression.NONE, "center_zoom": 0,
        "min_lon_e7": -1_800_000_000, "min_lat_e7": -850_000_000, "max_lon_e7": 1_800_000_000,
        "max_lat_e7": 850_000_000, "center_lon_e7": 0, "center_lat_e7": 0,
    }  # fmt: skip
    with write(path) as writer:
        writer.write_tile(zxy_to_tileid(0, 0, 0), road())
        writer.finalize(header, {"vector_layers": [{"id": "roads"}], "attribution": f"{EVIL}Road Office"})


@pytest.fixture(scope="module")
def site(
    programs: Path, stations: Stations, north: Station, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Site]:
    """A vehicle with points, and a station whose names are an attack."""
    assert PAGE.is_dir(), "the page is not built: make centre-page"
    folder = tmp_path_factory.mktemp("page")
    own_map(folder / "map.pmtiles")
    evil = stations.station()
    described_evil = described(
        evil, folder, EVIL, POINTS.replace("pump", EVIL), group=EVIL, location=[40.0, 20.0]
    )
    guarded = stations.station()
    gate = "ca,ioa,type,command_type,name\n1,3,M_SP_NA_1,C_SC_NA_1,gate\n"
    described_gate = described(guarded, folder, "gate house", gate, release=True)
    with Site(programs, folder, [described(north, folder), described_evil, described_gate], PAGE) as started:
        stations.say(north, 1, POSITION, position(now_ms(), *BELGRADE, 117))
        for ioa in (2, 3, 5):
            stations.say(north, ioa, M_SP_TB_1, single(now_ms(), False))
            stations.say(evil, ioa, M_SP_TB_1, single(now_ms(), ioa == 5))
        stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1.5))
        client = started.client("vera")
        until(lambda: len([each for each in client.get("/api/points") if each["at"]]) >= 8, "the points")
        yield started
    for station in (evil, guarded):
        stations.do(station.stop())


@pytest.fixture
def asked() -> list[str]:
    """The addresses that the page asks."""
    return []


@pytest.fixture
def page(browser: Browser, site: Site, asked: list[str]) -> Iterator[Page]:
    """Logged in as an operator; no script fails, and no dialogue of the browser opens."""
    with faultless(browser, viewport={"width": 1100, "height": 700}, color_scheme="dark") as made:
        made.on("request", lambda request: asked.append(request.url))
        log_in(made, site.port, "olga", PASSWORD, "stations")
        yield made


def view(page: Page, name: str) -> None:
    page.keyboard.press({"map": "1", "points": "2", "alarms": "3", "stations": "4"}[name])
    expect(page.locator(f"nav a[href='#{name}']")).to_have_attribute("aria-current", "page")


def load_again(page: Page) -> None:
    """Until it is logged in: before, no key does anything."""
    page.reload()
    page.wait_for_selector("nav")


def points_of_north(page: Page) -> None:
    """Until they are shown, those of another station are there: a click would be on these."""
    view(page, "points")
    page.locator(".side .list button", has_text="north").click()
    expect(page.locator("h2", has_text="Points of north")).to_be_visible()


def is_connected(site: Site) -> None:
    """Whatever a test before has done to it."""
    client = site.client("olga")
    until(
        lambda: next(each["link"] for each in client.get("/api/stations") if each["name"] == "north") == 3,
        "north is connected",
    )


def open_command(page: Page, point: str) -> None:
    points_of_north(page)
    page.locator("tr", has_text=point).locator("button.small").click()


def outcome(page: Page) -> str:
    return page.locator("dialog .outcome strong").inner_text()


def test_every_view_asks_only_this_machine_and_runs_no_name(page: Page, asked: list[str], site: Site) -> None:
    for name in ("stations", "points", "map", "alarms"):
        view(page, name)
        page.locator("main").get_by_text(EVIL).first.wait_for()
        assert page.locator("img[src=x]").count() == 0
    for tab in ("Events", "Commands"):
        page.get_by_role("button", name=tab).click()
    expect(page.locator("h2", has_text="Commands")).to_be_visible()
    hosts = {urlsplit(url).netloc for url in asked if not url.startswith(("blob:", "data:"))}
    assert hosts == {f"127.0.0.1:{site.port}"}


def green_middle(page: Page) -> dict[str, float]:
    """The middle of what has the colour of a good value (--good of the dark theme), in pixels of the map."""
    picture = page.locator(".maplibregl-canvas").screenshot()
    found = look_into(
        page,
        picture,
        """(pen) => {
          const { data, width } = pen.getImageData(0, 0, pen.canvas.width, pen.canvas.height);
          let x = 0, y = 0, count = 0;
          for (let i = 0; i < data.length; i += 4) {
            if (Math.hypot(data[i] - 76, data[i + 1] - 195, data[i + 2] - 138) > 30) continue;
            x += (i / 4) % width + 0.5;
            y += Math.floor(i / 4 / width) + 0.5;
            count++;
          }
          return { x: x / count, y: y / count, count };
        }""",
    )
    return dict(found)


def open_map(page: Page) -> None:
    """The legend, which has the markers' colours, is put away."""
    view(page, "map")
    until(lambda: page.evaluate("Boolean(openrtuMap.style?.getLayer('marks'))"), "the map")
    page.evaluate("document.querySelector('.legend').remove()")


def green_is_at_belgrade(page: Page) -> bool:
    middle = green_middle(page)
    wanted = page.evaluate(f"openrtuMap.project([{BELGRADE[1]}, {BELGRADE[0]}])")
    return middle["count"] > 50 and all(abs(middle[axis] - wanted[axis]) <= 1 for axis in "xy")


# The map goes to all its places by itself when it is told where they are, and leaves what it was to show.
IS_YET_TO_GO = "openrtuMap.getZoom() === 3.2"


def marker_is_seen(page: Page, stations: Stations, north: Station) -> None:
    """Within a pixel of its place, once it is all drawn."""

    def is_there() -> bool:
        stations.say(north, 1, POSITION, position(now_ms(), *BELGRADE, 117))
        if page.evaluate(IS_YET_TO_GO):
            return False
        look_at(page, 20.4, 44.8, 10)
        return green_is_at_belgrade(page)

    until(is_there, "a green marker at its place")


def still_green(page: Page, stations: Stations, north: Station) -> bool:
    """Though its connection may be lost meanwhile, on a busy host."""
    stations.say(north, 1, POSITION, position(now_ms(), *BELGRADE, 117))
    return green_is_at_belgrade(page)


def test_marker_is_where_the_vehicle_is(page: Page, stations: Stations, north: Station) -> None:
    open_map(page)
    marker_is_seen(page, stations, north)


LOSE = """() => {
  const context = openrtuMap.getCanvas().getContext("webgl2").getExtension("WEBGL_lose_context");
  openrtuMap.once("webglcontextlost", () => {
    window.lost = true;
    setTimeout(() => context.restoreContext());
  });
  context.loseContext();
}"""


def test_marker_is_back_after_a_lost_context_and_in_another_theme(
    page: Page, stations: Stations, north: Station
) -> None:
    open_map(page)
    marker_is_seen(page, stations, north)
    page.evaluate(LOSE)
    until(lambda: page.evaluate("window.lost && Boolean(openrtuMap.style?.getLayer('marks'))"), "it is back")
    marker_is_seen(page, stations, north)
    page.locator("#theme").click()
    page.locator("#theme").click()
    marker_is_seen(page, stations, north)


LABELS = """() => openrtuMap.getLayer("labels")
  ? openrtuMap.queryRenderedFeatures({ layers: ["labels"] }).map((each) => each.properties.label) : []"""


def test_marker_has_a_text_and_is_chosen_by_a_pointer(page: Page, stations: Stations, north: Station) -> None:
    """Its name; what is not good has its word and age, too."""
    open_map(page)
    marker_is_seen(page, stations, north)
    until(lambda: "north" in page.evaluate(LABELS), "the text of a good one")
    place = page.evaluate(f"openrtuMap.project([{BELGRADE[1]}, {BELGRADE[0]}])")
    page.locator(".maplibregl-canvas").click(position={"x": place["x"] + 5, "y": place["y"]})
    expect(page.locator(".about h2")).to_have_text("north")
    stations.say(north, 1, POSITION, position(now_ms(), 0, 0, fix=0))  # in a tunnel
    until(
        lambda: any(re.fullmatch(r"north\ninvalid, \d+ \w+", each) for each in page.evaluate(LABELS)),
        "the text of an invalid one",
    )
    expect(page.locator(".about dl")).to_contain_text(f"{BELGRADE[0]:.6f}°")
    stations.say(north, 1, POSITION, position(now_ms(), *BELGRADE, 117))


# They stay when the centre tells all that a moved map shows, which is without them.
MANY = """async (quality) => {
  const live = await import("./js/live.js");
  const add = () => {
    const station = [...live.stations.keys()][0];
    for (let number = 0; number < 10000; number++) {
      const place = { latitude: 40 + (number % 100) / 10, longitude: 15 + Math.floor(number / 100) / 10 };
      const id = 1e6 + number;
      live.points.set(id, { id, station, name: "", content: 100, at: live.now(), quality, ...place });
    }
  };
  add();
  live.watch(add);
}"""
# A map whose style comes anew is without the layer until it is dressed again.
DRAWN = "openrtuMap.getLayer('marks')?.implementation.places.length"
MOVED_SHEET = "openrtuMap.getLayer('marks')?.implementation.shift?.some(Boolean)"
# Whether a pointer at its place finds it.
AT = """(number) => {
  const marks = openrtuMap.getLayer("marks")?.implementation;
  const place = marks?.places.find((each) => each.id === `p${1e6 + number}`);
  return place && marks.under({ toArray: () => place.lngLat }).id === place.id;
}"""


def look_at(page: Page, longitude: float, latitude: float, zoom: int) -> None:
    """At each look: the map goes to all its places by itself when it sees the first of them."""
    page.evaluate(f"openrtuMap.jumpTo({{center: [{longitude}, {latitude}], zoom: {zoom}}})")
    page.wait_for_timeout(500)  # it is drawn meanwhile, or at the next look


def show_many(page: Page, quality: int) -> None:
    page.evaluate(MANY, quality)
    until(lambda: (page.evaluate(DRAWN) or 0) >= 10_000, "all are drawn")


def test_marker_stays_at_its_place_while_ten_thousand_are_dragged(
    page: Page, stations: Stations, north: Station
) -> None:
    """It is the only good one among them."""
    open_map(page)
    show_many(page, quality=INVALID)
    marker_is_seen(page, stations, north)
    canvas = page.locator(".maplibregl-canvas").bounding_box()
    assert canvas
    page.mouse.move(canvas["x"] + 300, canvas["y"] + 200)
    page.mouse.down()
    for x, y in ((340, 215), (397, 231), (330, 283)):
        page.mouse.move(canvas["x"] + x, canvas["y"] + y, steps=4)
        until(lambda: page.evaluate(MOVED_SHEET), "the sheet of all, moved")
        until(lambda: still_green(page, stations, north), "the good one at its place")
    page.mouse.up()
    marker_is_seen(page, stations, north)


def test_ten_thousand_markers_have_texts_where_these_can_be_read(page: Page) -> None:
    def texts(longitude: float, latitude: float, zoom: int) -> list[str]:
        look_at(page, longitude, latitude, zoom)
        return page.evaluate(LABELS)

    open_map(page)
    show_many(page, quality=0)
    until(lambda: texts(20, 45, 5) == [], "no text can be read")
    for number in (0, 99, 4321, 9999):
        until(lambda number=number: page.evaluate(AT, number), f"a pointer finds number {number}")
    until(lambda: texts(20.05, 45.05, 11), "texts")


# Of the next piece Chromium says If-Range, where it stores pieces. What the map asked for lies elsewhere.
PIECE = """async (octets) => {
    const answer = await fetch("/map/own.pmtiles?piece", { headers: { Range: `bytes=${octets}` } });
    return [answer.status, await answer.text()];
}"""


@contextmanager
def another_map(file: Path, octets: bytes) -> Iterator[None]:
    """In its place for a while: with it no centre would start."""
    own, other = file.with_suffix(".own"), file.with_suffix(".other")
    own.hardlink_to(file)
    other.write_bytes(octets)
    other.replace(file)
    try:
        yield
    finally:
        own.replace(file)


def test_map_of_ones_own(page: Page, site: Site) -> None:
    """It is drawn, by ranges of its file, and so is one in its place; and only for who has logged in."""
    view(page, "map")
    expect(page.locator(".maplibregl-ctrl-bottom-right")).to_contain_text("Road Office")
    drawn = "Boolean(openrtuMap.getLayer('own-line-roads'))"
    until(lambda: page.evaluate(drawn), "its layer")

    def road_is_seen() -> bool:
        look_at(page, 0, 0, 2)
        return bool(page.evaluate("openrtuMap.queryRenderedFeatures({layers: ['own-line-roads']}).length"))

    until(road_is_seen, "its road")
    assert page.evaluate(PIECE, "0-6") == [206, "PMTiles"]
    with another_map(site.folder / "map.pmtiles", b"PMTiles of another maker"):
        assert page.evaluate(PIECE, "7-23") == [206, " of another maker"]
    client = site.client("vera")
    response, octets = client.raw("GET", "/map/own.pmtiles", Range="bytes=0-6")
    assert (response.status, octets) == (206, b"PMTiles")
    with pytest.raises(AnswerError) as refused:
        site.client().raw("GET", "/map/own.pmtiles")
    assert refused.value.status == 401


def test_replay_shows_where_it_was(page: Page, site: Site, stations: Stations, north: Station) -> None:
    """Half an hour ago it was elsewhere; when replay ends it is back."""
    begin = now_ms() - 1_800_000
    way = [position(begin + 1000 * second, 43.5 + second / 1000, 21.5) for second in range(10)]
    stations.keep(north, 1, POSITION, way)
    stations.say(north, 1, POSITION, position(now_ms(), *BELGRADE, 117))
    client = site.client("vera")
    path = f"/api/tracks?from={begin}&to={begin + 10_000}"
    until(
        lambda: [len(each["properties"]["times"]) for each in client.get(path)["features"]] == [10],
        "it is stored",
    )
    view(page, "map")
    page.locator(".list button", has_text="north").click()
    page.get_by_role("button", name="Replay").click()
    slider = page.locator(".replay input[type=range]")
    expect(slider).to_have_attribute("step", "1000")
    slider.evaluate(
        "(input, at) => { input.value = String(at); input.dispatchEvent(new Event('input')); }",
        begin + 60_000,
    )
    expect(page.locator(".about dl")).to_contain_text("43.509000°")
    slider.evaluate(
        "(input, at) => { input.value = String(at); input.dispatchEvent(new Event('input')); }",
        begin + 600_000,
    )
    expect(page.locator(".list li", has_text="north").locator(".state")).to_have_text("old")
    page.locator(".replay").get_by_role("button", name="Close").click()
    expect(page.locator(".about dl")).to_contain_text(f"{BELGRADE[0]:.6f}°")
    expect(page.locator(".replay")).to_be_hidden()


def test_map_by_keys_alone(page: Page, stations: Stations, north: Station) -> None:
    """A vehicle is found and chosen; the map is moved; replay begins and ends. Without a pointer."""
    stations.say(north, 1, POSITION, position(now_ms(), *BELGRADE, 117))
    page.keyboard.press("1")
    page.keyboard.press("/")
    page.keyboard.type("nor")
    vehicle = page.locator(".list button", has_text="north")
    tab_to(page, vehicle)
    page.keyboard.press("Enter")
    expect(page.locator(".about dl")).to_contain_text(f"{BELGRADE[0]:.6f}°")
    until(lambda: not page.evaluate("openrtuMap.isMoving()"), "the map where the vehicle is")
    canvas = page.locator(".maplibregl-canvas")
    tab_to(page, canvas)
    where = "[openrtuMap.getCenter().lng, openrtuMap.getZoom()]"
    before = page.evaluate(where)
    page.keyboard.press("ArrowRight")
    until(lambda: page.evaluate(where)[0] > before[0], "it is moved")
    page.keyboard.press("-")
    until(lambda: page.evaluate(where)[1] < before[1], "it is smaller")
    tab_to(page, page.get_by_role("button", name="Replay"))
    page.keyboard.press("Enter")
    slider = page.locator(".replay input[type=range]")
    expect(slider).to_have_attribute("step", "1000")  # it is loaded
    tab_to(page, slider)
    at = int(slider.input_value())
    page.keyboard.press("ArrowRight")
    until(lambda: int(slider.input_value()) > at, "it is later")
    tab_to(page, page.locator(".replay").get_by_role("button", name="Close"))
    page.keyboard.press("Enter")
    expect(page.locator(".replay")).to_be_hidden()


def test_command_by_keys_alone(page: Page, site: Site, north: Station) -> None:
    """From the view to the end of a command, without a pointer. A second Enter behind the first does no more
    than to cancel."""
    is_connected(site)
    north.commanded.clear()
    page.keyboard.press("2")
    page.locator(".side .list button", has_text="north").focus()
    page.keyboard.press("Enter")
    expect(page.locator("h2", has_text="Points of north")).to_be_visible()
    page.locator("tr", has_text="pump").locator("button.small").focus()
    page.keyboard.press("Enter")
    expect(page.locator("dialog .choices button").first).to_be_focused()
    page.keyboard.press("Tab")
    page.keyboard.press("Space")
    for _ in range(2):
        page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="Execute")).to_be_enabled()
    expect(page.get_by_role("button", name="Cancel")).to_be_focused()
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    expect(page.locator("dialog .outcome")).to_have_class("outcome good")
    assert outcome(page) == "Executed"
    assert north.commanded == [(2, 1)]
    page.keyboard.press("Escape")
    expect(page.locator("dialog")).to_have_count(0)


def test_second_person_is_told_and_releases(page: Page, site: Site, stations: Stations) -> None:
    """Olga, at the page, releases what Omar has selected."""
    omar = site.client("omar")
    guarded = next(each for each in omar.get("/api/points") if each["name"] == "gate")
    sent = omar.post("/api/commands", {"point": guarded["id"], "value": 1})
    page.get_by_text("omar waits for a release").click()
    page.locator("td").get_by_role("button", name="Release").click()
    until(lambda: omar.get(f"/api/commands/{sent['id']}")["state"] == 9, "it is executed")
    expect(page.get_by_text("omar waits for a release")).to_be_hidden()


@pytest.mark.parametrize(
    ("manner", "kind", "words"),
    [
        ("refuse", "bad", "Refused by the station"),
        ("hang up", "old", "Fate unknown"),
        pytest.param("silent", "old", "No answer in time", marks=pytest.mark.slow),
    ],
)
def test_each_fate_looks_its_own(
    page: Page, site: Site, north: Station, manner: str, kind: str, words: str
) -> None:
    is_connected(site)
    open_command(page, "lamp")
    north.manner = manner
    page.locator("dialog .choices button").nth(1).click()
    page.locator("dialog button.main").click()
    expect(page.locator("dialog .outcome")).to_have_class(f"outcome {kind}", timeout=ANSWER_MS)
    north.manner = "done"
    assert outcome(page) == words


def test_escape_leaves_no_selection(page: Page, site: Site, north: Station) -> None:
    is_connected(site)
    client = site.client("olga")
    open_command(page, "pump")
    page.locator("dialog .choices button").nth(0).click()
    page.locator("dialog button.main").click()
    expect(page.locator("dialog button.main")).to_have_text("Execute")
    page.keyboard.press("Escape")
    until(lambda: client.get("/api/commands")[0]["state"] == 5, "the selection is cancelled")


def test_escape_before_the_answer_leaves_no_selection(page: Page, site: Site) -> None:
    """On a slow network the answer comes when the dialogue is gone."""
    is_connected(site)
    client = site.client("olga")
    before = len(client.get("/api/commands"))
    asked: list[Route] = []
    page.route("**/api/commands", lambda route: asked.append(route))
    open_command(page, "pump")
    page.locator("dialog .choices button").nth(1).click()
    page.locator("dialog button.main").click()
    until(lambda: page.wait_for_timeout(20) or asked, "it is asked")
    page.keyboard.press("Escape")
    expect(page.locator("dialog")).to_have_count(0)
    asked[0].continue_()
    until(
        lambda: (
            page.wait_for_timeout(20)
            or (len(client.get("/api/commands")) > before and client.get("/api/commands")[0]["state"] == 5)
        ),
        "the selection is cancelled",
    )


def test_answer_is_ordered_by_what_it_says_and_not_by_a_clock(page: Page, site: Site) -> None:
    """The times of a command are of two programs; a clock may be set back, and a busy one looks late."""
    is_connected(site)

    def later(route: Route) -> None:
        answer = route.fetch()
        route.fulfill(response=answer, json={**answer.json(), "changed": now_ms() + 3_600_000})

    page.route("**/api/commands", later)
    open_command(page, "pump")
    page.locator("dialog .choices button").nth(1).click()
    page.locator("dialog button.main").click()
    expect(page.get_by_role("button", name="Execute")).to_be_enabled()
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator("dialog .outcome")).to_have_class("outcome none")


def test_end_of_a_command_that_came_without_a_connection_is_told(page: Page, site: Site) -> None:
    """Who comes back is told all that is, and that command is no more."""
    is_connected(site)
    client = site.client("olga")
    sockets: list[WebSocketRoute] = []
    is_cut = False

    def through(socket: WebSocketRoute) -> None:
        if is_cut:
            socket.close()
        else:
            socket.connect_to_server()
            sockets.append(socket)

    page.route_web_socket("**/api/stream", through)
    load_again(page)
    open_command(page, "pump")
    page.locator("dialog .choices button").nth(1).click()
    page.locator("dialog button.main").click()
    expect(page.get_by_role("button", name="Execute")).to_be_enabled()
    is_cut = True
    sockets[-1].close()
    expect(page.locator(".banner")).to_contain_text("No connection to the centre")
    selected = client.get("/api/commands")[0]["id"]
    client.post(f"/api/commands/{selected}/cancel")
    until(lambda: client.get(f"/api/commands/{selected}")["state"] == 5, "it is cancelled")
    is_cut = False
    expect(page.locator("dialog .outcome")).to_have_class("outcome none")


def test_list_that_comes_slowly_is_shown_and_not_asked_for_meanwhile(page: Page) -> None:
    asked: list[Route] = []
    page.clock.install()
    page.route("**/api/events?*", lambda route: asked.append(route))
    load_again(page)
    view(page, "alarms")
    page.get_by_role("button", name="Events").click()
    until(lambda: page.wait_for_timeout(20) or asked, "it is asked for")
    page.clock.run_for(60_000)
    assert page.evaluate("fetch('api/me').then((answer) => answer.status)") == 200  # behind all others
    assert len(asked) == 1
    event = {"id": 1, "at": now_ms(), "station": 1, "point": 1, "value": 1, "quality": 0, "cause": 3}
    asked[0].fulfill(json=[event])
    expect(page.locator("tbody tr")).to_have_count(1)
    page.clock.run_for(10_000)
    until(lambda: page.wait_for_timeout(20) or len(asked) == 2, "it is asked for again")


def test_events_have_the_word_of_their_quality(page: Page, stations: Stations, north: Station) -> None:
    for bit in (0, 1, 16, 32, 64, 128):
        stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1.5, bit))
    view(page, "alarms")
    page.get_by_role("button", name="Events").click()
    for word in ("good", "overflow", "blocked", "substituted", "not topical", "invalid"):
        expect(page.locator("td .state", has_text=re.compile(f"^{word}$")).first).to_be_visible()
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1.5))


def test_absent_station_is_told_and_nothing_waits(
    page: Page, site: Site, north: Station, stations: Stations
) -> None:
    open_command(page, "lamp")
    north.commanded.clear()
    stations.do(north.stop())
    expect(page.locator("dialog .state.none")).to_have_text("no link")
    page.locator("dialog .choices button").nth(1).click()
    page.locator("dialog button.main").click()
    expect(page.locator("dialog .outcome")).to_contain_text("The station is not connected")
    assert outcome(page) == "Not sent"
    stations.do(north.listen())
    is_connected(site)
    assert not north.commanded


def test_alarm_is_acknowledged_by_two_at_once(
    page: Page, site: Site, stations: Stations, north: Station
) -> None:
    view(page, "alarms")
    row = page.locator("tr", has_text="level is too high")
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 9))
    expect(row).to_be_visible()
    page.route("**/acknowledge", lambda route: (first(), route.continue_()))
    other = site.client("omar")

    def first() -> None:
        """The other one is a moment faster."""
        alarm = next(each for each in other.get("/api/alarms") if each["kind"] == "high")
        other.post(f"/api/alarms/{alarm['id']}/acknowledge")

    row.get_by_role("button", name="Acknowledge").click()
    expect(page.locator(".error")).to_contain_text("was first")
    expect(row).to_contain_text("omar")
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1))
    page.mouse.move(5, 5)
    expect(row).to_have_count(0)


def test_point_is_found_and_its_last_hour_is_a_chart_and_a_file(
    page: Page, stations: Stations, north: Station
) -> None:
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1.25))
    points_of_north(page)
    page.locator("#search").fill("level")
    rows = page.locator("tbody tr:not(.device)")
    expect(rows).to_have_count(1)
    rows.locator("button.link").click()
    expect(page.locator(".chart canvas")).to_be_visible()
    expect(page.locator(".chart .u-legend")).to_contain_text("level")
    with page.expect_download() as download:
        page.get_by_role("link", name="CSV").click()
    assert re.search(r"\b1\.25\b", download.value.path().read_text())
    page.get_by_role("button", name="Earlier").click()
    expect(page.locator(".chart")).to_have_text("No change in this time")
    page.get_by_role("button", name="Later").click()
    expect(page.locator(".chart canvas")).to_be_visible()
    full = [
        {"at": now_ms() - 5000 + number, "value": 1.5, "quality": 0, "cause": 3} for number in range(5000)
    ]
    page.route("**/history?from=*", lambda route: route.fulfill(json=full))
    page.get_by_role("button", name="The last week").click()
    expect(page.locator(".chart p")).to_contain_text("Only the newest 5000 values")
    expect(page.locator(".chart canvas")).to_be_visible()


def test_map_follows_the_chosen_vehicle(page: Page, stations: Stations, north: Station) -> None:
    view(page, "map")
    page.locator(".side .list button", has_text="north").first.click()
    page.get_by_role("button", name="Follow").click()

    def is_in_the_middle() -> bool:
        stations.say(north, 1, POSITION, position(now_ms(), BELGRADE[0] + 0.2, BELGRADE[1], 117))
        longitude, latitude = page.evaluate("openrtuMap.getCenter().toArray()")
        return abs(longitude - BELGRADE[1]) < 1e-4 and abs(latitude - BELGRADE[0] - 0.2) < 1e-4

    until(is_in_the_middle, "the map where the vehicle is now")
    stations.say(north, 1, POSITION, position(now_ms(), *BELGRADE, 117))


# Each tone that the page begins.
TONES = """() => {
  window.tones = 0;
  const start = OscillatorNode.prototype.start;
  OscillatorNode.prototype.start = function (...when) { window.tones += 1; return start.apply(this, when); };
}"""


def test_alarm_sounds_and_is_shelved(page: Page, stations: Stations, north: Station) -> None:
    view(page, "alarms")
    page.evaluate(TONES)
    heard = page.evaluate("tones")
    row = page.locator("tr", has_text="level is too high")
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 9))
    expect(row).to_be_visible()
    until(lambda: page.evaluate("tones") > heard, "a tone of the alarm")
    row.get_by_role("button", name="Shelve").click()
    page.get_by_label("Reason").fill("pump test")
    page.keyboard.press("Enter")
    shelved = page.get_by_role("button", name="Shelved (1)")
    expect(shelved).to_be_visible()
    page.locator("h2", has_text="Alarms").click()
    expect(row).to_have_count(0)
    shelved.click()
    expect(row).to_contain_text("shelved until")
    expect(row).to_contain_text("pump test")
    row.get_by_role("button", name="Unshelve").click()
    row.get_by_role("button", name="Acknowledge").click()
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1))
    expect(row).to_contain_text("gone")
    page.mouse.move(5, 5)
    expect(row).to_have_count(0)
    page.get_by_role("button", name="Past alarms").click()
    page.locator("main").get_by_label("What").select_option("high")
    expect(row.first).to_be_visible()
    expect(page.locator("tbody tr", has_text="lost")).to_have_count(0)


def test_no_row_slides_under_the_pointer_and_many_are_acknowledged_at_once(
    page: Page, stations: Stations, north: Station
) -> None:
    """A click is meant for what is under it; active alarms stand before those that are gone."""
    view(page, "alarms")
    low = page.locator("tr", has_text="level is too high")
    fire = page.locator("tbody tr", has_text="fire").filter(has_text="north")
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 9))
    expect(low).to_be_visible()
    page.get_by_placeholder("Search").fill("NORTH")
    low.get_by_role("button", name="Acknowledge").hover()

    def top() -> float:
        box = low.bounding_box()
        assert box
        return box["y"]

    before = top()
    stations.say(north, 5, M_SP_TB_1, single(now_ms(), True))
    expect(fire).to_be_visible()
    assert top() == before
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1))
    expect(low).to_contain_text("gone")
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 9))
    expect(low).to_contain_text("1 \N{MULTIPLICATION SIGN} again")
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1))
    expect(low).to_contain_text("gone")
    assert top() == before
    page.mouse.move(5, 5)
    expect(page.locator("tbody tr").first).to_contain_text("fire")
    page.get_by_role("button", name="Acknowledge shown").click()
    expect(low).to_have_count(0)
    stations.say(north, 5, M_SP_TB_1, single(now_ms(), False))
    expect(fire).to_have_count(0)


def test_lost_connection_is_shown_and_comes_back(
    page: Page, site: Site, stations: Stations, north: Station
) -> None:
    """What was told meanwhile is there then."""
    points_of_north(page)
    expect(page.locator("td.value").first).to_be_visible()
    site.kill(site.centre)
    expect(page.locator(".banner")).to_contain_text("No connection to the centre")
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 3.75))
    site.start_centre()
    expect(page.locator(".banner")).to_be_hidden()
    expect(page.locator("td.value", has_text="3.75")).to_be_visible()
    site.kill(site.collector)
    expect(page.locator(".banner")).to_contain_text("rtu-centre is not running")
    expect(page.locator("td .state.none").first).to_have_text("no link")
    site.start_collector()
    expect(page.locator(".banner")).to_be_hidden()


def test_languages_theme_and_logout(page: Page) -> None:
    for language, word in (("de", "Karte"), ("sr", "Карта"), ("es", "Mapa"), ("en", "Map")):
        page.locator("#language").select_option(language)
        expect(page.locator("nav a").first).to_have_text(word)
    page.locator("#theme").click()
    expect(page.locator("html")).to_have_attribute("data-theme", "light")
    page.set_viewport_size({"width": 360, "height": 640})
    for name in ("stations", "points", "map", "alarms"):
        page.locator(f"nav a[href='#{name}']").click()
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
    tool(page, "#logout").click()
    expect(page.locator("#name")).to_be_focused()
    page.reload()
    expect(page.locator("#name")).to_be_visible()


@pytest.fixture
def engineer(browser: Browser, site: Site) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 360, "height": 700}, locale="en-GB")
    made = context.new_page()
    log_in(made, site.port, "emil", PASSWORD, "users")
    yield made
    context.close()


def test_engineer_manages_users_by_keys_alone(engineer: Page, site: Site) -> None:
    """On a phone's width. A wrong password of one's own changes nothing."""
    engineer.get_by_role("button", name="Add user").press("Enter")
    dialog = engineer.locator("dialog")
    expect(dialog.get_by_label("Name")).to_be_focused()
    for typed in ("ines", "o", None, PASSWORD, None, "wrong password"):
        if typed:
            engineer.keyboard.type(typed)
        engineer.keyboard.press("Tab")
    engineer.keyboard.press("Shift+Tab")
    dialog.get_by_label(EVIL).press("Space")
    dialog.get_by_label("Your own password").press("Enter")
    expect(dialog.locator(".error")).to_have_text("Your own password is wrong.")
    assert not [each for each in site.client("emil").get("/api/users") if each["name"] == "ines"]
    dialog.get_by_label("Your own password").fill(PASSWORD)
    dialog.get_by_label("Your own password").press("Enter")
    row = engineer.locator("tr", has_text="ines")
    expect(row).to_contain_text("Operator")
    expect(row).to_contain_text(EVIL)
    assert [each["name"] for each in site.client("ines").get("/api/stations")] == [EVIL]
    row.get_by_role("button", name="Change").press("Enter")
    dialog.get_by_label("disabled").press("Space")
    dialog.get_by_label("Your own password").fill(PASSWORD)
    dialog.get_by_label("Your own password").press("Enter")
    expect(row).to_contain_text("disabled")
    with pytest.raises(AnswerError):
        site.client("ines")
    row.get_by_role("button", name="Change").press("Enter")
    dialog.get_by_label("Your own password").fill(PASSWORD)
    dialog.get_by_role("button", name="Remove").press("Enter")
    expect(row).to_have_count(0)


def test_groups_are_offered_though_the_stream_has_told_nothing(browser: Browser, site: Site) -> None:
    """Without them a user that is saved sees all stations."""
    context = browser.new_context(locale="en-GB")
    context.route_web_socket("**/api/stream", lambda _: None)
    page = context.new_page()
    log_in(page, site.port, "emil", PASSWORD, "users")
    page.get_by_role("button", name="Add user").press("Enter")
    expect(page.locator("dialog").get_by_label(EVIL)).to_be_visible()
    context.close()


def test_engineer_reads_the_audit(engineer: Page, site: Site) -> None:
    client = site.client("olga")
    station = next(each["id"] for each in client.get("/api/stations") if each["name"] == "north")
    client.post(f"/api/stations/{station}/interrogate")
    engineer.get_by_role("button", name="Audit").press("Enter")
    engineer.get_by_label("Who").fill("olga")
    engineer.get_by_label("What").select_option("stations")
    engineer.get_by_label("Station").select_option("north")
    rows = engineer.locator("tbody tr")
    expect(rows.first).to_contain_text("interrogate")
    expect(rows.first).to_contain_text("north")
    with engineer.expect_download() as file:
        engineer.get_by_role("link", name="CSV").click()
    lines = file.value.path().read_text().splitlines()
    assert {line.split(",")[1:4] == ["olga", "interrogate", "north"] for line in lines[1:]} == {True}
    engineer.get_by_label("What").select_option("users")
    expect(engineer.locator(".empty")).to_contain_text("Nobody did such a thing")


def test_engineers_view_fits_a_phone_in_each_language(engineer: Page) -> None:
    for language, word in (("de", "Benutzer"), ("sr", "Корисници"), ("es", "Usuarios"), ("en", "Users")):
        tool(engineer, "#language").select_option(language)
        expect(engineer.locator("nav a").last).to_have_text(word)
        assert engineer.evaluate("document.documentElement.scrollWidth") <= 360, language


def test_operator_finds_no_users(page: Page) -> None:
    """The view is not there, and what it would ask is refused."""
    expect(page.locator("nav a[href='#users']")).to_have_count(0)
    page.evaluate("location.hash = '#users'")
    expect(page.locator("nav a[href='#map']")).to_have_attribute("aria-current", "page")
    for path in ("users", "audit", "audit?format=csv"):
        assert page.evaluate("(path) => fetch(`api/${path}`).then((answer) => answer.status)", path) == 403


def test_an_engineer_sees_the_frames_of_a_station(browser: Browser, site: Site) -> None:
    made = browser.new_page(viewport={"width": 1100, "height": 700})
    log_in(made, site.port, "emil", PASSWORD, "stations")
    north = made.locator("tr", has=made.get_by_role("link", name="north"))
    north.get_by_role("button", name="Trace").click()
    expect(made.locator(".trace h2")).to_have_text("Trace: north")
    north.get_by_role("button", name="Interrogate").click()
    rows = made.locator(".trace tbody tr")
    expect(rows.filter(has_text="C_IC_NA_1").filter(has_text="→").first).to_contain_text("act")
    expect(rows.filter(has_text="C_IC_NA_1").filter(has_text="actterm").first).to_contain_text("←")
    made.locator(".trace").get_by_role("button", name="Close").click()
    expect(made.locator(".trace")).to_have_count(0)
    made.close()
