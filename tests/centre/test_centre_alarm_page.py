# SPDX-License-Identifier: GPL-3.0-or-later
"""Alarms in a browser: the horn, parts of a fault, what is past, and how often they came."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from browser import LIMIT_MS, log_in, tab_to
from control_room import PAGE, PASSWORD, Site, Stations, described, now_ms, until
from lab.gateway import free_port
from lab.vehicles import M_ME_TF_1, M_SP_TB_1, Station, measured, single

pytestmark = pytest.mark.slow

NAMES = ("mill", "north", "south", "weir")
expect.set_options(timeout=LIMIT_MS)
TONES = """() => {
  window.tones = 0;
  const start = OscillatorNode.prototype.start;
  OscillatorNode.prototype.start = function (...when) { window.tones += 1; return start.apply(this, when); };
}"""


@pytest.fixture(scope="module")
def made(stations: Stations) -> Iterator[dict[str, Station]]:
    found = {name: stations.station() for name in NAMES}
    yield found
    for station in found.values():
        stations.do(station.stop())


@pytest.fixture(scope="module")
def site(
    programs: Path, made: dict[str, Station], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Site]:
    assert PAGE.is_dir(), "the page is not built: make centre-page"
    folder = tmp_path_factory.mktemp("alarms")
    here = [described(station, folder, name) for name, station in made.items()]
    hook = {"webhook": f"https://127.0.0.1:{free_port()}/"}  # nobody is there
    notify = {"targets": {"chat": hook}, "rules": [{"to": ["chat"], "kinds": ["state"]}]}
    centre = {"alarms": {"network_stations": 3}, "notify": notify}
    with Site(programs, folder, here, PAGE, users=("olga", "vera"), centre=centre) as started:
        client = started.client("vera")
        until(lambda: {each["link"] for each in client.get("/api/stations")} == {3}, "all are connected")
        yield started


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    made = browser.new_context(viewport={"width": 1100, "height": 700}, locale="en-GB", timezone_id="UTC")
    made.set_default_timeout(LIMIT_MS)
    yield made
    made.close()


def open_page(context: BrowserContext, site: Site, name: str, view: str) -> Page:
    page = context.new_page()
    log_in(page, site.port, name, PASSWORD, view)
    page.evaluate(TONES)
    return page


def heard(page: Page) -> int:
    return int(page.evaluate("tones"))


def sounds(page: Page) -> None:
    before = heard(page)
    until(lambda: heard(page) > before + 1, "it sounds again and again")


def calm(site: Site, stations: Stations, made: dict[str, Station]) -> None:
    """No alarm is open, whatever was before."""
    for station in made.values():
        stations.say(station, 4, M_ME_TF_1, measured(now_ms(), 1))
        stations.say(station, 5, M_SP_TB_1, single(now_ms(), False))
    client = site.client("olga")

    def over() -> bool:
        client.post("/api/alarms/acknowledge", {"ids": [each["id"] for each in client.get("/api/alarms")]})
        return not client.get("/api/alarms")

    until(over, "all are gone", 0.2)


def test_horn_sounds_on_every_screen_until_it_is_silenced(
    context: BrowserContext, site: Site, stations: Stations, made: dict[str, Station]
) -> None:
    """And again for a new one. All windows of a browser are silenced at once; a viewer's is quiet."""
    stations_page = open_page(context, site, "olga", "stations")
    points_page = context.new_page()
    points_page.goto(f"http://127.0.0.1:{site.port}/#points")
    points_page.locator("main").click()  # a browser that nobody has touched makes no sound
    points_page.evaluate(TONES)
    expect(stations_page.locator("#silence")).to_be_hidden()
    stations.say(made["north"], 4, M_ME_TF_1, measured(now_ms(), 9))
    for page in (stations_page, points_page):
        expect(page.locator("#silence")).to_have_text("Silence (1)")
        sounds(page)
    stations_page.keyboard.press("s")
    for page in (stations_page, points_page):
        expect(page.locator("#silence")).to_be_hidden()
    quiet = heard(points_page)
    stations.say(made["north"], 5, M_SP_TB_1, single(now_ms(), True))
    expect(points_page.locator("#silence")).to_have_text("Silence (1)")
    until(lambda: heard(points_page) > quiet, "it sounds for a new one")
    client = site.client("olga")
    client.post("/api/alarms/acknowledge", {"ids": [each["id"] for each in client.get("/api/alarms")]})
    for page in (stations_page, points_page):
        expect(page.locator("#silence")).to_be_hidden()
    stations.say(made["north"], 4, M_ME_TF_1, measured(now_ms(), 1))
    stations.say(made["north"], 5, M_SP_TB_1, single(now_ms(), False))
    until(lambda: not client.get("/api/alarms"), "both are gone")


def test_sound_is_switched_off_for_a_browser(
    context: BrowserContext, site: Site, stations: Stations, made: dict[str, Station]
) -> None:
    page = open_page(context, site, "olga", "alarms")
    page.get_by_role("button", name="Sound").click()
    row = page.locator("tbody tr", has_text="level is too high")
    stations.say(made["north"], 4, M_ME_TF_1, measured(now_ms(), 9))
    expect(row).to_be_visible()
    expect(page.locator("#silence")).to_be_hidden()
    assert heard(page) == 0
    page.get_by_role("button", name="Sound").click()
    expect(page.locator("#silence")).to_be_visible()
    sounds(page)
    row.get_by_role("button", name="Acknowledge").click()
    stations.say(made["north"], 4, M_ME_TF_1, measured(now_ms(), 1))
    page.mouse.move(5, 5)
    expect(row).to_have_count(0)


def test_a_fault_of_the_network_is_a_row_and_has_its_parts(
    context: BrowserContext, site: Site, stations: Stations, made: dict[str, Station]
) -> None:
    page = open_page(context, site, "olga", "alarms")
    for name in NAMES[:3]:
        stations.do(made[name].stop())
    rows = page.locator("tbody tr")
    fault = rows.filter(has_text="3 stations lost at once")
    expect(fault).to_be_visible()
    expect(rows).to_have_count(1)
    expect(page.locator("nav .count")).to_have_text("1")
    fault.get_by_role("button", name="Parts (3)").click()
    expect(rows).to_have_count(4)
    for name in NAMES[:3]:
        expect(rows.filter(has_text=name).filter(has_text="part of another alarm")).to_have_count(1)
    fault.get_by_role("button", name="Parts (3)").click()
    page.mouse.move(5, 5)
    expect(rows).to_have_count(1)
    fault.get_by_role("button", name="Acknowledge").click()
    page.mouse.move(5, 5)
    for name in NAMES[:3]:
        stations.do(made[name].listen())
    expect(rows).to_have_count(0)
    page.get_by_role("button", name="Past alarms").click()
    page.locator("main").get_by_label("What").select_option("network")
    expect(rows).to_have_count(1)


def test_events_and_past_alarms_are_found(
    context: BrowserContext, site: Site, stations: Stations, made: dict[str, Station]
) -> None:
    """By text, station, kind and an exact time; the file has the same."""
    stations.say(made["weir"], 4, M_ME_TF_1, measured(now_ms(), 8.25))
    stations.say(made["mill"], 5, M_SP_TB_1, single(now_ms(), True))
    client = site.client("olga")
    until(lambda: len(client.get("/api/alarms")) == 2, "two alarms")
    page = open_page(context, site, "olga", "alarms")
    main, rows = page.locator("main"), page.locator("tbody tr")
    page.get_by_role("button", name="Events").click()
    expect(rows.filter(has_text="fire").first).to_be_visible()
    main.get_by_label("Search").fill("LEVEL")
    expect(rows.filter(has_text="fire")).to_have_count(0)
    main.get_by_label("Station").select_option("weir")
    main.get_by_label("What").select_option("spontaneous")
    expect(rows).to_have_count(1)
    expect(rows).to_contain_text("8.25")
    with page.expect_download() as download:
        page.get_by_role("link", name="CSV").click()
    lines = download.value.path().read_text().splitlines()
    assert len(lines) == 2 and ",weir,level,8.25," in lines[1]
    page.get_by_role("button", name="Past alarms").click()
    main.get_by_label("Search").fill("weir")
    expect(rows.filter(has_text="too high")).to_have_count(1)
    expect(rows.filter(has_text="fire")).to_have_count(0)
    main.get_by_label("Time").select_option("")
    expect(rows.filter(has_text="too high")).to_have_count(1)  # of the last day
    main.get_by_label("To", exact=True).fill("2020-01-01T00:00")
    expect(rows.filter(has_text="too high")).to_have_count(0)
    main.get_by_label("To", exact=True).fill("2040-01-01T00:00")
    expect(rows.filter(has_text="too high")).to_have_count(1)
    stations.say(made["weir"], 4, M_ME_TF_1, measured(now_ms(), 1))
    stations.say(made["mill"], 5, M_SP_TB_1, single(now_ms(), False))
    client.post("/api/alarms/acknowledge", {"ids": [each["id"] for each in client.get("/api/alarms")]})
    until(lambda: not client.get("/api/alarms"), "both are gone")


def test_a_page_that_begins_at_its_events_offers_the_stations(context: BrowserContext, site: Site) -> None:
    """The centre tells them to a page that is already there."""
    page = open_page(context, site, "olga", "alarms/events")
    offered = page.locator("main").get_by_label("Station").locator("option")
    expect(offered).to_have_text(["Stations", *NAMES])
    page.locator("main").get_by_label("Station").select_option("weir")
    page.reload()
    expect(offered).to_have_text(["Stations", *NAMES])


def test_rates_are_figures_and_name_what_chatters(
    context: BrowserContext, site: Site, stations: Stations, made: dict[str, Station]
) -> None:
    client = site.client("olga")
    begun = now_ms()
    for number in range(6):  # at once: what takes longer than a minute does not chatter
        stations.say(made["south"], 5, M_SP_TB_1, single(begun + number, number % 2 == 0))
    until(lambda: client.get("/api/alarms/rates")["chattering"], "it chatters")
    page = open_page(context, site, "olga", "alarms")
    page.get_by_role("button", name="Rates").click()
    day = page.locator(".figures div", has_text="in 24 h").locator("dd")
    expect(day).to_have_text(str(client.get("/api/alarms/rates")["day"]))
    expect(page.locator(".bars .bar")).to_have_count(144)
    chattering = page.locator("h3", has_text="Chattering").locator("xpath=following-sibling::div[1]")
    expect(chattering.locator("tbody tr")).to_have_count(1)
    expect(chattering.locator("tbody tr")).to_contain_text("fire")
    client.post("/api/alarms/acknowledge", {"ids": [each["id"] for each in client.get("/api/alarms")]})


def test_operator_sees_what_waits_for_a_target(
    context: BrowserContext, site: Site, stations: Stations, made: dict[str, Station]
) -> None:
    stations.say(made["weir"], 5, M_SP_TB_1, single(now_ms(), True))
    page = open_page(context, site, "olga", "alarms")
    page.get_by_role("button", name="Notifications").click()
    target = page.locator("table").first.locator("tbody tr")
    expect(target).to_contain_text("Cannot connect")
    expect(page.locator("table").last.locator("tbody tr").first).to_contain_text("next attempt at")
    stations.say(made["weir"], 5, M_SP_TB_1, single(now_ms(), False))
    viewer = context.browser.new_context() if context.browser else context
    watching = open_page(viewer, site, "vera", "alarms")
    expect(watching.get_by_role("button", name="Rates")).to_be_visible()
    expect(watching.get_by_role("button", name="Notifications")).to_have_count(0)
    viewer.close()


def test_parts_are_opened_below_their_alarm_under_the_pointer(
    context: BrowserContext, site: Site, stations: Stations, made: dict[str, Station]
) -> None:
    """At once, though no row moves otherwise: that is what the click was for."""
    calm(site, stations, made)
    page = open_page(context, site, "olga", "alarms")
    stations.say(made["north"], 4, M_ME_TF_1, measured(now_ms(), 9))
    rows = page.locator("tbody tr")
    level = rows.filter(has_text="level is too high")
    expect(level).to_have_count(1)
    stations.do(made["north"].stop())
    lost = rows.filter(has_text="north").get_by_role("button", name="Parts (1)")
    expect(lost).to_be_visible()
    expect(rows).to_have_count(1)
    lost.hover()
    stations.say(made["weir"], 5, M_SP_TB_1, single(now_ms(), True))
    expect(rows).to_have_count(2)
    expect(rows.nth(1)).to_contain_text("weir")
    lost.click()
    expect(rows).to_have_count(3)
    expect(rows.nth(1)).to_contain_text("part of another alarm")
    lost.click()
    expect(rows).to_have_count(2)
    stations.do(made["north"].listen())
    calm(site, stations, made)


def test_alarms_are_shelved_and_silenced_by_keys_alone(
    context: BrowserContext, site: Site, stations: Stations, made: dict[str, Station]
) -> None:
    """From the login to the end of the alarm, without a pointer."""
    calm(site, stations, made)
    page = open_page(context, site, "olga", "stations")
    stations.say(made["north"], 4, M_ME_TF_1, measured(now_ms(), 9))
    expect(page.locator("#silence")).to_be_visible()
    page.keyboard.press("s")
    expect(page.locator("#silence")).to_be_hidden()
    page.keyboard.press("3")
    row = page.locator("tbody tr", has_text="level is too high")
    tab_to(page, row.get_by_role("button", name="Shelve"))
    page.keyboard.press("Enter")
    expect(page.get_by_label("Reason")).to_be_focused()
    page.keyboard.type("the probe is cleaned")
    page.keyboard.press("Enter")
    shelved = page.get_by_role("button", name="Shelved (1)")
    expect(shelved).to_be_visible()
    tab_to(page, shelved, "Shift+Tab")
    expect(row).to_be_hidden()
    page.keyboard.press("Enter")
    expect(row).to_contain_text("the probe is cleaned")
    tab_to(page, row.get_by_role("button", name="Unshelve"))
    page.keyboard.press("Enter")
    expect(row).not_to_contain_text("the probe is cleaned")
    expect(row.get_by_role("button", name="Acknowledge")).to_be_focused()  # who acts goes on in the row
    # It came before it was silenced, so it is quiet; one that comes again is not.
    expect(page.locator("#silence")).to_be_hidden()
    stations.say(made["north"], 4, M_ME_TF_1, measured(now_ms(), 1))
    expect(row).to_contain_text("gone")
    stations.say(made["north"], 4, M_ME_TF_1, measured(now_ms(), 8))
    expect(page.locator("#silence")).to_be_visible()
    tab_to(page, page.locator("#silence"))
    page.keyboard.press("Space")
    expect(page.locator("#silence")).to_be_hidden()
    tab_to(page, row.get_by_role("button", name="Acknowledge"))
    page.keyboard.press("Enter")
    expect(row).to_contain_text("olga")
    stations.say(made["north"], 4, M_ME_TF_1, measured(now_ms(), 1))
    tab_to(page, page.get_by_placeholder("Search"), "Shift+Tab")
    expect(row).to_be_hidden()


@pytest.mark.parametrize("size", [(1100, 400), (390, 560)], ids=["wide", "phone"])
def test_silence_lies_over_no_button(
    context: BrowserContext, site: Site, stations: Stations, made: dict[str, Station], size: tuple[int, int]
) -> None:
    calm(site, stations, made)
    page = open_page(context, site, "olga", "alarms")
    page.set_viewport_size({"width": size[0], "height": size[1]})
    for station in made.values():
        stations.say(station, 4, M_ME_TF_1, measured(now_ms(), 9))
        stations.say(station, 5, M_SP_TB_1, single(now_ms(), True))
    expect(page.locator("#silence")).to_have_text(f"Silence ({2 * len(made)})")
    last = page.locator("tbody tr").nth(2 * len(made) - 1)
    expect(last).to_be_attached()
    over = page.evaluate(
        """() => {
          const { left, right, top, bottom } = document.querySelector(".page").getBoundingClientRect();
          const silence = document.querySelector("#silence").getBoundingClientRect();
          return silence.top < bottom && silence.left < right && silence.right > left && silence.bottom > top;
        }"""
    )
    assert not over
    last.get_by_role("button", name="Acknowledge").click()
    calm(site, stations, made)
