# SPDX-License-Identifier: GPL-3.0-or-later
"""Linux on the twin: a kernel booted, and a shell on its debug UART."""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any, Self

from image import cpio
from nuc980.twin.machine import Machine
from nuc980.twin.uboot import UART_FIFO

BOOT_SECONDS = 300.0
RUN_SECONDS = 30.0
# A kernel's argument: programs lie at the same addresses at each start. QEMU then translates them once, not
# once for each process: that was two fifths of what a boot with the image's start scripts cost.
SAME_ADDRESSES = "norandmaps"

# What a kernel says of itself when something is wrong: behind its time stamp, or, before there is one, at the
# start of a line.
TROUBLE = re.compile(
    r"(?:\[ *\d+\.\d{6}\](?:\[[^]\r\n]*\])? |^)"
    r"((?:WARNING: |(?:\[ )?BUG: |BUG \S+ \(|Oops|Internal error: |Unable to handle kernel |Kernel panic|"
    r"INFO: (?:task|rcu|possible|trying) |DMA-API: (?!preallocated|debugging enabled))[^\r\n]*)",
    re.MULTILINE,
)
PANIC = re.compile(r"---\[ end Kernel panic")

# The kernel's console does not wait for a line's end: its messages come between any characters of a program.
MESSAGE = r"(?:\[ *\d+\.\d{6}\]|\*\* \d+ printk messages dropped)[^\n]*\n"
STATUS = rf"(?:\d(?:{MESSAGE})*)+"
BROKEN_IN = re.compile(rf"(?<=[^\n])(?:{MESSAGE})+")
# What the kernel says when a busy host lets its tasks wait: never what a command writes.
OF_A_BUSY_HOST = re.compile(
    r"^\[ *\d+\.\d{6}\] (?:ttyS ttyS\d+: \d+ input overrun\(s\)|sched: RT throttling activated)\n",
    re.MULTILINE,
)

SHELL_IS_UP = "<shell>"
# Takes the place of the log-in: no password, no line editing; a command's lines, then the mark that starts
# them. As the kernel's first process it also mounts what a start script would have. The kernel is heard from
# warnings on: less comes between a test's lines. It also says that the shell is up: its console may be late,
# and what it has to say of the boot then comes before.
SHELL = f"""#!/bin/sh
export PATH=/sbin:/usr/sbin:/bin:/usr/bin
if [ $$ = 1 ]; then
    mount -t proc proc /proc; mount -t sysfs sysfs /sys; mount -t devtmpfs devtmpfs /dev
fi
dmesg -n 5
echo '<1>{SHELL_IS_UP}' > /dev/kmsg
lines=
while IFS= read -r line; do
    case $line in
    '<run '*'>')
        sh -c "$lines" < /dev/null
        echo "<ran ${{line#<run }} $?>"
        lines=
        ;;
    *)
        lines="$lines
$line"
        ;;
    esac
done
"""
LOG_IN = "/sbin/getty"  # what an image's inittab starts on the debug UART


class LinuxError(Exception):
    """Linux did not do what was waited for; the text has the end of what its console said."""


@dataclass(frozen=True)
class Kernel:
    """What is booted, and its root: in the kernel itself, and a cpio archive (gzip or not) over that."""

    image: Path  # a zImage or an uImage
    dtb: Path
    root: Path | None = None
    arguments: str = "console=ttyS0,115200"

    def without_services(self) -> Self:
        """The same with the shell of Linux.boot as its first program: the image starts nothing.

        Its start scripts are three quarters of what an emulated boot costs.
        """
        return replace(self, arguments=f"{self.arguments} rdinit={LOG_IN}")


class Linux:
    """A shell on the debug UART of a machine that boots Linux; wait_for_shell() before the first run()."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.troubles: list[str] = []  # panics, oopses, warnings; who expects one clears the list
        self._heard = ""
        self._searched = 0  # up to here it was searched for troubles
        self._answered = 0  # and up to here it was waited for
        self._commands = 0
        self._closed = False

    @classmethod
    def boot(
        cls,
        qemu: Path,
        kernel: Kernel,
        *arguments: str | Path,
        files: Mapping[str, Path | str] | None = None,
        options: str = "",
        **settings: Any,
    ) -> Self:
        """Starts a kernel without a boot loader, up to the shell; the other arguments are Machine's.

        Unless the options name a pace, what the console says takes no time: the kernel polls the UART until
        each character is out, which is nearly half of what a boot without services costs.

        files, by their paths in the root, come over the root: a file of this machine with its mode, or the
        text of a script.
        """
        with tempfile.NamedTemporaryFile(prefix="initrd-") as initrd:
            initrd.write(kernel.root.read_bytes() if kernel.root else b"")
            initrd.write(bytes(-initrd.tell() % 4) + archive({LOG_IN: SHELL} | dict(files or {})))
            initrd.flush()
            if "pace=" not in options:
                options = f"pace=lines{options and ','}{options}"
            machine = Machine(
                qemu, "-kernel", kernel.image, "-dtb", kernel.dtb, "-initrd", initrd.name,
                "-append", kernel.arguments, *arguments, options=options, **settings,
            )  # fmt: skip
            linux = cls(machine)
            try:
                linux.wait_for_shell()
            except BaseException:
                linux.close()
                raise
            return linux

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the machine; its log stays."""
        self._closed = True
        self.machine.close()

    @property
    def log(self) -> str:
        """All that the console has said so far, as one reads it."""
        while self._receive(0.0):
            pass
        return self._heard.replace("\r", "")

    def wait_for(self, text: str | re.Pattern[str], seconds: float = BOOT_SECONDS) -> str:
        """Reads until it has come after the last wait_for; returns all up to its end. A panic ends it."""
        pattern = broken(re.escape(character) for character in text) if isinstance(text, str) else text
        deadline = time.monotonic() + seconds
        while not (found := pattern.search(self._heard, self._answered)):
            if PANIC.search(self._heard, self._answered):
                raise LinuxError(f"a panic instead of {pattern.pattern!r}:\n{self._end()}")
            left = deadline - time.monotonic()
            if left <= 0 or not self._receive(left):
                raise LinuxError(
                    f"no {pattern.pattern!r} within {seconds} s; the console said:\n{self._end()}"
                )
        before = self._heard[self._answered : found.end()]
        self._answered = found.end()
        return before.replace("\r", "")

    def wait_for_shell(self, seconds: float = BOOT_SECONDS) -> str:
        """Until the shell is there, at first or after a restart; returns what came before."""
        return self.wait_for(SHELL_IS_UP, seconds)

    def run(self, command: str, seconds: float = RUN_SECONDS) -> str:
        """What a command writes; raises LinuxError with it for a status that is not 0.

        It may have several lines. It has a shell of its own and no input: cd and variables end with it.
        """
        status, output = self.try_to(command, seconds)
        if status:
            raise LinuxError(f"status {status} of: {command}\n{output}")
        return output

    def try_to(self, command: str, seconds: float = RUN_SECONDS) -> tuple[int, str]:
        """A command's status, and what it writes."""
        self._commands += 1
        number = self._commands
        self.type(f"{command}\n<run {number}>\n")
        ran = f"<ran {number}> "
        # With its line's end, which otherwise comes within the echo of the next command, or behind that.
        ended = broken([*map(re.escape, ran), STATUS, ">", "\r?\n"])
        said = OF_A_BUSY_HOST.sub("", BROKEN_IN.sub("", self.wait_for(ended, seconds)))
        text, _, status = said.rpartition(ran)
        return int(status.removesuffix(">\n")), text.removesuffix("\n")

    def type(self, text: str) -> None:
        """Types characters, each part when the one before it has been echoed: no receiver overruns.

        What programs and the kernel say meanwhile may stand between the characters, and be taken for the end
        of an echo. So a part is half of what the receiver holds.
        """
        for start in range(0, len(text), UART_FIFO // 2):
            part = text[start : start + UART_FIFO // 2]
            self.machine.uarts[0].send(part.encode())
            self.wait_for(re.compile(".*?".join(map(re.escape, part)), re.DOTALL), RUN_SECONDS)

    def _receive(self, seconds: float) -> bool:
        data = b"" if self._closed else self.machine.uarts[0].receive(seconds)
        self._heard += data.decode("latin-1")
        self._search()
        return bool(data)

    def _search(self) -> None:
        """Notes the troubles in the lines that are complete."""
        end = self._heard.rfind("\n") + 1
        self.troubles += TROUBLE.findall(self._heard, self._searched, end)
        self._searched = max(self._searched, end)

    def _end(self) -> str:
        return self.log[-4000:]


def broken(parts: Iterable[str]) -> re.Pattern[str]:
    """A pattern of these, one after another, whatever messages of the kernel stand between them."""
    return re.compile(f"(?:{MESSAGE})*".join(parts))


def archive(files: Mapping[str, Path | str]) -> bytes:
    """A cpio archive of files by their paths in the root, with the folders that they need."""
    members = {path.lstrip("/"): content for path, content in files.items()}
    entries = [cpio.Entry.folder(folder) for folder in dict.fromkeys(_folders(members))]
    for name, content in members.items():
        if isinstance(content, Path):
            entries.append(cpio.Entry.file(name, content.read_bytes(), content.stat().st_mode & 0o777))
        else:
            entries.append(cpio.Entry.file(name, content, 0o755))
    return cpio.archive(entries)


def _folders(paths: Iterable[str]) -> Iterator[str]:
    for path in paths:
        yield from (str(folder) for folder in reversed(PurePosixPath(path).parents) if folder.name)
