# SPDX-License-Identifier: GPL-3.0-or-later
"""TCP through both Ethernet ports of the emulated board, both ways at once, this host at the far ends."""

import hashlib
import random
import socket
import threading

import pytest

from lab.gateway import free_port
from nuc980.twin.linux import Kernel, Linux

SIZE = 2_000_000  # bytes each way
SECONDS = 120.0
PORTS = (0, 1)
LISTENS = (5000, 5001)  # the board


@pytest.fixture(scope="module")
def kernel(kernel: Kernel) -> Kernel:
    return kernel.without_services()


@pytest.fixture(scope="module")
def forwarded() -> tuple[int, int]:
    """Ports of this host that lead to the board's, through its eth0 and its eth1."""
    return free_port(), free_port()


@pytest.fixture(scope="module")
def board_arguments(forwarded: tuple[int, int]) -> tuple[str, ...]:
    nets = (
        f"user,net=10.0.{n}.0/24,hostfwd=tcp:127.0.0.1:{forwarded[n]}-10.0.{n}.15:{LISTENS[n]}" for n in PORTS
    )
    return tuple(word for net in nets for word in ("-nic", net))


class Listener:
    """Takes one connection, and all that comes on it."""

    def __init__(self) -> None:
        self._socket = socket.create_server(("127.0.0.1", 0))
        self._socket.settimeout(SECONDS)
        self.port = self._socket.getsockname()[1]
        self._digest = hashlib.sha256()
        self._thread = threading.Thread(target=self._take, daemon=True)
        self._thread.start()

    def _take(self) -> None:
        connection, _ = self._socket.accept()
        while data := connection.recv(65536):
            self._digest.update(data)
        connection.close()
        self._socket.close()

    def digest(self) -> str:
        """Of all that came, when the far end has closed."""
        self._thread.join(SECONDS)
        return self._digest.hexdigest()


def send(port: int, content: bytes) -> None:
    with socket.create_connection(("127.0.0.1", port), SECONDS) as connection:
        connection.sendall(content)
        connection.shutdown(socket.SHUT_WR)
        assert connection.recv(1) == b""  # the board has it all


def test_megabytes_both_ways_through_both_ports(linux: Linux, forwarded: tuple[int, int]) -> None:
    for n in PORTS:
        linux.run(f"ip link set eth{n} up; ip addr flush dev eth{n}; ip addr add 10.0.{n}.15/24 dev eth{n}")
        linux.run(f"while ! grep -q 1 /sys/class/net/eth{n}/carrier; do sleep 0.1; done")
        # An input that never ends: at its end, nc would close the connection's other half.
        linux.run(
            f"mkfifo /tmp/mute{n}; (nc -l -p {LISTENS[n]} <> /tmp/mute{n} > /tmp/got{n};"
            f" touch /tmp/done{n}) &"
        )
    linux.run(f"dd if=/dev/urandom of=/tmp/sent bs=1000 count={SIZE // 1000} 2> /dev/null", seconds=SECONDS)
    content = [random.Random(n).randbytes(SIZE) for n in PORTS]
    listeners = [Listener() for _ in PORTS]
    senders = [threading.Thread(target=send, args=(forwarded[n], content[n])) for n in PORTS]
    for sender in senders:
        sender.start()
    ways = " & ".join(f"nc 10.0.{n}.2 {listeners[n].port} < /tmp/sent" for n in PORTS)
    linux.run(f"{ways} & wait", seconds=SECONDS)
    for sender in senders:
        sender.join(SECONDS)
        assert not sender.is_alive()
    linux.run("while ! [ -e /tmp/done0 -a -e /tmp/done1 ]; do sleep 0.1; done", seconds=SECONDS)

    def digest(file: str) -> str:
        return linux.run(f"sha256sum {file}").split()[0]

    assert [digest(f"/tmp/got{n}") for n in PORTS] == [hashlib.sha256(each).hexdigest() for each in content]
    assert [listener.digest() for listener in listeners] == [digest("/tmp/sent")] * len(PORTS)
    for n in PORTS:
        counters = linux.run(
            f"cd /sys/class/net/eth{n}/statistics; cat rx_errors tx_errors rx_dropped tx_dropped"
        )
        assert counters.split() == ["0"] * 4
