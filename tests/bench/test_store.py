# SPDX-License-Identifier: GPL-3.0-or-later
"""The bench of the store: what it feeds is stored, each event of it."""

import sqlite3
from pathlib import Path

import pytest
import store
from store import EVENTS, POSITIONS, intake


@pytest.mark.parametrize(("what", "table"), [(EVENTS, "history"), (POSITIONS, "track")])
def test_all_is_stored(what: str, table: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "TRANSACTION", 50)
    cost = intake(what, 20, 3, tmp_path)
    assert cost.cpu_us > 0
    assert "of 20 stations" in str(cost)
    with sqlite3.connect(tmp_path / f"{what}-20.db") as database:
        assert database.execute(f"SELECT count(*) FROM {table}").fetchone()[0] == 200
