# SPDX-License-Identifier: GPL-3.0-or-later
"""The page of the map in a browser, from a file: another function is tried, and what comes of it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import yaml
from program import DONE, run
from trees import CHIP, ROOT, TABLE

from nuc980.pins.board import load_board

sys.path.append(str(ROOT / "tests" / "centre"))
from browser import PLAIN, chromium, faultless


@pytest.mark.slow
def test_another_function_is_tried(tmp_path: Path) -> None:
    page_file, table = tmp_path / "map.html", tmp_path / "pins.yml"
    assert run("map", "-o", page_file).returncode == DONE
    with chromium(PLAIN) as browser, faultless(browser) as page:
        page.goto(f"{page_file.as_uri()}#pin=PE11")
        assert page.locator("#table").is_hidden()
        page.get_by_role("button", name="Use USB0_VBUSVLD on PE11").click()
        assert page.locator("#conflicts li").all_inner_texts() == []
        part = f"part: {load_board(TABLE, CHIP).part}\n"
        table.write_text(part + page.locator("#yaml").input_value())
        board = load_board(table, CHIP)
        assert board.devices["usbdev"].pins == {"USB0_VBUSVLD": "PE11"}
        assert board.devices.keys() - {"usbdev"} == load_board(TABLE, CHIP).devices.keys()

        # The address holds it; a signal on two pins and one that is lost are told.
        page.goto(f"{page_file.as_uri()}#pin=PA1&try=PA1:4,PA0:0")
        page.wait_for_function("document.querySelectorAll('#conflicts li').length == 2")
        assert set(page.locator("#conflicts li").all_inner_texts()) == {
            "UART1_TXD is on PF10 as well.",
            "uart1 loses UART1_RXD (PA0).",
        }
        assert yaml.safe_load(page.locator("#yaml").input_value())["gpios"].keys() == {"PA0"}
        page.get_by_role("button", name="Undo all").click()
        assert page.locator("#table").is_hidden()
        assert "try" not in page.url
