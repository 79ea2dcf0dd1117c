# SPDX-License-Identifier: GPL-3.0-or-later
"""A serial line without a wire: two pseudo-terminals, and a thread that carries the bytes across."""

import contextlib
import os
import select
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

READ_SIZE = 4096


def _carry(a: int, b: int, stop: int) -> None:
    while True:
        ready, _, _ = select.select([a, b, stop], [], [])
        if stop in ready:
            return
        for end in ready:
            os.write(b if end == a else a, os.read(end, READ_SIZE))


def _pty(link: Path, stack: contextlib.ExitStack) -> int:
    """Its master. The slave stays open: a master whose slave nobody has open reads EIO."""
    master, slave = os.openpty()
    stack.callback(os.close, master)
    stack.callback(os.close, slave)
    tty.setraw(slave)
    device = Path(os.ttyname(slave))
    device.chmod(0o666)
    link.symlink_to(device)
    stack.callback(link.unlink)
    return master


@contextlib.contextmanager
def line(one_end: Path, other_end: Path) -> Iterator[None]:
    """Makes both ends, as links to serial devices that everybody may open."""
    with contextlib.ExitStack() as stack:
        masters = _pty(one_end, stack), _pty(other_end, stack)
        stop, stopper = os.pipe()
        stack.callback(os.close, stop)
        carrier = threading.Thread(target=_carry, args=(*masters, stop))
        carrier.start()
        stack.callback(carrier.join)
        stack.callback(os.close, stopper)
        yield
