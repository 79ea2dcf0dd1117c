# SPDX-License-Identifier: GPL-3.0-or-later
"""The server of pymodbus, in an event loop of its own."""

import asyncio
import threading
from collections.abc import Coroutine, Sequence
from typing import Any

from pymodbus import FramerType, ModbusDeviceIdentification
from pymodbus.pdu import ModbusPDU
from pymodbus.server import ModbusSerialServer, ModbusTcpServer, ModbusUdpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from peers.device import BAUD_RATE, FIRST_ADDRESS, TABLE_SIZE, UNIT, Device

ANSWER_TIMEOUT_S = 60.0  # its memory takes seconds of a busy host
FUNCTION = {"coils": 1, "discrete_inputs": 2, "holding_registers": 3, "input_registers": 4}
BIT_TABLES = ("coils", "discrete_inputs")


def _bits() -> list[SimData]:
    return [SimData(FIRST_ADDRESS, values=[False] * TABLE_SIZE, datatype=DataType.BITS)]


def _registers() -> list[SimData]:
    return [SimData(FIRST_ADDRESS, count=TABLE_SIZE, values=0, datatype=DataType.REGISTERS)]


class PymodbusDevice(Device):
    identity = ModbusDeviceIdentification(
        info_name={"VendorName": "pymodbus", "ProductCode": "peer", "MajorMinorRevision": "1.0"}
    )
    framer = FramerType.SOCKET  # on TCP
    line_framer = FramerType.RTU  # on a line
    network_server: type[ModbusTcpServer] | type[ModbusUdpServer] = ModbusTcpServer
    _server: ModbusSerialServer | ModbusTcpServer | ModbusUdpServer

    def start(self) -> None:
        self._loop = asyncio.new_event_loop()
        # A daemon, so that a server that cannot start does not keep the tests from ending.
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._run(self._listen())

    def stop(self) -> None:
        self._run(self._server.shutdown())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def get(self, table: str, address: int, count: int) -> list[int]:
        values = self._run(self._server.async_getValues(UNIT, FUNCTION[table], address, count))
        return [int(value) for value in values]

    def set(self, table: str, address: int, values: Sequence[int]) -> None:
        own = [bool(value) for value in values] if table in BIT_TABLES else list(values)
        self._run(self._server.async_setValues(UNIT, FUNCTION[table], address, own))

    async def _listen(self) -> None:
        memory = SimDevice(UNIT, (_bits(), _bits(), _registers(), _registers()))
        if isinstance(self.place, int):
            address = ("127.0.0.1", self.place)
            self._server = self.network_server(
                memory,
                address=address,
                framer=self.framer,
                identity=self.identity,
                trace_pdu=self._trace,
            )
        else:
            self._server = ModbusSerialServer(
                memory,
                framer=self.line_framer,
                identity=self.identity,
                port=str(self.place),
                baudrate=BAUD_RATE,
                trace_pdu=self._trace,
            )
        await self._server.serve_forever(background=True)

    def _trace(self, sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if not sending:
            self.requests.append(bytes([pdu.function_code]) + pdu.encode())
        return pdu

    def _run(self, work: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(ANSWER_TIMEOUT_S)


class PymodbusRtuDevice(PymodbusDevice):
    """On TCP, it takes and gives the frames of a serial line."""

    framer = FramerType.RTU


class PymodbusUdpDevice(PymodbusDevice):
    """On a port of UDP."""

    network_server = ModbusUdpServer


class PymodbusAsciiDevice(PymodbusDevice):
    """On a line, with frames of text."""

    line_framer = FramerType.ASCII
