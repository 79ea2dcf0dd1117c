# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench-map`: how fluent the control centre's page is in Debian's Chromium, with RTUs polled at 1 Hz. Of
its map: frames a second, the longest time without one, and how many markers have moved, at rest and while
it is dragged; and while it is dragged with the markers hidden, which tells what the map takes beside the
same RTUs. With one marker it tells what the map itself takes. Of the lists of 2 000 stations: frames a
second at rest and while they are scrolled, and of how many nodes the page is made. No time is asserted.
Exit codes: 0 done, 1 something did not work, 2 not built.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import os
import socket
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from playwright.sync_api import CDPSession, Error, Page
from polls import PROGRAM, RTUS, PollError
from store import PASSWORD, STARTS_S, USER, running

from bench import machine
from lab.gateway import REPOSITORY, free_port

sys.path.insert(0, str(REPOSITORY / "tests" / "centre"))
from browser import LIMIT_MS, PLAIN, chromium, log_in

PAGE = REPOSITORY / "build" / "centre" / "page" / "done"
SIZE = {"width": 1280, "height": 800}
MARKERS = "openrtuMap.getLayer('marks').implementation.places.length"
# Dragged is drawn anew for each frame; at rest only what the centre tells is.
MEASURE = """async ([seconds, dragged]) => {
  const marks = openrtuMap.getLayer("marks").implementation, told = marks.show.bind(marks);
  let frames = 0, moved = 0, longest = 0, last = performance.now(), drawn = 0;
  marks.show = (places) => {
    const before = marks.numbers;
    told(places);
    const differs = (at) => before[at] !== marks.numbers[at];
    for (let at = 0; at < before.length; at += 3) moved += differs(at) || differs(at + 1);
  };
  const count = () => { drawn += 1; };
  openrtuMap.on("render", count);
  const begun = last;
  const swing = (part) => Math.sin(2 * Math.PI * (seconds / 2) * part);
  if (dragged) openrtuMap.panBy([250, 0], { duration: seconds * 1000, easing: swing, essential: true });
  await new Promise((done) => {
    const step = (now) => {
      frames += 1;
      longest = Math.max(longest, now - last);
      last = now;
      if (now - begun < seconds * 1000) requestAnimationFrame(step); else done();
    };
    requestAnimationFrame(step);
  });
  openrtuMap.off("render", count);
  openrtuMap.stop();
  delete marks.show;
  const passed = (last - begun) / 1000;
  return { frames: frames / passed, drawn: drawn / passed, moved: moved / passed, longest };
}"""

LISTED = 2000
KNOWN = """async (count) => (await import("./js/live.js")).stations.size >= count"""
# As a wheel scrolls: 3 000 pixels a second, some 100 rows; down, and up again.
SCROLLED = """async ([seconds, selector]) => {
  let frames = 0, longest = 0, last = performance.now();
  const begun = last, list = document.querySelector(selector ?? "body");
  await new Promise((done) => {
    const step = (now) => {
      frames += 1;
      longest = Math.max(longest, now - last);
      last = now;
      const part = (now - begun) / (seconds * 1000);
      if (selector) list.scrollTop = 3000 * seconds * Math.min(part, 1 - part);
      if (part < 1) requestAnimationFrame(step); else done();
    };
    requestAnimationFrame(step);
  });
  return { frames: frames / ((last - begun) / 1000), longest, nodes: document.querySelectorAll("*").length };
}"""


def browser_s() -> float:
    """CPU time of the browser's processes, which draw."""
    parents, used = {}, {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it has ended meanwhile
            fields = file.read_text().rpartition(")")[2].split()
            parents[int(file.parent.name)] = int(fields[1])
            if b"--type=" in (file.parent / "cmdline").read_bytes():
                used[int(file.parent.name)] = int(fields[11]) + int(fields[12])
    mine = {os.getpid()}
    while found := {each for each, parent in parents.items() if parent in mine} - mine:
        mine |= found
    return sum(used.get(each, 0) for each in mine) / os.sysconf("SC_CLK_TCK")


def scripts_s(metrics: CDPSession) -> float:
    """How long the page's scripts have run."""
    measured = metrics.send("Performance.getMetrics")["metrics"]
    return float(next(each["value"] for each in measured if each["name"] == "ScriptDuration"))


def answers(port: int) -> None:
    """10 000 stations that are new take the centre a while."""
    end = time.monotonic() + STARTS_S
    while True:
        try:
            socket.create_connection(("127.0.0.1", port)).close()
            return
        except OSError as error:
            if time.monotonic() > end:
                raise PollError(f"the centre does not answer: {error}") from error
            time.sleep(0.1)


def frames(count: int, seconds: int) -> Iterator[str]:
    with tempfile.TemporaryDirectory(prefix="frames-") as name:
        port = free_port()
        with running(count, port, Path(name), "v"), chromium() as browser:
            answers(port)
            page = browser.new_context(viewport=SIZE, color_scheme="light").new_page()
            log_in(page, port, USER, PASSWORD)
            page.wait_for_function("Boolean(window.openrtuMap?.style?.getLayer('marks'))", timeout=LIMIT_MS)
            while page.evaluate(MARKERS) < count:
                page.wait_for_timeout(500)
            metrics = page.context.new_cdp_session(page)
            metrics.send("Performance.enable")
            yield measured(page, metrics, f"{count} moving markers, the map at rest", False, seconds)
            for visibility, shown in (("visible", ""), ("none", " with all of them hidden")):
                page.evaluate(f"openrtuMap.setLayoutProperty('marks', 'visibility', '{visibility}')")
                what = f"{count} moving markers, the map dragged{shown}"
                yield measured(page, metrics, what, True, seconds)


def lists(count: int, seconds: int) -> Iterator[str]:
    """Of stations whose values change each second."""
    with tempfile.TemporaryDirectory(prefix="frames-") as name:
        port = free_port()
        with running(count, port, Path(name), "v"), chromium(PLAIN) as browser:
            answers(port)
            page = browser.new_context(viewport=SIZE, color_scheme="light").new_page()
            log_in(page, port, USER, PASSWORD, "stations")
            for view, selector in (("stations", ".page"), ("points", ".list")):
                page.evaluate(f"location.hash = '#{view}'")
                page.wait_for_function(KNOWN, arg=count, timeout=LIMIT_MS)
                for how, moved in (("at rest", None), ("scrolled", selector)):
                    seen = page.evaluate(SCROLLED, [seconds, moved])
                    yield (
                        f"{count} stations, the list of the view {view} {how}: {seen['nodes']} nodes,"
                        f" {seen['frames']:.1f} frames a second, {seen['longest']:.0f} ms the longest time"
                        f" without one; load {os.getloadavg()[0]:.1f}"
                    )


def measured(page: Page, metrics: CDPSession, what: str, dragged: bool, seconds: int) -> str:
    scripts, used, begun = scripts_s(metrics), browser_s(), time.monotonic()
    seen = page.evaluate(MEASURE, [seconds, dragged])
    passed = time.monotonic() - begun
    return (
        f"{what}, {SIZE['width']} x {SIZE['height']}, drawn by the processor:"
        f" {seen['frames']:.1f} frames a second, of which {seen['drawn']:.1f} draw the map;"
        f" {seen['longest']:.0f} ms the longest time without one;"
        f" {seen['moved']:.0f} markers moved a second;"
        f" the page's own scripts took {(scripts_s(metrics) - scripts) / passed * 1000:.0f} ms of a second,"
        f" all of the browser {(browser_s() - used) / passed * 1000:.0f} ms of CPU;"
        f" load {os.getloadavg()[0]:.1f}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description="How fluent the control centre's map is.")
    parser.add_argument("--quick", action="store_true", help="100 markers only")
    parser.add_argument("--lists", action="store_true", help="the lists only")
    parser.add_argument("--output", type=Path, default=REPOSITORY / "build", help="folder for the text")
    arguments = parser.parse_args()
    missing = [str(file) for file in (RTUS, PROGRAM, PAGE) if not file.exists()]
    if missing:
        print(f"not built: {', '.join(missing)}; type `make bench-map`, which builds them", file=sys.stderr)
        return 2
    lines = [f"{machine()}; load {os.getloadavg()[0]:.1f}; {datetime.date.today()}."]
    print(lines[0], flush=True)
    try:
        counts = (100,) if arguments.quick else (1, 1000, 10_000)
        for count in () if arguments.lists else counts:
            for line in frames(count, 4 if arguments.quick else 20):
                lines.append(line)
                print(line, flush=True)
        for line in lists(100 if arguments.quick else LISTED, 4 if arguments.quick else 20):
            lines.append(line)
            print(line, flush=True)
    except (PollError, OSError, TimeoutError, Error) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    arguments.output.mkdir(parents=True, exist_ok=True)
    (arguments.output / "frames.txt").write_text("\n\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
