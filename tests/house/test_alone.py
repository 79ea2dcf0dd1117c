# SPDX-License-Identifier: GPL-3.0-or-later
"""`make test` runs once more what failed beside other tests, and says so."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from alone import MOST

ROOT = Path(__file__).resolve().parents[2]

TESTS = """
from pathlib import Path
import pytest

def test_that_passes():
    pass

@pytest.mark.parametrize("number", range({fail_once}))
def test_that_fails_once(number):
    mark = Path(__file__).with_name(f"ran-{{number}}")
    first = not mark.exists()
    mark.touch()
    assert not first

def test_that_may_fail():
    assert not {fails}
"""


def run(folder: Path, fail_once: int, fails: bool, *words: str) -> subprocess.CompletedProcess[str]:
    """On tests of which some fail the first time and one fails always, if wanted."""
    file = folder / "test_some.py"
    file.write_text(TESTS.format(fail_once=fail_once, fails=fails))
    (folder / "conftest.py").write_text(
        "from times import Times\ndef pytest_configure(config):\n    config.pluginmanager.register(Times())\n"
    )
    return subprocess.run(
        [sys.executable, ROOT / "tests/run/alone.py", "-n", "0", "--rootdir", folder, file, *words],
        env=os.environ | {"OPENRTU_TIMES": str(folder / "some.json"), "PYTHONPATH": str(ROOT / "tests/run")},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.slow
def test_what_passes_is_run_once(tmp_path: Path) -> None:
    ran = run(tmp_path, fail_once=0, fails=False)
    assert ran.returncode == 0
    assert "alone" not in ran.stdout


@pytest.mark.slow
def test_what_passes_alone_is_named(tmp_path: Path) -> None:
    ran = run(tmp_path, fail_once=2, fails=False)
    assert ran.returncode == 0
    assert "passed only alone: test_some.py::test_that_fails_once[0]" in ran.stdout
    assert "passed only alone: test_some.py::test_that_fails_once[1]" in ran.stdout
    assert "test_that_passes" not in ran.stdout.split("once more, alone: 2")[1]


@pytest.mark.slow
def test_what_fails_again_fails(tmp_path: Path) -> None:
    ran = run(tmp_path, fail_once=1, fails=True)
    assert ran.returncode == 1
    assert "passed only alone: test_some.py::test_that_fails_once[0]" in ran.stdout
    assert "passed only alone: test_some.py::test_that_may_fail" not in ran.stdout


@pytest.mark.slow
def test_what_a_crash_leaves_out_is_not_passed(tmp_path: Path) -> None:
    """Its worker is gone, and with it the run: the other tests have not been run at all."""
    crash = f"import os\nfrom pathlib import Path\n\nmark = Path({str(tmp_path / 'ran')!r})\n\n"
    crash += "def test_that_crashes_once():\n    if not mark.exists():\n        mark.touch()\n"
    crash += "        os._exit(1)\n"
    (tmp_path / "test_crash.py").write_text(crash)
    ran = run(tmp_path, 0, False, "-n", "1", "--max-worker-restart", "0", str(tmp_path / "test_crash.py"))
    assert ran.returncode != 0, ran.stdout
    assert "alone" not in ran.stdout


@pytest.mark.slow
def test_many_are_no_accident(tmp_path: Path) -> None:
    files = [tmp_path / f"test_more_{number}.py" for number in range(MOST)]
    for file in files:
        file.write_text(TESTS.format(fail_once=1, fails=False).replace("ran-", f"{file.stem}-"))
    ran = run(tmp_path, 1, False, *map(str, files))
    assert ran.returncode == 1
    assert "alone" not in ran.stdout


@pytest.mark.slow
def test_many_of_one_file_are_one_accident(tmp_path: Path) -> None:
    ran = run(tmp_path, fail_once=2 * MOST, fails=False)
    assert ran.returncode == 0
    assert f"once more, alone: {2 * MOST}" in ran.stdout
