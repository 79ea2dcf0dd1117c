# SPDX-License-Identifier: GPL-3.0-or-later
"""Ports for servers of the tests."""

import socket


def free_port() -> int:
    """A UDP port that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]
