# SPDX-License-Identifier: GPL-3.0-or-later
"""Who gets into the control centre, who does not, and what each may do with the own account."""

import doctest
import os
import sqlite3
import stat
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pyotp
import pytest

from control_room import PASSWORD, Site, until
from lab.centre_client import AnswerError, Client
from openrtu_tools.centre import peers, second, tries
from openrtu_tools.centre.login import OF_BOTH, OF_CODE, PLACES
from openrtu_tools.centre.roles import SCOPES
from openrtu_tools.centre.settings import load
from openrtu_tools.centre.sqlite import SqliteStore
from postgres import Server
from test_centre_kill import full

pytestmark = pytest.mark.slow

WRONG = "guessed password"
CONFIRMED = {"own_password": PASSWORD}


@pytest.fixture(scope="module")
def site(of_north: Callable[..., Site], server: Server | None) -> Iterator[Site]:
    """Behind a proxy on 127.0.0.9."""
    with of_north(server=server, centre={"proxies": ["127.0.0.9", "203.0.113.0/28"]}) as started:
        yield started


def login(client: Client, name: str, password: str, **headers: str) -> int:
    """Its status; what it has forwarded stands in the headers."""
    try:
        response, _ = client.raw("POST", "/api/login", {"name": name, "password": password}, **headers)
    except AnswerError as error:
        return error.status
    return response.status


def code(client: Client, method: str, path: str, body: Any = None) -> str | None:
    with pytest.raises(AnswerError) as refused:
        client.raw(method, path, body)
    return refused.value.code


def at(site: Site, source: str) -> Client:
    return Client(site.port, source=source)


# ---- guesses -------------------------------------------------------------------------------------


def test_rules_of_tries_and_of_addresses() -> None:
    for module in tries, peers:
        assert doctest.testmod(module).failed == 0
    now = 0.0
    counted = tries.Tries(lambda: now)
    limit = [tries.Limit(("a",), 2)]
    waits = []
    for _ in range(8):
        try:
            counted.begin(limit)
        except tries.RefusedError as refused:
            waits.append(refused.wait_s)
            now += refused.wait_s
    assert waits == [30, 60, 120]
    now += tries.LONGEST_WAIT_S + tries.FORGET_S + 1
    assert [counted.begin(limit), counted.begin(limit)] == [None, None]


def test_a_flood_of_names_forgets_nobody_who_guesses() -> None:
    now = 0.0
    counted = tries.Tries(lambda: now)
    limit = [tries.Limit(("a",), 1)]
    counted.begin(limit)
    for number in range(tries.COUNTED_MOST - 1):
        counted.begin([tries.Limit((str(number),), 1)])
    with pytest.raises(tries.RefusedError):
        counted.begin(limit)


def test_refused_logins_are_in_the_audit(site: Site) -> None:
    """A name that nobody has is not: many a password was typed in its place."""
    begin = time.time_ns()
    stranger = at(site, "127.0.2.7")
    for name in "olga", "my secret password":
        assert login(stranger, name, WRONG) == 401
    refused = f"SELECT \"user\", detail FROM audit WHERE action = 'login refused' AND at_ns > {begin}"
    wanted = {("olga", "from 127.0.2.7"), ("", "from 127.0.2.7, unknown name")}
    until(lambda: wanted <= {tuple(row) for row in site.rows(refused)}, "both are in the audit", 0.2)
    assert not any("secret" in detail for _, detail in site.rows("SELECT id, detail FROM audit"))


def test_many_guesses_at_once_are_no_more_than_one_after_the_other(site: Site) -> None:
    """Of one name from one address: all wrong, so whatever their order is."""
    guesses = 100
    with ThreadPoolExecutor(guesses) as pool:
        asked = pool.map(
            lambda number: login(at(site, "127.0.2.1"), "omar", f"{WRONG} {number}"), range(guesses)
        )
        answers = Counter(asked)
    assert answers[401] <= OF_BOTH
    assert answers[401] + answers[429] == guesses
    assert login(at(site, "127.0.2.1"), "omar", PASSWORD) == 429
    assert login(at(site, "127.0.2.2"), "omar", PASSWORD) == 200


def test_who_is_to_wait_is_told_how_long(site: Site) -> None:
    stranger = at(site, "127.0.2.3")
    for _ in range(OF_BOTH):
        assert login(stranger, "nobody", WRONG) == 401
    with pytest.raises(AnswerError) as refused:
        stranger.raw("POST", "/api/login", {"name": "nobody", "password": WRONG})
    assert (refused.value.code, refused.value.status) == ("guesses", 429)
    assert 0 < refused.value.answer["wait_s"] <= 30
    assert int(refused.value.headers["Retry-After"]) == refused.value.answer["wait_s"]


def test_a_stranger_locks_nobody_out(site: Site) -> None:
    """Neither who comes from elsewhere, nor who is in already, and confirms with the own password."""
    engineer = at(site, "127.0.2.4").login("emil", PASSWORD)
    stranger = at(site, "127.0.2.5")
    assert [login(stranger, "emil", WRONG) for _ in range(OF_BOTH + 1)] == [401] * OF_BOTH + [429]
    assert login(at(site, "127.0.2.4"), "emil", PASSWORD) == 200
    user = {"name": "lisa", "role": "viewer", "password": PASSWORD}
    # From the stranger's own address, too: both are behind one router.
    engineer.source = "127.0.2.5"
    engineer.post("/api/users", {**user, **CONFIRMED})
    # Who has found it open guesses no more either.
    codes = [
        code(engineer, "POST", "/api/users", {**user, "own_password": WRONG}) for _ in range(OF_BOTH + 1)
    ]
    assert codes == ["own_password"] * OF_BOTH + ["guesses"]
    assert engineer.get("/api/me")["user"] == "emil"
    at(site, "127.0.2.4").login("emil", PASSWORD).post("/api/users/lisa/remove", CONFIRMED)


def test_only_the_proxy_says_for_whom_it_asks(site: Site) -> None:
    proxy = at(site, "127.0.0.9")
    guesser = {"X-Forwarded-For": "198.51.100.1, 192.0.2.1, 203.0.113.5"}
    for _ in range(OF_BOTH):
        assert login(proxy, "vera", WRONG, **guesser) == 401
    assert login(proxy, "vera", PASSWORD, **guesser) == 429
    # What the browser itself has written does not count.
    assert login(proxy, "vera", PASSWORD, **{"X-Forwarded-For": "198.51.100.2, 192.0.2.1"}) == 429
    assert login(proxy, "vera", PASSWORD, **{"X-Forwarded-For": "192.0.2.2"}) == 200
    liar = at(site, "127.0.2.6")
    for number in range(OF_BOTH):
        assert login(liar, "vera", WRONG, **{"X-Forwarded-For": f"192.0.2.{number + 10}"}) == 401
    assert login(liar, "vera", PASSWORD, **{"X-Forwarded-For": "192.0.2.99"}) == 429


def test_the_file_names_proxies_by_address_or_network(site: Site, tmp_path: Path) -> None:
    file = tmp_path / "wrong.json"
    file.write_text('{"stations": [], "centre": {"proxies": ["10.0.0.1/8"]}}')
    with pytest.raises(Exception, match=r"proxies: .* as 192\.0\.2\.0/24"):
        load(file)


def test_a_crowd_is_told_to_come_again_and_waits_for_no_queue(site: Site) -> None:
    """Each from an address of its own, of its own name; whoever is in confirms meanwhile."""
    crowd = 3 * PLACES
    with ThreadPoolExecutor(crowd) as pool:
        asked = pool.map(
            lambda number: login(at(site, f"127.0.3.{number + 1}"), f"n{number}", WRONG), range(crowd)
        )
        answers = Counter(asked)
    assert set(answers) <= {401, 429}
    assert answers[401] >= PLACES
    assert login(at(site, "127.0.2.4"), "emil", PASSWORD) == 200


@contextmanager
def storing_no_login(site: Site) -> Iterator[None]:
    """A full disk. PostgreSQL has room for a row yet in what it has of the disk: it is told to have none."""
    if not site.server:
        with full(site):
            yield
        return
    does = "RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN RAISE disk_full; END $$"
    none = f"CREATE OR REPLACE FUNCTION refuse() {does}"
    site.server.rows(f"{none}; CREATE TRIGGER refuse BEFORE INSERT ON sessions EXECUTE FUNCTION refuse()")
    yield
    site.server.rows("DROP TRIGGER refuse ON sessions")


def test_who_logs_in_while_nothing_can_be_stored_only_looks(site: Site) -> None:
    with storing_no_login(site):
        client = at(site, "127.0.2.8").login("emil", PASSWORD)
        assert client.get("/api/me")["role"] == "viewer"
        assert client.get("/api/stations")
        assert code(client, "GET", "/api/users") == "role"
        gone = at(site, "127.0.2.8").login("emil", PASSWORD)
        gone.post("/api/logout")
        assert code(gone, "GET", "/api/me") == "session"
    again = at(site, "127.0.2.8")
    until(
        lambda: again.login("emil", PASSWORD).get("/api/me")["role"] == "engineer", "it is stored again", 0.5
    )
    again.post("/api/password", {**CONFIRMED, "password": "another good password"})
    assert code(client, "GET", "/api/me") == "session"
    restored = {"password": PASSWORD, "own_password": "another good password"}
    again.post("/api/password", restored)


# ---- tokens and sessions -------------------------------------------------------------------------


@pytest.fixture
def omar(site: Site) -> Client:
    return at(site, "127.0.2.9").login("omar", PASSWORD)


def token(client: Client, scope: str = "read", label: str = "report") -> str:
    wanted = {"label": label, "days": 1, "scope": scope, **CONFIRMED}
    return str(client.post("/api/tokens", wanted)["token"])


def listed(client: Client, user: str = "") -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = client.get(f"/api/sessions{user and '?user='}{user}")
    return found


def test_a_token_is_made_with_the_password_and_never_by_a_token(site: Site, omar: Client) -> None:
    wanted = {"label": "report", "days": 1, "scope": "command"}
    assert code(omar, "POST", "/api/tokens", wanted) == "form"
    assert code(omar, "POST", "/api/tokens", {**wanted, "own_password": WRONG}) == "own_password"
    assert code(omar, "POST", "/api/tokens", {**wanted, "scope": "engineer", **CONFIRMED}) == "role"
    program = Client(site.port, token(omar, "command"))
    for method, path, body in (
        ("POST", "/api/tokens", {**wanted, **CONFIRMED}),
        ("POST", "/api/password", {"password": "another good password", **CONFIRMED}),
        ("GET", "/api/sessions", None),
        ("POST", "/api/sessions/0/end", None),
    ):
        assert code(program, method, path, body) == "token", path


@pytest.mark.parametrize("scope", SCOPES)
def test_a_token_may_what_its_scope_says(site: Site, scope: str) -> None:
    engineer = at(site, "127.0.2.10").login("emil", PASSWORD)
    program = Client(site.port, token(engineer, scope))
    assert program.get("/api/me")["role"] == SCOPES[scope]
    if scope == "read":
        assert code(program, "POST", "/api/commands", {"point": 1, "value": 1}) == "role"
    if scope != "engineer":
        assert code(program, "GET", "/api/users") == "role"
    printed = site.run("token", "emil", "--scope", scope, "--label", "printed").strip()
    assert Client(site.port, printed).get("/api/me")["role"] == SCOPES[scope]


def test_tokens_are_listed_with_their_last_use_and_revoked(site: Site, omar: Client) -> None:
    secret = token(omar, label="nightly")
    program = Client(site.port, secret)

    def row() -> dict[str, Any]:
        return next(each for each in listed(omar) if each["label"] == "nightly")

    assert (row()["scope"], row()["address"], row()["own"]) == ("read", "127.0.2.9", False)
    site_rows = "UPDATE sessions SET seen_s = 1 WHERE label = 'nightly'"
    if site.server:
        site.server.rows(f"{site_rows} RETURNING 1")
    else:
        with closing(sqlite3.connect(site.folder / "centre.db", timeout=30)) as database, database:
            database.execute(site_rows)
    program.get("/api/me")
    until(lambda: row()["seen"] > time.time() * 1000 - 3_600_000, "its use is noted", 0.5)
    assert secret not in str(listed(omar))
    stranger = at(site, "127.0.2.11").login("olga", PASSWORD)
    assert code(stranger, "POST", f"/api/sessions/{row()['id']}/end") == "unknown"
    assert code(stranger, "GET", "/api/sessions?user=omar") == "role"
    omar.post(f"/api/sessions/{row()['id']}/end")
    assert code(program, "GET", "/api/me") == "session"
    assert "nightly" not in {each["label"] for each in listed(omar)}


def test_sessions_are_listed_and_ended(site: Site, omar: Client) -> None:
    other = at(site, "127.0.2.12").login("omar", PASSWORD)
    (own,) = (each for each in listed(omar) if each["own"])
    (there,) = (each for each in listed(omar) if each["address"] == "127.0.2.12")
    assert (own["address"], there["own"]) == ("127.0.2.9", False)
    omar.post(f"/api/sessions/{there['id']}/end")
    assert code(other, "GET", "/api/me") == "session"
    engineer = at(site, "127.0.2.13").login("emil", PASSWORD)
    assert own["id"] in {each["id"] for each in listed(engineer, "omar")}
    engineer.post(f"/api/sessions/{own['id']}/end?user=omar")
    assert code(omar, "GET", "/api/me") == "session"
    ended = site.rows("SELECT \"user\", detail FROM audit WHERE action = 'session ended'")
    assert {("omar", "omar"), ("emil", "omar")} <= {tuple(row) for row in ended}


def test_ones_own_password(site: Site) -> None:
    """Another one ends all else that is open."""
    engineer = at(site, "127.0.2.14").login("emil", PASSWORD)
    engineer.post("/api/users", {"name": "paul", "role": "viewer", "password": PASSWORD, **CONFIRMED})
    here, there = (at(site, source).login("paul", PASSWORD) for source in ("127.0.2.15", "127.0.2.16"))
    program = Client(site.port, token(here))
    fresh = "a better password"
    assert code(here, "POST", "/api/password", {"password": "short", **CONFIRMED}) == "password"
    assert code(here, "POST", "/api/password", {"password": fresh, "own_password": WRONG}) == "own_password"
    here.post("/api/password", {"password": fresh, **CONFIRMED})
    assert here.get("/api/me")["user"] == "paul"
    assert {code(each, "GET", "/api/me") for each in (there, program)} == {"session"}
    assert login(at(site, "127.0.2.15"), "paul", PASSWORD) == 401
    assert login(at(site, "127.0.2.15"), "paul", fresh) == 200
    engineer.post("/api/users/paul/remove", CONFIRMED)


def test_of_two_engineers_who_remove_each_other_one_stays(site: Site) -> None:
    engineer = at(site, "127.0.2.17").login("emil", PASSWORD)
    made = {"role": "engineer", "password": PASSWORD, **CONFIRMED}
    for name in "rita", "rolf":
        engineer.post("/api/users", {"name": name, **made})
    clients = {name: at(site, "127.0.2.18").login(name, PASSWORD) for name in ("rita", "rolf")}

    def remove(of: tuple[str, str]) -> int:
        try:
            return clients[of[0]].raw("POST", f"/api/users/{of[1]}/remove", CONFIRMED)[0].status
        except AnswerError as error:
            return error.status

    with ThreadPoolExecutor(2) as pool:
        assert sorted(pool.map(remove, [("rita", "rolf"), ("rolf", "rita")]))[0] == 200
    names = {each["name"] for each in engineer.get("/api/users")}
    (left,) = names & {"rita", "rolf"}
    engineer.post(f"/api/users/{left}/remove", CONFIRMED)


# ---- a second factor -----------------------------------------------------------------------------


def code_of(secret: str, steps: int = 0) -> str:
    return str(pyotp.TOTP(secret).at(int(time.time()) + 30 * steps))


def enrol(client: Client) -> tuple[str, list[str]]:
    """Its secret and recovery codes. The code is of the step before: the one of now is left for a login."""
    secret = client.post("/api/second_factor/offer", CONFIRMED)["secret"]
    return secret, client.post("/api/second_factor/begin", {"code": code_of(secret, -1)})["recovery_codes"]


def with_code(site: Site, source: str, name: str, given: str) -> str:
    """What a login with it is answered."""
    try:
        wanted = {"name": name, "password": PASSWORD, "code": given}
        at(site, source).raw("POST", "/api/login", wanted)
    except AnswerError as error:
        return str(error.code)
    return "in"


@pytest.fixture
def guarded(site: Site) -> Iterator[str]:
    """A user of this test alone."""
    engineer = at(site, "127.0.2.20").login("emil", PASSWORD)
    engineer.post("/api/users", {"name": "gina", "role": "viewer", "password": PASSWORD, **CONFIRMED})
    yield "gina"
    engineer.post("/api/users/gina/remove", CONFIRMED)


def test_a_second_factor_is_asked_for_and_each_code_is_good_once(site: Site, guarded: str) -> None:
    assert doctest.testmod(second).failed == 0
    client = at(site, "127.0.2.21").login(guarded, PASSWORD)
    assert code(client, "POST", "/api/second_factor/offer", {"own_password": WRONG}) == "own_password"
    offered = client.post("/api/second_factor/offer", CONFIRMED)
    assert offered["secret"] in offered["uri"]
    assert code(client, "POST", "/api/second_factor/begin", {"code": "000000"}) == "wrong_code"
    assert client.get("/api/second_factor") == {"on": False, "recovery_codes": 0}
    secret, recovery = enrol(client)
    assert client.get("/api/second_factor") == {"on": True, "recovery_codes": 10}
    assert with_code(site, "127.0.2.21", guarded, "") == "code"
    assert login(at(site, "127.0.2.21"), guarded, WRONG) == 401

    def taken() -> str:
        typed = code_of(secret, 1)
        return typed if with_code(site, "127.0.2.21", guarded, typed) == "in" else ""

    used = until(taken, "one of its codes", 1)
    answers = {with_code(site, "127.0.2.21", guarded, each) for each in (code_of(secret), used)}
    assert answers == {"wrong_code"}
    program = Client(site.port, token(client))
    assert program.get("/api/me")["user"] == guarded
    assert (
        with_code(site, "127.0.2.22", guarded, recovery[3].lower()),
        with_code(site, "127.0.2.22", guarded, recovery[3]),
    ) == ("in", "wrong_code")
    assert client.get("/api/second_factor")["recovery_codes"] == 9
    hashes = str(site.rows("SELECT recovery FROM users WHERE name = 'gina'"))
    assert not any(each.replace("-", "") in hashes for each in recovery)
    ending = {**CONFIRMED, "code": recovery[0]}
    assert code(client, "POST", "/api/second_factor/end", {**ending, "code": "123456"}) == "wrong_code"
    client.post("/api/second_factor/end", ending)
    assert login(at(site, "127.0.2.21"), guarded, PASSWORD) == 200


def test_a_code_of_two_logins_at_once_lets_one_in(site: Site, guarded: str) -> None:
    secret, _ = enrol(at(site, "127.0.2.23").login(guarded, PASSWORD))
    right = code_of(secret)
    with ThreadPoolExecutor(4) as pool:
        answers = Counter(pool.map(lambda _: with_code(site, "127.0.2.23", guarded, right), range(4)))
    assert answers["in"] <= 1
    assert set(answers) <= {"in", "wrong_code"}


def test_codes_are_not_guessed_from_many_addresses(site: Site, guarded: str) -> None:
    secret, _ = enrol(at(site, "127.0.2.24").login(guarded, PASSWORD))
    answers = [with_code(site, f"127.0.6.{number + 1}", guarded, "abcdef") for number in range(OF_CODE + 1)]
    assert answers == ["wrong_code"] * OF_CODE + ["guesses"]
    assert with_code(site, "127.0.6.99", guarded, code_of(secret)) == "guesses"


def test_a_lost_second_factor_is_given_up_by_an_engineer_or_at_the_machine(site: Site, guarded: str) -> None:
    client = at(site, "127.0.2.25").login(guarded, PASSWORD)
    enrol(client)
    engineer = at(site, "127.0.2.26").login("emil", PASSWORD)
    assert {each["name"] for each in engineer.get("/api/users") if each["second_factor"]} == {guarded}
    path = f"/api/users/{guarded}/second_factor/end"
    assert code(client, "POST", path, CONFIRMED) == "role"
    assert code(engineer, "POST", path, {"own_password": WRONG}) == "own_password"
    engineer.post(path, CONFIRMED)
    enrol(at(site, "127.0.2.25").login(guarded, PASSWORD))
    # Another password does not end it.
    engineer.post("/api/users", {"name": guarded, "role": "viewer", "password": PASSWORD, **CONFIRMED})
    assert with_code(site, "127.0.2.25", guarded, "") == "code"
    site.run("user", guarded, "--no-second-factor", stdin=PASSWORD)
    assert login(at(site, "127.0.2.25"), guarded, PASSWORD) == 200


def test_codes_are_good_once_while_nothing_can_be_stored(site: Site, guarded: str) -> None:
    secret, recovery = enrol(at(site, "127.0.2.27").login(guarded, PASSWORD))
    with storing_no_login(site):
        right = code_of(secret, 1)
        answers = [with_code(site, "127.0.2.27", guarded, each) for each in (right, right, recovery[0])]
    assert answers in (["in", "wrong_code", "wrong_code"], ["wrong_code"] * 3)  # its step may have ended


# ---- the file ------------------------------------------------------------------------------------


@pytest.mark.parametrize("before", [None, 0o644])
def test_database_is_nobody_elses(tmp_path: Path, before: int | None) -> None:
    """Made with the usual mask, or by a centre of before."""
    path = tmp_path / "centre.db"
    if before:
        with closing(sqlite3.connect(path)) as database:
            database.execute("PRAGMA journal_mode = WAL")
            database.execute("CREATE TABLE filled (id INTEGER)")
            path.chmod(before)
    mask = os.umask(0o022)
    try:
        with closing(SqliteStore(path)) as store:
            store.transaction(lambda database: database.execute("CREATE TABLE more (id INTEGER)"))
            modes = {each.name: stat.S_IMODE(each.stat().st_mode) for each in tmp_path.iterdir()}
    finally:
        os.umask(mask)
    assert modes == dict.fromkeys(("centre.db", "centre.db-wal", "centre.db-shm"), 0o600)
