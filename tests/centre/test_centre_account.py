# SPDX-License-Identifier: GPL-3.0-or-later
"""The account dialogue of the control centre's page, in a browser."""

import re
from collections.abc import Callable, Iterator

import pyotp
import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from browser import LIMIT_MS, faultless, log_in, tool
from control_room import PAGE, PASSWORD, Site
from lab.centre_client import AnswerError, Client

pytestmark = pytest.mark.slow

FRESH = "a better password"
expect.set_options(timeout=LIMIT_MS)


@pytest.fixture(scope="module")
def site(of_north: Callable[..., Site]) -> Iterator[Site]:
    assert PAGE.is_dir(), "the page is not built: make centre-page"
    with of_north(page=PAGE) as started:
        yield started


@pytest.fixture
def page(browser: Browser, site: Site) -> Iterator[Page]:
    """As an operator, on a telephone."""
    with faultless(browser, viewport={"width": 390, "height": 780}) as made:
        log_in(made, site.port, "olga", PASSWORD, "stations")
        yield made


def part(page: Page, title: str) -> Locator:
    return page.locator("dialog .part", has=page.get_by_role("heading", name=title))


def open_account(page: Page) -> Locator:
    tool(page, "#account").press("Enter")
    dialog = page.locator("dialog")
    expect(dialog.get_by_text("this login")).to_be_visible()
    return dialog


def test_a_token_is_made_shown_once_and_ended(page: Page, site: Site) -> None:
    dialog = open_account(page)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    form = part(page, "New token for a program")
    form.get_by_label("What it is for").fill("nightly report")
    expect(form.get_by_label("May").locator("option")).to_have_text(["read", "read and command"])
    form.get_by_label("Your own password").fill("guessed password")
    form.get_by_role("button", name="Make").press("Enter")
    expect(form.get_by_role("alert")).to_have_text("Your own password is wrong.")
    form.get_by_label("Your own password").fill(PASSWORD)
    form.get_by_role("button", name="Make").press("Enter")
    secret = form.locator(".secret").inner_text()
    program = Client(site.port, secret)
    assert (program.get("/api/me")["user"], program.get("/api/me")["role"]) == ("olga", "viewer")
    page.get_by_role("button", name="Close").press("Enter")
    dialog = open_account(page)
    assert secret not in dialog.inner_text()
    row = dialog.locator("tr", has_text="nightly report")
    expect(row.locator("td").nth(1)).to_have_text("read")
    row.get_by_role("button", name="End").press("Enter")
    expect(row).to_have_count(0)
    with pytest.raises(AnswerError):
        program.get("/api/me")


def test_another_login_is_ended(page: Page, site: Site) -> None:
    other = Client(site.port, source="127.0.5.1").login("olga", PASSWORD)
    row = open_account(page).locator("tr", has_text="127.0.5.1")
    row.get_by_role("button", name="End").press("Enter")
    expect(row).to_have_count(0)
    with pytest.raises(AnswerError):
        other.get("/api/me")


def test_ones_own_password_is_changed(page: Page, site: Site) -> None:
    other = Client(site.port, source="127.0.5.2").login("olga", PASSWORD)
    open_account(page)
    for old, new in ((PASSWORD, FRESH), (FRESH, PASSWORD)):
        form = part(page, "Your password")
        form.get_by_label(re.compile("New password")).fill(new)
        form.get_by_label("Your own password").fill(old)
        form.get_by_role("button", name="Save").press("Enter")
        expect(form.get_by_role("status")).to_have_text(
            "It is changed. All else that you had open has ended."
        )
        with pytest.raises(AnswerError):
            other.get("/api/me")
        other = Client(site.port, source="127.0.5.2").login("olga", new)


def test_a_second_factor_is_set_up_asked_for_and_ended(page: Page, site: Site) -> None:
    dialog = open_account(page)
    form = part(page, "Second factor")
    form.get_by_label("Your own password").fill(PASSWORD)
    form.get_by_role("button", name="Set up").press("Enter")
    secret = form.locator(".secret").inner_text().replace(" ", "")
    app = pyotp.TOTP(secret)
    form = part(page, "The app's code")
    form.get_by_label("Code").fill(app.now())
    form.get_by_role("button", name="Switch on").press("Enter")
    done = part(page, "Your second factor is on")
    recovery = done.locator(".secret").inner_text().split()
    assert len(recovery) == 10
    page.get_by_role("button", name="Close").press("Enter")
    tool(page, "#logout").press("Enter")
    page.locator("#name").fill("olga")
    page.locator("#password").fill(PASSWORD)
    page.keyboard.press("Enter")
    expect(page.locator("#code")).to_be_focused()
    page.keyboard.type("000000")
    page.keyboard.press("Enter")
    expect(page.get_by_role("alert")).to_have_text("The code is wrong, or was used already.")
    page.locator("#code").fill(recovery[0])
    page.keyboard.press("Enter")
    page.wait_for_selector("nav")
    dialog = open_account(page)
    form = part(page, "Your second factor is on")
    expect(form).to_contain_text("Recovery codes that are left: 9")
    form.get_by_label("Your own password").fill(PASSWORD)
    form.get_by_label(re.compile("Code of your second factor")).fill(recovery[1])
    form.get_by_role("button", name="Switch off").press("Enter")
    expect(dialog.get_by_role("button", name="Set up")).to_be_visible()
    site.client("olga")


def test_an_engineer_ends_a_second_factor_that_is_lost(browser: Browser, site: Site) -> None:
    client = Client(site.port, source="127.0.5.3").login("omar", PASSWORD)
    secret = client.post("/api/second_factor/offer", {"own_password": PASSWORD})["secret"]
    client.post("/api/second_factor/begin", {"code": pyotp.TOTP(secret).now()})
    page = browser.new_page()
    log_in(page, site.port, "emil", PASSWORD, "users")
    for name, buttons in (("vera", 0), ("omar", 1)):
        page.locator("tr", has_text=name).get_by_role("button", name="Change").press("Enter")
        expect(page.locator("dialog")).to_be_visible()
        lost = page.get_by_role("button", name="Second factor is lost")
        expect(lost).to_have_count(buttons)
        if not buttons:
            page.keyboard.press("Escape")
            expect(page.locator("dialog")).to_have_count(0)
    page.get_by_label("Your own password").fill(PASSWORD)
    lost.press("Enter")
    expect(page.locator("dialog")).to_have_count(0)
    assert client.get("/api/second_factor")["on"] is False
    page.close()


def test_who_is_to_wait_is_told_how_long(browser: Browser, site: Site) -> None:
    page = browser.new_page()
    page.set_default_timeout(LIMIT_MS)
    page.goto(f"http://127.0.0.1:{site.port}/")
    page.locator("#name").fill("stranger")
    seen = set()
    for _ in range(6):
        page.locator("#password").fill("guessed password")
        with page.expect_response("**/api/login") as answered:
            page.keyboard.press("Enter")
        seen.add(answered.value.status)
    assert seen == {401, 429}
    expect(page.get_by_role("alert")).to_have_text(re.compile(r"Try again in [1-9]\d? s\."))
    page.close()
