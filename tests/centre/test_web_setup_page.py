# SPDX-License-Identifier: GPL-3.0-or-later
"""The set-up view of rtu-web in a browser: an error at its line, the dry run, the trial, what is kept."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect
from playwright.sync_api import Page as Tab

from browser import LIMIT_MS, faultless
from peers.authority import give_to_station
from rig.web import PASSWORD, WEB_USER, Page, make_user, page_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def gateway(programs: Path) -> Iterator[Page]:
    with page_of(programs, setup=True) as page:
        make_user(page.folder / "web.users", "otto", "installer")
        give_to_station(page.folder / "web.users", WEB_USER)
        yield page


@pytest.fixture
def tab(browser: Browser) -> Iterator[Tab]:
    with faultless(browser, ignore_https_errors=True, color_scheme="light") as tab:
        tab.set_default_timeout(LIMIT_MS)
        yield tab


def log_in(tab: Tab, gateway: Page, name: str) -> None:
    tab.goto(f"https://127.0.0.1:{gateway.port}/#setup")
    tab.fill("[name=name]", name)
    tab.fill("[name=password]", PASSWORD)
    tab.keyboard.press("Enter")
    tab.wait_for_selector("#nav a[aria-current]")


def test_an_installer_changes_a_point(gateway: Page, tab: Tab) -> None:
    file = gateway.gateway.config_file
    before = file.read_text()
    log_in(tab, gateway, "otto")
    expect(tab.locator("#text")).to_have_value(before)
    # The keys of the place where the cursor is.
    tab.evaluate(
        "() => { const t = document.getElementById('text');"
        " t.setSelectionRange(...Array(2).fill(t.value.indexOf('\"baud_rate\"') + 4));"
        " t.dispatchEvent(new Event('keyup')); }"
    )
    expect(tab.locator(".hints")).to_contain_text("the transceivers of the board end at 500 kbit/s")
    expect(tab.locator(".chips button[aria-pressed=true]")).to_have_text("baud_rate")
    # An error, at its line.
    tab.fill("#text", before.replace('"scaled"', '"scalled"', 1))
    tab.click("text=Check")
    line = before[: before.index('"scaled"')].count("\n") + 1
    expect(tab.locator("#report li.bad")).to_contain_text('did you mean "scaled"?')
    tab.click(f"text=Line {line}")
    assert '"scalled"' in tab.evaluate("getSelection().toString()")
    # What is not the page's.
    config = json.loads(before)
    tab.fill("#text", json.dumps(config | {"modules": [{"name": "x", "program": "/bin/sh"}]}, indent=2))
    tab.click("text=Check")
    expect(tab.locator("#report li.bad")).to_contain_text("modules: is new: the page may not add it")
    # The dry run, and the trial.
    config["port"][0]["slaves"][0]["input_registers"].append({"address": 2, "name": "new", "type": "scaled"})
    text = json.dumps(config, indent=2)
    tab.fill("#text", text)
    tab.click("text=Check")
    expect(tab.locator("#phase")).to_contain_text("Can be applied")
    expect(tab.locator("#report")).to_contain_text("+ new, CA 1010")
    tab.click("text=Apply for 60 s")
    expect(tab.locator("#phase")).to_contain_text("s left to keep it")
    assert file.read_text() == before and "new" in gateway.gateway.points()
    tab.click("text=Keep it")
    expect(tab.locator("#phase")).to_contain_text("Nothing is proposed")
    assert file.read_text() == text
    # The file that was replaced comes back into the editor, not into force.
    tab.click("text=Load the file in force")
    expect(tab.locator("section[aria-label=History] tbody tr")).to_contain_text("otto")
    tab.click("section[aria-label=History] button")
    expect(tab.locator("#text")).to_have_value(before)
    assert file.read_text() == text


def test_nobody_else_sees_the_view(gateway: Page, tab: Tab) -> None:
    log_in(tab, gateway, "engineer")
    expect(tab.locator("#nav a[data-view=setup]")).to_be_hidden()
    expect(tab.locator("#nav a[aria-current]")).to_have_text("Points")
