# SPDX-License-Identifier: GPL-3.0-or-later
"""A copy of the sources with mutants in one room, and its build."""

from __future__ import annotations

import filecmp
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

from mutants import Mutant, mutants_of, written

SOURCES = Path("package/openrtu/src")
HERE = Path(__file__).resolve().parent
NO_PRODUCT = ("test_", "fuzz_", "fake_")
MOST = 65535  # mutant.c's MUTANTS less 0, which is none
OPTIONS = ["-Dtests=enabled", "-Dtls=true", "-Dsnmp=true", "-Dweb=true", "-Doptimization=1"]


class NoScore(Exception):
    """Says why there is none, and what to do."""


class Room:
    """A copy of the sources whose room `name` has mutants in it, and its build."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.folder = Path("build/mutation").resolve()
        self.sources = self.folder / "src"
        self.build = self.folder / "build"
        self.reached = self.folder / "reached.bin"

    def copied(self) -> None:
        """What is the same already keeps its time: one build serves all rooms, one after the other."""
        self.sources.mkdir(parents=True, exist_ok=True)
        copy_changed(SOURCES, self.sources)
        if not (self.build / "build.ninja").exists():
            chosen = self.folder / "mutant.o"
            self._run(
                [
                    "cc",
                    "-c",
                    "-O1",
                    "-fPIC",
                    f'-DMUTANTS_FOLDER="{self.folder}"',
                    str(HERE / "mutant.c"),
                    "-o",
                    str(chosen),
                ]
            )
            arguments = f"-g1 -w -include {HERE / 'mutant.h'}"
            linked = [f"-Dc_args={arguments}", f"-Dc_link_args={chosen}"]
            self._run(["meson", "setup", str(self.build), str(self.sources), *OPTIONS, *linked])

    def mutants(self) -> list[Mutant]:
        """Of each source once, though it may be compiled for several programs."""
        commands = json.loads((self.build / "compile_commands.json").read_text())
        sources = {(self.build / entry["file"]).resolve(): entry["command"] for entry in commands}
        folder = self.sources / self.name
        return [
            mutant
            for file, command in sorted(sources.items())
            if file.parent == folder and not file.name.startswith(NO_PRODUCT)
            for mutant in mutants_of(file, self._arguments(command))
        ]

    def turn_on(self, number: int) -> None:
        """For processes without MUTANT in their environment; 0: none."""
        (self.folder / "on").write_text(str(number))

    def _arguments(self, command: str) -> list[str]:
        """As clang's library takes them: relative folders are the build's."""
        kept = [word for word in shlex.split(command) if word.startswith(("-D", "-I", "-std="))]
        folders = [
            f"-I{(self.build / word[2:]).resolve()}" if word.startswith("-I") else word for word in kept
        ]
        clang = subprocess.run(["clang", "-print-resource-dir"], capture_output=True, text=True)
        return [*folders, "-include", str(HERE / "mutant.h"), f"-I{clang.stdout.strip()}/include"]

    def compiled(self, mutants: dict[int, Mutant]) -> dict[int, Mutant]:
        """Those that could be compiled; they are in the build then. What the compiler refuses is left out."""
        originals = {mutant.file: mutant.file.read_bytes() for mutant in mutants.values()}
        while True:
            for file, source in originals.items():
                here = {number: mutant for number, mutant in mutants.items() if mutant.file == file}
                file.write_bytes(written(source, here))
            done = subprocess.run(
                ["ninja", "-k", "0", "-C", str(self.build), "all", "meson-test-prereq"],
                capture_output=True,
                text=True,
            )
            if done.returncode == 0:
                return mutants
            refused = set(re.findall(r"(\S+\.c):(\d+):\d+: error", done.stdout))
            places = {((self.build / file).resolve(), int(line)) for file, line in refused}
            kept = {
                number: m for number, m in mutants.items() if not any(_near(m, place) for place in places)
            }
            if len(kept) == len(mutants):
                raise NoScore(f"the room does not compile:\n{done.stdout[-2000:]}")
            mutants = kept

    @staticmethod
    def _run(command: list[str]) -> None:
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise NoScore(f"{shlex.join(command)} failed:\n{(done.stdout + done.stderr)[-2000:]}")


def copy_changed(source: Path, copy: Path) -> None:
    """The copy has the same files afterwards; those that were the same are not touched."""
    compared = filecmp.dircmp(source, copy, ignore=[])
    for name in compared.right_only:
        path = copy / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    for name in compared.left_only:
        path = source / name
        (shutil.copytree if path.is_dir() else shutil.copy)(path, copy / name)
    for name in filecmp.cmpfiles(source, copy, compared.common_files, shallow=False)[1]:
        shutil.copy(source / name, copy / name)
    for name in compared.common_dirs:
        copy_changed(source / name, copy / name)


def _near(mutant: Mutant, place: tuple[Path, int]) -> bool:
    """Lines before it may have become fewer or more."""
    return mutant.file == place[0] and abs(mutant.line - place[1]) <= 1
