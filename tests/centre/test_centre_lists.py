# SPDX-License-Identifier: GPL-3.0-or-later
"""The page at night: long lists, zones, narrow screens, keys, and axe-core on every screen there is."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from browser import LIMIT_MS, log_in, tool
from control_room import PAGE, PASSWORD, ROOT, Site, Stations, described, now_ms, until
from lab.vehicles import M_ME_TF_1, M_SP_TB_1, Station, measured, single

pytestmark = pytest.mark.slow

AXE = ROOT / "build" / "axe" / "node_modules" / "axe-core" / "axe.min.js"
MANY = 2000
NODES_MOST = 2500
WIDE, PHONE = {"width": 1100, "height": 700}, {"width": 390, "height": 800}
HALF = {"width": 640, "height": 360}  # of 1280 by 720, as a browser's zoom of 200 % leaves it
SITE_ZONE = "Europe/Belgrade"
expect.set_options(timeout=LIMIT_MS)

PICTURE = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 100"><title>Pump</title>
<g data-point="north/pump" data-command="north/pump"><circle cx="60" cy="50" r="30" fill="#888"/>
<text x="60" y="55" text-anchor="middle" data-text="1: runs; 0: stands">P1</text></g></svg>
"""

# They are there once more when the centre tells all.
ADD = """async (count) => {
  const live = await import("./js/live.js");
  const add = () => {
    for (let id = 1e6; id < 1e6 + count; id++)
      live.stations.set(id, { id, name: `substation ${id - 1e6}`, group: id % 2 ? "east" : "west", link: 3,
        since: live.now() - id, heard: live.now(), clock: 0, records: id - 1e6, sessions: 1 });
  };
  add();
  live.watch(add);
}"""


@pytest.fixture(scope="module")
def site(
    programs: Path, stations: Stations, north: Station, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Site]:
    assert PAGE.is_dir(), "the page is not built: make centre-page"
    folder = tmp_path_factory.mktemp("night")
    (folder / "pump.svg").write_text(PICTURE)
    keys = {"page": PAGE, "centre": {"zone": SITE_ZONE, "pictures": "."}}
    with Site(programs, folder, [described(north, folder, group="water")], **keys) as started:
        for ioa in (2, 3, 5):
            stations.say(north, ioa, M_SP_TB_1, single(now_ms(), ioa == 5))
        stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 9))
        client = started.client("emil")
        until(lambda: len(client.get("/api/alarms")) >= 2, "the alarms")
        yield started


def opened(browser: Browser, site: Site, view: str, **how: object) -> Page:
    settings = {"viewport": WIDE, "locale": "en-GB", "timezone_id": "America/New_York", **how}
    page = browser.new_context(**settings).new_page()  # type: ignore[arg-type]
    log_in(page, site.port, "emil", PASSWORD, view)
    return page


@pytest.fixture
def page(browser: Browser, site: Site) -> Iterator[Page]:
    """An engineer, in New York."""
    made = opened(browser, site, "stations")
    wrong: list[str] = []
    made.on("pageerror", lambda error: wrong.append(str(error)))
    yield made
    made.context.close()
    assert wrong == []


def nodes(page: Page) -> int:
    return int(page.evaluate("document.querySelectorAll('*').length"))


# ---- long lists ----------------------------------------------------------------------------------


def test_two_thousand_stations_are_few_nodes(page: Page) -> None:
    """From one end to the other; each row says which of all it is."""
    page.evaluate(ADD, MANY)
    table = page.locator("table")
    expect(table).to_have_attribute("aria-rowcount", str(MANY + 2))
    assert nodes(page) < NODES_MOST
    first = page.get_by_role("link", name="north")
    expect(page.locator("tr", has=first)).to_have_attribute("aria-rowindex", "2")
    first.focus()
    page.evaluate("document.querySelector('.page').scrollTop = 30000")
    expect(page.locator("tbody tr:not(.gap)").nth(1)).not_to_have_attribute("aria-rowindex", "3")
    expect(first).to_be_focused()
    assert nodes(page) < NODES_MOST
    page.keyboard.press("End")
    last = page.get_by_role("link", name=f"substation {MANY - 1}", exact=True)
    expect(last).to_be_focused()
    expect(last).to_be_in_viewport()
    expect(page.locator("tr", has=last)).to_have_attribute("aria-rowindex", str(MANY + 2))
    page.keyboard.press("ArrowUp")
    expect(page.get_by_role("link", name=f"substation {MANY - 2}", exact=True)).to_be_focused()
    assert nodes(page) < NODES_MOST
    page.keyboard.press("Home")
    expect(first).to_be_focused()
    expect(first).to_be_in_viewport()
    page.keyboard.press("PageDown")
    expect(page.locator("tbody a:focus")).to_be_in_viewport()
    expect(first).not_to_be_focused()


def test_list_is_found_and_sorted(page: Page) -> None:
    page.evaluate(ADD, MANY)
    expect(page.locator("table")).to_have_attribute("aria-rowcount", str(MANY + 2))
    page.keyboard.press("Control+f")
    expect(page.get_by_placeholder("Search")).to_be_focused()
    page.keyboard.type("STATION 19")
    expect(page.get_by_role("status").first).to_have_text(f"111 of {MANY + 1}")
    expect(page.locator("table")).to_have_attribute("aria-rowcount", "112")
    heading = page.locator("th", has_text="Records")
    heading.get_by_role("button").click()
    expect(heading).to_have_attribute("aria-sort", "ascending")
    expect(page.locator("tbody a").first).to_have_text("substation 1999")
    heading.get_by_role("button").click()
    expect(heading).to_have_attribute("aria-sort", "descending")
    expect(page.locator("tbody a").first).to_have_text("substation 19")


def test_list_beside_the_points_is_as_short(page: Page) -> None:
    page.keyboard.press("2")
    expect(page.locator("h2", has_text="Points of north")).to_be_visible()
    page.evaluate(ADD, MANY)
    expect(page.locator(".list li").first).to_have_attribute("aria-setsize", str(MANY + 1))
    page.locator(".list button", has_text="north").press("End")
    last = page.locator(".list li", has_text=f"substation {MANY - 1}")
    expect(last.locator("button")).to_be_focused()
    expect(last).to_have_attribute("aria-posinset", str(MANY + 1))
    assert nodes(page) < NODES_MOST
    page.keyboard.press("Enter")
    expect(page.locator("h2", has_text=f"Points of substation {MANY - 1}")).to_be_visible()


# ---- zones ---------------------------------------------------------------------------------------

TIMES = """async (moments) => {
  const { time } = await import("./js/words.js");
  return moments.map((moment) => time(Date.parse(moment)).replaceAll("\u00a0", " "));
}"""
FIELD = """async ([text, last]) => {
  const { fromField, toField } = await import("./js/zone.js");
  const ms = fromField(text, last);
  return [new Date(ms).toISOString(), toField(ms)];
}"""
AXIS = """async (moments) => {
  const { axisTimes } = await import("./js/zone.js");
  const texts = axisTimes(moments.map((moment) => Date.parse(moment) / 1000));
  return texts.map((text) => text.replaceAll("\u00a0", " "));
}"""


def test_repeated_hour_is_told_apart_in_the_sites_zone(page: Page) -> None:
    """On 25 October the clocks of Belgrade go from 03:00 +02 to 02:00 +01."""
    twice = page.evaluate(TIMES, ["2026-10-25T00:30:00Z", "2026-10-25T01:30:00Z"])
    assert twice == ["2026-10-25 02:30:00 +02", "2026-10-25 02:30:00 +01"]
    for text, last, meant, shown in (
        ("2026-10-25T02:30", False, "2026-10-25T00:30:00.000Z", "2026-10-25T02:30"),
        ("2026-10-25T02:30", True, "2026-10-25T01:30:00.000Z", "2026-10-25T02:30"),
        ("2026-03-29T02:30", False, "2026-03-29T01:30:00.000Z", "2026-03-29T03:30"),
    ):
        assert page.evaluate(FIELD, [text, last]) == [meant, shown]
    hours = [f"2026-10-25T{hour:02}:00:00Z" for hour in range(3)]
    assert page.evaluate(AXIS, hours) == ["02:00 +02\n2026-10-25", "02:00 +01", "03:00"]


def test_zone_is_chosen_and_kept(page: Page) -> None:
    """The site's at first; then what the user takes, in each list and after the page has come anew."""
    zone = page.locator("#zone")
    expect(zone.locator("option")).to_have_text(
        [f"{SITE_ZONE} (site)", "UTC", "America/New_York (browser)"], use_inner_text=True
    )
    heard = page.locator("tbody td.time").nth(1)
    expect(heard).to_have_text(re.compile(r"\d\d:\d\d:\d\d\s\+0[12]$"))
    zone.select_option("utc")
    expect(heard).to_have_text(re.compile(r"\d\d:\d\d:\d\dZ$"))
    page.reload()
    expect(page.locator("#zone")).to_have_value("utc")
    expect(page.locator(".clock")).to_have_text(re.compile(r"^\d\d:\d\d:\d\dZ$"))
    page.locator("#zone").select_option("browser")
    for name in ("alarms", "stations"):
        page.locator(f"nav a[href='#{name}']").click()
        expect(page.locator("td.time", has_text=re.compile("\\s\N{MINUS SIGN}0[45]$")).first).to_be_visible()
    assert page.evaluate(TIMES, ["2026-07-01T12:00:00Z"]) == ["2026-07-01 08:00:00 \N{MINUS SIGN}04"]


def test_replay_is_asked_for_in_the_chosen_zone(page: Page) -> None:
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.keyboard.press("1")
    page.get_by_role("button", name="Replay").click()
    expect(page.locator(".replay")).to_contain_text(SITE_ZONE)
    page.locator(".replay").get_by_label("From").fill("2026-07-01T12:00")
    page.locator(".replay").get_by_label("To").fill("2026-07-01T13:00")
    page.locator(".replay").get_by_role("button", name="Load").click()
    wanted = "from=1782900000000&to=1782903600000"  # 10:00 and 11:00 UTC
    until(lambda: [url for url in asked if wanted in url] or page.wait_for_timeout(50), "the tracks")


# ---- keys ----------------------------------------------------------------------------------------


def test_keys_are_listed_and_none_works_while_one_types(page: Page) -> None:
    page.get_by_placeholder("Search").focus()
    page.keyboard.type("?2/")
    expect(page.get_by_placeholder("Search")).to_have_value("?2/")
    expect(page.locator("dialog")).to_have_count(0)
    page.get_by_placeholder("Search").fill("")
    link = page.get_by_role("link", name="north")
    link.focus()
    page.keyboard.press("?")
    expect(page.locator("dialog h2")).to_have_text("Keys")
    page.keyboard.press("2")
    expect(page.locator("nav a[href='#stations']")).to_have_attribute("aria-current", "page")
    page.keyboard.press("Escape")
    expect(page.locator("dialog")).to_have_count(0)
    expect(link).to_be_focused()


def test_focus_returns_to_the_user_who_was_changed(page: Page) -> None:
    """Though the list has come anew meanwhile."""
    page.evaluate("location.hash = '#users'")
    change = page.locator("tr", has_text="vera").get_by_role("button", name="Change")
    change.press("Enter")
    page.locator("dialog").get_by_label("Your own password").fill(PASSWORD)
    page.keyboard.press("Enter")
    expect(page.locator("dialog")).to_have_count(0)
    expect(change).to_be_focused()


# ---- every screen there is -----------------------------------------------------------------------


def screens(page: Page) -> Iterator[str]:
    """By the navigation, the tabs of each view, and what opens a dialogue: nothing is named here."""
    for view in page.eval_on_selector_all("nav a", "links => links.map((link) => link.hash)"):
        page.evaluate("(hash) => { location.hash = hash; }", view)
        expect(page.locator(f"nav a[href='{view}']")).to_have_attribute("aria-current", "page")
        for tab in range(max(1, page.locator(".tabs button").count())):
            if page.locator(".tabs button").count():
                page.locator(".tabs button").nth(tab).click()
            page.wait_for_load_state("networkidle")
            name = f"{view} {tab}"
            yield name
            openers = page.locator("main [aria-haspopup=dialog]")
            texts = openers.all_inner_texts()
            for text in dict.fromkeys(texts):
                openers.nth(texts.index(text)).click()
                yield from dialogue(page, f"{name} {text}")
    for id_ in page.eval_on_selector_all(".tools [aria-haspopup=dialog]", "all => all.map(({ id }) => id)"):
        tool(page, f"#{id_}").click()
        yield from dialogue(page, id_)


def dialogue(page: Page, name: str) -> Iterator[str]:
    expect(page.locator("dialog[open]")).to_be_visible()
    page.wait_for_load_state("networkidle")
    yield name
    page.keyboard.press("Escape")
    expect(page.locator("dialog")).to_have_count(0)


CHECK = """async () => (await axe.run(document, { resultTypes: ["violations"] })).violations
  .map((each) => [each.id, ...each.nodes.map((node) => node.html.slice(0, 200))])"""
# What is wider than the page, and is not scrolled in itself; controls that a finger misses (WCAG 2.5.8).
NARROW = """() => {
  const page = document.documentElement;
  const wrong = page.scrollWidth > page.clientWidth ? [`the page: ${page.scrollWidth} pixels`] : [];
  for (const view of document.querySelectorAll(".page")) {
    if (view.scrollWidth > view.clientWidth) wrong.push(`a view: ${view.scrollWidth} pixels`);
  }
  for (const element of document.querySelectorAll("button, select, input, main a")) {
    const box = element.getBoundingClientRect();
    if (!box.width || element.closest(".maplibregl-control-container")) continue;
    const scrolls = element.closest(".scroll");
    const text = element.outerHTML.slice(0, 120);
    if (!scrolls && (box.left < -0.5 || box.right > page.clientWidth + 0.5)) wrong.push(`beside it: ${text}`);
    if (element.matches("button, select") && box.height < 24) wrong.push(`${box.height} high: ${text}`);
  }
  return wrong;
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [WIDE, PHONE, HALF], ids=["wide", "phone", "zoom 200 %"])
def test_every_screen_is_for_everybody(
    browser: Browser, site: Site, size: dict[str, int], scheme: str
) -> None:
    """axe-core finds nothing, and nothing lies beside a narrow page."""
    made = opened(browser, site, "map", viewport=size, color_scheme=scheme)
    made.evaluate(AXE.read_text())
    wrong = {}
    seen = []
    for name in screens(made):
        seen.append(name)
        found = made.evaluate(CHECK) + made.evaluate(NARROW)
        if found:
            wrong[name] = found
    made.context.close()
    assert wrong == {}, json.dumps(wrong, indent=1)
    assert len(seen) > 10


def test_login_is_for_everybody(browser: Browser, site: Site) -> None:
    for scheme in ("light", "dark"):
        made = browser.new_page(viewport=PHONE, color_scheme=scheme)
        made.goto(f"http://127.0.0.1:{site.port}/")
        expect(made.locator("#name")).to_be_visible()
        made.evaluate(AXE.read_text())
        assert made.evaluate(CHECK) + made.evaluate(NARROW) == []
        made.close()


def test_what_opens_a_dialogue_says_so() -> None:
    """Else the walk over all screens would miss it: who opens one marks what does."""
    for file in (ROOT / "centre" / "page" / "js").glob("*.js"):
        text = file.read_text()
        if file.name != "dom.js":
            assert "showModal" not in text, file
        if file.name not in ("dom.js", "command.js", "main.js") and re.search(r"\bmodal\(", text):
            assert '"aria-haspopup"' in text or file.name in ("account.js", "trips.js"), file
