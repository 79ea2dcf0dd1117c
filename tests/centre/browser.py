# SPDX-License-Identifier: GPL-3.0-or-later
"""Debian's Chromium without a screen and without its own windows, on the control centre's page."""

from __future__ import annotations

import base64
import contextlib
from collections.abc import Iterator
from typing import Any

from playwright.sync_api import Browser, Locator, Page, sync_playwright

# What chromium --headless draws of itself for each window takes more than twice the processor time.
PROGRAM = "/usr/bin/chromium-headless-shell"
# It asks nobody else.
PLAIN = [
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
]
# It draws WebGL by itself, for the map.
FLAGS = [*PLAIN, "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
LIMIT_MS = 120_000  # for a hang only
TABS_MOST = 100


@contextlib.contextmanager
def chromium(flags: list[str] = FLAGS) -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=PROGRAM, args=flags, timeout=LIMIT_MS)
        yield browser
        browser.close()


@contextlib.contextmanager
def faultless(browser: Browser, **settings: Any) -> Iterator[Page]:
    """A page on which no script fails, asks somebody with a dialogue, or is held by the policy."""
    context = browser.new_context(**{"locale": "en-GB", "timezone_id": "UTC", **settings})
    page = context.new_page()
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("dialog", lambda dialog: (wrong.append(dialog.message), dialog.dismiss()))
    page.on(
        "console", lambda message: wrong.append(message.text) if "Content Security" in message.text else None
    )
    yield page
    context.close()
    assert wrong == []


def log_in(page: Page, port: int, name: str, password: str, view: str = "map") -> None:
    """By the keyboard alone."""
    page.set_default_timeout(LIMIT_MS)
    page.goto(f"http://127.0.0.1:{port}/#{view}")
    page.wait_for_selector("#name")
    page.bring_to_front()  # of a page behind another one nothing has the focus
    page.wait_for_selector("#name:focus")
    page.keyboard.type(name)
    page.keyboard.press("Tab")
    page.keyboard.type(password)
    page.keyboard.press("Enter")
    page.wait_for_selector("nav, .error:not(:empty)")
    assert page.locator("nav").count(), page.locator(".error").inner_text()


def tab_to(page: Page, wanted: Locator, key: str = "Tab") -> None:
    """By the keyboard alone, as often as it takes."""
    for _ in range(TABS_MOST):
        if wanted.evaluate("one => one === document.activeElement"):
            return
        page.keyboard.press(key)
    raise AssertionError(f"no {key} leads to {wanted}")


def look_into(page: Page, picture: bytes, script: str, argument: Any = None) -> Any:
    """What a script finds in a screenshot; it is called with a pen of its pixels, and with the argument."""
    return page.evaluate(
        f"""async ([text, argument]) => {{
          const octets = Uint8Array.from(atob(text), (octet) => octet.charCodeAt(0));
          const image = await createImageBitmap(new Blob([octets]));
          const pen = new OffscreenCanvas(image.width, image.height).getContext("2d");
          pen.drawImage(image, 0, 0);
          return ({script})(pen, argument);
        }}""",
        # Of octets Playwright makes an object each: 2 CPU s.
        [base64.b64encode(picture).decode(), argument],
    )


def tool(page: Page, selector: str) -> Locator:
    """Of the head. A narrow page has them in its menu."""
    wanted = page.locator(selector)
    if not wanted.is_visible():
        page.locator("#menu").click()
    return wanted
