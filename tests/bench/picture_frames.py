# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench-pictures`: how fluent a process picture of 2 000 bound elements is in Debian's Chromium, without a
graphics card, while 50 points a second change: frames a second, the longest time without one, elements that
were touched; at rest, and while a mouse drags it. No time is asserted.
Exit codes: 0 done, 1 something did not work, 2 not built.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path

from frames import PAGE, SIZE, browser_s
from playwright.sync_api import Error, Page

from bench import machine
from lab.gateway import REPOSITORY, default_build
from lab.vehicles import M_ME_TF_1, measured

sys.path.insert(0, str(REPOSITORY / "tests" / "centre"))
from browser import chromium, log_in
from control_room import PASSWORD, Site, Stations, described

ELEMENTS, CHANGES = 2000, 50
COLUMNS = 50
KINDS = (
    '<text x="{x}" y="{y}" font-size="7" data-point="north/p{n}" data-text="{{value:1}}">0.0</text>',
    '<rect x="{x}" y="{top}" width="14" height="10" data-point="north/p{n}"'
    ' data-fill="..30: #2e7d32; 30..70: #f9a825; else: #c62828"/>',
    '<path d="M{x} {y}h14" stroke="#333" stroke-width="2" data-point="north/p{n}"'
    ' data-rotate="0: 0; 100: 90"/>',
    '<rect x="{x}" y="{top}" width="14" height="10" fill="#3b7fc4" data-point="north/p{n}"'
    ' data-level="0: 0; 100: 1"/>',
)
MEASURE = """async (seconds) => {
  const svg = document.querySelector(".drawing").shadowRoot.querySelector("svg");
  const touched = new Set();
  let touches = 0;
  const watch = new MutationObserver((all) => {
    for (const one of all.filter((each) => each.target !== svg)) { touches += 1; touched.add(one.target); }
  });
  watch.observe(svg, { subtree: true, attributes: true, childList: true });
  let frames = 0, longest = 0, last = performance.now();
  const begun = last;
  await new Promise((done) => {
    const step = (now) => {
      frames += 1;
      longest = Math.max(longest, now - last);
      last = now;
      if (now - begun < seconds * 1000) requestAnimationFrame(step); else done();
    };
    requestAnimationFrame(step);
  });
  watch.disconnect();
  const passed = (last - begun) / 1000;
  return { frames: frames / passed, longest, touches: touches / passed, touched: touched.size / passed };
}"""
SWING_PX, SWING_S = 60, 2


def drawing() -> str:
    body = "\n".join(
        KINDS[n % len(KINDS)].format(
            n=n, x=n % COLUMNS * 20, y=n // COLUMNS * 16 + 11, top=n // COLUMNS * 16 + 2
        )
        for n in range(ELEMENTS)
    )
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1000 640">\n{body}\n</svg>\n'


def frames(seconds: int) -> Iterator[str]:
    with tempfile.TemporaryDirectory(prefix="pictures-") as name:
        folder, stations = Path(name), Stations()
        station = stations.station()
        (folder / "pictures").mkdir()
        (folder / "pictures" / "large.svg").write_text(drawing())
        points = "".join(f"1,{n + 1},M_ME_NC_1,p{n}\n" for n in range(ELEMENTS))
        here = [described(station, folder, "north", f"ca,ioa,type,name\n{points}")]
        for ioa in range(1, ELEMENTS + 1):
            stations.say(station, ioa, M_ME_TF_1, measured(time.time_ns() // 1_000_000, ioa % 100))
        with Site(default_build(), folder, here, PAGE.parent, users=["vera"]) as site, chromium() as browser:
            page = browser.new_context(viewport=SIZE, color_scheme="light").new_page()
            log_in(page, site.port, "vera", PASSWORD, "pictures/large")
            last = f".drawing [aria-label='p{ELEMENTS - 1}: {ELEMENTS % 100}, good']"
            page.wait_for_selector(last, state="attached")
            ended = threading.Event()

            def change() -> None:
                for number in count():
                    if ended.wait(1 / CHANGES):
                        return
                    at = time.time_ns() // 1_000_000
                    stations.say(
                        station, number * 7 % ELEMENTS + 1, M_ME_TF_1, measured(at, number * 13 % 101)
                    )

            changing = threading.Thread(target=change, daemon=True)
            changing.start()
            page.wait_for_timeout(3000)
            for what, dragged in (("at rest", False), ("dragged", True)):
                yield told(page, what, dragged, seconds)
            ended.set()
            changing.join()
        stations.do(station.stop())
        stations.close()


def drag(page: Page, until_s: float) -> None:
    """There and back, as a hand does."""
    page.mouse.move(640, 400)
    page.mouse.down()
    while time.monotonic() < until_s:
        away = SWING_PX * math.sin(2 * math.pi * time.monotonic() / SWING_S)
        page.mouse.move(640 + away, 400 + away / 2)
    page.mouse.up()


def told(page: Page, what: str, dragged: bool, seconds: int) -> str:
    used, begun = browser_s(), time.monotonic()
    page.evaluate(f"seconds => {{ window.measured = ({MEASURE})(seconds); }}", seconds)
    if dragged:
        drag(page, begun + seconds)
    seen = page.evaluate("window.measured")
    passed = time.monotonic() - begun
    return (
        f"a picture of {ELEMENTS} bound elements, {CHANGES} points a second, {what}, drawn by the processor:"
        f" {seen['frames']:.1f} frames a second; {seen['longest']:.0f} ms the longest time without one;"
        f" {seen['touches']:.0f} touches of {seen['touched']:.0f} elements a second;"
        f" all of the browser {(browser_s() - used) / passed * 1000:.0f} ms of CPU a second;"
        f" load {os.getloadavg()[0]:.1f}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description="How fluent a process picture is.")
    parser.add_argument("--seconds", type=int, default=20)
    parser.add_argument("--output", type=Path, default=REPOSITORY / "build", help="folder for the text")
    arguments = parser.parse_args()
    if not PAGE.exists():
        print(f"bench-pictures: {PAGE} is not there: make centre-page", file=sys.stderr)
        return 2
    lines = [f"{machine()}"]
    try:
        for line in frames(arguments.seconds):
            print(line, flush=True)
            lines.append(line)
    except (Error, AssertionError, OSError) as error:
        print(f"bench-pictures: {error}", file=sys.stderr)
        return 1
    (arguments.output / "picture-frames.txt").write_text("\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
