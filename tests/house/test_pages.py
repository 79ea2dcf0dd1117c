# SPDX-License-Identifier: GPL-3.0-or-later
"""The pages as a site: each is in the navigation, and what `make site` makes loads nothing from elsewhere."""

import re
import subprocess
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = yaml.safe_load((ROOT / "mkdocs.yml").read_text())
HTML = ROOT / SETTINGS["site_dir"]
# What a browser loads by itself. Links that a reader follows may lead anywhere.
LOADS = {"src", "srcset", "poster", "data"}
ELSEWHERE = re.compile(r"(?:https?:)?//")


def pages_of(nav: list[Any]) -> Iterator[str]:
    """Of a navigation, which nests groups in groups."""
    for entry in nav:
        for target in entry.values() if isinstance(entry, dict) else [entry]:
            yield from pages_of(target) if isinstance(target, list) else [target]


def test_each_page_is_in_the_navigation_once() -> None:
    """What is not has to be added to mkdocs.yml, in the group of its readers."""
    pages = [f"docs/{page.name}" for page in (ROOT / "docs").glob("*.md")]
    at_the_top = [page.name for page in ROOT.glob("*.md")]
    assert sorted(pages_of(SETTINGS["nav"])) == sorted(pages + at_the_top)
    assert next(pages_of(SETTINGS["nav"])) == "README.md"


class Loaded(HTMLParser):
    """What a page loads from other places than the site."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        loads = LOADS | ({"href"} if tag == "link" else set())
        self.found += [value for name, value in attrs if name in loads and value and ELSEWHERE.match(value)]


@pytest.mark.slow
def test_the_site_is_built_and_loads_nothing_from_elsewhere() -> None:
    """MkDocs itself ends with an error for a link or an anchor that leads nowhere."""
    built = subprocess.run(["make", "site"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    pages = list(HTML.rglob("*.html"))
    assert {HTML / "index.html", HTML / "docs/security.html", HTML / "CHANGELOG.html"} <= set(pages)
    found = {page.name: loaded for page in pages if (loaded := Loaded(page.read_text()).found)}
    for sheet in HTML.rglob("*.css"):
        if loaded := re.findall(r"(?:url\(|@import )[\"']?(?:https?:)?//[^)\"']+", sheet.read_text()):
            found[sheet.name] = loaded
    assert found == {}


def test_what_a_page_loads_is_seen() -> None:
    text = '<a href="https://a.example"><link href="//b.example/x.css"><img src="https://c.example/y.png">'
    assert Loaded(text + '<script src="x.js">').found == ["//b.example/x.css", "https://c.example/y.png"]
