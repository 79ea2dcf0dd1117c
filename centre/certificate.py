# SPDX-License-Identifier: GPL-3.0-or-later
"""The certificate of the centre for browsers, which may change while it serves."""

from __future__ import annotations

import asyncio
import logging
import ssl
import stat
from pathlib import Path

from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.settings import Tls

log = logging.getLogger("centre")

LOOK_S = 5.0


def tls_context(tls: Tls) -> ssl.SSLContext:
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    _check_key(tls.key)
    try:
        context.load_cert_chain(tls.certificate, tls.key)
    except OSError as error:  # ssl.SSLError is one
        raise CentreError(
            f"tls: {tls.certificate} and {tls.key}: {error}; are they there, readable, in PEM and a pair?"
        ) from error
    return context


def _check_key(key: Path) -> None:
    """A group may read it, as Debian's ssl-cert; as the gateway has it."""
    try:
        mode = key.stat().st_mode
    except OSError:
        return  # loading it says why
    if mode & stat.S_IRWXO:
        raise CentreError(f"tls: {key}: others may read it, who then are this centre: chmod o= {key}")


def _stamps(tls: Tls) -> list[tuple[int, ...]]:
    """Of both files; of one that is not there, nothing."""
    found: list[tuple[int, ...]] = []
    for path in (tls.certificate, tls.key):
        try:
            status = path.stat()
        except OSError:
            found.append(())
        else:
            found.append((status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns))
    return found


async def renew(tls: Tls, context: ssl.SSLContext) -> None:
    """Takes another pair for connections that come, for ever. One that does not do is not taken."""
    known = _stamps(tls)
    while True:
        await asyncio.sleep(LOOK_S)
        now = _stamps(tls)
        if now == known:
            continue
        known = now
        try:
            tls_context(tls)  # to try them: what a context has taken by half it does not give back
            context.load_cert_chain(tls.certificate, tls.key)
        except (CentreError, OSError) as error:
            log.error("not in force: %s", error)
        else:
            log.info("the certificate has changed and is in force")
