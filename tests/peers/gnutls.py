# SPDX-License-Identifier: GPL-3.0-or-later
"""GnuTLS as the TLS of a controlling station, by its C library: it shares nothing with OpenSSL."""

from __future__ import annotations

import ctypes
import socket
import struct
from ctypes import byref, c_char_p, c_int, c_size_t, c_ssize_t, c_uint, c_void_p
from types import TracebackType
from typing import Self

from peers.authority import Identity

WAITS_S = 10

# gnutls/gnutls.h of 3.7
CLIENT, CERTIFICATE, PEM, SHUT_WR, PEER_TOO = 1 << 1, 1, 1, 1, 1
AGAIN, INTERRUPTED = -28, -52


class GnuTlsError(Exception):
    """What GnuTLS says."""


def library() -> ctypes.CDLL:
    found = ctypes.CDLL("libgnutls.so.30")
    found.gnutls_strerror.restype = found.gnutls_check_version.restype = c_char_p
    found.gnutls_protocol_get_name.restype = c_char_p
    found.gnutls_record_send.restype = found.gnutls_record_recv.restype = c_ssize_t
    found.gnutls_record_send.argtypes = found.gnutls_record_recv.argtypes = (c_void_p, c_char_p, c_size_t)
    found.gnutls_record_check_pending.restype = c_size_t
    return found


class GnuTls:
    """A session on a connected socket, greeted. Its socket blocks, up to WAITS_S."""

    def __init__(
        self,
        plain: socket.socket,
        ca: str,
        identity: Identity | None,
        priority: str,
        former: bytes | None = None,
    ) -> None:
        self.plain = plain
        plain.setblocking(True)
        for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
            plain.setsockopt(socket.SOL_SOCKET, option, struct.pack("@ll", WAITS_S, 0))
        self._lib = library()
        self._session, self._credentials = c_void_p(), c_void_p()
        self._check(self._lib.gnutls_certificate_allocate_credentials(byref(self._credentials)))
        trusted = self._lib.gnutls_certificate_set_x509_trust_file(self._credentials, ca.encode(), PEM)
        assert trusted == 1
        if identity:
            files = (str(identity.certificate).encode(), str(identity.key).encode())
            self._check(self._lib.gnutls_certificate_set_x509_key_file(self._credentials, *files, PEM))
        self._check(self._lib.gnutls_init(byref(self._session), c_uint(CLIENT)))
        self._check(self._lib.gnutls_priority_set_direct(self._session, priority.encode(), None))
        self._check(self._lib.gnutls_credentials_set(self._session, CERTIFICATE, self._credentials))
        self._lib.gnutls_session_set_verify_cert(self._session, None, c_uint(0))
        if former:
            self._check(self._lib.gnutls_session_set_data(self._session, former, c_size_t(len(former))))
        self._lib.gnutls_transport_set_int2(self._session, plain.fileno(), plain.fileno())
        self._again(self._lib.gnutls_handshake)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lib.gnutls_bye(self._session, SHUT_WR)
        self._lib.gnutls_deinit(self._session)
        self._lib.gnutls_certificate_free_credentials(self._credentials)
        self.plain.close()

    def send(self, octets: bytes) -> None:
        sent = 0
        while sent < len(octets):
            sent += self._check(
                self._lib.gnutls_record_send(self._session, octets[sent:], len(octets) - sent)
            )

    def recv(self, count: int = 65536) -> bytes | None:
        """What came; empty: the station has closed in order; None: a record that is not for us."""
        place = ctypes.create_string_buffer(count)
        got = self._lib.gnutls_record_recv(self._session, place, count)
        return None if got in (AGAIN, INTERRUPTED) else place.raw[: self._check(got)]

    def receive(self, count: int) -> bytes:
        """So many octets."""
        octets = b""
        while len(octets) < count:
            came = self.recv(count - len(octets))
            assert came != b"", "closed by the station"
            octets += came or b""
        return octets

    @property
    def pending(self) -> bool:
        """Octets wait that the socket does not have any more."""
        return bool(self._lib.gnutls_record_check_pending(self._session))

    @property
    def version(self) -> str:
        return str(
            self._lib.gnutls_protocol_get_name(self._lib.gnutls_protocol_get_version(self._session)).decode()
        )

    @property
    def is_resumed(self) -> bool:
        return bool(self._lib.gnutls_session_is_resumed(self._session))

    def session(self) -> bytes:
        """What it can be resumed with; of TLS 1.3 only when its ticket has come."""
        size = c_size_t(0)
        self._lib.gnutls_session_get_data(self._session, None, byref(size))
        place = ctypes.create_string_buffer(size.value)
        self._check(self._lib.gnutls_session_get_data(self._session, place, byref(size)))
        return place.raw[: size.value]

    def renew_keys(self) -> None:
        """TLS 1.3: its own, and it asks for the station's."""
        self._again(lambda session: self._lib.gnutls_session_key_update(session, PEER_TOO))

    def _again(self, call: object) -> None:
        while (result := call(self._session)) in (AGAIN, INTERRUPTED):  # type: ignore[operator]
            pass
        self._check(result)

    def _check(self, result: int) -> int:
        if result < 0:
            raise GnuTlsError(self._lib.gnutls_strerror(c_int(result)).decode())
        return result
