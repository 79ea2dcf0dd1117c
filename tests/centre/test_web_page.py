# SPDX-License-Identifier: GPL-3.0-or-later
"""The page of rtu-web in a browser: it shows what rtuctl says, and no text of the gateway runs in it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Route, expect
from playwright.sync_api import Page as Tab

from browser import LIMIT_MS
from rig.web import DEVICE, HOSTILE, PASSWORD, WAIT_S, Page, page_of

STATION = "<img src=x onerror=document.title='X'>"
PHONE = {"width": 360, "height": 740}
LETTERS = {
    "good": "G",
    "invalid": "I",
    "not topical": "N",
    "blocked": "B",
    "substituted": "S",
    "overflow": "O",
}

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def gateway(programs: Path) -> Iterator[Page]:
    with page_of(programs, commands=True, station=STATION) as page:
        yield page


def context_of(browser: Browser) -> BrowserContext:
    return browser.new_context(ignore_https_errors=True, color_scheme="light", locale="en-GB")


def log_in(tab: Tab, port: int, role: str, view: str = "points") -> None:
    """By the keyboard alone."""
    tab.set_default_timeout(LIMIT_MS)
    tab.goto(f"https://127.0.0.1:{port}/#{view}")
    tab.wait_for_selector("[name=name]:focus")
    tab.keyboard.type(role)
    tab.keyboard.press("Tab")
    tab.keyboard.type(PASSWORD)
    tab.keyboard.press("Enter")
    tab.wait_for_selector("tbody tr")


@pytest.fixture(scope="module")
def tab(gateway: Page, browser: Browser) -> Iterator[Tab]:
    context = context_of(browser)
    tab = context.new_page()
    asked: list[str] = []
    errors: list[str] = []
    tab.on("request", lambda request: asked.append(request.url))
    tab.on("pageerror", lambda error: errors.append(str(error)))
    log_in(tab, gateway.port, "operator")
    yield tab
    assert errors == []
    assert [url for url in asked if not url.startswith(f"https://127.0.0.1:{gateway.port}/")] == []
    context.close()


def shown(tab: Tab) -> dict[str, list[str]]:
    """The cells of each row, by the name of its point, all of one moment."""
    rows: list[list[str]] = tab.evaluate(
        "[...document.querySelectorAll('tbody tr')].map((row) =>"
        " [...row.cells].map((cell) => cell.textContent))"
    )
    return {row[0]: row for row in rows}


def test_each_point_is_as_rtuctl_has_it(gateway: Page, tab: Tab) -> None:
    gateway.set_and_scan(DEVICE, "input_registers", 0, [77, 88])
    expect(tab.locator("tr", has_text="level").locator("td.value")).to_have_text("77", timeout=LIMIT_MS)
    points, rows = gateway.gateway.points(), shown(tab)
    assert rows.keys() == points.keys()
    for name, point in points.items():
        _, value, quality, age, _, kind, ca, ioa, owner = rows[name]
        assert value == str(point["value"])
        assert quality == LETTERS[point["quality"]] + point["quality"]
        assert age.endswith(" s")
        assert (kind, ca, ioa, owner) == (
            point["type"],
            str(point["ca"]),
            str(point["ioa"]),
            point["owner"],
        )


def test_no_text_becomes_a_part_of_the_page(tab: Tab) -> None:
    assert tab.locator("td", has_text=HOSTILE).count() == 1
    expect(tab.locator("#station")).to_have_text(STATION)
    assert tab.locator("table svg, table img, #station img").count() == 0
    assert tab.title() == STATION  # nothing has run


def test_views_by_the_keyboard_alone(tab: Tab) -> None:
    for key, text in (
        ("2", "All modules run."),
        ("5", "ttyS1"),
        ("6", "rtu-web"),
        ("7", "logged in from"),
        ("8", "read 2 input registers from"),
        ("3", "change"),
    ):
        tab.keyboard.press(key)
        expect(tab.locator("#view")).to_contain_text(text, timeout=LIMIT_MS)
    tab.keyboard.press("1")
    tab.wait_for_selector("#search")  # the former view has rows too
    tab.keyboard.press("/")
    tab.keyboard.type("lev")
    expect(tab.locator("tbody tr")).to_have_count(1, timeout=LIMIT_MS)
    tab.keyboard.press("Escape")
    tab.keyboard.press("t")
    assert tab.evaluate("document.documentElement.dataset.theme") == "dark"
    tab.keyboard.press("t")


def test_a_late_answer_draws_no_older_list(tab: Tab) -> None:
    """Of two questions at a time the later answer need not be the newer one: it asks one behind the other."""
    tab.keyboard.press("1")
    expect(tab.locator("tr", has_text="level")).to_have_count(1, timeout=LIMIT_MS)
    asked: list[Route] = []

    def hold_the_first(route: Route) -> None:
        asked.append(route)
        if len(asked) > 1:
            route.continue_()

    tab.route("**/api/points*", hold_the_first)
    tab.wait_for_event("request", lambda request: "/api/points" in request.url)
    tab.locator("#search").fill("level")
    for _ in range(3):  # whatever the page asks at once has come by then
        tab.evaluate("async () => (await fetch('/api/state')).status")
    assert len(asked) == 1
    asked[0].continue_()
    expect(tab.locator("tbody tr")).to_have_count(1, timeout=LIMIT_MS)
    tab.locator("#search").fill("")
    tab.keyboard.press("Escape")  # other keys would be typed there
    tab.unroute("**/api/points*")


def test_a_dead_device_is_an_alarm(gateway: Page, tab: Tab) -> None:
    gateway.lines.fault(DEVICE, "mute")
    expect(tab.locator("nav .count")).to_have_text("5", timeout=LIMIT_MS)
    tab.keyboard.press("2")
    row = tab.locator("tr", has_text="level")
    expect(row.locator(".state.bad")).to_have_text("Iinvalid", timeout=LIMIT_MS)
    gateway.lines.fault(DEVICE, "clear")
    expect(tab.locator("nav .count")).to_have_count(0, timeout=LIMIT_MS)
    expect(tab.locator("#view")).to_contain_text("All points are good.", timeout=LIMIT_MS)


def command(tab: Tab, name: str, value: str) -> None:
    tab.keyboard.press("4")
    tab.locator("tr", has_text=name).locator("button").click()
    tab.locator("dialog input").fill(value)
    tab.locator("dialog button.main:visible").click()


def test_a_command_is_given_beside_what_is_there(gateway: Page, tab: Tab) -> None:
    tab.keyboard.press("4")
    tab.locator("tr", has_text="setpoint").locator("button").click()
    expect(tab.locator("#now")).to_have_text("40 kW Ggood", timeout=LIMIT_MS)
    expect(tab.locator("#allowed")).to_have_text("0 to 100 kW")
    expect(tab.locator("dialog label")).to_contain_text("(kW)")
    gateway.set_and_scan(DEVICE, "holding_registers", 0, [45])
    expect(tab.locator("#now")).to_have_text("45 kW Ggood", timeout=LIMIT_MS)  # while it is open
    tab.keyboard.press("Escape")
    tab.locator("tr", has_text="lamp").locator("button").click()
    expect(tab.locator("#now")).to_contain_text("off")
    expect(tab.locator("#allowed")).to_have_text("on or off")
    tab.keyboard.press("Escape")


def test_each_fate_of_a_command_has_its_look(gateway: Page, tab: Tab) -> None:
    outcome = tab.locator("#outcome")
    command(tab, "breaker", "on")
    expect(outcome).to_have_class("outcome good", timeout=LIMIT_MS)
    expect(outcome).to_contain_text("Selected")
    tab.locator("dialog button.main:visible", has_text="Execute").click()
    expect(outcome).to_contain_text("Executed", timeout=LIMIT_MS)
    assert gateway.lines.get(DEVICE, "coils", 0) == 1
    tab.keyboard.press("Escape")

    gateway.lines.fault(DEVICE, "exception", 2, 5)
    command(tab, "lamp", "on")
    expect(outcome).to_have_class("outcome bad", timeout=LIMIT_MS)
    expect(outcome).to_contain_text("exception 2")
    gateway.lines.fault(DEVICE, "clear")
    tab.keyboard.press("Escape")

    gateway.lines.fault(DEVICE, "mute")
    command(tab, "lamp", "on")
    expect(outcome).to_have_class("outcome none", timeout=LIMIT_MS)
    gateway.gateway.kill("rtu-modbus-1")
    expect(outcome).to_have_class("outcome unknown", timeout=LIMIT_MS)
    expect(outcome).to_contain_text("Fate unknown")
    gateway.lines.fault(DEVICE, "clear")
    tab.keyboard.press("Escape")
    gateway.gateway.wait_for(
        lambda: gateway.gateway.points()["level"]["quality"] == "good", WAIT_S, "the device is back"
    )


def test_a_viewer_on_a_phone(gateway: Page, browser: Browser) -> None:
    context = context_of(browser)
    tab = context.new_page()
    tab.set_viewport_size(PHONE)
    log_in(tab, gateway.port, "viewer")
    assert tab.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    tab.keyboard.press("4")
    expect(tab.locator("tr", has_text="breaker")).to_have_count(1, timeout=LIMIT_MS)
    assert tab.locator("td button").count() == 0
    tab.keyboard.press("7")
    tab.wait_for_selector(".log tbody tr")
    for place in ("#clock", ".log tbody tr:first-child td:last-child", ".log tbody tr:first-child .time"):
        box = tab.locator(place).bounding_box()
        assert box is not None and box["x"] >= 0 and box["x"] + box["width"] <= PHONE["width"], place
    assert tab.evaluate("(card) => card.scrollWidth <= card.clientWidth", tab.query_selector(".card"))
    tab.locator("#logout").click()
    tab.wait_for_selector("[name=name]:focus")
    assert tab.locator("#view").is_hidden()
    context.close()


def test_a_page_whose_gateway_is_gone_says_so(gateway: Page, tab: Tab) -> None:
    tab.keyboard.press("1")
    gateway.gateway.ctl("module", "rtu-web", "stop")
    expect(tab.locator("#banner")).to_contain_text("What you see is old", timeout=LIMIT_MS)
    gateway.gateway.ctl("module", "rtu-web", "start")
    tab.wait_for_selector("[name=name]:focus")  # another process knows nobody
