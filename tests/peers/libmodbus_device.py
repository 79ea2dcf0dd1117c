# SPDX-License-Identifier: GPL-3.0-or-later
"""The server of libmodbus, in a thread of its own."""

import ctypes
import errno
import os
import select
import threading
from collections.abc import Sequence
from ctypes import POINTER, c_char, c_char_p, c_int, c_uint, c_uint8, c_uint16, c_uint32, c_void_p
from pathlib import Path
from typing import Any

from peers.device import BAUD_RATE, FIRST_ADDRESS, TABLE_SIZE, UNIT, Device

ADU_MAX = 260
CRC_SIZE = 2
MBAP_SIZE = 7  # its unit included
STOP_LOOK_US = 20_000  # how often a server that hears nothing looks whether it shall stop


class _Mapping(ctypes.Structure):
    """modbus_mapping_t of modbus.h."""

    _fields_ = (
        ("nb_bits", c_int),
        ("start_bits", c_int),
        ("nb_input_bits", c_int),
        ("start_input_bits", c_int),
        ("nb_input_registers", c_int),
        ("start_input_registers", c_int),
        ("nb_registers", c_int),
        ("start_registers", c_int),
        ("coils", POINTER(c_uint8)),
        ("discrete_inputs", POINTER(c_uint8)),
        ("input_registers", POINTER(c_uint16)),
        ("holding_registers", POINTER(c_uint16)),
    )


def _library() -> ctypes.CDLL:
    library = ctypes.CDLL("libmodbus.so.5", use_errno=True)
    prototypes: dict[str, tuple[Any, list[Any]]] = {
        "modbus_new_rtu": (c_void_p, [c_char_p, c_int, c_char, c_int, c_int]),
        "modbus_new_tcp": (c_void_p, [c_char_p, c_int]),
        "modbus_tcp_listen": (c_int, [c_void_p, c_int]),
        "modbus_tcp_accept": (c_int, [c_void_p, POINTER(c_int)]),
        "modbus_free": (None, [c_void_p]),
        "modbus_set_slave": (c_int, [c_void_p, c_int]),
        "modbus_set_indication_timeout": (c_int, [c_void_p, c_uint32, c_uint32]),
        "modbus_connect": (c_int, [c_void_p]),
        "modbus_close": (None, [c_void_p]),
        "modbus_mapping_new_start_address": (POINTER(_Mapping), [c_uint] * 8),
        "modbus_mapping_free": (None, [POINTER(_Mapping)]),
        "modbus_receive": (c_int, [c_void_p, c_char_p]),
        "modbus_reply": (c_int, [c_void_p, c_char_p, c_int, POINTER(_Mapping)]),
        "modbus_strerror": (c_char_p, [c_int]),
    }
    for name, (result, arguments) in prototypes.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


class LibmodbusDevice(Device):
    def __init__(self, place: Path | int) -> None:
        super().__init__(place)
        self._library = _library()
        self._stopping = threading.Event()
        self._answering = threading.Lock()

    def start(self) -> None:
        library = self._library
        if isinstance(self.place, int):
            self._context = library.modbus_new_tcp(b"127.0.0.1", self.place)
        else:
            self._context = library.modbus_new_rtu(str(self.place).encode(), BAUD_RATE, b"N", 8, 1)
        self._must(self._context is not None)
        self._must(library.modbus_set_slave(self._context, UNIT) == 0)
        self._must(library.modbus_set_indication_timeout(self._context, 0, STOP_LOOK_US) == 0)
        if isinstance(self.place, int):
            self._listener = c_int(library.modbus_tcp_listen(self._context, 1))
            self._must(self._listener.value >= 0)
        else:
            self._must(library.modbus_connect(self._context) == 0)
        self._mapping = library.modbus_mapping_new_start_address(*(FIRST_ADDRESS, TABLE_SIZE) * 4)
        self._must(bool(self._mapping))
        self._stopping.clear()
        serve = self._serve_connections if isinstance(self.place, int) else self._serve
        self._thread = threading.Thread(target=serve)
        self._thread.start()

    def stop(self) -> None:
        self._stopping.set()
        self._thread.join()
        self._library.modbus_close(self._context)
        if isinstance(self.place, int):
            os.close(self._listener.value)
        self._library.modbus_free(self._context)
        self._library.modbus_mapping_free(self._mapping)

    def get(self, table: str, address: int, count: int) -> list[int]:
        begin = address - FIRST_ADDRESS
        with self._answering:
            return list(getattr(self._mapping.contents, table)[begin : begin + count])

    def set(self, table: str, address: int, values: Sequence[int]) -> None:
        with self._answering:
            for place, value in enumerate(values, address - FIRST_ADDRESS):
                getattr(self._mapping.contents, table)[place] = value

    def _serve_connections(self) -> None:
        while not self._stopping.is_set():
            if select.select([self._listener.value], [], [], STOP_LOOK_US / 1e6)[0]:
                self._must(self._library.modbus_tcp_accept(self._context, self._listener) >= 0)
                self._serve()
                self._library.modbus_close(self._context)

    def _serve(self) -> None:
        """Until it is stopped, or the peer closes the connection."""
        frame = ctypes.create_string_buffer(ADU_MAX)
        while not self._stopping.is_set():
            length = self._library.modbus_receive(self._context, frame)
            if length > 0:
                self.requests.append(self._pdu(frame.raw[:length]))
                with self._answering:
                    self._library.modbus_reply(self._context, frame, length, self._mapping)
            elif isinstance(self.place, int) and ctypes.get_errno() != errno.ETIMEDOUT:
                return

    def _pdu(self, frame: bytes) -> bytes:
        return frame[MBAP_SIZE:] if isinstance(self.place, int) else frame[1:-CRC_SIZE]

    def _must(self, good: bool) -> None:
        if not good:
            cause = self._library.modbus_strerror(ctypes.get_errno()).decode()
            raise OSError(f"libmodbus cannot serve {self.place}: {cause}")
