# SPDX-License-Identifier: GPL-3.0-or-later
"""The completion of rtuctl in bash, which rtuctl prints from its own tables."""

import os
import re
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory

POINTS = ("pump", "pump-2", "$(touch${IFS}proof)", "valve")


@pytest.fixture(scope="module")
def gateway(programs: Path) -> Iterator[Gateway]:
    directory = run_directory()
    points = [
        {"name": name, "type": "single", "ioa": ioa, "command": name != "valve"}
        for ioa, name in enumerate(POINTS, 1)
    ]
    module = {"name": "missing", "program": "/missing", "ca": 1, "points": points}
    try:
        with Gateway(
            listening_on({"port": [], "modules": [module]}, free_port()), directory, programs
        ) as gateway:
            yield gateway
    finally:
        remove(directory)


def completed(gateway: Gateway, *words: str) -> list[str]:
    """What the last word can become."""
    line = shlex.join(["rtuctl", "--map", str(gateway.map), *words])
    script = f"""
        source {shlex.quote(str(gateway.build))}/rtuctl/rtuctl.bash
        COMP_WORDS=({line}) COMP_CWORD={len(words) + 2}
        _rtuctl
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    path = f"{gateway.build}/rtuctl:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euc", script],
        cwd=gateway.directory,
        env={"PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    return done.stdout.splitlines()


def test_each_command_of_the_help_is_completed(gateway: Gateway) -> None:
    names = re.findall(r"^  ([a-z]\w+) ", gateway.ctl("--help"), re.MULTILINE)
    assert "points" in names
    assert sorted(set(completed(gateway, ""))) == sorted([*names, "--map", "--json", "--help", "--version"])
    assert completed(gateway, "cloc") == ["clock"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("show", "pump"), ["pump", "pump-2"]),
        (("show", "v"), ["valve"]),
        (("set", "v"), []),  # it takes no commands
        (("set", "pump-2", "on", "--s"), ["--select"]),
        (("set", "pump", "on", "--pulse", "l"), ["long"]),
        (("lines", "--h"), ["--help", "--histogram"]),
        (("step", "pump", "h"), ["higher"]),
        (("counters", "miss"), ["missing"]),
        (("module", "mis"), ["missing"]),
        (("module", "pu"), []),
        (("module", "missing", "st"), ["stop", "start"]),
        (("events", "--count", ""), []),
    ],
)
def test_words_are_completed(gateway: Gateway, words: tuple[str, ...], expected: list[str]) -> None:
    assert [word for word in completed(gateway, *words) if word] == expected


def test_name_is_completed_and_not_run(gateway: Gateway) -> None:
    assert completed(gateway, "show", "$") == ["$(touch${IFS}proof)"]
    assert not (gateway.directory / "proof").exists()
