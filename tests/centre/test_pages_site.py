# SPDX-License-Identifier: GPL-3.0-or-later
"""The pages as a site, in a browser: from files alone, without a server and without network."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from browser import LIMIT_MS, chromium

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
HTML = ROOT / "build/pages/html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    subprocess.run(["make", "site"], cwd=ROOT, check=True, capture_output=True)
    with chromium() as browser:
        yield browser


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    """A page that has asked for nothing but files, and had no fault, when the test is over."""
    page = browser.new_page()
    page.set_default_timeout(LIMIT_MS)
    asked: list[str] = []
    faults: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: faults.append(str(error)))
    yield page
    assert [url for url in asked if not url.startswith(("file:", "blob:file:", "data:"))] == []
    assert faults == []
    page.close()


def test_search_finds_a_page(page: Page) -> None:
    page.goto((HTML / "index.html").as_uri())
    page.locator(".md-search__input").click()
    page.keyboard.type("geofence")
    found = page.locator(".md-search-result__link").first
    expect(found).to_be_visible(timeout=LIMIT_MS)
    found.click()
    page.wait_for_url("**/docs/positioning.html*")


@pytest.mark.parametrize(("scheme", "shown"), [("light", "default"), ("dark", "slate")])
def test_colours_follow_the_reader(page: Page, scheme: str, shown: str) -> None:
    page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
    page.goto((HTML / "docs/security.html").as_uri())
    expect(page.locator("body")).to_have_attribute("data-md-color-scheme", shown)
    figure = page.locator("article img").first
    assert figure.evaluate("image => image.decode().then(() => image.naturalWidth)") > 0


def test_links_between_pages_and_to_files(page: Page) -> None:
    page.goto((HTML / "index.html").as_uri())
    page.locator('article a[href$="device-tree.html"]').first.click()
    page.wait_for_url("**/docs/device-tree.html")
    target = page.locator("article a", has_text="nuc980.dtsi").first.get_attribute("href")
    assert target and (HTML / "docs" / target).resolve().is_file()
