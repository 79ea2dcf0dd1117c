# SPDX-License-Identifier: GPL-3.0-or-later
"""Set-up in the gateway's page by HTTP: what it may change, the dry run, the trial, what a kill leaves.

The minute of the trial passes in rtud/test_proposal.c; each key of the file is tried in rtud/test_page.c.
"""

import json
import os
import stat
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

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


def until(what: Callable[[], Any]) -> Any:
    deadline = time.monotonic() + WAIT_S
    while not (found := what()):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return found


def ended(client: Client) -> dict[str, Any]:
    """When rtud has answered the last wish."""

    def look() -> dict[str, Any] | None:
        said: dict[str, Any] = client.ask("/api/setup").json()
        return None if said["waits"] else said

    found: dict[str, Any] = until(look)
    return found


def wish(client: Client, name: str, **body: Any) -> dict[str, Any]:
    answer = client.ask(f"/api/setup/{name}", body)
    assert answer.status == 202, answer.text
    return ended(client)


def load(client: Client, number: int = 0) -> dict[str, Any]:
    wish(client, "show", number=number)
    shown: dict[str, Any] = client.ask("/api/setup/text").json()
    return shown


def check(client: Client, text: str, base: int) -> dict[str, Any]:
    answer = client.ask_text(f"/api/setup/check?base={base}", text)
    assert answer.status == 202, answer.text
    return ended(client)


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


def test_a_change_is_checked_tried_confirmed_and_kept(page: Page, installer: Client) -> None:
    file = page.gateway.config_file
    before, mode = file.read_text(), stat.S_IMODE(file.stat().st_mode)
    shown = load(installer)
    assert shown["text"] == before and shown["history"] == []
    text = changed(before, "kept")
    said = check(installer, text, shown["base"])
    assert (said["good"], said["phase"], said["mine"]) == (True, "checked", True)
    for line in ("+ kept, CA 1010", "rtu-modbus-1 gets a new process", "rtu-web is not touched"):
        assert line in said["report"]
    assert "kept" not in names(page)
    said = wish(installer, "apply", proposed=said["proposed"])
    assert said["phase"] == "trial" and 0 < said["left_s"] <= 60, said
    assert "kept" in names(page)
    assert file.read_text() == before  # what a power cut would find
    said = wish(installer, "confirm", proposed=said["proposed"])
    assert (said["good"], said["phase"]) == (True, "none"), said
    assert file.read_text() == text and stat.S_IMODE(file.stat().st_mode) == mode
    (entry,) = load(installer)["history"]
    assert (entry["number"], entry["user"]) == (1, "installer")
    assert load(installer, 1)["text"] == before
    history = file.with_name("gateway.json.history")
    assert stat.S_IMODE(history.stat().st_mode) == 0o700
    for line in ("set-up: installer puts a configuration into force", "installer has confirmed"):
        until(lambda line=line: line in page.gateway.log_file.read_text())


def test_what_is_taken_back_was_never_on_the_disk(page: Page, installer: Client) -> None:
    file = page.gateway.config_file
    before = file.read_text()
    said = check(installer, changed(before, "gone", 3), load(installer)["base"])
    said = wish(installer, "apply", proposed=said["proposed"])
    assert said["phase"] == "trial" and "gone" in names(page)
    # Nobody else changes anything meanwhile, and nobody else confirms.
    other = page.client("other")
    assert wish(other, "confirm", proposed=said["proposed"])["refused"]
    assert check(other, before, said["in_force"])["refused"]
    with pytest.raises(Exception, match="busy with another change"):
        page.gateway.ctl("reload", "--dry-run", str(file))
    wish(installer, "return")
    until(lambda: phase(installer) == "none")
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
    said = check(installer, json.dumps(file, indent=2), load(installer)["base"])
    assert not said["good"] and said["phase"] == "none"
    assert line in said["report"] and f"{page.gateway.config_file}:" in said["report"]
    assert wish(installer, "apply", proposed=said["proposed"])["refused"]
    assert page.gateway.config_file.read_text() == before


@pytest.mark.parametrize("form", ['{"include": ["other"],', '{"include": [], "include": ["other"],'])
def test_a_file_that_the_page_may_not_name_is_not_opened(page: Page, installer: Client, form: str) -> None:
    """rtud may read what the page may not: the reader's complaints of it would show its words."""
    (page.folder / "other").write_text("hush, this is no JSON")
    before = page.gateway.config_file.read_text()
    text = before.replace("{", form.replace("other", str(page.folder / "other")), 1)
    said = check(installer, text, load(installer)["base"])
    assert not said["good"] and "include: is new" in said["report"]
    assert "hush" not in said["report"] and "/other" not in said["report"]


def test_what_is_no_json_is_named_at_its_line(page: Page, installer: Client) -> None:
    base = load(installer)["base"]
    before = page.gateway.config_file.read_text()
    for text, message in (
        ('{\n  "port": [],\n}', ":2:"),
        (before.replace("{", '{"port": [],', 1), "duplicate"),
        ("\x00\xff", ":1:"),
    ):
        said = check(installer, text, base)
        assert not said["good"] and message in said["report"], said
        assert wish(installer, "apply", proposed=said["proposed"])["refused"]


def test_who_changed_the_file_by_hand_is_not_overwritten(page: Page, installer: Client) -> None:
    file = page.gateway.config_file
    before = file.read_text()
    base = load(installer)["base"]
    file.write_text(before + "\n")
    said = check(installer, changed(before, "late", 4), base)
    assert not said["good"] and "is not what runs" in said["report"]
    assert "rtuctl reload" in load(installer)["error"]
    page.gateway.ctl("reload")
    said = check(installer, changed(before, "late", 4), base)
    assert "has changed since you have loaded it" in said["report"]
    # And during the trial.
    said = check(installer, changed(before, "late", 4), load(installer)["base"])
    said = wish(installer, "apply", proposed=said["proposed"])
    assert said["phase"] == "trial"
    file.write_text(before)
    said = wish(installer, "confirm", proposed=said["proposed"])
    assert not said["good"] and "somebody has changed the file meanwhile" in said["report"]
    until(lambda: phase(installer) == "none")
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
    said = check(installer, "[" * LONGEST, load(installer)["base"])
    assert not said["good"]


def test_set_up_lets_nobody_command(page: Page) -> None:
    """What a page that was taken over may request of points is what its configuration says: nothing."""
    (module,) = (row for row in page.gateway.query("modules") if row["name"] == "rtu-web")
    assert module["alive"]


def test_its_files_are_for_who_asked(page: Page, installer: Client) -> None:
    """Without rights, all processes are one user's."""
    shown = load(installer)
    check(installer, shown["text"], shown["base"])
    assert not list(page.gateway.map.glob("setup.proposed*.new"))
    modes = {"setup.shown": 0o400, "setup.proposed": 0o600, "setup.state": 0o640}
    for name, mode in modes.items():
        found = stat.S_IMODE((page.gateway.map / name).stat().st_mode)
        assert found == (mode if os.geteuid() == 0 else 0o600)


def test_a_killed_rtud_comes_back_with_the_file_that_was_confirmed(page: Page, installer: Client) -> None:
    """As after a power cut in the trial. The last test of the file."""
    file = page.gateway.config_file
    before = file.read_text()
    said = check(installer, changed(before, "lost", 5), load(installer)["base"])
    said = wish(installer, "apply", proposed=said["proposed"])
    assert said["phase"] == "trial" and "lost" in names(page)
    assert page.gateway.process is not None
    page.gateway.process.kill()
    page.gateway.process.wait()
    assert file.read_text() == before
    page.gateway.start()
    assert "lost" not in names(page)
    client = page.client("installer")
    assert phase(client) == "none" and load(client)["text"] == before


def test_a_configuration_is_kept_where_the_file_cannot_be_written(page: Page) -> None:
    """As on a board, whose own file is in a root that is read only. Behind the kill above."""
    gateway = page.gateway
    kept = page.folder / "site" / "config.json"
    kept.parent.mkdir()
    gateway.stop()
    before = gateway.config_file.read_text()
    gateway.options = ["--kept", kept]
    gateway.start()
    installer = page.client("installer")
    said = check(installer, changed(before, "site", 6), load(installer)["base"])
    said = wish(installer, "apply", proposed=said["proposed"])
    said = wish(installer, "confirm", proposed=said["proposed"])
    assert (said["good"], said["phase"]) == (True, "none"), said
    assert "site" in json.dumps(json.loads(kept.read_text())) and gateway.config_file.read_text() == before
    assert f"{kept} is read in place of {gateway.config_file}" in gateway.ctl("reload")
    assert "site" in names(page)
    gateway.stop()
    gateway.start()
    installer = page.client("installer")
    assert "site" in names(page)
    shown = load(installer)
    assert shown["text"] == kept.read_text() and load(installer, 1)["text"] == before
    gateway.stop()
    kept.write_text("{")
    gateway.start()
    assert "site" not in names(page)
    assert f"{kept} is not used" in gateway.log_file.read_text()
