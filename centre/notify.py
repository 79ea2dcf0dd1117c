# SPDX-License-Identifier: GPL-3.0-or-later
"""Alarms to people, by mail and by the web: docs/control-centre.md, "Notifications"."""

from __future__ import annotations

import asyncio
import json
import logging
import smtplib
import socket
import ssl
import threading
import time
from collections import ChainMap
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from email.message import EmailMessage
from email.policy import SMTP
from email.utils import format_datetime
from typing import Any

import aiohttp

from openrtu_tools.centre import outbox
from openrtu_tools.centre.centre import Centre
from openrtu_tools.centre.errors import CentreError, StoreError
from openrtu_tools.centre.formats import moment
from openrtu_tools.centre.model import NS_PER_MS, Alarm, Changes, Json
from openrtu_tools.centre.outbox import Message
from openrtu_tools.centre.settings import Mail, Notify, Target
from openrtu_tools.centre.store import Database

log = logging.getLogger("centre")

LOOK_S = 1.0  # for what is due
ANSWER_S = 30.0  # all of an attempt
STORE_S = 1.0  # until it is tried again
ERROR_MOST = 200  # characters


class RefusedMessageError(Exception):
    """The target is there, and does not want this message: others may go."""


def tls_context(ca: Any) -> ssl.SSLContext:
    try:
        return ssl.create_default_context(cafile=ca)
    except OSError as error:
        raise CentreError(f"notify: {ca}: {error}; is it there, readable and in PEM?") from error


# ---- a mail --------------------------------------------------------------------------------------


def line(alarm: Json) -> str:
    """Of a mail. What a station calls itself makes neither a line nor a head."""
    words = [alarm["station"], alarm["text"]]
    text = ": ".join(word for word in words if word)
    return "".join(each if each.isprintable() else " " for each in text)


def written(message: Message, sender: str, to: str) -> EmailMessage:
    content = json.loads(message.body)
    alarms = content["alarms"]
    others = len(alarms) - 1 + content["more"]
    made = EmailMessage(policy=SMTP)
    made["From"], made["To"] = sender, to
    gone = content.get("gone", False)
    subject = f"[OpenRTU] {'gone: ' if gone else ''}{line(alarms[0])}"
    made["Subject"] = subject[:200] + (f" (and {others} more)" if others else "")
    made["Date"] = format_datetime(datetime.fromtimestamp(message.made_ns / 1e9, UTC))
    made["Message-ID"] = f"<{message.uid}@{sender.rpartition('@')[2]}>"
    made["Auto-Submitted"] = "auto-generated"
    lines = [
        f"{moment(alarm['since'])}  priority {alarm['priority']}  {line(alarm)}"
        + (f", gone {moment(alarm['gone'])}" if gone else "")
        for alarm in alarms
    ]
    if content["more"]:
        lines.append(f"and {content['more']} more")
    lines += ["", "Times are UTC." + ("" if gone else " Acknowledge it on the control centre's page."), ""]
    made.set_content("\n".join(lines))
    return made


class Attempt:
    """A mail under way, in a thread of its own that nobody waits for longer than he wants to."""

    def __init__(self, settings: Mail, password: str, context: ssl.SSLContext) -> None:
        self.settings = settings
        self.password = password
        self.context = context
        self.server: smtplib.SMTP | None = None

    def send(self, mail: EmailMessage) -> None:
        settings, attempt = self.settings, self
        kind: type[smtplib.SMTP] = smtplib.SMTP if settings.starttls else smtplib.SMTP_SSL

        class Server(kind):  # type: ignore[misc, valid-type]
            """Known before it is connected, so that it can be cut off."""

            def __init__(self, **keys: Any) -> None:
                attempt.server = self
                super().__init__(settings.host, settings.port, timeout=ANSWER_S, **keys)

        with Server(**({} if settings.starttls else {"context": self.context})) as server:
            if settings.starttls:
                server.starttls(context=self.context)
            if settings.user:
                server.login(settings.user, self.password)
            server.send_message(mail)

    def cut(self) -> None:
        sock = getattr(self.server, "sock", None)
        if sock:
            with suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)


async def in_thread(work: Callable[[], None], cut: Callable[[], None]) -> None:
    """Work that may hang: then it is cut off, and its thread keeps no process from its end."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()

    def tell(error: BaseException | None) -> None:
        if not done.done():
            done.set_exception(error) if error else done.set_result(None)

    def run() -> None:
        error: BaseException | None = None
        try:
            work()
        except Exception as caught:
            error = caught
        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(tell, error)

    threading.Thread(target=run, name="mail", daemon=True).start()
    try:
        async with asyncio.timeout(ANSWER_S):
            await done
    except BaseException:
        cut()
        raise


# ---- all targets -----------------------------------------------------------------------------------


class Notifier:
    """Watches the centre; what is to be told is in the database before anybody is told, each target has a
    task of its own, and none waits for another.
    """

    def __init__(self, centre: Centre, settings: Notify) -> None:
        self.centre = centre
        self.settings = settings
        self.came: dict[int, int] = {}  # alarms that nobody has acknowledged: when they came
        self.told: dict[outbox.Told, bool] = {}  # whether the last word was of its end
        self.closed: dict[int, Alarm] = {}  # gone and acknowledged, and not everybody may know
        self.waiting: dict[str, list[Message]] = {name: [] for name in settings.targets}
        self.something = {name: asyncio.Event() for name in settings.targets}
        mail = settings.mail
        self.password = mail.password() if mail else ""
        self.mail_tls = tls_context(mail.ca) if mail else None
        self.tokens = {name: target.token() for name, target in settings.targets.items()}
        self.tls = {
            name: tls_context(target.ca) for name, target in settings.targets.items() if target.webhook
        }

    def changed(self, changes: Changes, linked: set[int]) -> None:
        for id_, alarm in changes.alarms.items():
            if alarm.acknowledged_ns is None:
                self.came.setdefault(id_, time.time_ns())
            else:
                self.came.pop(id_, None)
            if not alarm.open:
                self.closed[id_] = alarm

    async def run(self) -> None:
        """Until it is cancelled."""
        self.centre.watchers.add(self)
        try:
            kept = await self._store(lambda database: outbox.load(database, self.settings.targets))
            self.told = kept.told
            self.came = {**kept.came, **self.came}
            self.closed = {**kept.closed, **self.closed}
            for message in kept.messages:
                self.waiting[message.target].append(message)
            timeout = aiohttp.ClientTimeout(total=ANSWER_S)
            async with (
                aiohttp.ClientSession(timeout=timeout) as session,
                asyncio.TaskGroup() as tasks,
            ):
                for name in self.settings.targets:
                    tasks.create_task(self._serve(name, session))
                while True:
                    await self._tell_due()
                    await asyncio.sleep(LOOK_S)
        finally:
            self.centre.watchers.discard(self)

    async def _store(self, work: Callable[[Database], Any]) -> Any:
        """Until it is stored."""
        while True:
            try:
                return await self.centre.store.write(work)
            except StoreError:
                await asyncio.sleep(STORE_S)

    async def _tell_due(self) -> None:
        """What has no room waits: it is told later, unless somebody has acknowledged it by then."""
        now_ns, model = time.time_ns(), self.centre.model
        came = self._free(outbox.due(self.settings, self.came, model, self.told, now_ns))
        known = ChainMap(self.closed, model.alarms)
        gone = self._free(outbox.ended(self.settings, self.told, known))

        def add(database: Database) -> list[Message]:
            return [
                outbox.add(database, name, alarms, model, now_ns, is_end)
                for is_end, of_targets in ((False, came), (True, gone))
                for name, alarms in of_targets.items()
            ]

        messages = await self._store(add) if came or gone else []
        for is_end, of_targets in ((False, came), (True, gone)):
            for name, alarms in of_targets.items():
                self.told |= {(alarm.id, name): is_end for alarm in alarms}
        for message in messages:
            self.waiting[message.target].append(message)
            self.something[message.target].set()
        self._forget_closed()

    def _free(self, found: dict[str, list[Alarm]]) -> dict[str, list[Alarm]]:
        """Without what has no room; and who is told of ends is told nothing of an alarm before the last word
        of it was taken: in another order it would not be so.
        """
        free = {}
        for name, alarms in found.items():
            waiting = self.waiting[name]
            if len(waiting) >= outbox.WAITING_MOST:
                continue
            busy = set().union(*map(outbox.names, waiting)) if self.settings.targets[name].gone else ()
            if left := [alarm for alarm in alarms if alarm.id not in busy]:
                free[name] = left
        return free

    def _forget_closed(self) -> None:
        """Those of whose end all are told who want to be."""
        for id_ in [*self.closed]:
            of_alarm = [(name, self.told.get((id_, name))) for name in self.settings.targets]
            if not any(said is False and self.settings.targets[name].gone for name, said in of_alarm):
                del self.closed[id_]
                for name in self.settings.targets:
                    self.told.pop((id_, name), None)

    # ---- a target ------------------------------------------------------------------------------

    async def _serve(self, name: str, session: aiohttp.ClientSession) -> None:
        while True:
            if not self.waiting[name]:
                self.something[name].clear()
                await self.something[name].wait()
            message = min(self.waiting[name], key=lambda each: (each.next_ns, each.id))
            await asyncio.sleep(max(0.0, (message.next_ns - time.time_ns()) / 1e9))
            try:
                await self._send(message, self.settings.targets[name], session)
            except RefusedMessageError as error:
                await self._failed(message, str(error), [])
            except Exception as error:  # whatever it is, it concerns this target alone
                others = [each for each in self.waiting[name] if each is not message]
                await self._failed(message, str(error) or f"no answer in {ANSWER_S:g} s", others)
            else:
                await self._end(replace(message, tries=message.tries + 1, error=""), True)

    async def _end(self, message: Message, taken: bool) -> None:
        await self._store(lambda database: outbox.end(database, message, taken))
        of_target = self.waiting[message.target]
        of_target[:] = [each for each in of_target if each.id != message.id]

    async def _failed(self, message: Message, error: str, others: list[Message]) -> None:
        """Is the target not there, the others wait as long."""
        if not message.tries:
            log.warning("notify: %s: %s; trying again", message.target, error)
        tries, now_ns = message.tries + 1, time.time_ns()
        next_ns = now_ns + int(outbox.pause_s(tries) * 1e9)
        message = replace(message, tries=tries, next_ns=next_ns, error=error[:ERROR_MOST])
        if message.made_ns < now_ns - outbox.GIVE_UP_NS:
            log.error("notify: %s: given up: %s", message.target, error)
            await self._end(message, False)
            return
        put_off = [message, *(replace(each, next_ns=max(each.next_ns, next_ns)) for each in others)]
        await self._store(lambda database: outbox.put_off(database, put_off))
        following = {each.id: each for each in put_off}
        of_target = self.waiting[message.target]
        of_target[:] = [following.get(each.id, each) for each in of_target]

    async def _send(self, message: Message, target: Target, session: aiohttp.ClientSession) -> None:
        if target.webhook:
            await self._post(message, target, session)
            return
        mail = self.settings.mail
        assert mail and self.mail_tls
        attempt = Attempt(mail, self.password, self.mail_tls)
        content = written(message, mail.sender, target.mail)
        try:
            await in_thread(lambda: attempt.send(content), attempt.cut)
        except (smtplib.SMTPDataError, smtplib.SMTPRecipientsRefused) as error:
            raise RefusedMessageError(str(error)) from error

    async def _post(self, message: Message, target: Target, session: aiohttp.ClientSession) -> None:
        """To the address of the file and nowhere else; what it answers is not read."""
        content = {
            "id": message.uid,
            "target": message.target,
            "made": message.made_ns // NS_PER_MS,
            **json.loads(message.body),
        }
        headers = {"Idempotency-Key": message.uid}
        if token := self.tokens[message.target]:
            headers["Authorization"] = f"Bearer {token}"
        async with session.post(
            target.webhook, json=content, headers=headers, ssl=self.tls[message.target], allow_redirects=False
        ) as response:
            if 400 <= response.status < 500 and response.status not in (401, 403, 404, 408, 429):
                raise RefusedMessageError(f"it answers {response.status} {response.reason}")
            if not 200 <= response.status < 300:
                raise aiohttp.ClientError(f"it answers {response.status} {response.reason}")
