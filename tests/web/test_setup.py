# SPDX-License-Identifier: GPL-3.0-or-later
"""Set-up in the gateway's page by HTTP: what it may change, the dry run, the trial, what a kill leaves.

The minute of the trial passes in rtud/test_proposal.c; each key of the file is tried in rtud/test_page.c.
"""

import json
import os
import stat
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import GatewayError
from peers.authority import give_to_station
from rig.web import WAIT_S, WEB_USER, Client, Page, make_user, page_of

LONGEST = 256 * 1024  # SETUP_TEXT_MAX


@pytest.fixture(scope="module")
def page(programs: Path) -> Iterator[Page]:
    with page_of(programs, setup=True) as page:
        for name in ("installer", "other"):
            make_user(page.folder / "web.users", name, "installer")
        give_to_station(page.folder / "web.users", WEB_USER)
        yield page


@pytest.fixture(scope="module")
def installer(page: Page) -> Client:
    return page.client("installer")


def ended(page: Page, client: Client) -> dict[str, Any]:
    """When rtud has answered the last wish."""
    said: dict[str, Any] = {}

    def look() -> bool:
        said.update(client.ask("/api/setup").json())
        return not said["waits"]

    page.gateway.wait_for(look, WAIT_S, "rtud answers the wish")
    return said


def wish(page: Page, client: Client, name: str, **body: Any) -> dict[str, Any]:
    answer = client.ask(f"/api/setup/{name}", body)
    assert answer.status == 202, answer.text
    return ended(page, client)


def load(page: Page, client: Client, number: int = 0) -> dict[str, Any]:
    wish(page, client, "show", number=number)
    shown: dict[str, Any] = client.ask("/api/setup/text").json()
    return shown


def check(page: Page, client: Client, text: str, base: int) -> dict[str, Any]:
    answer = client.ask_text(f"/api/setup/check?base={base}", text)
    assert answer.status == 202, answer.text
    return ended(page, client)


def changed(text: str, name: str, address: int = 2) -> str:
    """With one more point."""
    file = json.loads(text)
    file["port"][0]["slaves"][0]["input_registers"].append(
        {"address": address, "name": name, "type": "scaled"}
    )
    return json.dumps(file, indent=2)


def names(page: Page) -> set[str]:
    return set(page.gateway.points())


def phase(client: Client) -> str:
    return str(client.ask("/api/setup").json()["phase"])


def is_logged(page: Page, line: str) -> bool:
    return line in page.gateway.log_file.read_text()


def test_a_change_is_checked_tried_confirmed_and_kept(page: Page, installer: Client) -> None:
    file = page.gateway.config_file
    before, mode = file.read_text(), stat.S_IMODE(file.stat().st_mode)
    shown = load(page, installer)
    assert shown["text"] == before and shown["history"] == []
    text = changed(before, "kept")
    said = check(page, installer, text, shown["base"])
    assert (said["good"], said["phase"], said["mine"]) == (True, "checked", True)
    for line in ("+ kept, CA 1010", "rtu-modbus-1 gets a new process", "rtu-web is not touched"):
        assert line in said["report"]
    assert "kept" not in names(page)
    said = wish(page, installer, "apply", proposed=said["proposed"])
    assert said["phase"] == "trial" and 0 < said["left_s"] <= 60, said
    assert "kept" in names(page)
    assert file.read_text() == before  # what a power cut would find
    said = wish(page, installer, "confirm", proposed=said["proposed"])
    assert (said["good"], said["phase"]) == (True, "none"), said
    assert file.read_text() == text and stat.S_IMODE(file.stat().st_mode) == mode
    (entry,) = load(page, installer)["history"]
    assert (entry["number"], entry["user"]) == (1, "installer")
    assert load(page, installer, 1)["text"] == before
    history = file.with_name("gateway.json.history")
    assert stat.S_IMODE(history.stat().st_mode) == 0o700
    for line in ("set-up: installer puts a configuration into force", "installer has confirmed"):
        page.gateway.wait_for(partial(is_logged, page, line), WAIT_S, line)


def test_what_is_taken_back_was_never_on_the_disk(page: Page, installer: Client) -> None:
    file = page.gateway.config_file
    before = file.read_text()
    said = check(page, installer, changed(before, "gone", 3), load(page, installer)["base"])
    said = wish(page, installer, "apply", proposed=said["proposed"])
    assert said["phase"] == "trial" and "gone" in names(page)
    # Nobody else changes anything meanwhile, and nobody else confirms.
    other = page.client("other")
    assert wish(page, other, "confirm", proposed=said["proposed"])["refused"]
    assert check(page, other, before, said["in_force"])["refused"]
    with pytest.raises(GatewayError, match="busy with another change"):
        page.gateway.ctl("reload", "--dry-run", str(file))
    wish(page, installer, "return")
    page.gateway.wait_for(lambda: phase(installer) == "none", WAIT_S, "the trial is over")
    assert "gone" not in names(page) and file.read_text() == before


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda file: file.update(modules=[{"name": "x", "program": "/bin/sh"}]), "modules: is new"),
        (lambda file: file["web"].pop("users"), "web: is another one"),
        (lambda file: file["port"][0].update(device="/dev/console"), "port[0].device: is new"),
        (lambda file: file.update(include=["../../etc/passwd"]), "include: is new"),
        (lambda file: file["port"][0]["slaves"][0].update(template="../x"), "template: "),
        (lambda file: file["port"][0].update(baud_rate="fast"), "port[0].baud_rate: is a string"),
    ],
)
def test_what_the_page_may_not_or_nobody_can(
    page: Page, installer: Client, change: Callable[[Any], Any], line: str
) -> None:
    before = page.gateway.config_file.read_text()
    file = json.loads(before)
    change(file)
    said = check(page, installer, json.dumps(file, indent=2), load(page, installer)["base"])
    assert not said["good"] and said["phase"] == "none"
    assert line in said["report"] and f"{page.gateway.config_file}:" in said["report"]
    assert wish(page, installer, "apply", proposed=said["proposed"])["refused"]
    assert page.gateway.config_file.read_text() == before


@pytest.mark.parametrize("form", ['{"include": ["other"],', '{"include": [], "include": ["other"],'])
def test_a_file_that_the_page_may_not_name_is_not_opened(page: Page, installer: Client, form: str) -> None:
    """rtud may read what the page may not: the reader's complaints of it would show its words."""
    (page.folder / "other").write_text("hush, this is no JSON")
    before = page.gateway.config_file.read_text()
    text = before.replace("{", form.replace("other", str(page.folder / "other")), 1)
    said = check(page, installer, text, load(page, installer)["base"])
    assert not said["good"] and "include: is new" in said["report"]
    assert "hush" not in said["report"] and "/other" not in said["report"]


def test_what_is_no_json_is_named_at_its_line(page: Page, installer: Client) -> None:
    base = load(page, installer)["base"]
    before = page.gateway.config_file.read_text()
    for text, message in (
        ('{\n  "port": [],\n}', ":2:"),
        (before.replace("{", '{"port": [],', 1), "duplicate"),
        ("\x00\xff", ":1:"),
    ):
        said = check(page, installer, text, base)
        assert not said["good"] and message in said["report"], said
        assert wish(page, installer, "apply", proposed=said["proposed"])["refused"]


def test_who_changed_the_file_by_hand_is_not_overwritten(page: Page, installer: Client) -> None:
    file = page.gateway.config_file
    before = file.read_text()
    base = load(page, installer)["base"]
    file.write_text(before + "\n")
    said = check(page, installer, changed(before, "late", 4), base)
    assert not said["good"] and "is not what runs" in said["report"]
    assert "rtuctl reload" in load(page, installer)["error"]
    page.gateway.ctl("reload")
    said = check(page, installer, changed(before, "late", 4), base)
    assert "has changed since you have loaded it" in said["report"]
    # And during the trial.
    said = check(page, installer, changed(before, "late", 4), load(page, installer)["base"])
    said = wish(page, installer, "apply", proposed=said["proposed"])
    assert said["phase"] == "trial"
    file.write_text(before)
    said = wish(page, installer, "confirm", proposed=said["proposed"])
    assert not said["good"] and "somebody has changed the file meanwhile" in said["report"]
    page.gateway.wait_for(lambda: phase(installer) == "none", WAIT_S, "the trial is over")
    assert file.read_text() == before and "late" not in names(page)
    page.gateway.ctl("reload")


def test_only_an_installer_sets_up(page: Page, installer: Client) -> None:
    for name in ("viewer", "operator", "engineer"):
        client = page.client(name)
        assert client.ask("/api/state").json()["setup"] is False
        for path in ("/api/setup", "/api/setup/text"):
            assert client.ask(path).status == 403
        for path in ("show", "apply", "confirm", "return", "check"):
            assert client.ask(f"/api/setup/{path}", {}).status == 403
    assert Client(page.port, page.folder / "web.pem").ask_text("/api/setup/check", "x").status == 401
    state = installer.ask("/api/state").json()
    assert state["setup"] and not state["commands"]
    order = {"action": "execute", "name": "lamp", "value": "on"}
    assert installer.ask("/api/order", order).status == 403


def test_only_the_page_hands_over_a_text(page: Page, installer: Client) -> None:
    text = page.gateway.config_file.read_text()
    for headers in ({"X_CSRF_Token": "0" * 64}, {"Content_Type": "text/plain"}):
        assert installer.ask_text("/api/setup/check", text, **headers).status == 403
    long = installer.ask_text("/api/setup/check", "x", Content_Length=str(LONGEST + 1))
    assert long.status == 413
    assert installer.ask_text("/api/setup/check", "").status == 400
    assert installer.ask("/api/setup/check").status == 405
    said = check(page, installer, "[" * LONGEST, load(page, installer)["base"])
    assert not said["good"]


def test_its_files_are_for_who_asked(page: Page, installer: Client) -> None:
    """Without rights, all processes are one user's."""
    shown = load(page, installer)
    check(page, installer, shown["text"], shown["base"])
    assert not list(page.gateway.map.glob("setup.proposed*.new"))
    modes = {"setup.shown": 0o400, "setup.proposed": 0o600, "setup.state": 0o640}
    for name, mode in modes.items():
        found = stat.S_IMODE((page.gateway.map / name).stat().st_mode)
        assert found == (mode if os.geteuid() == 0 else 0o600)


def test_a_killed_rtud_comes_back_with_the_file_that_was_confirmed(page: Page, installer: Client) -> None:
    """As after a power cut in the trial."""
    file = page.gateway.config_file
    before = file.read_text()
    said = check(page, installer, changed(before, "lost", 5), load(page, installer)["base"])
    said = wish(page, installer, "apply", proposed=said["proposed"])
    assert said["phase"] == "trial" and "lost" in names(page)
    assert page.gateway.process is not None
    page.gateway.process.kill()
    page.gateway.process.wait()
    assert file.read_text() == before
    page.gateway.start()
    assert "lost" not in names(page)
    client = page.client("installer")
    assert phase(client) == "none" and load(page, client)["text"] == before


def test_a_configuration_is_kept_where_the_file_cannot_be_written(page: Page) -> None:
    """As on a board, whose own file is in a root that is read only. The last test of the file."""
    gateway = page.gateway
    kept = page.folder / "site" / "config.json"
    kept.parent.mkdir()
    gateway.stop()
    before = gateway.config_file.read_text()
    gateway.options = ["--kept", kept]
    gateway.start()
    installer = page.client("installer")
    said = check(page, installer, changed(before, "site", 6), load(page, installer)["base"])
    said = wish(page, installer, "apply", proposed=said["proposed"])
    said = wish(page, installer, "confirm", proposed=said["proposed"])
    assert (said["good"], said["phase"]) == (True, "none"), said
    assert "site" in json.dumps(json.loads(kept.read_text())) and gateway.config_file.read_text() == before
    assert f"{kept} is read in place of {gateway.config_file}" in gateway.ctl("reload")
    assert "site" in names(page)
    gateway.stop()
    gateway.start()
    installer = page.client("installer")
    assert "site" in names(page)
    shown = load(page, installer)
    assert shown["text"] == kept.read_text() and load(page, installer, 1)["text"] == before
    gateway.stop()
    kept.write_text("{")
    gateway.start()
    assert "site" not in names(page)
    assert f"{kept} is not used" in gateway.log_file.read_text()
