# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs pytest with the arguments given; then once more, alone, what failed beside other tests.

`python tests/run/alone.py ARGUMENTS`. OPENRTU_TIMES names the file in which times.py leaves what the tests
cost and what failed; the second run's is beside it. The last lines name what passed alone: such a test is at
fault, or the product has a race. Exit code: that of the last run.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from times import ALONE, failed_tests, passed_alone

# Files with failures; more are no accident of a busy host. What fails in a file often fails the
# rest of it, which has the same gateway or guest.
MOST = 6


def run(arguments: list[str], times: Path) -> int:
    times.unlink(missing_ok=True)
    environment = os.environ | {"OPENRTU_TIMES": str(times)}
    return subprocess.run([sys.executable, "-m", "pytest", *arguments], env=environment).returncode


def main(arguments: list[str]) -> int:
    times = Path(os.environ["OPENRTU_TIMES"])
    alone = times.with_name(times.stem + ALONE)
    alone.unlink(missing_ok=True)
    result = run(arguments, times)
    failed = failed_tests(times) if result == pytest.ExitCode.TESTS_FAILED else []
    files = {test.partition("::")[0] for test in failed}
    if not 0 < len(files) <= MOST:
        return result
    print(f"once more, alone: {len(failed)}", flush=True)
    result = run(["-n", "0", *failed], alone)
    print(*passed_alone(alone), sep="\n", flush=True)
    return result


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
