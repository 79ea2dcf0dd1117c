# SPDX-License-Identifier: GPL-3.0-or-later
"""The server of uModbus, in threads of its own."""

import contextlib
import socket
import threading
from collections.abc import Sequence
from socketserver import ThreadingTCPServer
from typing import Any

from umodbus import conf
from umodbus.server.tcp import RequestHandler, get_server

from peers.device import FIRST_ADDRESS, LAST_ADDRESS, UNIT, Device

ADDRESSES = range(FIRST_ADDRESS, LAST_ADDRESS + 1)
READ_BY = {1: "coils", 2: "discrete_inputs", 3: "holding_registers", 4: "input_registers"}
WRITTEN_BY = {5: "coils", 15: "coils", 6: "holding_registers", 16: "holding_registers"}


class _Server(ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = True
    block_on_close = False


class UmodbusDevice(Device):
    def start(self) -> None:
        conf.SIGNED_VALUES = False
        self._tables = {table: [0] * (LAST_ADDRESS + 1) for table in READ_BY.values()}
        self._answering = threading.Lock()
        self._connections: list[socket.socket] = []
        self._server = get_server(_Server, ("127.0.0.1", self.place), self._handler())
        for function, table in READ_BY.items():
            self._server.route([UNIT], [function], ADDRESSES)(self._reads(table))
        for function, table in WRITTEN_BY.items():
            self._server.route([UNIT], [function], ADDRESSES)(self._writes(table))
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()
        for connection in self._connections:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def get(self, table: str, address: int, count: int) -> list[int]:
        with self._answering:
            return self._tables[table][address : address + count]

    def set(self, table: str, address: int, values: Sequence[int]) -> None:
        with self._answering:
            self._tables[table][address : address + len(values)] = values

    def _handler(self) -> type[RequestHandler]:
        device = self

        class Handler(RequestHandler):  # type: ignore[misc]
            def setup(self) -> None:
                device._connections.append(self.request)

            def process(self, request: bytes) -> Any:
                device.requests.append(bytes(self.get_request_pdu(request)))
                with device._answering:
                    return super().process(request)

        return Handler

    def _reads(self, table: str) -> Any:
        def read(slave_id: int, function_code: int, address: int) -> int:
            return self._tables[table][address]

        return read

    def _writes(self, table: str) -> Any:
        def write(slave_id: int, function_code: int, address: int, value: int) -> None:
            self._tables[table][address] = int(value)

        return write
