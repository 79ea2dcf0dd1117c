# SPDX-License-Identifier: GPL-3.0-or-later
"""The words of the page: each has a place, and no language says what English does not."""

import json
import re
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "centre" / "page"
ENGLISH = json.loads((PAGE / "lang" / "en.json").read_text())


@pytest.mark.parametrize("language", ["en", "de", "sr", "es"])
def test_no_word_is_there_twice(language: str) -> None:
    """The second one would be said in place of the first, too."""
    text = (PAGE / "lang" / f"{language}.json").read_text()
    keys = json.loads(text, object_pairs_hook=lambda pairs: [key for key, _ in pairs])
    assert sorted(keys) == sorted(set(keys))


@pytest.mark.parametrize("language", ["de", "sr", "es"])
def test_language_has_known_words_with_the_same_places(language: str) -> None:
    words = json.loads((PAGE / "lang" / f"{language}.json").read_text())
    assert words.keys() <= ENGLISH.keys()
    for key, text in words.items():
        assert sorted(re.findall(r"{(\w+)}", text)) == sorted(re.findall(r"{(\w+)}", ENGLISH[key])), key


def test_each_word_that_a_module_says_is_there() -> None:
    """In place of one that is not stands its key."""
    said = set()
    for file in (PAGE / "js").glob("*.js"):
        code = re.sub(r"^\s*//.*", "", file.read_text(), flags=re.MULTILINE)
        said |= {(file.name, key) for key in re.findall(r'\bt\("(\w+)"', code)}
    assert len(said) > 100
    assert {each for each in said if each[1] not in ENGLISH} == set()


def test_page_makes_no_markup_of_text() -> None:
    """What would turn a name into markup or code is nowhere in the page."""
    for file in (PAGE / "js").glob("*.js"):
        assert not re.search(
            r"innerHTML|outerHTML|insertAdjacent|document\.write|\beval\(", file.read_text()
        ), file


def test_each_name_that_a_module_imports_is_exported() -> None:
    """One that is not leaves the whole page blank."""
    for file in (PAGE / "js").glob("*.js"):
        for names, other in re.findall(
            r'^import {([^}]*)} from "\./(\w+\.js)"', file.read_text(), re.MULTILINE
        ):
            exported = set(re.findall(r"^export (?:async )?(?:function\*?|const|let|class) (\w+)",
                                      (PAGE / "js" / other).read_text(), re.MULTILINE))  # fmt: skip
            wanted = {name.split(" as ")[0].strip() for name in names.split(",") if name.strip()}
            assert wanted <= exported, (file.name, other, wanted - exported)
