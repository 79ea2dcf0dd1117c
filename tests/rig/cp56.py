# SPDX-License-Identifier: GPL-3.0-or-later
"""A time as IEC 60870-5 sends it."""

import datetime


def cp56(when: datetime.datetime) -> bytes:
    """CP56Time2a (IEC 60870-5-101, 7.2.6.18), day of week not used."""
    milliseconds = when.second * 1000 + when.microsecond // 1000
    date = (when.minute, when.hour, when.day, when.month, when.year % 100)
    return milliseconds.to_bytes(2, "little") + bytes(date)
