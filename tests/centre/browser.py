# SPDX-License-Identifier: GPL-3.0-or-later
"""Debian's Chromium, without a screen, on the control centre's page."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from playwright.sync_api import Browser, Locator, Page, sync_playwright

PROGRAM = "/usr/bin/chromium"
# It asks nobody else.
PLAIN = [
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
]
# It draws WebGL by itself, for the map.
FLAGS = [*PLAIN, "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
LIMIT_MS = 120_000  # for a hang only


@contextlib.contextmanager
def chromium(flags: list[str] = FLAGS) -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=PROGRAM, args=flags, timeout=LIMIT_MS)
        yield browser
        browser.close()


def log_in(page: Page, port: int, name: str, password: str, view: str = "map") -> None:
    """By the keyboard alone."""
    page.set_default_timeout(LIMIT_MS)
    page.goto(f"http://127.0.0.1:{port}/#{view}")
    page.wait_for_selector("#name:focus")
    page.keyboard.type(name)
    page.keyboard.press("Tab")
    page.keyboard.type(password)
    page.keyboard.press("Enter")
    page.wait_for_selector("nav, .error:not(:empty)")
    assert page.locator("nav").count(), page.locator(".error").inner_text()


def tool(page: Page, selector: str) -> Locator:
    """Of the head. A narrow page has them in its menu."""
    wanted = page.locator(selector)
    if not wanted.is_visible():
        page.locator("#menu").click()
    return wanted
