# SPDX-License-Identifier: GPL-3.0-or-later
"""What bash completes of `openrtu`: the script that it prints, in a bash."""

import subprocess
from pathlib import Path

import pytest

from openrtu_tools.cli import TOOLS

ROOT = Path(__file__).resolve().parents[2]
OPENRTU = ROOT / "scripts/openrtu"

# As bash calls it: the words, the last of which is completed, and the function that `complete` has named.
ASK = """
source "$1"
function=$(complete -p openrtu | sed 's/.*-F \\([^ ]*\\).*/\\1/')
shift
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)) COMP_LINE="$*" COMP_POINT=${#COMP_LINE}
"$function" openrtu "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
echo "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("completion") / "openrtu"
    with file.open("w") as out:
        subprocess.run([OPENRTU, "--completion", "bash"], stdout=out, check=True)
    return file


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("lo", "logic"),
        ("web", "web-users"),
        ("logic c", "check compile"),
        ("logic run --pl", "--plot"),
        ("logic filter ell", "elliptic"),
        ("snmp-keys --encryption AES-1", "AES-128 AES-192"),
        ("centre x s", "serve station"),
        ("centre x user anna --role op", "operator"),
        ("points gate", "gateway.csv"),
    ],
)
def test_bash(script: Path, tmp_path: Path, typed: str, completed: str) -> None:
    (tmp_path / "gateway.csv").touch()
    words = ["bash", "--norc", "-c", ASK, "bash", script, "openrtu", *typed.split()]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (f"{completed}\n", "")


@pytest.mark.slow
def test_zsh_has_each_subcommand() -> None:
    done = subprocess.run([OPENRTU, "--completion", "zsh"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("#compdef openrtu\n")
    assert [name for name in TOOLS if f"    {name}:" not in done.stdout] == []


def test_another_shell_is_refused() -> None:
    done = subprocess.run([OPENRTU, "--completion", "fish"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert "invalid choice: 'fish' (choose from " in done.stderr
