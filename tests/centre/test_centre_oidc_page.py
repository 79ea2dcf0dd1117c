# SPDX-License-Identifier: GPL-3.0-or-later
"""Users of a real provider (npm's oidc-provider) come in through its page, in a browser."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Self

import pytest
from playwright.sync_api import Browser, Page, expect

from browser import LIMIT_MS, log_in
from control_room import PAGE, PASSWORD, Site
from hostile_provider import CLIENT, SECRET
from lab.centre_client import LIMIT_S
from lab.gateway import free_port
from test_centre_oidc import configured

pytestmark = pytest.mark.slow

BUILD = Path(__file__).resolve().parents[2] / "build"
expect.set_options(timeout=LIMIT_MS)


class Provider:
    """For a browser it is another site: localhost, and not 127.0.0.1."""

    def __init__(self) -> None:
        self.port = free_port()
        self.issuer = f"http://localhost:{self.port}"
        self.centre = ""
        self.process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        modules = BUILD / "provider" / "node_modules"
        assert modules.is_dir(), "the provider is not there: make build/provider/npm.done"
        script = Path(__file__).parent / "provider" / "provider.mjs"
        words = ["node", script, modules, str(self.port), self.centre, CLIENT, SECRET]
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert self.process.stdout
        while line := self.process.stdout.readline():
            if line == "ready\n":
                return
        raise AssertionError(f"the provider has ended: {self.process.wait(LIMIT_S)}")

    def stop(self) -> None:
        if self.process:
            self.process.kill()
            self.process.communicate(timeout=LIMIT_S)
            self.process = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


@pytest.fixture(scope="module")
def provider() -> Iterator[Provider]:
    with Provider() as made:
        yield made


@pytest.fixture(scope="module")
def site(of_north: Callable[..., Site], provider: Provider) -> Iterator[Site]:
    assert PAGE.is_dir(), "the page is not built: make centre-page"
    made = of_north(page=PAGE)
    provider.centre = f"http://127.0.0.1:{made.port}"
    content = json.loads(made.file.read_text())
    scope = "openid profile groups"
    content["centre"]["oidc"] = configured(
        provider.issuer, url=provider.centre, scope=scope, userinfo=True, logout=True
    )
    made.file.write_text(json.dumps(content))
    (made.folder / "oidc.secret").write_text(SECRET)
    (made.folder / "oidc.secret").chmod(0o600)
    provider.start()
    with made:
        yield made


@pytest.fixture
def page(browser: Browser, site: Site) -> Iterator[Page]:
    context = browser.new_context(locale="en-GB", timezone_id="UTC")
    made = context.new_page()
    made.set_default_timeout(LIMIT_MS)
    wrong: list[str] = []
    context.on("weberror", lambda error: wrong.append(str(error.error)))
    yield made
    context.close()
    assert wrong == []


def at_provider(page: Page, name: str) -> None:
    """Its own page: a name, a password, and that the centre may know it."""
    page.locator("[name=login]").fill(name)
    page.locator("[name=password]").fill("whatever it is")
    page.locator("[type=submit]").click()


def consent(page: Page) -> None:
    page.get_by_role("button", name="Continue").click()


def come_in(page: Page, site: Site, name: str) -> None:
    page.goto(f"http://127.0.0.1:{site.port}/")
    page.get_by_role("button", name="Log in by the plant").click()
    at_provider(page, name)
    consent(page)


def test_a_user_comes_in_through_the_providers_page(page: Page, site: Site) -> None:
    come_in(page, site, "anna")
    page.wait_for_selector("nav")
    assert "code=" not in page.url and "state=" not in page.url
    page.get_by_role("button", name="Account").click()
    dialog = page.locator("dialog")
    expect(dialog.get_by_role("heading", level=2)).to_have_text("Account · oidc:anna · Operator")
    expect(dialog.get_by_text("Your provider keeps your password")).to_be_visible()
    expect(dialog.locator("input")).to_have_count(0)
    page.get_by_role("button", name="Close").click()
    assert ("oidc:anna", "login", f"by {site_issuer(site)}") in {
        tuple(row) for row in site.rows('SELECT "user", action, detail FROM audit')
    }


def test_who_logs_out_is_logged_out_at_the_provider(page: Page, site: Site, provider: Provider) -> None:
    """And leads back to the page of the centre. Whoever comes next must say who it is."""
    come_in(page, site, "anna")
    page.wait_for_selector("nav")
    sessions = "SELECT count(*) FROM sessions WHERE \"user\" = 'oidc:anna'"
    before = site.rows(sessions)[0][0]
    page.get_by_role("button", name="Log out").click()
    sign_out = page.get_by_role("button", name="Yes, sign me out")
    expect(sign_out).to_be_visible()
    assert page.url.startswith(f"{provider.issuer}/session/end?client_id=")
    assert site.rows(sessions)[0][0] == before - 1
    sign_out.click()
    expect(page.locator("#name")).to_be_visible()
    assert page.url.startswith(provider.centre)
    page.get_by_role("button", name="Log in by the plant").click()
    expect(page.locator("[name=login]")).to_be_visible()
    page.go_back()
    page.reload()
    expect(page.locator("#name")).to_be_visible()


def site_issuer(site: Site) -> str:
    return str(json.loads(site.file.read_text())["centre"]["oidc"]["issuer"])


def test_who_has_no_role_is_told_so(page: Page, site: Site) -> None:
    come_in(page, site, "guest")
    expect(page.get_by_role("alert")).to_have_text("The provider knows you, but gives you no role here.")
    assert page.url.endswith("/#map")


def test_a_change_of_a_user_takes_a_login_once_more(page: Page, site: Site) -> None:
    come_in(page, site, "carla")
    page.goto(f"http://127.0.0.1:{site.port}/#users")
    page.get_by_role("button", name="Add user").click()
    dialog = page.locator("dialog")
    dialog.get_by_label("Name").fill("fiona")
    dialog.get_by_label("Password").fill(PASSWORD)
    dialog.get_by_role("button", name="Save").click()
    expect(dialog.get_by_role("alert")).to_have_text("First log in at your provider once more.")
    with page.context.expect_page() as opened:
        dialog.get_by_role("link", name="Log in once more").click()
    once_more = opened.value
    once_more.set_default_timeout(LIMIT_MS)
    at_provider(once_more, "carla")  # though it knows her: that is what is asked for
    expect(once_more.get_by_role("status")).to_have_text(
        "It is confirmed. Close this page, and go on in the other one within 2 min."
    )
    once_more.close()
    dialog.get_by_role("button", name="Save").click()
    expect(page.locator("tr", has_text="fiona")).to_be_visible()


def test_a_logout_at_the_provider_ends_the_session_here(page: Page, site: Site, provider: Provider) -> None:
    come_in(page, site, "anna")
    page.wait_for_selector("nav")
    there = page.context.new_page()
    there.set_default_timeout(LIMIT_MS)
    there.goto(f"{provider.issuer}/session/end")
    there.get_by_role("button", name="Yes, sign me out").click()
    expect(page.locator("#name")).to_be_visible()
    ended = site.rows("SELECT \"user\", detail FROM audit WHERE action = 'session ended'")
    assert ("oidc:anna", "by the provider") in {tuple(row) for row in ended}


def test_new_keys_of_the_provider_are_taken(page: Page, site: Site, provider: Provider) -> None:
    come_in(page, site, "anna")
    page.wait_for_selector("nav")
    provider.stop()
    provider.start()
    page.context.clear_cookies()
    come_in(page, site, "anna")
    page.wait_for_selector("nav")


def test_without_the_provider_users_of_the_centre_come_in(
    page: Page, browser: Browser, site: Site, provider: Provider
) -> None:
    come_in(page, site, "anna")
    page.wait_for_selector("nav")
    provider.stop()
    local = browser.new_page()
    log_in(local, site.port, "olga", PASSWORD, "stations")
    local.close()
    page.reload()
    page.wait_for_selector("nav")  # who is in stays in
    site.kill(site.centre)  # what the provider said of itself is forgotten
    site.start_centre()
    fresh = browser.new_page()
    fresh.set_default_timeout(LIMIT_MS)
    fresh.goto(f"http://127.0.0.1:{site.port}/")
    fresh.get_by_role("button", name="Log in by the plant").click()
    expect(fresh.get_by_role("alert")).to_have_text(
        "The provider does not answer. Users of this centre can log in."
    )
    fresh.close()
