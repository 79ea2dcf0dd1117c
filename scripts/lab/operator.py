# SPDX-License-Identifier: GPL-3.0-or-later
"""
libiec61850's client commands: port, data object, value, then what to do: browse, report, select, operate,
cancel.
Prints the control model, what became of each, the termination and what was reported, as JSON.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pyiec61850 import pyiec61850 as lib

from lab.errors import LabError
from lab.libiec61850 import check, connected, texts_of
from lab.patience import Deadline, slowness

ANSWER_S = 10.0
WHOLE_S = 120.0


class OperatorError(LabError):
    """The client has not come so far as to ask."""


class Termination(lib.CommandTermHandler):  # type: ignore[misc]
    """Takes CommandTermination, in a thread of libiec61850's."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[dict[str, int]] = []
        self.control: Any = None

    def trigger(self) -> None:
        last = lib.ControlObjectClient_getLastApplError(self.control)
        self.seen.append({"error": last.error, "cause": last.addCause})


class Reported(lib.RCBHandler):  # type: ignore[misc]
    """Takes reports, in a thread of libiec61850's: which members of the data set changed, by index."""

    def __init__(self, members: int) -> None:
        super().__init__()
        self.members = members
        self.seen: list[int] = []

    def trigger(self) -> None:
        reasons = [
            lib.ClientReport_getReasonForInclusion(self._client_report, at) for at in range(self.members)
        ]
        changed = lib.IEC61850_REASON_DATA_CHANGE
        self.seen += [at for at, reason in enumerate(reasons) if reason == changed]


class Reports:
    """Of a device: what changes under ST, from now on, through its block urcbStatus01."""

    def __init__(self, connection: Any, device: str) -> None:
        listed, error = lib.IedConnection_getDataSetDirectory(connection, f"{device}/LLN0.status", None)
        check(error, "data set")
        self.members = texts_of(listed)
        reference = f"{device}/LLN0.RP.urcbStatus01"
        block = lib.ClientReportControlBlock_create(reference)
        _, error = lib.IedConnection_getRCBValues(connection, reference, block)
        check(error, reference)
        self.handler, self.subscriber = Reported(len(self.members)), lib.RCBSubscriber()
        self.subscriber.setIedConnection(connection)
        self.subscriber.setRcbReference(reference)
        self.subscriber.setRcbRptId(lib.ClientReportControlBlock_getRptId(block))
        self.subscriber.setEventHandler(self.handler.__disown__())
        self.subscriber.subscribe()
        lib.ClientReportControlBlock_setTrgOps(block, lib.TRG_OPT_DATA_CHANGED)
        lib.ClientReportControlBlock_setOptFlds(block, lib.RPT_OPT_REASON_FOR_INCLUSION)
        lib.ClientReportControlBlock_setRptEna(block, True)
        written = lib.RCB_ELEMENT_TRG_OPS | lib.RCB_ELEMENT_OPT_FLDS | lib.RCB_ELEMENT_RPT_ENA
        _, error = lib.IedConnection_setRCBValues(connection, block, written, True)
        check(error, reference)

    def changed(self) -> list[str]:
        return [self.members[at] for at in self.handler.seen]


def browsed(connection: Any) -> dict[str, int]:
    """The logical devices, and how many logical nodes each has."""
    listed, error = lib.IedConnection_getLogicalDeviceList(connection)
    check(error, "logical devices")
    found = {}
    for device in texts_of(listed):
        nodes, error = lib.IedConnection_getLogicalDeviceDirectory(connection, device)
        check(error, device)
        found[device] = len(texts_of(nodes))
    return found


def value_of(text: str, kind: int) -> Any:
    if kind == lib.MMS_BOOLEAN:
        return lib.MmsValue_newBoolean(text == "true")
    if kind == lib.MMS_INTEGER:
        return lib.MmsValue_newIntegerFromInt32(int(text))
    structure = lib.MmsValue_createEmptyStructure(1)
    lib.MmsValue_setElement(structure, 0, lib.MmsValue_newFloat(float(text)))
    return structure


def outcome(control: Any, done: bool) -> dict[str, Any]:
    last = lib.ControlObjectClient_getLastApplError(control)
    return {"done": bool(done), "error": last.error, "cause": last.addCause}


def act(control: Any, action: str, value: Any) -> bool:
    if action == "operate":
        return bool(lib.ControlObjectClient_operate(control, value, 0))
    if action == "cancel":
        return bool(lib.ControlObjectClient_cancel(control))
    if lib.ControlObjectClient_getControlModel(control) == lib.CONTROL_MODEL_SBO_ENHANCED:
        return bool(lib.ControlObjectClient_selectWithValue(control, value))
    return bool(lib.ControlObjectClient_select(control))


def operate(port: int, reference: str, value: str, *actions: str) -> dict[str, Any]:
    """What a process of this file prints."""
    command = [sys.executable, "-m", "lab.operator", str(port), reference, value, *actions]
    paths = os.environ | {"PYTHONPATH": str(Path(__file__).resolve().parents[1])}
    patience_s = WHOLE_S * slowness()
    run = subprocess.run(command, env=paths, capture_output=True, text=True, timeout=patience_s, check=False)
    if run.returncode != 0:
        raise OperatorError(f"libiec61850's client: {run.stderr.strip() or run.stdout.strip()}")
    outcomes: dict[str, Any] = json.loads(run.stdout)
    return outcomes


def wait(condition: Callable[[], bool]) -> None:
    """Until it is so, or has not become so in time: what was seen tells."""
    deadline = Deadline(ANSWER_S)
    while not condition() and not deadline.over:
        time.sleep(0.01)


def main() -> None:
    port, reference, text, *actions = sys.argv[1:]
    connection = connected(int(port))
    control = lib.ControlObjectClient_create(reference, connection)
    lib.ControlObjectClient_setOrigin(control, "tests", 2)
    model = lib.ControlObjectClient_getControlModel(control)
    handler, subscriber = Termination(), lib.CommandTermSubscriber()
    handler.control = control
    subscriber.setLibiec61850ControlObjectClient(control)
    subscriber.setEventHandler(handler.__disown__())
    subscriber.subscribe()
    value = value_of(text, lib.ControlObjectClient_getCtlValType(control))
    outcomes: dict[str, Any] = {"model": model}
    reports = None
    for action in actions:
        if action == "browse":
            outcomes[action] = browsed(connection)
        elif action == "report":
            reports = Reports(connection, reference.partition("/")[0])
        else:
            outcomes[action] = outcome(control, act(control, action, value))
    if outcomes.get("operate", {}).get("done"):
        if model in (lib.CONTROL_MODEL_DIRECT_ENHANCED, lib.CONTROL_MODEL_SBO_ENHANCED):
            wait(lambda: bool(handler.seen))
        if reports:
            wait(lambda: bool(reports.changed()))
            outcomes["report"] = reports.changed()
    print(json.dumps(outcomes | {"terminations": handler.seen}), flush=True)
    lib.IedConnection_close(connection)


if __name__ == "__main__":
    main()
