# SPDX-License-Identifier: GPL-3.0-or-later
"""How SWUpdate compares versions: its own functions, of the source that the board's is built from."""

import itertools
import subprocess
from pathlib import Path

import pytest

from release.version import swupdate
from rig.versions import IN_ORDER

SOURCE = Path(__file__).resolve().parents[2] / "build/swupdate/debian"
PROGRAM = """
#include <stdarg.h>
#include <stdio.h>
#include "util.h"

int loglevel;

void notify(RECOVERY_STATUS status, int error, int level, const char *text)
{
	(void)status, (void)error, (void)level, (void)text;
}

int main(int argc, char **argv)
{
	return argc != 3 ? 9 : compare_versions(argv[1], argv[2]) < 0 ? 0 : 1;
}
"""


@pytest.fixture(scope="module")
def is_older(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program that ends with 0 if SWUpdate has its first word for older than its second."""
    folder = tmp_path_factory.mktemp("judge")
    (folder / "generated").mkdir()
    (folder / "generated/autoconf.h").touch()
    (folder / "main.c").write_text(PROGRAM)
    command = ["cc", "-w", "-D_GNU_SOURCE", "-ffunction-sections", "-Wl,--gc-sections", f"-I{folder}"]
    command += [f"-I{SOURCE}/include", "-o", folder / "is-older", folder / "main.c"]
    command += [SOURCE / "core" / name for name in ("artifacts_versions.c", "semver.c", "util.c")]
    subprocess.run(command, check=True)
    return folder / "is-older"


def test_candidates_and_builds_sort_before_the_release(is_older: Path) -> None:
    """A build's number, where there is one, follows the version."""
    versions = [
        build
        for version in map(swupdate, IN_ORDER)
        for build in (version, f"{version}.1", f"{version}.2", f"{version}.10")
    ]
    for older, newer in itertools.combinations(versions, 2):
        for words, code in (((older, newer), 0), ((newer, older), 1), ((older, older), 1)):
            assert subprocess.run([is_older, *words]).returncode == code, words
