# SPDX-License-Identifier: GPL-3.0-or-later
"""Alarms to people: who takes mails and requests here is of another maker. With kills in between."""

import doctest
import json
import socket
import ssl
import threading
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from email import message_from_bytes
from email.policy import default
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from aiosmtpd.controller import Controller
from aiosmtpd.smtp import SMTP, AuthResult

from control_room import Site, Stations, described, now_ms, until
from lab.centre_client import AnswerError, Client
from lab.gateway import free_port
from lab.vehicles import M_ME_TF_1, M_SP_TB_1, Station, measured, single
from openrtu_tools.centre import outbox, settings
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.model import Alarm, Model
from openrtu_tools.centre.model import Station as Known
from openrtu_tools.centre.notify import written
from openrtu_tools.centre.outbox import Message
from openrtu_tools.centre.settings import Notify, NotifyRule, StationSettings, Target
from postgres import Server
from test_centre_tls import make_pair

S = 10**9
PASSWORD = "correct horse battery"


# ---- who is told -------------------------------------------------------------------------------------


class Post(ThreadingHTTPServer):
    """Takes requests over TLS: with which answer, the test says."""

    daemon_threads = True

    def __init__(self, folder: Path, port: int = 0) -> None:
        self.told: list[dict[str, Any]] = []
        self.heads: list[dict[str, str]] = []
        self.status, self.location = 200, ""
        self.holds = threading.Event()  # no answer while it is not set
        self.holds.set()
        super().__init__(("127.0.0.1", port), Answer)
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        context.load_cert_chain(folder / "certificate.pem", folder / "key.pem")
        self.socket = context.wrap_socket(self.socket, server_side=True, do_handshake_on_connect=False)
        threading.Thread(target=self.serve_forever, args=(0.05,), daemon=True).start()

    def handle_error(self, *_: Any) -> None:
        """One that was killed has left."""

    @property
    def url(self) -> str:
        return f"https://127.0.0.1:{self.server_address[1]}/alarms"

    @property
    def alarms(self) -> set[int]:
        return {alarm["id"] for told in self.told for alarm in told["alarms"]}


class Answer(BaseHTTPRequestHandler):
    server: Post

    def do_POST(self) -> None:
        content = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.heads.append(dict(self.headers))
        self.server.told.append(json.loads(content))
        self.server.holds.wait()
        self.send_response(self.server.status)
        if self.server.location:
            self.send_header("Location", self.server.location)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *_: Any) -> None: ...


class Box:
    """What aiosmtpd has taken."""

    def __init__(self) -> None:
        self.mails: list[Any] = []
        self.to: list[str] = []
        self.answer = "250 OK"

    @property
    def told(self) -> list[Any]:
        """Each mail once: whoever is killed before the answer sends it again."""
        return [*{mail["Message-ID"]: mail for mail in self.mails}.values()]

    async def handle_DATA(self, _server: Any, _session: Any, envelope: Any) -> str:
        if self.answer.startswith("250"):
            self.mails.append(message_from_bytes(envelope.content, policy=default))
            self.to += envelope.rcpt_tos
        return self.answer


def allowed(_server: Any, _session: Any, _envelope: Any, _mechanism: str, data: Any) -> AuthResult:
    return AuthResult(success=(data.login, data.password) == (b"centre", b"secret"))


class Mailer(Controller):
    """Takes mails of who is known, over TLS only."""

    def __init__(self, folder: Path, box: Box, starttls: bool) -> None:
        self.tls = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        self.tls.load_cert_chain(folder / "certificate.pem", folder / "key.pem")
        self.starttls = starttls
        super().__init__(
            box, hostname="127.0.0.1", port=free_port(), ssl_context=None if starttls else self.tls
        )

    def factory(self) -> SMTP:
        upgraded = {"tls_context": self.tls, "require_starttls": True} if self.starttls else {}
        return SMTP(
            self.handler, authenticator=allowed, auth_required=True,
            auth_require_tls=self.starttls, **upgraded,
        )  # fmt: skip


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    """Where a certificate of 127.0.0.1 is, with its key."""
    make_pair(tmp_path)
    return tmp_path


@pytest.fixture
def box() -> Box:
    return Box()


@pytest.fixture(params=[False, True], ids=["tls", "starttls"])
def mailer(request: pytest.FixtureRequest, pair: Path, box: Box) -> Iterator[Mailer]:
    made = Mailer(pair, box, request.param)
    made.start()
    yield made
    made.stop()


@pytest.fixture
def post(pair: Path) -> Iterator[Post]:
    made = Post(pair)
    yield made
    made.holds.set()
    made.shutdown()
    made.server_close()


@pytest.fixture
def station(stations: Stations) -> Iterator[Station]:
    made = stations.station()
    yield made
    stations.do(made.stop())


def secrets(folder: Path) -> None:
    for name, text in (("mail.password", "secret"), ("hook.token", "token of the hook")):
        (folder / name).write_text(f"{text}\n")
        (folder / name).chmod(0o600)


def mail_of(mailer: Mailer, **keys: Any) -> dict[str, Any]:
    made = {
        "host": "127.0.0.1", "port": mailer.port, "starttls": mailer.starttls, "from": "centre@example.org",
        "user": "centre", "password_file": "mail.password", "ca": "certificate.pem",
    }  # fmt: skip
    return {**made, **keys}


def state(client: Client, name: str) -> dict[str, Any]:
    """Of a client that stays: a user has few sessions, and the oldest makes room."""
    targets = client.get("/api/notifications")["targets"]
    return next(each for each in targets if each["name"] == name)


# ---- rules -------------------------------------------------------------------------------------------


def test_doctests() -> None:
    assert doctest.testmod(outbox).failed == 0


def alarm(id_: int, kind: str = "lost", priority: int = 1, station: int = 1, **keys: Any) -> Alarm:
    return replace(Alarm(id_, kind, station, None, None, priority, None, 0), **keys)


def test_rule_tells_what_it_is_for_and_nobody_twice() -> None:
    model = Model()
    for id_, group in ((1, "water"), (2, "heat")):
        model.stations[id_] = Known(id_, StationSettings(f"s{id_}", group=group))
    alarms = [
        alarm(1), alarm(2, "quality", 2), alarm(3, station=2), alarm(4, acknowledged_ns=1),
        alarm(5, suppressed_by=6), alarm(6, "network"), alarm(7, shelved_until_ns=50 * S),
        alarm(8, "clock", 3),
    ]  # fmt: skip
    model.alarms = {each.id: each for each in alarms}
    rules = (
        NotifyRule(("all", "duty")), NotifyRule(("duty",), 1), NotifyRule(("water",), 2, (), "water"),
        NotifyRule(("quality",), kinds=("quality",)), NotifyRule(("chief",), 1, after_s=900),
    )  # fmt: skip
    targets = {name: Target(mail="a@b") for rule in rules for name in rule.to}
    notify = Notify(targets, rules)
    came = dict.fromkeys(model.alarms, 0)

    def told(now_s: int, before: set[tuple[int, str]] = frozenset()) -> dict[str, list[int]]:  # type: ignore[assignment]
        found = outbox.due(notify, came, model, dict.fromkeys(before, False), now_s * S)
        return {name: [each.id for each in alarms] for name, alarms in found.items()}

    everything = [1, 2, 3, 6, 8]
    assert told(1) == {"all": everything, "duty": everything, "water": [1, 2, 6], "quality": [2]}
    assert told(1, {(each, "all") for each in everything})["duty"] == everything
    assert "all" not in told(1, {(each, "all") for each in everything})
    assert told(60)["all"] == [1, 2, 3, 6, 7, 8]
    assert told(900)["chief"] == [1, 3, 6, 7]


def test_end_is_told_to_who_wants_it_and_was_told_of_the_alarm() -> None:
    model = Model()
    model.stations[1] = Known(1, StationSettings("s1"))
    both = ("all", "starts")
    notify = Notify({"all": Target(mail="a@b", gone=True), "starts": Target(mail="c@d")}, (NotifyRule(both),))
    model.alarms = {1: alarm(1, gone_ns=9), 2: alarm(2), 3: alarm(3, gone_ns=9)}
    told = {(id_, name): False for id_ in (1, 2) for name in both}
    ended = outbox.ended(notify, told, model.alarms)
    assert {name: [each.id for each in alarms] for name, alarms in ended.items()} == {"all": [1]}
    told[1, "all"] = True
    came = dict.fromkeys(model.alarms, 0)

    def due() -> dict[str, list[int]]:
        found = outbox.due(notify, came, model, told, S)
        return {name: [each.id for each in alarms] for name, alarms in found.items()}

    assert (outbox.ended(notify, told, model.alarms), due()) == ({}, {"all": [3], "starts": [3]})
    model.alarms[1] = alarm(1, returns=1)  # it is there again: whoever was told of its end is told
    assert due() == {"all": [1, 3], "starts": [3]}


def test_name_makes_no_head_of_a_mail() -> None:
    named = {"station": "mill\r\nBcc: evil@example.org", "text": "station lost", "since": 0, "priority": 1}
    body = json.dumps({"alarms": [named, named], "more": 3})
    mail = written(Message(1, "uid", "duty", body, 0, 0, 0, ""), "centre@example.org", "duty@example.org")
    read = message_from_bytes(mail.as_bytes(), policy=default)
    assert read["Bcc"] is None
    assert read["Subject"] == "[OpenRTU] mill  Bcc: evil@example.org: station lost (and 4 more)"
    assert read["Message-ID"] == "<uid@example.org>"
    assert read.get_content().count("Times are UTC.") == 1


@pytest.mark.parametrize(
    ("wanted", "why"),
    [
        ({"targets": {"a": {"webhook": "http://127.0.0.1/x"}}, "rules": []}, "does not match"),
        ({"targets": {"a": {"webhook": "https://user@127.0.0.1/x"}}, "rules": []}, "does not match"),
        ({"targets": {"a": {"mail": "a@b\nBcc: c@d"}}, "rules": []}, "does not match"),
        ({"targets": {"a": {"mail": "a@b"}}, "rules": []}, "which server takes it"),
        ({"targets": {}, "rules": [{"to": ["a"]}]}, "there is no target a"),
    ],
)
def test_what_is_no_target_is_refused(tmp_path: Path, wanted: dict[str, Any], why: str) -> None:
    file = tmp_path / "centre.json"
    file.write_text(json.dumps({"stations": [], "centre": {"notify": wanted}}))
    with pytest.raises(CentreError, match=why):
        settings.load(file)


# ---- told --------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_mail_and_request_tell_an_alarm_once(
    programs: Path, stations: Stations, station: Station, tmp_path: Path, mailer: Mailer, box: Box, post: Post
) -> None:
    """With what a receiver needs to know it again; what is acknowledged is told no more."""
    secrets(tmp_path)
    targets = {
        "duty": {"mail": "duty@example.org"},
        "hook": {"webhook": post.url, "token_file": "hook.token", "ca": "certificate.pem"},
        "chief": {"mail": "chief@example.org"},
    }
    rules = [{"to": ["duty", "hook"]}, {"to": ["chief"], "after_s": 3600}]
    notify = {"mail": mail_of(mailer), "targets": targets, "rules": rules}
    with Site(
        programs, tmp_path, [described(station, tmp_path, group="water")], users=("olga", "vera"),
        centre={"notify": notify},
    ) as site:  # fmt: skip
        stations.say(station, 4, M_ME_TF_1, measured(now_ms(), 9))
        until(lambda: post.told and box.mails, "both are told")
        [told] = post.told
        assert [each["text"] for each in told["alarms"]] == ["level is too high: 9 m"]
        assert (told["alarms"][0]["station"], told["alarms"][0]["group"], told["more"]) == (
            "north",
            "water",
            0,
        )
        assert post.heads[0]["Authorization"] == "Bearer token of the hook"
        assert post.heads[0]["Idempotency-Key"] == told["id"]
        assert box.mails[0]["Subject"] == "[OpenRTU] north: level is too high: 9 m"
        assert box.to == ["duty@example.org"]
        client = site.client("olga")
        until(lambda: state(client, "hook")["last"] and state(client, "duty")["last"], "both have taken it")
        site.kill(site.centre)
        site.start_centre()
        client = site.client("olga")
        client.post("/api/alarms/acknowledge", {"ids": [each["id"] for each in client.get("/api/alarms")]})
        stations.say(station, 5, M_SP_TB_1, single(now_ms(), True))
        until(lambda: len(post.told) > 1 and len(box.mails) > 1, "both are told of the next one")
        assert [[each["kind"] for each in told["alarms"]] for told in post.told] == [["high"], ["state"]]
        assert (len(box.mails), set(box.to)) == (2, {"duty@example.org"})
        with pytest.raises(AnswerError) as refused:
            site.client("vera").get("/api/notifications")
        assert refused.value.code == "role"
        shown = json.dumps(client.get("/api/notifications"))
        assert "127.0.0.1" not in shown and "token" not in shown


@pytest.mark.slow
def test_end_of_an_alarm_is_told_in_order(
    programs: Path,
    stations: Stations,
    station: Station,
    server: Server | None,
    tmp_path: Path,
    pair: Path,
    box: Box,
    post: Post,
) -> None:
    """By mail and request, after its begin, once, over a kill; and to who asks for it alone."""
    secrets(tmp_path)
    mailer = Mailer(pair, box, False)
    mailer.start()
    hook = {"webhook": post.url, "ca": "certificate.pem", "gone": True}
    duty, chief = {"mail": "duty@example.org", "gone": True}, {"mail": "chief@example.org"}
    targets = {"duty": duty, "chief": chief, "hook": hook}
    rules = [{"to": [*targets], "kinds": ["high"]}]
    notify = {"mail": mail_of(mailer), "targets": targets, "rules": rules}

    def said() -> list[tuple[bool, list[str]]]:
        ids: dict[str, tuple[bool, list[str]]] = {}
        for told in post.told:  # what came twice has the same id
            ids[told["id"]] = (told["gone"], [each["text"] for each in told["alarms"]])
        return [*ids.values()]

    with Site(
        programs,
        tmp_path,
        [described(station, tmp_path)],
        users=("olga",),
        server=server,
        centre={"notify": notify},
    ) as site:
        client = site.client("olga")
        post.holds.clear()
        stations.say(station, 4, M_ME_TF_1, measured(now_ms(), 9))
        until(lambda: post.told, "it has the message, and does not answer")
        client.post("/api/alarms/acknowledge", {"ids": [each["id"] for each in client.get("/api/alarms")]})
        stations.say(station, 4, M_ME_TF_1, measured(now_ms(), 1))
        until(lambda: len(box.told) == 3, "the mails do not wait for the request")
        site.kill(site.centre)
        post.holds.set()
        site.start_centre()
        until(lambda: len(said()) == 2, "the end follows")
        client = site.client("olga")
        stations.say(station, 4, M_ME_TF_1, measured(now_ms(), 9))
        until(lambda: len(said()) == 3, "a new one")
        stations.say(station, 4, M_ME_TF_1, measured(now_ms(), 1))
        until(lambda: len(said()) == 4, "its end, which nobody has acknowledged")
        stations.say(station, 4, M_ME_TF_1, measured(now_ms(), 8))
        until(lambda: len(said()) == 5, "it comes again")
        until(lambda: len(box.told) == 7, "and each mail")
    mailer.stop()
    high = "level is too high: 9 m"
    again = "level is too high: 8 m"
    assert said() == [(False, [high]), (True, [high]), (False, [high]), (True, [high]), (False, [again])]
    of_duty = [mail["Subject"] for mail in box.told if mail["To"] == "duty@example.org"]
    begin, end = f"[OpenRTU] north: {high}", f"[OpenRTU] gone: north: {high}"
    assert of_duty == [begin, end, begin, end, f"[OpenRTU] north: {again}"]
    assert [mail["Subject"] for mail in box.told if mail["To"] == "chief@example.org"] == [begin, begin]
    assert ", gone 20" in next(mail for mail in box.told if "gone:" in mail["Subject"]).get_content()


@pytest.mark.slow
def test_nothing_is_lost_by_kills_and_what_comes_twice_is_known_by_its_id(
    programs: Path, stations: Stations, station: Station, server: Server | None, tmp_path: Path, post: Post
) -> None:
    """The centre is killed while the receiver has a message and has not answered; and while it is gone."""
    notify = {
        "targets": {"hook": {"webhook": post.url, "ca": "certificate.pem"}},
        "rules": [{"to": ["hook"], "kinds": ["high", "state"]}],
    }
    wanted: set[int] = set()
    with Site(
        programs,
        tmp_path,
        [described(station, tmp_path)],
        users=("olga",),
        server=server,
        centre={"notify": notify},
    ) as site:
        for round_ in range(3):
            post.holds.clear()
            before = len(post.told)
            stations.say(station, 5, M_SP_TB_1, single(now_ms(), True))
            until(lambda before=before: len(post.told) > before, "it has a message, and does not answer")
            site.kill(site.centre)
            post.holds.set()
            site.start_centre()
            again = post.told[before]["id"]
            until(
                lambda before=before, again=again: again in [each["id"] for each in post.told[before + 1 :]],
                "it comes again, with its id",
            )
            client = site.client("olga")
            [alarm] = client.get("/api/alarms?kind=state")
            wanted.add(alarm["id"])
            post.status = 503
            stations.say(station, 4, M_ME_TF_1, measured(now_ms(), 9 + round_))
            until(
                lambda client=client: state(client, "hook")["waiting"],
                "it waits for a receiver that is not well",
            )
            wanted |= {each["id"] for each in client.get("/api/alarms?kind=high")}
            site.kill(site.centre)
            post.status = 200
            site.start_centre()
            client = site.client("olga")
            until(lambda client=client: not state(client, "hook")["waiting"], "all is taken")
            ids = [each["id"] for each in client.get("/api/alarms")]
            client.post("/api/alarms/acknowledge", {"ids": ids})
            stations.say(station, 4, M_ME_TF_1, measured(now_ms(), 1))
            stations.say(station, 5, M_SP_TB_1, single(now_ms(), False))
            until(lambda client=client: not client.get("/api/alarms"), "they are gone")
    assert post.alarms == wanted and len(wanted) == 6
    alarms_of = {told["id"]: [alarm["id"] for alarm in told["alarms"]] for told in post.told}
    assert all(alarms_of[told["id"]] == [alarm["id"] for alarm in told["alarms"]] for told in post.told)
    assert set(Counter(each for ids in alarms_of.values() for each in ids).values()) == {1}


@pytest.mark.slow
def test_who_hangs_delays_nobody_and_no_redirection_is_followed(
    programs: Path, stations: Stations, station: Station, tmp_path: Path, post: Post, box: Box
) -> None:
    """One says nothing at all, one does not answer, one points elsewhere, one has an unknown certificate."""
    secrets(tmp_path)
    mute = socket.create_server(("127.0.0.1", 0))
    slow, astray = Post(tmp_path), Post(tmp_path)
    slow.holds.clear()
    elsewhere = Post(tmp_path)
    astray.status, astray.location = 307, elsewhere.url
    targets = {
        "mute": {"mail": "mute@example.org"},
        "slow": {"webhook": slow.url, "ca": "certificate.pem"},
        "astray": {"webhook": astray.url, "ca": "certificate.pem"},
        "stranger": {"webhook": elsewhere.url},
        "good": {"webhook": post.url, "ca": "certificate.pem"},
    }
    mail = {"host": "127.0.0.1", "port": mute.getsockname()[1], "from": "centre@example.org"}
    notify = {"mail": mail, "targets": targets, "rules": [{"to": list(targets)}]}
    with Site(
        programs, tmp_path, [described(station, tmp_path)], users=("olga",), centre={"notify": notify}
    ) as site:
        stations.say(station, 4, M_ME_TF_1, measured(now_ms(), 9))
        until(lambda: slow.told and post.told, "one hangs, and one is told")
        stations.say(station, 5, M_SP_TB_1, single(now_ms(), True))
        until(lambda: len(post.alarms) == 2, "it is told the next one, too")
        client = site.client("olga")
        until(lambda: "307" in state(client, "astray")["error"], "it is said who points elsewhere")
        until(lambda: "certificate" in state(client, "stranger")["error"], "it is said whom nobody trusts")
        assert (len(slow.told), elsewhere.told) == (1, [])
        assert (state(client, "good")["waiting"], state(client, "slow")["waiting"]) == (0, 2)
        assert site.centre
        site.centre.terminate()  # what hangs does not keep it
        assert site.centre.wait(60) == 0
    mute.close()
    for each in (slow, astray, elsewhere):
        each.holds.set()
        each.shutdown()
        each.server_close()
