# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes the pictures of docs/web.md in a browser, from a gateway of its own.

PYTHONPATH=tests:scripts .venv/bin/python tests/centre/web_pictures.py
"""

from pathlib import Path

from playwright.sync_api import Page as Tab

from browser import chromium
from lab.gateway import free_port, run_directory
from rig.desk import chapter_5, everything_read, gateway_on_lines
from rig.web import PASSWORD, WAIT_S, make_files

FIGURES = Path(__file__).resolve().parents[2] / "docs" / "figures"
NATIVE = Path(__file__).resolve().parents[2] / "build" / "native"
WIDE = {"width": 1160, "height": 560}
SETTLES_MS = 1500


def take(tab: Tab, name: str) -> None:
    tab.wait_for_timeout(SETTLES_MS)
    tab.screenshot(path=FIGURES / f"web-{name}.png")


def main() -> None:
    folder, port = run_directory(), free_port()
    folder.chmod(0o755)
    make_files(folder)
    config = chapter_5()
    config["web"] = {
        **{"port": port, "station": "Substation 7", "users": str(folder / "web.users"), "commands": True},
        **{"certificate": str(folder / "web.pem"), "key": str(folder / "web.key")},
    }
    with gateway_on_lines(config, NATIVE) as (lines, gateway), chromium() as browser:
        gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "every device has been read")
        tab = browser.new_context(
            ignore_https_errors=True, viewport=WIDE, color_scheme="light", locale="en-GB"
        ).new_page()
        tab.goto(f"https://127.0.0.1:{port}/")
        tab.fill("[name=name]", "operator")
        tab.fill("[name=password]", PASSWORD)
        tab.click("button.main")
        tab.wait_for_selector("tbody tr")
        tab.fill("#search", "feeder10")
        lines.fault("1.10", "mute")
        tab.wait_for_selector(".state.bad")
        take(tab, "points")
        lines.fault("1.10", "clear")
        gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "the device is back")
        tab.keyboard.press("Escape")
        tab.keyboard.press("4")
        tab.locator("tr", has_text="feeder10.breaker-command").locator("button").click()
        tab.fill("dialog input", "on")
        tab.locator("dialog button.main:visible").click()
        tab.locator("dialog button.main:visible", has_text="Execute").click()
        tab.locator("#outcome", has_text="Executed").wait_for()
        take(tab, "command")


if __name__ == "__main__":
    main()
