# SPDX-License-Identifier: GPL-3.0-or-later
"""How a process takes its turns on a busy machine: seldom and long, or often and short."""

from __future__ import annotations

import ctypes
import os
import platform
import struct

SHORT_NS = 100_000  # the shortest that Linux gives
# sched_setattr(2), which the C library of Debian 12 does not have.
SYSTEM_CALLS = {"x86_64": 314, "aarch64": 274}
SCHED_ATTR = struct.Struct(
    "=IIQiIQQQ"
)  # of version 0: size, policy, flags, nice, priority, runtime, deadline, period
SCHED_OTHER = 0


def take_short_turns() -> None:
    """Asks Linux for short turns of this process and all that it starts; its share and its niceness stay.

    The programs of a show wait for each other some thousand times a second. Beside busy processes each wait
    lasts a turn of theirs, unless the one that is woken asks for less time than they do. Linux has this since
    6.12 (sched_runtime of SCHED_OTHER); before, and on other processors, nothing changes.
    """
    number = SYSTEM_CALLS.get(platform.machine())
    if number is not None and os.sched_getscheduler(0) == SCHED_OTHER:
        nice = os.getpriority(os.PRIO_PROCESS, 0)
        attributes = SCHED_ATTR.pack(SCHED_ATTR.size, SCHED_OTHER, 0, nice, 0, SHORT_NS, 0, 0)
        ctypes.CDLL(None).syscall(number, 0, attributes, 0)
