# SPDX-License-Identifier: GPL-3.0-or-later
"""Who comes in by a provider of OpenID Connect, and who does not, whatever the provider says."""

import base64
import http.client
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from http.cookies import SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, quote, urlencode, urlsplit

import pytest
from joserfc.jwk import RSAKey

from control_room import PASSWORD, ROOT, Site, until
from hostile_provider import CLIENT, SECRET, Hostile, challenge
from lab.centre_client import LIMIT_S, AnswerError, Client
from openrtu_tools.centre.settings import load
from postgres import Server

ROLES = [
    {"value": "chiefs", "role": "engineer"},
    {"value": "ops", "role": "operator", "groups": ["water"]},
    {"value": "guests", "role": "viewer"},
]


def configured(issuer: str, **more: Any) -> dict[str, Any]:
    return {
        "issuer": issuer, "client_id": CLIENT, "secret_file": "oidc.secret", "claim": "groups",
        "roles": ROLES, "label": "the plant", **more,
    }  # fmt: skip


@pytest.fixture(scope="module")
def hostile() -> Iterator[Hostile]:
    with Hostile() as provider:
        yield provider


@pytest.fixture(scope="module")
def site(of_north: Callable[..., Site], hostile: Hostile, server: Server | None) -> Iterator[Site]:
    made = of_north(server=server, centre={"proxies": ["127.0.0.9"]})
    content = json.loads(made.file.read_text())
    content["centre"]["oidc"] = configured(hostile.issuer, url=f"http://127.0.0.1:{made.port}", session_h=2)
    made.file.write_text(json.dumps(content))
    secret = made.folder / "oidc.secret"
    secret.write_text(SECRET + "\n")
    secret.chmod(0o600)
    with made:
        yield made


@pytest.fixture(scope="module")
def asking(of_north: Callable[..., Site], hostile: Hostile) -> Iterator[Site]:
    """It wants to know more than the ID token says, and logs out at the provider."""
    made = of_north()
    content = json.loads(made.file.read_text())
    more = {"url": f"http://127.0.0.1:{made.port}", "userinfo": True, "logout": True}
    content["centre"]["oidc"] = configured(hostile.issuer, **more)
    del content["centre"]["oidc"]["secret_file"]
    made.file.write_text(json.dumps(content))
    with made:
        yield made


@pytest.fixture(autouse=True)
def honest(hostile: Hostile) -> None:
    hostile.token, hostile.claims, hostile.nonce = hostile.sign, {}, ""
    hostile.userinfo = {}
    hostile.hangs.clear()
    hostile.redirects.clear()
    hostile.answers.clear()
    hostile.description.clear()


class Browser:
    """As far as it matters here: it keeps cookies and tells where it is sent."""

    def __init__(self, site: Site, source: str = "127.0.0.1") -> None:
        self.site = site
        self.source = source
        self.cookies: dict[str, str] = {}
        self.set: list[str] = []

    def get(self, path: str, method: str = "GET", body: str = "", **headers: str) -> http.client.HTTPResponse:
        connection = http.client.HTTPConnection(
            "127.0.0.1", self.site.port, timeout=LIMIT_S, source_address=(self.source, 0)
        )
        cookies = "; ".join(f"{name}={value}" for name, value in self.cookies.items())
        connection.request(method, path, body or None, {"Cookie": cookies, **headers})
        response = connection.getresponse()
        self.set = response.headers.get_all("Set-Cookie") or []
        response.read()
        connection.close()
        for line in self.set:
            for name, morsel in SimpleCookie(line).items():
                self.cookies[name] = morsel.value
                if not morsel.value:
                    del self.cookies[name]
        return response

    def begin(self, path: str = "/api/oidc/begin") -> dict[str, str]:
        """What the provider is told."""
        response = self.get(path)
        assert response.status == 303
        asked = urlsplit(response.headers["Location"])
        return {key: value[0] for key, value in parse_qs(asked.query).items()}

    def back(self, **query: str) -> str:
        """The word with which it comes back to the page; "" if nothing is said."""
        response = self.get(f"/api/oidc/callback?{urlencode(query)}")
        page = f"http://127.0.0.1:{self.site.port}/"
        where = response.headers["Location"]
        assert response.status == 303
        assert where.startswith(page)
        return where.removeprefix(page).removeprefix("#login/")

    def login(self, hostile: Hostile, path: str = "/api/oidc/begin") -> str:
        told = self.begin(path)
        hostile.nonce = told["nonce"]
        return self.back(code="code", state=told["state"])

    def client(self) -> Client:
        client = Client(self.site.port)
        client.headers = {"Cookie": f"openrtu_session={self.cookies['openrtu_session']}"}
        client.headers["X-CSRF-Token"] = client.get("/api/me")["csrf"]
        return client


def said(client: Client, method: str, path: str, body: Any = None) -> str | None:
    try:
        client.raw(method, path, body)
    except AnswerError as error:
        return error.code
    return None


def audited(site: Site, action: str) -> list[str]:
    return [
        f"{row[1]}: {row[2]}"
        for row in site.rows(f"SELECT id, \"user\", detail FROM audit WHERE action = '{action}'")
    ]


# ---- who comes in --------------------------------------------------------------------------------


def test_a_user_comes_in_with_the_role_that_the_file_says(site: Site, hostile: Hostile) -> None:
    browser = Browser(site)
    told = browser.begin()
    assert told["redirect_uri"] == f"http://127.0.0.1:{site.port}/api/oidc/callback"
    assert (told["tenant"], told["response_type"], told["code_challenge_method"]) == ("1", "code", "S256")
    [cookie] = browser.set
    assert "HttpOnly" in cookie and "SameSite=Lax" in cookie
    assert not {told["state"], told["nonce"]} & set(cookie.split("="))
    hostile.nonce = told["nonce"]
    assert browser.back(code="a code", state=told["state"], iss=hostile.issuer) == ""
    assert "SameSite=Strict" in next(line for line in browser.set if line.startswith("openrtu_session"))
    me = browser.client().get("/api/me")
    assert (me["user"], me["role"], me["provided"]) == ("oidc:anna", "operator", True)
    _, form, authorization = next(each for each in reversed(hostile.asked) if each[0] == "/realm/token")
    assert challenge(form["code_verifier"]) == told["code_challenge"]
    assert (form["code"], form["redirect_uri"]) == ("a code", told["redirect_uri"])
    pair = f"{quote(CLIENT, '')}:{quote(SECRET, '')}".encode()
    assert authorization == f"Basic {base64.b64encode(pair).decode()}"
    assert f"oidc:anna: by {hostile.issuer}" in audited(site, "login")
    assert "oidc:anna: oidc:anna: operator, of water, by the provider" in audited(site, "user")


@pytest.mark.slow
def test_a_role_is_what_the_provider_says_now(site: Site, hostile: Hostile) -> None:
    """A session that is there has it at once; no role is no way in."""
    hostile.claims = {"sub": "1002", "preferred_username": "bert"}
    there = Browser(site)
    there.login(hostile)
    assert there.client().get("/api/me")["role"] == "operator"
    hostile.claims["groups"] = "guests"
    assert Browser(site).login(hostile) == ""
    assert there.client().get("/api/me")["role"] == "viewer"
    for groups in ([], None, "", "staff", ["Ops"], {"ops": 1}, 7, [["ops"]]):
        hostile.claims["groups"] = groups
        assert Browser(site).login(hostile) == "no_role", groups
    until(
        lambda: any("gives no role" in each for each in audited(site, "login refused")), "it is audited", 0.2
    )


@pytest.mark.slow
def test_nobody_has_the_name_of_another(site: Site, hostile: Hostile) -> None:
    """Neither of a local user, nor of another one of the provider's."""
    hostile.claims = {"sub": "1003", "preferred_username": "emil"}
    emil = Browser(site)
    emil.login(hostile)
    assert emil.client().get("/api/me")["user"] == "oidc:emil"
    hostile.claims = {"sub": "1004", "preferred_username": "emil"}
    assert Browser(site).login(hostile) == "name_taken"
    # Who has another name there keeps this one.
    hostile.claims = {"sub": "1003", "preferred_username": "engineer"}
    again = Browser(site)
    again.login(hostile)
    assert again.client().get("/api/me")["user"] == "oidc:emil"
    for name in "x" * 80, "a\nb", "a\u202eb":
        hostile.claims = {"sub": name, "preferred_username": name}
        assert Browser(site).login(hostile) == "name", name
    local = site.client("emil")
    made = {"name": "oidc:eve", "role": "engineer", "password": PASSWORD, "own_password": PASSWORD}
    assert said(local, "POST", "/api/users", made) == "provided"
    assert said(local, "POST", "/api/users", {**made, "name": "oidc:emil"}) == "provided"
    # And no password lets in who has none.
    for password in "", PASSWORD:
        assert said(Client(site.port), "POST", "/api/login", {"name": "oidc:emil", "password": password}) in (
            "password", "guesses",
        )  # fmt: skip


@pytest.mark.parametrize("text", ["\0", "a\ud800"])
def test_what_no_database_takes_is_refused(site: Site, hostile: Hostile, text: str) -> None:
    for claim in "preferred_username", "sid":
        hostile.claims = {claim: text}
        assert Browser(site).login(hostile) == "form"
    assert send_out(site, hostile.logout_token(sid=text)) == 400


@pytest.mark.slow
def test_an_engineer_keeps_a_providers_user_out(site: Site, hostile: Hostile) -> None:
    hostile.claims = {"sub": "1005", "preferred_username": "dora", "groups": "guests"}
    browser = Browser(site)
    browser.login(hostile)
    dora, emil = browser.client(), site.client("emil")
    change = {"name": "oidc:dora", "role": "viewer", "disabled": True, "own_password": PASSWORD}
    assert said(emil, "POST", "/api/users", {**change, "role": "engineer"}) == "provided"
    emil.post("/api/users", change)
    assert said(dora, "GET", "/api/me") == "session"
    assert Browser(site).login(hostile) == "disabled"
    emil.post("/api/users", {**change, "disabled": False})
    assert Browser(site).login(hostile) == ""
    emil.post("/api/users/oidc:dora/remove", {"own_password": PASSWORD})
    assert "oidc:dora" not in {each["name"] for each in emil.get("/api/users")}


@pytest.mark.slow
def test_what_belongs_to_a_password_is_the_providers(site: Site, hostile: Hostile) -> None:
    """Tokens too: the centre never hears that the provider has let a user go."""
    hostile.claims = {"sub": "1006", "preferred_username": "ines", "groups": "chiefs"}
    browser = Browser(site)
    browser.login(hostile)
    assert browser.login(hostile, "/api/oidc/begin?again=1") == "again"
    ines, own = browser.client(), {"own_password": ""}
    token = {"label": "report", "days": 1, "scope": "read", **own}
    assert said(ines, "POST", "/api/tokens", token) == "provided"
    assert said(ines, "POST", "/api/password", {"password": PASSWORD, **own}) == "provided"
    assert said(ines, "POST", "/api/second_factor/offer", own) == "provided"
    command = [sys.executable, "-m", "openrtu_tools", "centre", site.file, "token", "oidc:ines"]
    done = subprocess.run(command, env=site.environment, capture_output=True, text=True, check=False)
    assert done.returncode and "a program has a user of its own" in done.stderr


# ---- once more -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_change_needs_a_login_once_more(site: Site, hostile: Hostile) -> None:
    hostile.claims = {"sub": "1007", "preferred_username": "gerd", "groups": "chiefs"}
    browser = Browser(site)
    browser.login(hostile)
    gerd = browser.client()
    body = {"name": "frank", "role": "viewer", "password": PASSWORD, "own_password": PASSWORD}
    assert said(gerd, "POST", "/api/users", body) == "again"
    told = browser.begin("/api/oidc/begin?again=1")
    assert (told["prompt"], told["max_age"]) == ("login", "0")
    hostile.nonce = told["nonce"]
    # The provider lets in whoever had logged in an hour ago, or does not say when.
    for when in int(time.time()) - 3600, None, "now":
        hostile.claims["auth_time"] = when
        assert browser.login(hostile, "/api/oidc/begin?again=1") == "token", when
    del hostile.claims["auth_time"]
    hostile.claims["sub"] = "1008"
    assert browser.login(hostile, "/api/oidc/begin?again=1") == "somebody_else"
    assert said(gerd, "POST", "/api/users", body) == "again"
    hostile.claims["sub"] = "1007"
    session = browser.cookies["openrtu_session"]
    assert browser.login(hostile, "/api/oidc/begin?again=1") == "again"
    assert browser.cookies["openrtu_session"] == session
    assert said(gerd, "POST", "/api/users", body) is None
    # Of this session alone.
    other = Browser(site)
    other.login(hostile)
    assert said(other.client(), "POST", "/api/users/frank/remove", {"own_password": ""}) == "again"
    gerd.post("/api/users/frank/remove", {"own_password": ""})


def test_who_has_a_password_or_no_session_does_not_log_in_once_more(site: Site) -> None:
    browser = Browser(site)
    assert browser.get("/api/oidc/begin?again=1").status == 401
    browser.cookies["openrtu_session"] = site.client("emil").headers["Cookie"].partition("=")[2]
    assert browser.get("/api/oidc/begin?again=1").status == 409


# ---- state, nonce, code --------------------------------------------------------------------------


def test_an_answer_is_worth_nothing_in_another_browser(site: Site, hostile: Hostile) -> None:
    """Nobody is logged in as somebody else by a link (login CSRF)."""
    attacker, victim = Browser(site), Browser(site)
    told = attacker.begin()
    hostile.nonce = told["nonce"]
    assert victim.back(code="code", state=told["state"]) == "state"
    victim.begin()
    assert victim.back(code="code", state=told["state"]) == "state"
    assert "openrtu_session" not in victim.cookies
    assert attacker.back(code="code", state=told["state"]) == ""


def test_a_session_of_before_is_not_kept(site: Site, hostile: Hostile) -> None:
    """Whoever has put a cookie into somebody's browser has nothing of the login (session fixation)."""
    browser = Browser(site)
    browser.cookies["openrtu_session"] = "fixed"
    assert browser.login(hostile) == ""
    assert browser.cookies["openrtu_session"] != "fixed"
    fixed = Client(site.port)
    fixed.headers = {"Cookie": "openrtu_session=fixed"}
    assert said(fixed, "GET", "/api/me") == "session"


@pytest.mark.parametrize("spoilt", ["", "x", "e30.x", "é", "a" * 4000])
def test_a_cookie_that_is_not_ours_is_none(site: Site, spoilt: str) -> None:
    browser = Browser(site)
    told = browser.begin()
    sealed = browser.cookies["openrtu_oidc"]
    browser.cookies["openrtu_oidc"] = quote(spoilt)
    assert browser.back(code="code", state=told["state"]) == "state"
    body, _, seal = sealed.partition(".")
    browser.cookies["openrtu_oidc"] = f"{body[:-4]}AAAA.{seal}"
    assert browser.back(code="code", state=told["state"]) == "state"


def test_an_answer_is_taken_once(site: Site, hostile: Hostile) -> None:
    """By a provider that takes a code again and again."""
    browser = Browser(site)
    told = browser.begin()
    kept = dict(browser.cookies)
    hostile.nonce = told["nonce"]
    assert browser.back(code="code", state=told["state"]) == ""
    assert "openrtu_oidc" not in browser.cookies
    assert browser.back(code="code", state=told["state"]) == "state"
    browser.cookies = kept
    assert browser.back(code="code", state=told["state"]) == "state"


def test_many_answers_at_once_are_one_login(site: Site, hostile: Hostile) -> None:
    browser = Browser(site)
    told = browser.begin()
    hostile.nonce = told["nonce"]

    def back(_: int) -> str:
        other = Browser(site)
        other.cookies = dict(browser.cookies)
        return other.back(code="code", state=told["state"])

    with ThreadPoolExecutor(6) as pool:
        words = list(pool.map(back, range(6)))
    assert words.count("") == 1


def test_what_the_provider_refuses_is_no_login(site: Site, hostile: Hostile) -> None:
    browser = Browser(site)
    told = browser.begin()
    said = {"error": "access_denied", "error_description": "<script>", "state": told["state"]}
    assert browser.back(**said) == "cancelled"
    assert Browser(site).back(**said) == "state"


def test_another_issuer_answers(site: Site, hostile: Hostile) -> None:
    """One provider's code is not given to another one (mix-up, RFC 9207)."""
    browser = Browser(site)
    told = browser.begin()
    hostile.nonce = told["nonce"]
    before = len(hostile.asked)
    assert browser.back(code="code", state=told["state"], iss="https://other.example") == "token"
    assert all(path != "/realm/token" for path, *_ in hostile.asked[before:])


# ---- tokens --------------------------------------------------------------------------------------

WRONG: dict[str, dict[str, Any]] = {
    "nonce": {"nonce": "another"},
    "no nonce": {"nonce": None},
    "audience": {"aud": "another client"},
    "audiences": {"aud": [CLIENT, "another client"]},
    "audiences with azp": {"aud": [CLIENT, "another client"], "azp": CLIENT},
    "no audience": {"aud": None},
    "odd audience": {"aud": {CLIENT: 1}},
    "authorized party": {"azp": "another client"},
    "issuer": {"iss": "http://127.0.0.1/realm"},
    "longer issuer": {"iss": "ISSUER/"},
    "no issuer": {"iss": None},
    "expired": {"exp": -61},
    "no expiry": {"exp": None},
    "expiry in words": {"exp": "tomorrow"},
    "expiry without end": {"exp": float("inf")},
    "from the future": {"iat": 120},
    "not yet": {"nbf": 120},
    "of another login": {"iat": -120},
    "no time": {"iat": None},
    "no subject": {"sub": None},
    "empty subject": {"sub": ""},
    "a list of subjects": {"sub": ["1001"]},
    "access token": {"at_hash": "AAAA"},
}


@pytest.mark.parametrize("claims", WRONG.values(), ids=list(WRONG))
def test_a_token_that_is_not_for_this_login_is_refused(
    site: Site, hostile: Hostile, claims: dict[str, Any]
) -> None:
    now_s = int(time.time())
    hostile.claims = {
        key: value + now_s
        if isinstance(value, int)
        else hostile.issuer + "/"
        if value == "ISSUER/"
        else value
        for key, value in claims.items()
    }
    browser = Browser(site, f"127.0.7.{list(WRONG.values()).index(claims) + 1}")
    told = browser.begin()
    hostile.nonce = told["nonce"]
    assert browser.back(code="code", state=told["state"]) == "token"
    assert "openrtu_session" not in browser.cookies


@pytest.mark.parametrize("manner", ["by_none", "by_hmac", "by_secret", "by_another", "by_own_key", "altered"])
def test_a_token_that_the_provider_has_not_signed_is_refused(
    site: Site, hostile: Hostile, manner: str
) -> None:
    hostile.token = getattr(hostile, manner)
    browser = Browser(site, "127.0.8.1")
    assert browser.login(hostile) == "token"
    assert "openrtu_session" not in browser.cookies


@pytest.mark.parametrize("answer", [b"", b"[]", b"{}", b'{"id_token": 7}', b'{"id_token": "a.b.c"}', b"\xff"])
def test_an_answer_that_is_no_token_is_refused(site: Site, hostile: Hostile, answer: bytes) -> None:
    hostile.answers["/realm/token"] = answer or b" "
    assert Browser(site, "127.0.8.2").login(hostile) in ("token", "provider")


def test_an_answer_without_end_and_one_that_leads_elsewhere_are_refused(site: Site, hostile: Hostile) -> None:
    hostile.answers["/realm/token"] = b" " * (1 << 20)
    assert Browser(site, "127.0.8.3").login(hostile) == "provider"
    hostile.answers.clear()
    hostile.redirects["/realm/token"] = f"{hostile.issuer}/elsewhere"
    assert Browser(site, "127.0.8.3").login(hostile) == "provider"
    assert "/realm/elsewhere" not in {path for path, *_ in hostile.asked}


@pytest.mark.slow
def test_guesses_of_codes_have_their_limit(site: Site, hostile: Hostile) -> None:
    hostile.token = hostile.by_none
    browser = Browser(site, "127.0.8.4")
    words = [browser.login(hostile) for _ in range(21)]
    assert words == ["token"] * 20 + ["guesses"]


# ---- keys ----------------------------------------------------------------------------------------


def keys_asked(hostile: Hostile) -> int:
    return sum(path == "/realm/keys" for path, *_ in hostile.asked)


@pytest.mark.slow
def test_new_keys_are_looked_for_and_not_at_every_strangers_word(site: Site, hostile: Hostile) -> None:
    """This is the only test that changes the keys: a look for unknown ones has its pause."""
    site.kill(site.centre)
    site.start_centre()  # which has looked for none
    assert Browser(site).login(hostile) == ""
    hostile.key = RSAKey.generate_key(2048, {"kid": "two"})
    hostile.shown = [{"kty": "AKP", "kid": "odd"}, "nonsense", hostile.key.as_dict(private=False)]
    before = keys_asked(hostile)
    assert Browser(site).login(hostile) == ""
    assert keys_asked(hostile) == before + 1
    hostile.token = hostile.by_own_key
    assert [Browser(site, "127.0.8.5").login(hostile) for _ in range(5)] == ["token"] * 5
    assert keys_asked(hostile) == before + 1
    hostile.token = hostile.sign
    assert Browser(site).login(hostile) == ""


def answers_again(site: Site, hostile: Hostile) -> bool:
    """That it failed is kept for a moment."""
    hostile.hangs.clear()
    where = Browser(site).get("/api/oidc/begin").headers["Location"]
    return "state=" in where and Browser(site).login(hostile) == ""


# ---- a provider that is not there ----------------------------------------------------------------


@pytest.mark.slow
def test_a_provider_that_hangs_delays_nobody(site: Site, hostile: Hostile) -> None:
    hostile.late.clear()
    hostile.hangs.add("/realm/token")
    before = len(hostile.asked)
    browsers = [Browser(site, f"127.0.9.{number + 1}") for number in range(12)]
    told = [browser.begin() for browser in browsers]
    with ThreadPoolExecutor(len(browsers)) as pool:
        waiting = [
            pool.submit(browser.back, code="code", state=each["state"])
            for browser, each in zip(browsers, told, strict=True)
        ]
        until(lambda: "/realm/token" in {path for path, *_ in hostile.asked[before:]}, "one hangs")
        assert site.client("emil").get("/api/me")["user"] == "emil"
        words = [each.result() for each in waiting]
    assert set(words) == {"provider", "logins"}
    assert words.count("logins") >= 1
    hostile.late.set()
    hostile.hangs.clear()


@pytest.mark.slow
@pytest.mark.parametrize("path", ["/realm/.well-known/openid-configuration", "/realm/keys"])
def test_a_provider_that_says_nothing_of_itself_delays_nobody(
    site: Site, hostile: Hostile, path: str
) -> None:
    site.kill(site.centre)
    site.start_centre()
    hostile.late.clear()
    hostile.hangs.add(path)
    before = len(hostile.asked)
    with ThreadPoolExecutor(3) as pool:
        if path.endswith("keys"):
            waiting = [pool.submit(Browser(site).login, hostile) for _ in range(3)]
        else:
            waiting = [pool.submit(Browser(site).get, "/api/oidc/begin") for _ in range(3)]
        until(lambda: path in {each for each, *_ in hostile.asked[before:]}, "it hangs")
        assert site.client("emil").get("/api/me")["user"] == "emil"
        answers = [each.result() for each in waiting]
    words = {
        each if isinstance(each, str) else each.headers["Location"].rpartition("/")[2] for each in answers
    }
    assert words == {"provider"}
    # Those who wanted it at once have waited for one answer.
    assert [each for each, *_ in hostile.asked[before:]].count(path) == 1
    hostile.late.set()
    until(lambda: answers_again(site, hostile), "it is asked again", 0.5)


@pytest.mark.slow
@pytest.mark.parametrize(
    "description",
    [
        {"issuer": "http://127.0.0.1/other"},
        {"token_endpoint": "file:///etc/passwd"},
        {"jwks_uri": None},
        {"authorization_endpoint": "javascript:alert(1)"},
    ],
)
def test_a_description_that_is_not_its_own_is_refused(
    site: Site, hostile: Hostile, description: dict[str, Any]
) -> None:
    hostile.description.update(description)
    site.kill(site.centre)
    site.start_centre()
    response = Browser(site).get("/api/oidc/begin")
    assert (response.status, response.headers["Location"]) == (
        303, f"http://127.0.0.1:{site.port}/#login/provider",
    )  # fmt: skip
    assert site.client("emil").get("/api/me")["user"] == "emil"
    hostile.description.clear()
    until(lambda: answers_again(site, hostile), "it is asked again", 0.5)


# ---- it sends somebody out -----------------------------------------------------------------------


def send_out(site: Site, token: str) -> int:
    form = {"Content-Type": "application/x-www-form-urlencoded"}
    return Browser(site).get("/api/oidc/logout", "POST", urlencode({"logout_token": token}), **form).status


def test_the_provider_ends_a_session_or_all_of_a_user(site: Site, hostile: Hostile) -> None:
    clients = {}
    for sub, sid in ("2001", "a"), ("2001", "b"), ("2001", "c"), ("2002", "d"):
        hostile.claims = {"sub": sub, "preferred_username": sub, "sid": sid}
        browser = Browser(site)
        assert browser.login(hostile) == ""
        clients[sid] = browser.client()

    def alive() -> set[str]:
        return {sid for sid, client in clients.items() if said(client, "GET", "/api/me") is None}

    assert send_out(site, hostile.logout_token(sid="a")) == 200
    assert alive() == {"b", "c", "d"}
    assert send_out(site, hostile.logout_token(sub="2002", sid="b")) == 200  # of another user
    assert alive() == {"b", "c", "d"}
    assert send_out(site, hostile.logout_token(sub="2001", sid="b")) == 200
    assert alive() == {"c", "d"}
    assert send_out(site, hostile.logout_token(sub="2001")) == 200
    assert alive() == {"d"}
    assert "oidc:2001: by the provider" in audited(site, "session ended")
    now_s = int(time.time())
    for wrong in (
        {},
        {"sub": "2002", "nonce": "n"},
        {"sub": "2002", "events": None},
        {"sub": "2002", "events": {"other": {}}},
        {"sub": "2002", "aud": "another client"},
        {"sub": "2002", "iss": "http://127.0.0.1/other"},
        {"sub": "2002", "iat": now_s - 3600, "exp": None},
        {"sub": "2002", "iat": None},
        {"sub": ["2002"]},
    ):
        assert send_out(site, hostile.logout_token(**wrong)) == 403, wrong
    assert send_out(site, hostile.by_hmac({"sub": "2002"})) == 403
    assert send_out(site, hostile.sign(hostile.all_claims())) == 403  # an ID token is none
    assert send_out(site, "") == 403
    assert alive() == {"d"}


# ---- more of a user, and its way out --------------------------------------------------------------


def publish(asking: Site, hostile: Hostile, **description: Any) -> None:
    """The provider says this of itself from now on."""
    hostile.description = {"userinfo_endpoint": f"{hostile.issuer}/userinfo", **description}
    asking.kill(asking.centre)
    asking.start_centre()


@pytest.mark.slow
def test_userinfo_says_what_the_token_does_not(asking: Site, hostile: Hostile) -> None:
    """What is signed counts; the rest is of the same user, asked for with the token of this login."""
    publish(asking, hostile)
    hostile.claims = {"groups": None, "preferred_username": None}
    hostile.userinfo = {"sub": "1001", "groups": ["ops"], "preferred_username": "nora"}
    browser = Browser(asking)
    assert browser.login(hostile) == ""
    me = browser.client().get("/api/me")
    assert (me["user"], me["role"]) == ("oidc:nora", "operator")
    assert ("/realm/userinfo", {}, "Bearer access") in hostile.asked
    hostile.claims = {"groups": ["guests"]}
    hostile.userinfo = {"sub": "1001", "groups": ["chiefs"]}
    browser = Browser(asking)
    assert browser.login(hostile) == ""
    assert browser.client().get("/api/me")["role"] == "viewer"


@pytest.mark.slow
def test_userinfo_of_somebody_else_or_none_is_no_login(asking: Site, hostile: Hostile) -> None:
    publish(asking, hostile)
    hostile.claims = {"groups": None}
    for subject in ("1002", None, "", ["1001"], 1001):
        hostile.userinfo = {"sub": subject, "groups": ["chiefs"]}
        assert Browser(asking, "127.0.10.1").login(hostile) == "token", subject
    hostile.userinfo = {"groups": ["chiefs"]}
    assert Browser(asking, "127.0.10.1").login(hostile) == "token"
    signed = hostile.sign({"sub": "1001", "groups": ["chiefs"]}).encode()  # as a JWT, which nobody asked for
    for answer in (b"[]", b" ", b'"1001"', signed, b" " * (1 << 20)):
        hostile.answers["/realm/userinfo"] = answer
        assert Browser(asking, "127.0.10.2").login(hostile) == "provider", answer[:20]
    hostile.answers.clear()
    hostile.redirects["/realm/userinfo"] = f"{hostile.issuer}/elsewhere"
    assert Browser(asking, "127.0.10.3").login(hostile) == "provider"
    assert "/realm/elsewhere" not in {path for path, *_ in hostile.asked}
    hostile.redirects.clear()
    hostile.answers["/realm/token"] = json.dumps({"id_token": hostile.sign(hostile.all_claims())}).encode()
    assert Browser(asking, "127.0.10.4").login(hostile) == "token"


@pytest.mark.slow
@pytest.mark.parametrize("where", [None, "file:///etc/passwd", 7])
def test_a_provider_without_userinfo_is_none_for_who_asks_for_it(
    asking: Site, hostile: Hostile, where: Any
) -> None:
    publish(asking, hostile, userinfo_endpoint=where)
    assert Browser(asking).get("/api/oidc/begin").headers["Location"].endswith("#login/provider")


def left(asking: Site, browser: Browser) -> str:
    """Where the page goes after *Log out*. In any case the session has ended."""
    client = browser.client()
    where = str(json.loads(client.raw("POST", "/api/logout", {})[1])["provider"])
    assert said(client, "GET", "/api/me") == "session"
    assert not asking.rows("SELECT 1 FROM sessions WHERE \"user\" = 'oidc:anna'")
    return where


@pytest.mark.slow
def test_who_logs_out_is_sent_to_the_provider(asking: Site, hostile: Hostile) -> None:
    publish(asking, hostile, end_session_endpoint=f"{hostile.issuer}/end?tenant=1")
    hostile.userinfo = {"sub": "1001"}
    tokens = []
    hostile.token = lambda claims: tokens.append(hostile.sign(claims)) or tokens[-1]
    browser = Browser(asking)
    assert browser.login(hostile) == ""
    where = urlsplit(left(asking, browser))
    assert where.path == "/realm/end"
    assert parse_qs(where.query) == {
        "tenant": ["1"], "client_id": [CLIENT], "id_token_hint": [tokens[-1]],
        "post_logout_redirect_uri": [f"http://127.0.0.1:{asking.port}/"],
    }  # fmt: skip
    # A token that is too long for an address, and one of before the centre's start: the provider asks.
    hostile.claims = {"more": "x" * 4096}
    assert browser.login(hostile) == ""
    assert "id_token_hint" not in left(asking, browser)
    hostile.claims = {}
    assert browser.login(hostile) == ""
    publish(asking, hostile, end_session_endpoint=f"{hostile.issuer}/end")
    assert "id_token_hint" not in left(asking, browser)
    # Who has a password here has nothing to do with it.
    assert json.loads(asking.client("emil").raw("POST", "/api/logout", {})[1]) == {"provider": ""}


@pytest.mark.slow
@pytest.mark.parametrize("where", [None, "javascript:alert(1)", "//elsewhere.example/end", ["x"]])
def test_a_provider_without_an_end_ends_nothing_there(asking: Site, hostile: Hostile, where: Any) -> None:
    publish(asking, hostile, end_session_endpoint=where)
    hostile.userinfo = {"sub": "1001"}
    browser = Browser(asking)
    assert browser.login(hostile) == ""
    assert left(asking, browser) == ""


@pytest.mark.slow
def test_a_provider_that_hangs_keeps_nobody_in(asking: Site, hostile: Hostile) -> None:
    publish(asking, hostile, end_session_endpoint=f"{hostile.issuer}/end")
    hostile.userinfo = {"sub": "1001"}
    browser = Browser(asking)
    assert browser.login(hostile) == ""
    publish(asking, hostile)
    hostile.late.clear()
    hostile.hangs.add("/realm/.well-known/openid-configuration")
    assert left(asking, browser) == ""
    hostile.late.set()


# ---- cookies -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_no_other_host_of_the_site_puts_its_cookie_in_the_place_of_ours(
    of_north: Callable[..., Site], hostile: Hostile
) -> None:
    """Behind https a browser takes a cookie of this name from this host alone."""
    made = of_north(centre={"secure": True})
    content = json.loads(made.file.read_text())
    content["centre"]["oidc"] = configured(hostile.issuer, url="https://centre.example", roles=ROLES)
    del content["centre"]["oidc"]["secret_file"]
    made.file.write_text(json.dumps(content))
    with made:
        browser = Browser(made)
        told = browser.begin()
        [cookie] = browser.set
        assert cookie.startswith("__Host-openrtu_oidc=")
        assert {"Secure", "Path=/", "HttpOnly"} <= {*cookie.split("; ")} and "Domain" not in cookie
        assert told["redirect_uri"] == "https://centre.example/api/oidc/callback"
        hostile.nonce = told["nonce"]
        response = browser.get(f"/api/oidc/callback?code=c&state={told['state']}", Host="evil.example")
        assert response.headers["Location"] == "https://centre.example/"
        # A public client says its name, and has no secret.
        _, form, authorization = next(each for each in reversed(hostile.asked) if each[0] == "/realm/token")
        assert (form["client_id"], authorization) == (CLIENT, "")


# ---- the file ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"issuer": "http://login.example/realm"}, "issuer"),
        ({"url": "http://centre.example"}, "url"),
        ({"url": "https://centre.example/"}, "url"),
        ({"url": "https://centre.example"}, "secure"),
        ({"scope": "profile"}, "scope"),
        ({"roles": []}, "roles"),
        ({"roles": [{"value": "a", "role": "root"}]}, "root"),
        ({"roles": [{"value": "a", "role": "engineer", "groups": ["water"]}]}, "all stations"),
        ({"password": "x"}, "password"),
    ],
)
def test_the_file_says_who_is_believed(tmp_path: Path, more: dict[str, Any], says: str) -> None:
    content = configured("https://login.example/realm", url="http://127.0.0.1:8104") | more
    file = tmp_path / "centre.json"
    file.write_text(json.dumps({"stations": [], "centre": {"oidc": content}}))
    with pytest.raises(Exception, match=says):
        load(file)


@pytest.mark.slow
def test_who_has_no_provider_needs_no_authlib() -> None:
    """And who has one is told what to type."""
    script = """
import sys
sys.modules.update(dict.fromkeys(("authlib", "joserfc")))
from openrtu_tools.centre import verbs, web
from openrtu_tools.centre.errors import CentreError
try:
    web.provided(None, None)
except CentreError as error:
    print(error)
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "scripts")}
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("the Python package authlib is missing; type: ")


@pytest.mark.slow
def test_the_clients_secret_is_nobody_elses(tmp_path: Path) -> None:
    (tmp_path / "oidc.secret").write_text(SECRET)
    (tmp_path / "oidc.secret").chmod(0o640)
    content = configured("https://login.example/realm", url="http://127.0.0.1:8104")
    file = tmp_path / "centre.json"
    file.write_text(json.dumps({"stations": [], "centre": {"oidc": content}}))
    with pytest.raises(Exception, match="others may read it"):
        oidc = load(file).oidc
        assert oidc
        oidc.secret()
