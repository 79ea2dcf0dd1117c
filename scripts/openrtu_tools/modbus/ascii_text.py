# SPDX-License-Identifier: GPL-3.0-or-later
"""Modbus ASCII (MODBUS over Serial Line V1.02, 2.5.2): what an RTU line would carry, as text."""

from __future__ import annotations

import time

from openrtu_tools.modbus import frames
from openrtu_tools.modbus.links import Stream
from openrtu_tools.modbus.serial_port import Settings

BEGIN, END = b":", b"\r\n"
CRC = 2
PAUSE_S = 1.0  # between two characters of a frame, at most
TEXT_MOST = 2 * 256 + 3  # without a begin and an end for as long, it is noise


def lrc(body: bytes) -> bytes:
    return bytes([-sum(body) & 0xFF])


def encoded(frame: bytes) -> bytes:
    """Of a frame with its CRC."""
    body = frame[:-CRC]
    return BEGIN + (body + lrc(body)).hex().upper().encode() + END


def decoded(text: bytes) -> bytes:
    """What stood between begin and end, with a CRC that is as right as the LRC was."""
    try:
        octets = bytes.fromhex(text.decode("ascii"))
    except ValueError:  # no digits: nobody's frame
        return text
    body, sound = octets[:-1], octets[-1:] == lrc(octets[:-1])
    crc = frames.crc(body)
    return body + (crc if sound else bytes(octet ^ 0xFF for octet in crc))


class AsciiStream(Stream):
    """Takes RTU frames and gives them, over a stream of text."""

    characters = 2
    check = "LRC"

    def __init__(self, text: Stream) -> None:
        self.name = text.name
        self.text = text
        self._octets = b""

    def configure(self, settings: Settings) -> None:
        self._octets = b""
        self.text.configure(settings)

    def close(self) -> None:
        self.text.close()

    def _send(self, octets: bytes) -> None:
        self._octets = b""
        self.text.send(encoded(octets))

    def _receive(self, seconds: float) -> bytes:
        """Of a whole frame, or of what will be none."""
        end = time.monotonic() + seconds
        while True:
            begin, frame_end = self._octets.rfind(BEGIN), self._octets.find(END)
            if frame_end >= 0:
                text, self._octets = self._octets[:frame_end], self._octets[frame_end + len(END) :]
                return decoded(text.rpartition(BEGIN)[2])
            if len(self._octets) - max(begin, 0) > TEXT_MOST:
                noise, self._octets = self._octets, b""
                return noise
            more = self.text.receive(end - time.monotonic())
            if not more:
                noise, self._octets = self._octets, b""
                return noise
            self._octets += more
            end = time.monotonic() + max(seconds, PAUSE_S)

    def _trace(self, direction: str, octets: bytes) -> None:
        """The text is, not this."""
