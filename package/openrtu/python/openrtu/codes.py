# SPDX-License-Identifier: GPL-3.0-or-later
"""The numbers of a module: qualities, states and results of commands, levels of the log.

Made by `make codes` from the headers of C; do not edit.
"""

from enum import IntEnum, IntFlag


class Quality(IntFlag):
    """What is wrong with a value; the bits of IEC 60870-5-101, 7.2.6.3. 0 is good."""

    GOOD = 0x00
    OVERFLOW = 0x01
    BLOCKED = 0x10
    SUBSTITUTED = 0x20
    NOT_TOPICAL = 0x40
    INVALID = 0x80


class Level(IntEnum):
    """How bad a line of the log is."""

    ERROR = 0
    WARNING = 1
    INFO = 2
    DEBUG = 3


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
    """Why a command is in its state."""

    NONE = 0
    DONE = 1  # while executing: the device has confirmed it, and it goes on
    EXCEPTION = 2  # the device refused
    TIMEOUT = 3  # the device did not answer: it may or may not have acted
    TOO_OLD = 4  # not begun in time
    NOT_SELECTED = 5  # it needs a selection
    INTERLOCK = 6  # another has the point, or its owner refuses it
    OUT_OF_RANGE = 7  # the point cannot hold this value
    NOT_COMMANDABLE = 8  # or its owner does not run
    UNKNOWN_FATE = 9  # the owner died: it may or may not have acted
    NO_SCALE = 10  # the device's scale is not known
    SENT = 11  # to all, of whom none answers: a broadcast
