# SPDX-License-Identifier: GPL-3.0-or-later
"""When what should hold need not: what trouble a fault makes for whom, and for how long."""

from __future__ import annotations

import math

from plant_history import CALL_WITHIN_S, CENTRE, History, Told
from plant_world import JOURNAL, MODBUS_PORT, NETWORKED, PORT, Fault

AGE_S = 3.0
AFTER_S = 15.0  # what is behind a fault may still be its consequence
RAREST_S = 65.0  # the longest pause before a probe, and the probe (docs/limit.md)
PROBED_S = 5.0  # a device that lived for long before is probed so soon after it was dead for as long again
DOUBTED_S = 5.0  # the first pause that a device seems to need (docs/limit.md)
LOST_S = 45.0  # until each side of a connection that is lost knows it: t3, t1, and a new one
JOURNAL_S = 90.0  # what waits in a gateway without a journal, and is lost with rtud
RECORDED_S = 5.0  # until an event is in the journal: it is read, waits for the next record, and is written
READERS = ("rtud", "rtu-modbus-1")
DISK = ("full", "refuses", "worn")
LOST = ("lost", "power")  # in silence
BEGINS_ANEW = ("kill", "stop", "hung", "cut", "lost")  # a process, or a connection


def is_trouble_of(device: str, fault: Fault) -> bool:
    """It may keep the device from being read. What comes late falls into what others say on the line."""
    line = device.split(".")[0]
    if fault.kind in ("reload", "closing", "tearing", "idling", "memory", *DISK):
        return False
    if fault.kind in ("cut", "lost", "power"):
        return (line, fault.of) == (f"{NETWORKED}", f"{MODBUS_PORT}")
    if fault.kind == "late":
        return fault.of.split(".")[0] == line
    return fault.of in ("rtu-modbus-1", "rtud", "linesim", device, line)


def doubted_s(fault: Fault) -> float:
    """Until none is tried in the place of a pause that it needed: after 5 s, and twice as long each time."""
    return fault.for_s + DOUBTED_S if fault.kind == "deaf" else 0.0


def is_read_again_s(fault: Fault, troubles: list[Fault]) -> float:
    """From when on a device must be read as ever, by what docs/limit.md says of its probes."""
    lived = not any(fault.at_s - RAREST_S < other.end_s and other.at_s < fault.at_s for other in troubles)
    begins_later_s = AFTER_S if fault.kind in BEGINS_ANEW else 0.0
    probed_s = max(AFTER_S, fault.for_s + PROBED_S) if lived else RAREST_S
    return fault.end_s + doubted_s(fault) + begins_later_s + probed_s


def troubled_times(device: str, faults: tuple[Fault, ...]) -> list[tuple[float, float]]:
    """When the device may not be read as it should."""
    troubles = [fault for fault in faults if is_trouble_of(device, fault)]
    return [(fault.at_s, is_read_again_s(fault, troubles)) for fault in troubles]


def overlaps(times: list[tuple[float, float]], from_s: float, to_s: float) -> bool:
    return any(begin_s < to_s and from_s < end_s for begin_s, end_s in times)


def direct_times(device: str, faults: tuple[Fault, ...]) -> list[tuple[float, float]]:
    """When a device that answers may be read too seldom."""
    return [
        (fault.at_s, fault.end_s + doubted_s(fault) + (AFTER_S if fault.kind in BEGINS_ANEW else PROBED_S))
        for fault in faults
        if is_trouble_of(device, fault)
    ]


def device_of(point: str) -> str:
    ca = int(point.split(".")[0])
    return f"{ca // 1000}.{ca % 1000}"


def unwritten_from_s(history: History, end: Fault) -> float:
    """From when on the journal need not have what happens, if that ends it; all, if it is not read again."""
    from_s = end.at_s - RECORDED_S
    for fault in sorted(history.faults, key=lambda fault: fault.at_s, reverse=True):
        near = fault.at_s < end.at_s + CALL_WITHIN_S + AFTER_S and fault.end_s + RECORDED_S > from_s
        if fault.kind == "worn" and near:
            return -math.inf
        if fault.kind in ("full", "refuses") and near:
            from_s = min(from_s, fault.at_s - RECORDED_S)
    return from_s


def unread_times(device: str, faults: tuple[Fault, ...]) -> list[tuple[float, float]]:
    """When it may not be read. With its process it is not dead: that reads it as soon as it is back."""
    own = tuple(fault for fault in faults if fault.of not in READERS)
    behind_s = CALL_WITHIN_S + AFTER_S
    readers = [(fault.at_s, fault.end_s + behind_s) for fault in faults if fault.of in READERS]
    return [*troubled_times(device, own), *readers]


def has_journal(history: History, end: Fault) -> bool:
    """One that nothing had kept from its work before the gateway's end."""
    if not any(JOURNAL in front.processes for front in history.run.world.fronts):
        return False
    kept_up = [(fault.at_s, fault.end_s + AFTER_S) for fault in history.faults if fault.of == JOURNAL]
    return not overlaps(kept_up, end.at_s - AFTER_S, end.at_s)


def goes_with_the_gateway(history: History, since_s: float) -> bool:
    """What came then may have waited in it, as it ended."""
    for fault in history.faults:
        if (fault.kind, fault.of) != ("kill", "rtud"):
            continue
        journal = has_journal(history, fault)
        unwritten_s = unwritten_from_s(history, fault) if journal else -math.inf
        from_s = unwritten_s if math.isfinite(unwritten_s) else fault.at_s - JOURNAL_S
        if from_s < since_s < fault.at_s + (CALL_WITHIN_S + AFTER_S if journal else JOURNAL_S):
            return True
    return False


def could_be_lost(point: str, since_s: float, until_s: float, history: History) -> bool:
    """The line was not read meanwhile, or the gateway went with what waited in it."""
    troubled = unread_times(device_of(point), history.faults)
    return overlaps(troubled, since_s, until_s) or goes_with_the_gateway(history, since_s)


def is_disturbed(point: str, others: list[Fault], from_s: float, to_s: float) -> bool:
    """Something else has to do with the point, or with its way to the centre."""
    device = device_of(point)
    if overlaps(troubled_times(device, tuple(others)), from_s, to_s):
        return True
    on_its_way = [other for other in others if other.of in ("rtu-iec104", CENTRE, f"{PORT}")]
    times = [(other.at_s, other.end_s + (LOST_S if other.kind in LOST else AFTER_S)) for other in on_its_way]
    return overlaps(times, from_s, to_s)


def is_no_alarm(history: History, event: Told) -> bool:
    """Neither its device, nor its line, nor the process that reads it had trouble."""
    tag_s = event.tag_s or 0.0
    times = troubled_times(device_of(event.point), history.faults)
    there = history.has(event.point, tag_s, tag_s + AGE_S)
    return there and not event.good and not overlaps(times, tag_s - AGE_S, tag_s + AGE_S)
