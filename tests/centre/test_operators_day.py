# SPDX-License-Identifier: GPL-3.0-or-later
"""A night of an operator, from login to handing over: the story of docs/operators-day.md, at a whole centre.

With OPENRTU_FIGURES=docs/figures it takes the pictures of that page, too.
"""

from __future__ import annotations

import csv
import io
import math
import os
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pyotp
import pytest
from playwright.sync_api import Browser, Page, expect

from browser import LIMIT_MS, tool
from control_room import PAGE, PASSWORD, Site, Stations, described, now_ms, until
from lab.vehicles import M_ME_TF_1, M_SP_TB_1, POSITION, Station, measured, position, single

pytestmark = pytest.mark.slow
expect.set_options(timeout=LIMIT_MS)

FIGURES = os.environ.get("OPENRTU_FIGURES")
WIDE, PHONE = {"width": 1100, "height": 640}, {"width": 390, "height": 760}
SETTLES_MS = 1500
ZONE = "Europe/Belgrade"
PLANT = """ca,ioa,type,command_type,name,unit,select,high,state,priority
1,2,M_SP_NA_1,C_SC_NA_1,pump.run,,true,,,
1,4,M_ME_NC_1,,tank.level,m,,4.5,,1
1,5,M_SP_NA_1,,door.open,,,,1,3
"""
VAN = "ca,ioa,type,name\n1,1,,van.position\n"
SAVA = "pumping station Sava"
PLANTS = {
    SAVA: (44.80, 20.43), "pumping station Dunav": (44.85, 20.52),
    "pumping station Tamiš": (44.87, 20.64), "reservoir Avala": (44.69, 20.52),
    "reservoir Zvezdara": (44.80, 20.51), "waterworks Makiš": (44.76, 20.36),
}  # fmt: skip
ROAD = [(44.79 + 0.004 * step, 20.40 + 0.009 * step) for step in range(12)]


PICTURE = f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 320 180"><title>{SAVA}</title>
<path d="M20 150H120M180 150H230" fill="none" stroke="#8a98a5" stroke-width="4"/>
<rect x="230" y="30" width="60" height="130" rx="3" fill="none" stroke="#54616e" stroke-width="2"/>
<rect x="233" y="33" width="54" height="124" data-point="{SAVA}/tank.level" data-level="0: 0; 5: 1"
  data-fill="..4.5: #3b7fc4; else: bad"/>
<text x="260" y="24" font-size="12" text-anchor="middle" data-point="{SAVA}/tank.level"
  data-text="{{value:1}} m"/>
<g id="pump" data-point="{SAVA}/pump.run" data-command="">
  <circle cx="150" cy="150" r="22" fill="none" stroke="#54616e" stroke-width="2"
    data-fill="1: good; 0: panel"/>
  <path d="M138 162V138L166 150Z" fill="#54616e"/>
  <text x="150" y="116" font-size="12" text-anchor="middle"
    data-words="1: runs; 0: stands"/>
</g>
<text x="24" y="60" font-size="12" data-point="{SAVA}/door.open" data-words="1: door open; 0: door closed"/>
</svg>
"""


def take(page: Page, name: str) -> None:
    """A picture, where pictures are wanted."""
    if FIGURES:
        page.wait_for_timeout(SETTLES_MS)
        page.screenshot(path=Path(FIGURES) / f"day-{name}.png")


@pytest.fixture(scope="module")
def plants(stations: Stations) -> Iterator[dict[str, Station]]:
    made = {name: stations.station() for name in PLANTS}
    yield made
    for each in made.values():
        stations.do(each.stop())


@pytest.fixture(scope="module")
def van(stations: Stations) -> Iterator[Station]:
    made = stations.station()
    yield made
    stations.do(made.stop())


@pytest.fixture(scope="module")
def site(
    programs: Path,
    stations: Stations,
    plants: dict[str, Station],
    van: Station,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Site]:
    assert PAGE.is_dir(), "the page is not built: make centre-page"
    folder = tmp_path_factory.mktemp("day")
    (folder / "pictures").mkdir()
    (folder / "pictures" / "sava.svg").write_text(PICTURE)
    here = [
        described(plants[name], folder, name, PLANT, group="water", location=list(place))
        for name, place in PLANTS.items()
    ]
    here.append(described(van, folder, "van 7", VAN, group="vans"))
    with Site(programs, folder, here, PAGE, centre={"zone": ZONE}) as started:
        evening = [
            measured(now_ms() - 60_000 * minute, 2.4 + 0.4 * math.sin(minute / 8))
            for minute in range(55, 0, -1)
        ]
        stations.keep(plants[SAVA], 4, M_ME_TF_1, evening)
        for each in plants.values():
            stations.say(each, 2, M_SP_TB_1, single(now_ms(), False))
            stations.say(each, 4, M_ME_TF_1, measured(now_ms(), 2.4))
            stations.say(each, 5, M_SP_TB_1, single(now_ms(), False))
        for number, place in enumerate(ROAD):
            at = now_ms() - 10_000 * (len(ROAD) - number)
            stations.say(van, 1, POSITION, position(at, *place, 90))
        client = started.client("olga")

        def calm() -> bool:
            """It was away for a moment, to have something to tell."""
            ids = [each["id"] for each in client.get("/api/alarms")]
            client.post("/api/alarms/acknowledge", {"ids": ids})
            return not client.get("/api/alarms")

        wanted = 3 * len(plants) + 1
        until(lambda: len([each for each in client.get("/api/points") if each["at"]]) >= wanted, "the points")
        until(calm, "no alarm is left")
        yield started


def second_factor(site: Site, name: str) -> pyotp.TOTP:
    client = site.client(name)
    app = pyotp.TOTP(client.post("/api/second_factor/offer", {"own_password": PASSWORD})["secret"])
    client.post("/api/second_factor/begin", {"code": app.now()})
    return app


def entered(browser: Browser, site: Site, name: str, app: pyotp.TOTP, scheme: str) -> Page:
    """By name, password and the telephone's code."""
    page = browser.new_context(
        viewport=WIDE, locale="en-GB", color_scheme=scheme, timezone_id=ZONE
    ).new_page()
    page.set_default_timeout(LIMIT_MS)
    page.goto(f"http://127.0.0.1:{site.port}/#alarms")
    page.locator("#name").fill(name)
    page.locator("#password").fill(PASSWORD)
    page.keyboard.press("Enter")
    code = page.locator("#code")
    expect(code).to_be_focused()
    code.fill(app.at(int(time.time()) + app.interval))  # no code is taken twice
    if scheme == "dark":
        take(page, "login")
    page.keyboard.press("Enter")
    expect(page.locator("nav")).to_be_visible()
    return page


def test_a_night_of_an_operator(
    browser: Browser, site: Site, stations: Stations, plants: dict[str, Station], van: Station
) -> None:
    olga, omar = second_factor(site, "olga"), second_factor(site, "omar")
    page = entered(browser, site, "olga", olga, "dark")
    expect(page.locator(".empty")).to_contain_text("No alarms")

    # A storm: pumps have stopped, tanks run over, doors are opened.
    for each in plants.values():
        stations.say(each, 4, M_ME_TF_1, measured(now_ms(), 4.9))
        stations.say(each, 5, M_SP_TB_1, single(now_ms(), True))
    alarms = page.locator("tbody tr:not(.gap)")
    expect(alarms).to_have_count(2 * len(plants))
    take(page, "storm")
    page.keyboard.press("s")
    expect(page.locator("#silence")).to_be_hidden()

    # Only the doors: somebody is there, who has said so. All of them at once.
    page.keyboard.press("/")
    page.keyboard.type("door")
    expect(alarms).to_have_count(len(plants))
    page.get_by_role("button", name=f"Acknowledge shown ({len(plants)})").click()
    for each in plants.values():
        stations.say(each, 5, M_SP_TB_1, single(now_ms(), False))
    expect(alarms).to_have_count(0)
    page.get_by_placeholder("Search").fill("")
    expect(alarms).to_have_count(len(plants))

    # A pump is started, with a selection before.
    page.locator("nav a[href='#points']").click()
    page.locator(".side .list button", has_text=SAVA).click()
    expect(page.locator("h2", has_text=f"Points of {SAVA}")).to_be_visible()
    page.locator("tr", has_text="pump.run").get_by_role("button", name="Command").click()
    page.locator("dialog .choices button").nth(1).click()
    page.get_by_role("button", name="Select", exact=True).click()
    expect(page.get_by_role("button", name="Execute")).to_be_visible()
    take(page, "selected")
    page.get_by_role("button", name="Execute").click()
    expect(page.locator("dialog .outcome")).to_have_class("outcome good")
    assert plants[SAVA].commanded[-1] == (2, 1)
    page.keyboard.press("Escape")
    for each in plants.values():
        stations.say(each, 4, M_ME_TF_1, measured(now_ms(), 3.1))

    # What it did, on the plant's picture; enough has run off, so the pump is stopped from there.
    stations.say(plants[SAVA], 2, M_SP_TB_1, single(now_ms(), True))
    page.locator("nav a[href='#pictures']").click()
    pump = page.locator(".drawing #p-pump")
    expect(pump.locator("text")).to_have_text("runs")
    expect(page.locator(".drawing text", has_text="3.1 m")).to_be_visible()
    take(page, "picture")
    pump.click()
    page.locator("dialog .choices button").nth(0).click()
    page.get_by_role("button", name="Select", exact=True).click()
    page.get_by_role("button", name="Execute").click()
    expect(page.locator("dialog .outcome")).to_have_class("outcome good")
    assert plants[SAVA].commanded[-1] == (2, 0)
    page.keyboard.press("Escape")
    stations.say(plants[SAVA], 2, M_SP_TB_1, single(now_ms(), False))
    expect(pump.locator("text")).to_have_text("stands")

    # How the level went: closer by a key, read at the cursor, and as a file.
    page.locator("nav a[href='#trends']").click()
    page.locator(".side .list button", has_text=SAVA).click()
    page.locator(".side .list .inner button", has_text="tank.level").click()
    level = page.locator("tr[data-point]", has_text="tank.level")
    expect(level).to_contain_text("3.1 m")
    page.locator(".trend").focus()
    before = page.url
    page.keyboard.press("+")
    page.wait_for_function("(before) => location.href !== before", arg=before)
    over = page.locator(".u-over").bounding_box()
    assert over
    page.mouse.move(over["x"] + over["width"] / 2, over["y"] + over["height"] / 2)
    expect(level).not_to_contain_text("3.1 m")
    expect(level).to_contain_text("good")
    take(page, "trend")
    page.get_by_role("button", name="Hour").click()
    file = page.get_by_role("link", name="CSV")

    def hours() -> float:
        asked = parse_qs(urlsplit(str(file.get_attribute("href"))).query)
        return (float(asked["to"][0]) - float(asked["from"][0])) / 3_600_000

    until(lambda: hours() > 0.99, "the file is of the last hour")
    with page.expect_download() as got:
        file.click()
    last = [float(row["last"]) for row in csv.DictReader(io.StringIO(Path(got.value.path()).read_text()))]
    assert len(last) > 50
    assert (max(last), last[-1]) == (pytest.approx(4.9), pytest.approx(3.1))

    # The van is in a tunnel: its last place stays, and is told to be invalid.
    page.keyboard.press("1")
    stations.say(van, 1, POSITION, position(now_ms(), 0, 0, fix=0))
    row = page.locator(".list button", has_text="van 7")
    expect(row).to_contain_text("invalid")
    row.click()
    expect(page.locator(".about dl")).to_contain_text(f"{ROAD[-1][0]:.6f}°")
    expect(page.locator(".about")).to_contain_text("Track of the last hour")
    take(page, "lost")

    # The rest is done on the telephone, on the way to the kitchen.
    phone = browser.new_context(viewport=PHONE, locale="en-GB", color_scheme="dark", timezone_id=ZONE)
    phone.add_cookies(page.context.cookies())
    small = phone.new_page()
    small.set_default_timeout(LIMIT_MS)
    small.goto(f"http://127.0.0.1:{site.port}/#alarms")
    level = small.locator("tbody tr", has_text="Avala").filter(has_text="tank.level")
    expect(level).to_contain_text("gone")
    take(small, "phone")
    small.locator("tbody tr", has_text="Sava").get_by_role("button", name="Shelve").click()
    small.get_by_label("Reason").fill("pump is tested until six")
    small.keyboard.press("Enter")
    expect(small.get_by_role("button", name="Shelved (1)")).to_be_visible()
    small.get_by_role("button", name="Acknowledge shown").click()
    expect(level).to_have_count(0)
    phone.close()

    # What happened, for who comes in the morning.
    page.locator("nav a[href='#alarms']").click()
    page.get_by_role("button", name="Past alarms").click()
    expect(page.locator("tbody tr", has_text="door.open")).to_have_count(len(plants))
    page.get_by_role("button", name="Commands").click()
    commands = page.locator("tbody tr", has_text="pump.run")
    expect(commands).to_have_count(2)
    for number in range(2):
        expect(commands.nth(number)).to_contain_text("Executed")
    page.get_by_role("button", name="Events").click()
    expect(page.locator("tbody tr", has_text="tank.level").first).to_be_visible()
    take(page, "events")
    tool(page, "#logout").click()
    expect(page.locator("#name")).to_be_focused()
    page.context.close()

    # The next one sees what is shelved, by whom, until when, and why.
    page = entered(browser, site, "omar", omar, "light")
    page.get_by_role("button", name="Shelved (1)").click()
    sava = page.locator("tbody tr", has_text="Sava")
    expect(sava).to_contain_text("pump is tested until six")
    take(page, "morning")
    page.context.close()
