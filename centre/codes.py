# SPDX-License-Identifier: GPL-3.0-or-later
"""The numbers of what rtu-centre says and is asked: docs/centre.md.

Made by `make codes` from the headers of C; do not edit.
"""

from enum import IntEnum

# Flags of a record.
LAST = 0x01
TEST = 0x02
TAGGED = 0x04
TIME_INVALID = 0x08
NEGATIVE = 0x10
SENT = 0x20
GAP = 0x40

# Flags of a command.
SELECT = 0x01
WITH_TIME = 0x02

# What is wrong with a value: bits.
INVALID = 0x80
NOT_TOPICAL = 0x40
SUBSTITUTED = 0x20
BLOCKED = 0x10
OVERFLOW = 0x01

# As IEC 60870-5-101, 7.2.6.3 has them.
LETTERS = {
    OVERFLOW: "OV",
    BLOCKED: "BL",
    SUBSTITUTED: "SB",
    NOT_TOPICAL: "NT",
    INVALID: "IV",
}


class Kind(IntEnum):
    """Of a record."""

    STATION = 1
    LINK = 2
    INFORMATION = 3
    POSITION = 4
    PROGRESS = 5
    OTHER = 6
    OCTETS = 7


class Link(IntEnum):
    """Of a station."""

    WAITING = 0
    CONNECTING = 1
    STARTING = 2
    UP = 3
    DOWN = 4
    STANDBY = 5
    SECURING = 6


class State(IntEnum):
    """The ten states of a command."""

    INACTIVE = 0
    SELECTION_REQUEST = 1
    ACCEPTED_SELECTION = 2
    REFUSED_SELECTION = 3
    INTERRUPTION_REQUEST = 4
    INTERRUPTED_SELECTION = 5
    EXECUTION_REQUEST = 6
    EXECUTING = 7
    REFUSED_COMMAND = 8
    EXECUTED_COMMAND = 9


class Result(IntEnum):
    """Why a command has its state."""

    NONE = 0
    DONE = 1
    EXCEPTION = 2
    TIMEOUT = 3
    TOO_OLD = 4
    NOT_SELECTED = 5
    INTERLOCK = 6
    OUT_OF_RANGE = 7
    NOT_COMMANDABLE = 8
    UNKNOWN_FATE = 9
    NO_SCALE = 10
    SENT = 11
    NOT_UP = 64
    BUSY = 65
    NOT_KNOWN = 66


class Ask(IntEnum):
    """What rtu-centre is asked."""

    ACKNOWLEDGE = 1
    COMMAND = 2
    EXECUTE = 3
    CANCEL = 4
    INTERROGATE = 5
    COUNTERS = 6
    READ = 7
    SET_CLOCK = 8
    TEST_COMMAND = 9
    RESET = 10
    TRACE = 11


class Content(IntEnum):
    """Of an object, or a place."""

    SINGLE = 0
    DOUBLE = 1
    STEP = 2
    BITS = 3
    NORMALIZED = 4
    SCALED = 5
    FLOAT = 6
    TOTAL = 7
    PROTECTION_EVENT = 8
    PROTECTION_START = 9
    PROTECTION_OUTPUT = 10
    PACKED_SINGLES = 11
    INITIALISATION = 12
    POSITION = 100


class Cause(IntEnum):
    """Of transmission."""

    CYCLIC = 1
    BACKGROUND = 2
    SPONTANEOUS = 3
    INITIALISED = 4
    REQUEST = 5
    ACTIVATION = 6
    ACTIVATION_CON = 7
    DEACTIVATION = 8
    DEACTIVATION_CON = 9
    ACTIVATION_TERM = 10
    RETURN_REMOTE = 11
    RETURN_LOCAL = 12
    INTERROGATED = 20
    COUNTERS_REQUESTED = 37
    UNKNOWN_TYPE = 44
    UNKNOWN_CAUSE = 45
    UNKNOWN_CA = 46
    UNKNOWN_IOA = 47
