# SPDX-License-Identifier: GPL-3.0-or-later
"""A controlling station of another make: c104, which is lib60870. It knows nothing of the configuration."""

# No `from __future__ import annotations` here: c104 compares the annotations of callbacks, as objects.
import datetime
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Self

import c104

from lab.errors import LabError
from lab.patience import LOOK_S, Deadline

CONNECT_TIMEOUT_S = 30.0
ANSWER_TIMEOUT_S = 30.0
SHORTEST_I_FRAME = 15  # APCI, data unit identifier, information object address
ACT_CON = 7
ACT_TERM = 10
BROADCAST = 0xFFFF


class MasterError(LabError):
    """The controlled station did not answer as the protocol asks."""


@dataclass(frozen=True)
class Report:
    """One information object as it arrived."""

    ca: int
    ioa: int
    type: str  # M_SP_NA_1 …
    value: Any  # bool, int, float; a double point's name: OFF, ON …
    quality: str  # "good", or the set flags
    cause: str  # SPONTANEOUS …
    recorded_at: datetime.datetime | None  # the time tag
    monotonic_s: float = field(compare=False)

    @property
    def text(self) -> str:
        """In a line's part."""
        return f"CA {self.ca} IOA {self.ioa} = {self.value}, {self.quality}"

    @property
    def good(self) -> bool:
        """No quality bit is set."""
        return self.quality == "good"


@dataclass(frozen=True)
class Asdu:
    """The head of an ASDU as it was on the wire."""

    kind: int
    cause: int
    negative: bool
    ca: int
    ioa: int

    @classmethod
    def of(cls, frame: bytes) -> Self:
        """From an I frame with its APCI."""
        return cls(
            kind=frame[6],
            cause=frame[8] & 0x3F,
            negative=bool(frame[8] & 0x40),
            ca=int.from_bytes(frame[10:12], "little"),
            ioa=int.from_bytes(frame[12:15], "little"),
        )

    def is_of(self, kind: c104.Type, ca: int, ioa: int) -> bool:
        return (self.kind, self.ca, self.ioa) == (kind.value, ca, ioa)


def _quality_words(quality: Any) -> str:
    if quality is None or quality.is_good():
        return "good"
    return "+".join(
        name for name, flag in type(quality).__members__.items() if flag.value and flag in quality
    )


def _plain(value: Any) -> Any:
    """c104's numbers as Python's; a double point as its name."""
    if isinstance(value, c104.Double):
        return value.name
    if isinstance(value, c104.NormalizedFloat):
        return float(value)
    if isinstance(value, c104.Int16 | c104.Int7):
        return int(value)
    if isinstance(value, c104.Byte32):
        return int.from_bytes(bytes(value), "little")
    return value


def _utc(time_tag: datetime.datetime | None) -> datetime.datetime | None:
    """c104 gives the time tag as it is on the wire, without a zone; the gateway's is UTC."""
    return time_tag.replace(tzinfo=datetime.UTC) if time_tag else None


class Monitor:
    """A controlling station on one connection: it interrogates, and keeps what arrives."""

    def __init__(self, address: str, port: int) -> None:
        self._arrived = threading.Condition()
        self._reports: list[Report] = []
        self._asdus: list[Asdu] = []
        self._monitor = c104.Client(tick_rate_ms=50, command_timeout_ms=10_000)
        self._monitor.on_new_station(callable=self._on_new_station)
        self._monitor.on_new_point(callable=self._on_new_point)
        self.connection = self._monitor.add_connection(ip=address, port=port, init=c104.Init.NONE)
        self.connection.on_receive_raw(callable=self._on_receive_raw)
        self.connection.on_unexpected_message(callable=self._on_unexpected_message)

    def __enter__(self) -> Self:
        self._monitor.start()
        _start_transfer(self.connection)
        return self

    def __exit__(self, *_: object) -> None:
        self._monitor.stop()

    # ---- what arrives ------------------------------------------------------------------------

    def _on_new_station(self, client: c104.Client, connection: c104.Connection, common_address: int) -> None:
        connection.add_station(common_address=common_address)

    def _on_new_point(
        self, client: c104.Client, station: c104.Station, io_address: int, point_type: c104.Type
    ) -> None:
        point = station.add_point(io_address=io_address, type=point_type)
        point.on_receive(callable=self._on_report)

    def _on_report(
        self, point: c104.Point, previous_info: c104.Information, message: c104.IncomingMessage
    ) -> c104.ResponseState:
        self._keep(message)
        return c104.ResponseState.SUCCESS

    def _on_unexpected_message(
        self, connection: c104.Connection, message: c104.IncomingMessage, cause: c104.Umc
    ) -> None:
        """For c104 a point has the type that it came with first; with a time tag, events have another."""
        more = cause == c104.Umc.MISMATCHED_TYPE_ID
        while more:
            self._keep(message)
            more = message.next()

    def _keep(self, message: c104.IncomingMessage) -> None:
        report = Report(
            ca=message.common_address,
            ioa=message.io_address,
            type=message.type.name,
            value=_plain(message.info.value),
            quality=_quality_words(message.info.quality),
            cause=message.cot.name,
            recorded_at=_utc(message.info.recorded_at),
            monotonic_s=time.monotonic(),
        )
        with self._arrived:
            self._reports.append(report)
            self._arrived.notify_all()

    def _on_receive_raw(self, connection: c104.Connection, data: bytes) -> None:
        if len(data) >= SHORTEST_I_FRAME:
            with self._arrived:
                self._asdus.append(Asdu.of(data))
                self._arrived.notify_all()

    def mark(self) -> int:
        """The place behind the newest report, for reports_since and wait."""
        with self._arrived:
            return len(self._reports)

    def reports_since(self, mark: int) -> list[Report]:
        """What arrived after mark, in order."""
        with self._arrived:
            return self._reports[mark:]

    def wait(
        self, wanted: Callable[[Report], bool], since: int = 0, timeout_s: float = 30.0, what: str = ""
    ) -> Report:
        """The first report behind `since` that is wanted. Raises MasterError when none comes in time.

        timeout_s is for an idle machine (lab.patience).
        """
        deadline = Deadline(timeout_s)
        with self._arrived:
            while True:
                for report in self._reports[since:]:
                    if wanted(report):
                        return report
                if deadline.over:
                    others = self._reports[since:]
                    seen = f"not within {deadline.waited:.0f} s"
                    listed = "\n".join(map(str, others[-20:]))
                    raise MasterError(
                        f"{seen}: {what or 'the wanted report'}; since then:\n{listed}",
                        expected=what,
                        seen=f"{seen}; the last other report: {others[-1].text if others else 'none'}",
                        late=True,
                    )
                self._arrived.wait(min(LOOK_S, deadline.left))

    # ---- what is sent ------------------------------------------------------------------------

    def interrogate(self, ca: int, group: int = 0) -> list[Report]:
        """A station (or group 1..16) interrogation; returns its objects, in order of arrival."""
        since, sent = self.mark(), self._raw_mark()
        self.connection.interrogation(
            common_address=ca, qualifier=c104.Qoi(20 + group), wait_for_response=False
        )
        if not self._confirmed(sent, c104.Type.C_IC_NA_1, ca, 0):
            raise MasterError(f"CA {ca} refused the interrogation")
        self._await_terminated(sent, c104.Type.C_IC_NA_1, ca, 0)
        # c104 hands over the objects in another thread, later than the raw frames.
        cause = f"INTERROGATED_BY_GROUP_{group}" if group else "INTERROGATED_BY_STATION"
        return self._settled(lambda: [r for r in self.reports_since(since) if r.cause == cause])

    def is_refused(self, ca: int) -> bool:
        """Whether the controlled station refuses an interrogation of this CA."""
        sent = self._raw_mark()
        self.connection.interrogation(common_address=ca, wait_for_response=False)
        return not self._confirmed(sent, c104.Type.C_IC_NA_1, ca, 0)

    def interrogate_counters(self, ca: int, freeze: c104.Frz = c104.Frz.READ) -> list[Report]:
        """A general counter interrogation; returns its readings, none unless it reads."""
        since, sent = self.mark(), self._raw_mark()
        self.connection.counter_interrogation(
            common_address=ca, qualifier=c104.Rqt.GENERAL, freeze=freeze, wait_for_response=False
        )
        if not self._confirmed(sent, c104.Type.C_CI_NA_1, ca, 0):
            raise MasterError(f"CA {ca} refused the counter interrogation")
        self._await_terminated(sent, c104.Type.C_CI_NA_1, ca, 0)
        cause = "REQUESTED_BY_GENERAL_COUNTER"
        return self._settled(lambda: [r for r in self.reports_since(since) if r.cause == cause])

    def interrogate_all(self, *cas: int) -> list[Report]:
        """An interrogation of the broadcast address; returns its objects when each CA has terminated it."""
        since, sent = self.mark(), self._raw_mark()
        self.connection.interrogation(common_address=BROADCAST, wait_for_response=False)
        for ca in cas:
            if not self._confirmed(sent, c104.Type.C_IC_NA_1, ca, 0):
                raise MasterError(f"CA {ca} refused the interrogation of all stations")
            self._await_terminated(sent, c104.Type.C_IC_NA_1, ca, 0)
        return self._settled(
            lambda: [r for r in self.reports_since(since) if r.cause == "INTERROGATED_BY_STATION"]
        )

    def synchronise_clock(self, ca: int) -> None:
        """Sends this machine's time."""
        sent = self._raw_mark()
        self.connection.clock_sync(common_address=ca, wait_for_response=False)
        if not self._confirmed(sent, c104.Type.C_CS_NA_1, ca, 0):
            raise MasterError(f"CA {ca} refused the clock synchronisation")

    # ---- frames --------------------------------------------------------------------------------

    def _raw_mark(self) -> int:
        with self._arrived:
            return len(self._asdus)

    def _confirmed(self, since: int, kind: c104.Type, ca: int, ioa: int) -> bool:
        """The answer as it was on the wire: c104's own waiting misses one that comes within 0.3 ms."""
        answer = self._await_asdu(since, lambda a: a.is_of(kind, ca, ioa) and a.cause != ACT_TERM)
        return answer.cause == ACT_CON and not answer.negative

    def _await_terminated(self, since: int, kind: c104.Type, ca: int, ioa: int) -> None:
        self._await_asdu(since, lambda a: a.is_of(kind, ca, ioa) and a.cause == ACT_TERM)

    def _await_asdu(self, since: int, wanted: Callable[[Asdu], bool]) -> Asdu:
        deadline = Deadline(ANSWER_TIMEOUT_S)
        with self._arrived:
            while True:
                for asdu in self._asdus[since:]:
                    if wanted(asdu):
                        return asdu
                if deadline.over:
                    raise MasterError(f"no answer within {deadline.waited:.0f} s", late=True)
                self._arrived.wait(min(LOOK_S, deadline.left))

    def _settled(self, collect: Callable[[], list[Report]], quiet_s: float = 0.1) -> list[Report]:
        found = collect()
        quiet = Deadline(quiet_s)
        while not quiet.over:
            time.sleep(0.01)
            now = collect()
            if len(now) != len(found):
                quiet = Deadline(quiet_s)
            found = now
        return found


class Master(Monitor):
    """
    A controlling station on two connections, one to monitor and one to command: c104 allows one point an
    address, and the gateway's commands have the addresses of what they change.
    """

    def __init__(self, address: str, port: int) -> None:
        super().__init__(address, port)
        self._operator = c104.Client(tick_rate_ms=50, command_timeout_ms=1_000)
        # c104 itself would add each point that reports: between remove_point and add_point of `command`, too.
        self._operator.on_new_point(callable=self._no_point_of_the_operator)
        self.commands = self._operator.add_connection(ip=address, port=port, init=c104.Init.NONE)
        self.commands.on_receive_raw(callable=self._on_receive_raw)

    def __enter__(self) -> Self:
        super().__enter__()
        self._operator.start()
        _start_transfer(self.commands)
        return self

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        self._operator.stop()

    def _no_point_of_the_operator(
        self, client: c104.Client, station: c104.Station, io_address: int, point_type: c104.Type
    ) -> None:
        """The operator's points are commands; what reports is the monitor's."""

    def command(self, ca: int, ioa: int, type_name: str, info: Any, *, select: bool = False) -> bool:
        """Sends a command, as "C_SC_NA_1", c104.SingleCmd(True). True: confirmed positively.

        select: c104 selects first, and executes once that is confirmed, which is what is told here.
        """
        point, sent = self._sent(ca, ioa, type_name, info, select)
        return self._confirmed(sent, point.type, ca, ioa)

    def command_to_its_end(self, ca: int, ioa: int, type_name: str, info: Any) -> bool:
        """A direct command; if it was confirmed, it is terminated too, so that another command can follow."""
        point, sent = self._sent(ca, ioa, type_name, info)
        confirmed = self._confirmed(sent, point.type, ca, ioa)
        if confirmed:
            self._await_terminated(sent, point.type, ca, ioa)
        return confirmed

    def _sent(
        self, ca: int, ioa: int, type_name: str, info: Any, select: bool = False
    ) -> tuple[c104.Point, int]:
        self.commands.add_station(common_address=ca)  # None where it is there already
        station = self.commands.get_station(ca)
        if station.get_point(ioa):
            station.remove_point(ioa)
        point = station.add_point(io_address=ioa, type=getattr(c104.Type, type_name))
        point.info = info
        if select:
            point.command_mode = c104.CommandMode.SELECT_AND_EXECUTE
        sent = self._raw_mark()
        point.transmit(cause=c104.Cot.ACTIVATION)
        return point, sent


def _start_transfer(connection: c104.Connection) -> None:
    connection.connect()
    _wait(lambda: connection.is_connected, CONNECT_TIMEOUT_S, "no connection to the controlled station")
    connection.unmute()
    _wait(lambda: not connection.is_muted, CONNECT_TIMEOUT_S, "no STARTDT con")


def _wait(condition: Callable[[], bool], timeout_s: float, message: str) -> None:
    deadline = Deadline(timeout_s)
    while not condition():
        if deadline.over:
            raise MasterError(message, late=True)
        time.sleep(0.01)
