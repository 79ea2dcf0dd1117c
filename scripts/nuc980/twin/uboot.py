# SPDX-License-Identifier: GPL-3.0-or-later
"""U-Boot's command line on the twin's debug UART."""

from __future__ import annotations

from nuc980.twin.machine import Machine, SerialLine

PROMPT = b"\n=> "
# What the receiver holds while U-Boot is busy with something else.
UART_FIFO = 16


class Console:
    """U-Boot's command line, from reset on."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.line: SerialLine = machine.uarts[0]
        self.banner = self.stop()

    def stop(self) -> str:
        """Stops the count-down of a start; returns what came before."""
        before = self.line.wait_for(b"Hit any key to stop autoboot:")
        self.line.send(b" ")
        return text(before + self.line.wait_for(b"=> "))

    def type(self, command: str) -> None:
        """Types a command's characters, each part when the one before it has been echoed, and Enter."""
        for start in range(0, len(command), UART_FIFO):
            part = command[start : start + UART_FIFO].encode()
            self.line.send(part)
            self.line.wait_for(part)
        self.line.send(b"\r")

    def run(self, command: str) -> str:
        """What U-Boot answers."""
        self.type(command)
        return text(self.line.wait_for(PROMPT).removesuffix(PROMPT))

    def reset(self) -> str:
        """Starts anew, up to the prompt; returns what came before."""
        self.type("reset")
        return self.stop()

    def environment(self) -> dict[str, str]:
        """The variables in RAM."""
        return dict(line.split("=", 1) for line in self.run("printenv").splitlines() if "=" in line)


def text(output: bytes) -> str:
    """A line's output as one reads it."""
    return output.decode(errors="replace").replace("\r", "")
