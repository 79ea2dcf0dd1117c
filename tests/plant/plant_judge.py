# SPDX-License-Identifier: GPL-3.0-or-later
"""What must hold in each world, seen from outside: docs/plant.md has a sentence for each."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence

from plant_excuses import (
    AGE_S,
    LOST_S,
    could_be_lost,
    device_of,
    direct_times,
    is_disturbed,
    is_no_alarm,
    is_trouble_of,
    overlaps,
    troubled_times,
)
from plant_history import CENTRE, LINK_DOWN, NEXT_S, Dated, History, Told, Violation, Write, seconds
from plant_world import CHANGES_FROM_S, ORDERED, PORT, RECOVERY_S, SETTLED_S, Order, Run

HELD_S = 5.0
ENDED_S = 2.0  # by then a module that was stopped is told to be back, or is ended by rtud, which is told
SAME_S = 0.1  # rtud looks at heartbeats every 50 ms
INVALID_S = 5.0  # from the last answer of a device until its points are told invalid
WINDOW_S = 10
CONNECTIONS = 16  # of rtu-iec104; of others there are fewer
GROWTH_KIB = 1024  # pages that are used later
LINES_AT_ONCE = 40  # about peers, of a program that has begun (docs/telecontrol.md)
LINES_A_MINUTE = 60  # of a program: worlds with a fault every 8 s have half as many
MINUTE = len("2026-01-01T00:00")
ANSWERS_LEAST = 15  # of a device that lives, in each window: two reads a second, and a neighbour's time-outs
EXECUTED, REFUSED = 9, 8
NOT_SENT = (6, 7, 64, 65, 66)  # docs/centre.md
ORDER_S = 5.0  # a command takes that long where nothing fails, besides its ways
NOTICED_S = 1.0  # the first of the hang-ups behind each answer may meet a command on its way
ENDS_OF_CONNECTION = ("rtu-iec104", "rtud", CENTRE, f"{PORT}")
ENDS_CONNECTION_S = {"kill": 15.0, "stop": 15.0, "cut": 20.0, "lost": LOST_S, "power": LOST_S}


def age_s(history: History, told: Told) -> float:
    """How old a value may be at its time tag, or as it comes. What is not good is an old one's."""
    if not told.good:
        return float("inf")
    return AGE_S + (history.delay_s(told.at_s) if told.tag_s is None else 0.0)


def values_are_true(history: History) -> Iterator[Violation]:
    """Good is what its device held shortly before. What is not good, it held at some time before."""
    for told in history.told:
        until_s = told.at_s if told.tag_s is None else told.tag_s
        from_s = until_s - age_s(history, told)
        if told.point not in history.held:
            yield Violation("no value of nobody", told.at_s, f"{told.point} is {told.value}")
        elif not history.held_within(told.point, told.value, from_s, until_s + 0.001):
            yield Violation("true", told.at_s, f"{told.point} is told as {told}")


def is_told_twice(event: Told, before: Told) -> bool:
    """Within a connection. A module may be lost twice in a millisecond: silent, and then killed."""
    what = (event.session, event.tag_s, event.value, event.good)
    return event.good and what == (before.session, before.tag_s, before.value, before.good)


def tells_the_same(event: Told, other: Told) -> bool:
    return (event.value, event.good) == (other.value, other.good)


def is_followed(event: Dated, lost: Dated, later: Sequence[Dated], history: History) -> bool:
    """What a module read before it was lost, and tells behind that: its return or its end is told as well."""
    return not lost.good and any(
        (lost.tag_s or 0) < (other.tag_s or 0)
        and other.at_s - history.delay_s(other.at_s) <= event.at_s + ENDED_S
        for other in later
    )


def was_told(event: Told, told: list[Told], slack_s: float) -> bool:
    """As then; as the calendar clock drifts meanwhile, its time tag is another one."""
    return any(
        abs((event.tag_s or 0) - (other.tag_s or 0)) <= slack_s
        and event.good == other.good
        and (event.value == other.value or not event.good)
        for other in told
    )


def events_are_in_order(history: History) -> Iterator[Violation]:
    """Within a connection none comes twice, or after a later one; a new connection may repeat."""
    for point, events in history.events.items():
        latest = events[0]
        for place, (before, event) in enumerate(zip([None, *events[:-1]], events, strict=True), 1):
            if before and is_told_twice(event, before):
                yield Violation("once", event.at_s, f"{point} of {event.tag_s:.3f} s")
            goes_back = (event.tag_s or 0) < (latest.tag_s or 0) and not tells_the_same(event, latest)
            goes_back = goes_back and not is_followed(event, latest, events[place:], history)
            before_it = [] if event.session == latest.session else events[: place - 1]
            if goes_back and not was_told(event, before_it, history.drift_s):
                yield Violation("order", event.at_s, f"{point}: {event} after {latest}")
            latest = max(latest, event, key=lambda told: told.tag_s or 0)


def lifeless_times(events: list[Told]) -> Iterator[tuple[float, float]]:
    """When a point was not good, as its events of one connection have it."""
    since_s = None
    for event in events:
        tag_s = event.tag_s or 0.0
        if not event.good and since_s is None:
            since_s = tag_s
        elif event.good and since_s is not None:
            yield since_s, tag_s
            since_s = None


def interrogations_tell_the_same(history: History) -> Iterator[Violation]:
    """What its events tell as not good, from before to after it, no interrogation tells as good."""
    lifeless: dict[tuple[str, int], list[tuple[float, float]]] = {}
    for point, events in history.events.items():
        for session, of_session in itertools.groupby(events, key=lambda event: event.session):
            lifeless[point, session] = list(lifeless_times(list(of_session)))
    for told in history.told:
        if told.tag_s is not None or not told.good:
            continue
        asked_s = told.at_s - history.delay_s(told.at_s)
        for since_s, until_s in lifeless.get((told.point, told.session), []):
            if since_s < asked_s - SAME_S and told.at_s < until_s - SAME_S:
                text = f"{told.point} is told as {told}, by events not from {since_s:.3f} to {until_s:.3f} s"
                yield Violation("same", told.at_s, text)


def lost_of(history: History, told: set[tuple[str, int | None]]) -> Iterator[Violation]:
    """What a device held for a while, and the line could read, and is not among what was told."""
    for point, held in history.held.items():
        if point.endswith(".10001"):
            continue  # a bit has but two values
        ends = [since for since, _ in held[1:]] + [history.end_s]
        for (since_s, value), until_s in zip(held, ends, strict=True):
            if until_s - since_s < HELD_S or value == 0 or (point, value) in told:
                continue
            if not history.has(point, since_s, since_s + HELD_S):
                continue
            if not could_be_lost(point, since_s, since_s + HELD_S, history):
                text = f"{point} was {value} from {since_s:.3f} to {until_s:.3f} s"
                yield Violation("no event lost", since_s, text)


def no_event_is_lost(history: History) -> Iterator[Violation]:
    yield from lost_of(
        history, {(event.point, event.value) for events in history.events.values() for event in events}
    )


def all_recovers(history: History) -> Iterator[Violation]:
    """Some time after the last fault the centre knows each value, and that it is good."""
    if history.configured[-1][0] > history.end_s:
        yield Violation("recovery", history.end_s, "no configuration is in force as a whole")
    last = {told.point: told for told in history.told}
    for point, held in history.held.items():
        told = last.get(point)
        if not history.has(point, history.end_s - SETTLED_S, history.end_s):
            continue
        if told is None or not told.good or told.value != held[-1][1]:
            seen = "nothing" if told is None else f"{told.value}, {'good' if told.good else 'not good'}"
            text = f"{point} is {held[-1][1]}, the centre knows {seen}"
            yield Violation("recovery", history.end_s, text)


def first_point(device: str) -> str:
    line, unit = map(int, device.split("."))
    return f"{line * 1000 + unit}.30001"


def periods_are_kept(history: History) -> Iterator[Violation]:
    """A device is asked as often as it should be, whatever its neighbours do, and soon after its trouble."""
    samples = history.answers
    devices = samples[0][1] if samples else {}
    least = ANSWERS_LEAST if history.run.world.bits else ANSWERS_LEAST // 2
    for device in devices:
        direct, troubled = direct_times(device, history.faults), troubled_times(device, history.faults)
        dead = history.dead_times(device)
        for (from_s, before), (to_s, after) in zip(samples, samples[WINDOW_S:], strict=False):
            count = after[device] - before[device]
            if not history.has(first_point(device), from_s, to_s):
                continue
            if count >= least or from_s < CHANGES_FROM_S or to_s - from_s < WINDOW_S - 1:
                continue
            may_be_dead = overlaps(troubled, from_s, to_s) and overlaps(dead, from_s, to_s)
            if not may_be_dead and not overlaps(direct, from_s, to_s):
                text = f"device {device} answered {count} requests from {from_s:.3f} to {to_s:.3f} s"
                yield Violation("period", to_s, text)


def silence_is_told(history: History) -> Iterator[Violation]:
    """The points of a device that answers nothing any more are told invalid soon."""
    for fault in history.faults:
        until_s = fault.at_s + INVALID_S
        if fault.kind not in ("silent", "unplugged") or fault.for_s < INVALID_S:
            continue
        others = [other for other in history.faults if other is not fault]
        for point in history.held:
            events = history.events.get(point, [])
            if not history.has(point, fault.at_s, until_s):
                continue
            if not is_trouble_of(device_of(point), fault) or is_disturbed(point, others, fault.at_s, until_s):
                continue
            if not any(not event.good and fault.at_s <= (event.tag_s or 0) <= until_s for event in events):
                yield Violation("silence", until_s, f"{point} is not told invalid")


def nothing_is_bad_without_trouble(history: History) -> Iterator[Violation]:
    """What a device that can be read holds is good, whatever else fails, and whatever time it is."""
    for point, events in history.events.items():
        for event in events:
            if is_no_alarm(history, event):
                yield Violation("good", event.at_s, f"{point} is told as {event}")


def connections_stay(history: History) -> Iterator[Violation]:
    """One ends behind trouble of its ends, or of the link."""
    ended = [
        (fault.at_s, fault.end_s + ENDS_CONNECTION_S.get(fault.kind, 0.0))
        for fault in history.faults
        if fault.of in ENDS_OF_CONNECTION
    ]
    for line in history.run.told(history.master.consumer):
        at_s = seconds(line["at"])
        if line.get("state") == LINK_DOWN and not overlaps(ended, at_s - NEXT_S, at_s):
            yield Violation("connection", at_s, "the centre's connection ends")


def lines_a_minute(run: Run) -> Iterator[tuple[str, int]]:
    """Of each program that writes, but for its first; rtu-centre's lines have no time, and come evenly."""
    counts: Counter[tuple[str, str]] = Counter()
    for line in run.log("gateway"):
        if " " in line:
            counts[line[:MINUTE], line.split(" ", 2)[1]] += 1 - LINES_AT_ONCE * (" listening on " in line)
    yield from ((program, count) for (_, program), count in counts.items())
    yield "rtu-centre", round(len(run.log("centre")) * 60 / run.world.seconds)


def commands_are_executed_once(history: History) -> Iterator[Violation]:
    """At most once, whatever becomes of connections and programs: each has a value of its own."""
    seen: set[int] = set()
    for write in history.writes:
        if write.value in seen:
            yield Violation("command once", write.at_s, f"{write.value} is written again into {write.device}")
        seen.add(write.value)


def is_answered_truly(order: Order, told: list[tuple[float, int, int]], writes: list[Write]) -> bool:
    """Executed is what the device has done before; what was not sent it never does."""
    for at_s, state, result in told:
        written = any(write.at_s <= at_s and write.device == order.device for write in writes)
        if (state == EXECUTED and not written) or (result in NOT_SENT and writes):
            return False
    return True


def is_done_or_not_sent(states: list[tuple[int, int]]) -> bool:
    return bool(states) and (states[-1][0] == EXECUTED or states[-1][1] in NOT_SENT)


def has_to_be_done(history: History, order: Order) -> bool:
    """Neither the device nor the way to it has trouble, nor had it shortly before."""
    until_s = order.at_s + ORDER_S + 4 * history.way_s
    point = f"{order.line * 1000 + order.unit}.{ORDERED}"
    torn = [(fault.at_s, fault.end_s) for fault in history.faults if fault.kind in ("tearing", "step")]
    torn += [(fault.at_s, fault.at_s + NOTICED_S) for fault in history.faults if fault.kind == "closing"]
    if not history.has(point, order.at_s, until_s) or overlaps(torn, order.at_s - AGE_S, until_s):
        return False
    return not is_disturbed(point, list(history.faults), order.at_s, until_s)


def commands_are_answered_truly(history: History) -> Iterator[Violation]:
    """Executed is told of what the device has done, and of all that nothing kept from it."""
    for order in history.run.world.orders:
        told = history.ordered.get(order.value)
        if told is None:
            continue
        writes = [write for write in history.writes if write.value == order.value]
        states = [(state, result) for _, state, result in told]
        what = f"{order.value} to {order.device}: {states}, {len(writes)} writes"
        if not is_answered_truly(order, told, writes):
            yield Violation("command true", order.at_s, what)
        elif not is_done_or_not_sent(states) and has_to_be_done(history, order):
            yield Violation("command done", order.at_s, what)


def values_are_of_the_configuration(history: History) -> Iterator[Violation]:
    """What is not in the one in force is not told as good."""
    for point, events in history.events.items():
        for event in events:
            tag_s = event.tag_s or 0.0
            if event.good and history.has_not(point, tag_s, event.at_s):
                yield Violation("configuration", event.at_s, f"{point} is told as {event}")


def devices_are_of_the_configuration(history: History) -> Iterator[Violation]:
    """Nor is a device asked that is not in it."""
    for (from_s, before), (to_s, after) in itertools.pairwise(history.answers):
        for device in before:
            if after[device] > before[device] and history.has_not(first_point(device), from_s, to_s):
                yield Violation("configuration", to_s, f"device {device} is asked")


def reloads_a_minute(run: Run) -> int:
    """At most. A line process begins by each, and has a line for each of its lines and devices then."""
    told = run.told("reload") if run.world.reloads else []
    times = [seconds(line["at"]) for line in told if line["kind"] == "in force"]
    return max((sum(0 <= other - at_s < 60 for other in times) for at_s in times), default=0)


def no_log_is_flooded(history: History) -> Iterator[Violation]:
    """What goes on happening is counted, and does not fill the log."""
    world = history.run.world
    begun = reloads_a_minute(history.run) * (len(world.lines) + len(world.units))
    for program, count in lines_a_minute(history.run):
        most = [front.lines.get(program, 0) for front in world.fronts]
        if count > max(LINES_A_MINUTE + begun, *most, 0):
            yield Violation("log", history.end_s, f"{program} writes {count} lines in a minute")


def who_cannot_start_says_why(history: History) -> Iterator[Violation]:
    """Each module that begins without memory and ends has a line that says so."""
    begun = any(fault.kind == "kill" and fault.for_s for fault in history.faults)
    log = history.run.log("gateway") if begun else []
    ended = sum("exited with code" in line for line in log)
    said = sum("memory" in line for line in log)
    if said < ended:
        yield Violation("start", history.end_s, f"{ended} modules could not start, {said} said why")


def nothing_grows_without_end(history: History) -> Iterator[Violation]:
    """What a program holds stays what it was some time after its begin, but for its connections."""
    for account in history.run.accounts:
        if not account.process.startswith("rtu"):
            continue
        descriptors = account.most_descriptors - account.first_descriptors
        kib = account.last_kib - account.first_kib
        if descriptors > CONNECTIONS or kib > GROWTH_KIB:
            what = f"{account.process} in its life {account.life} holds {descriptors} descriptors"
            yield Violation("bounded", history.end_s, f"{what} and {kib} KiB more than before")


def nobody_crashes(history: History) -> Iterator[Violation]:
    if history.run.code != 0:
        yield Violation("no crash", history.end_s, history.run.said)


OF_THE_PLANT = (
    nobody_crashes,
    nothing_grows_without_end,
    who_cannot_start_says_why,
    periods_are_kept,
    no_log_is_flooded,
    devices_are_of_the_configuration,
    commands_are_executed_once,
    commands_are_answered_truly,
)
OF_A_MASTER = (
    values_are_true,
    events_are_in_order,
    interrogations_tell_the_same,
    no_event_is_lost,
    silence_is_told,
    nothing_is_bad_without_trouble,
    connections_stay,
    values_are_of_the_configuration,
    all_recovers,
)
assert SETTLED_S < RECOVERY_S


def judge_master(history: History) -> Iterator[Violation]:
    """What must hold for each that is told."""
    for rule in OF_A_MASTER:
        found = list(rule(history))
        for front in history.run.world.fronts:
            found = front.excuses(history, found)
        yield from found


def judge(run: Run) -> list[Violation]:
    """In the order of time."""
    history = History(run)
    found = [one for rule in OF_THE_PLANT for one in rule(history)]
    found += judge_master(history)
    found += [one for front in run.world.fronts for one in front.judge(history)]
    return sorted(found, key=lambda one: one.at_s)
