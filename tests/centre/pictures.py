# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes the pictures of docs/control-centre.md in a browser, from `make centre KEEP=1`.

python tests/centre/pictures.py PORT PASSWORD
"""

import argparse
from pathlib import Path

from playwright.sync_api import Page

from browser import chromium, log_in

FIGURES = Path(__file__).resolve().parents[2] / "docs" / "figures"
SETTLES_MS = 3000  # names fade in
SIZE = {"width": 1100, "height": 640}


def take(page: Page, name: str) -> None:
    page.screenshot(path=FIGURES / f"centre-{name}.png")


def silence(page: Page) -> None:
    """Its button lies over the page while the horn sounds."""
    page.keyboard.press("s")
    page.locator("#silence").wait_for(state="hidden")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("port", type=int)
    parser.add_argument("password")
    arguments = parser.parse_args()
    with chromium() as browser:
        page = browser.new_context(viewport=SIZE, color_scheme="light", locale="en-GB").new_page()
        log_in(page, arguments.port, "operator", arguments.password)
        # The town is far away from a place that the map knows well: a vehicle in Europe, and its neighbours.
        page.locator(".list button", has_text="Torino-Milano").click()
        page.locator(".about", has_text="Track of the last hour").wait_for()
        page.evaluate("openrtuMap.jumpTo({center: [12, 47], zoom: 4.1})")
        while page.evaluate("openrtuMap.getLayer('marks').implementation.inSight().length") < 9:
            page.wait_for_timeout(100)
        page.wait_for_timeout(SETTLES_MS)
        silence(page)
        take(page, "map")
        page.keyboard.press("2")
        page.locator(".side .list button", has_text="substation Beograd").click()
        silence(page)
        page.locator("tr", has_text="feeder10.breaker-command").locator("button.small").click()
        page.locator("dialog .choices button").nth(1).click()
        page.locator("dialog button.main").click()
        page.locator("dialog button.main", has_text="Execute").click()
        page.locator("dialog .outcome").wait_for()
        take(page, "command")
        page.keyboard.press("Escape")
        page.evaluate("location.hash = 'pictures/substation-bay'")
        page.locator(".drawing #p-qa1[aria-label*=good]").wait_for()
        silence(page)
        take(page, "bay")
        page.keyboard.press("7")
        page.get_by_role("button", name="Audit").click()
        page.locator("td", has_text="feeder10.breaker-command").first.wait_for()
        silence(page)
        take(page, "audit")


if __name__ == "__main__":
    main()
