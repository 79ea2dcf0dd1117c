# SPDX-License-Identifier: GPL-3.0-or-later
"""libiec61850's client takes the reports of a device: port, logical device.

Prints "ready", then the members of the data set that have changed, as JSON; ends with its input.
"""

import json
import sys
import time
from typing import Any

from pyiec61850 import pyiec61850 as lib

from lab.libiec61850 import check, close, connected, texts_of
from lab.patience import Deadline

SEEN_S = 60.0  # for a hang only
REST_S = 0.01  # the lock is free meanwhile


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


def main() -> None:
    port, device = sys.argv[1:]
    connection = connected(int(port))
    reports = Reports(connection, device)
    print("ready", flush=True)
    deadline = Deadline(SEEN_S)
    while not reports.changed() and not deadline.over:
        time.sleep(REST_S)
    print(json.dumps(reports.changed()), flush=True)
    sys.stdin.read()
    close(connection)


if __name__ == "__main__":
    main()
