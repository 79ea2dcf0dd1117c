# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs of the board under QEMU, in the places of this machine's, with their instructions counted."""

from __future__ import annotations

import struct
import subprocess
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Self

from lab.gateway import REPOSITORY

HERE = REPOSITORY / "tests/bench"
SOURCE = REPOSITORY / "package/openrtu/src"
PROGRAMS = REPOSITORY / "build/arm-release-tls"
SYSROOT = REPOSITORY / "build/arm-sysroot"
PLUGIN_API = REPOSITORY / "build/qemu/source/include/qemu"
AGENT = REPOSITORY / "build/net-snmp-agent/build"  # Net-SNMP with its agent, for the contender
ARM = ["arm-linux-gnueabi-gcc", f"--sysroot={SYSROOT}", "-march=armv5te", "-mfloat-abi=soft", "-marm"]
OPTIONS = ["-Os", "-std=gnu11", "-D_GNU_SOURCE", "-D_TIME_BITS=64", "-D_FILE_OFFSET_BITS=64"]
MODULES = ("modules/rtu-iec104", "modules/rtu-snmp")


AGENT_LIBRARY = AGENT / "agent/.libs/libnetsnmpagent.a"


@dataclass(frozen=True)
class Counts:
    """What count_memory.c counts: counts.h."""

    instructions: float = 0.0
    calls: float = 0.0
    octets: float = 0.0  # between the cache for data and memory

    def __add__(self, other: Self) -> Self:
        return type(self)(*(one + more for one, more in zip(astuple(self), astuple(other), strict=True)))

    def __sub__(self, other: Self) -> Self:
        return type(self)(*(one - less for one, less in zip(astuple(self), astuple(other), strict=True)))

    def __truediv__(self, times: int) -> Self:
        return type(self)(*(each / times for each in astuple(self)))


def missing(*more: Path) -> list[Path]:
    """What a gateway under QEMU needs, and more, as far as it is not built."""
    wanted = [PROGRAMS / name for name in ("rtud/rtud", "rtuctl/rtuctl", *MODULES)]
    return [file for file in (*wanted, PLUGIN_API / "qemu-plugin.h", *more) if not file.exists()]


def built(program: Path, source: str, *more: str | Path) -> Path:
    subprocess.run([*ARM, *OPTIONS, "-o", program, HERE / source, *more], check=True)
    return program


def build_plugin(plugin: Path, source: str) -> None:
    command = ["cc", "-O2", "-shared", "-fPIC", f"-I{PLUGIN_API}", "-o", plugin, HERE / source]
    subprocess.run(command, check=True)


class Emulated:
    """A folder with programs that run under QEMU, and what each has had carried out."""

    def __init__(self, folder: Path, plugin: str = "count_instructions.c") -> None:
        self.folder = folder
        self.plugin = folder / "count.so"
        folder.mkdir()
        build_plugin(self.plugin, plugin)

    def add(self, name: str, program: Path) -> Path:
        place = self.folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        count = self._count_of(name)
        count.touch()
        count.chmod(0o666)  # a module's user adds to it
        words = {"SYSROOT": SYSROOT, "PLUGIN": f"{self.plugin},count={count}", "PROGRAM": program}
        defines = [f'-D{word}="{value}"' for word, value in words.items()]
        subprocess.run(["cc", *defines, "-o", place, HERE / "under_qemu.c"], check=True)
        return place

    def add_gateway(self) -> None:
        for name in ("rtud/rtud", "rtuctl/rtuctl", *MODULES):
            self.add(name, PROGRAMS / name)
        tests = {*(SOURCE / "map").glob("test_*.c"), *(SOURCE / "map").glob("fuzz_*.c")}
        sources = {*(SOURCE / "map").glob("*.c")} - tests
        source = built(self.folder / "source", "event_source.c", f"-I{SOURCE}", *sources, "-lm")
        self.add("modules/rtu-modbus", source)

    def add_agent(self) -> Path:
        libraries = [AGENT / f"agent/.libs/libnetsnmp{name}.a" for name in ("mibs", "agent", "mibs")]
        libraries.append(AGENT / "snmplib/.libs/libnetsnmp.a")
        include = f"-I{AGENT}/include"
        agent = built(self.folder / "agent", "default_agent.c", include, *libraries, "-lcrypto", "-lm")
        return self.add("default_agent", agent)

    def _count_of(self, name: str) -> Path:
        return self.folder / f"{Path(name).name}.count"

    def counts(self, name: str) -> Counts:
        """Of the plugin count_memory.c."""
        octets = self._count_of(name).read_bytes()
        return Counts(*struct.unpack("<3Q", octets)) if octets else Counts()

    def millions(self, name: str) -> float:
        octets = self._count_of(name).read_bytes()
        return int(struct.unpack("<Q", octets)[0]) / 1e6 if octets else 0.0
