# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs pytest with the arguments given; then once more, alone, what failed beside other tests.

`python tests/alone.py ARGUMENTS`. Alone: the second run waits until the other parts of `make test` have run
their tests. OPENRTU_TIMES names the file in which times.py leaves what the tests cost and what failed; the
second run's is beside it. The last lines name what passed alone: such a test is at fault, or the product has
a race. Exit code: that of the last run.
"""

import fcntl
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from times import ALONE, failed_tests, passed_alone

# More are no accident of a busy host.
MOST = 3


def run(arguments: list[str], times: Path) -> int:
    times.unlink(missing_ok=True)
    environment = os.environ | {"OPENRTU_TIMES": str(times)}
    return subprocess.run([sys.executable, "-m", "pytest", *arguments], env=environment).returncode


@contextmanager
def held(file: Path, how: int) -> Iterator[None]:
    """The lock of this file: LOCK_SH beside others who share it, LOCK_EX with nobody beside."""
    with file.open("w") as lock:
        fcntl.flock(lock, how)
        yield


def main(arguments: list[str]) -> int:
    times = Path(os.environ["OPENRTU_TIMES"])
    alone = times.with_name(times.stem + ALONE)
    alone.unlink(missing_ok=True)
    times.parent.mkdir(parents=True, exist_ok=True)
    lock = times.with_name("lock")
    with held(lock, fcntl.LOCK_SH):
        result = run(arguments, times)
    failed = failed_tests(times) if result == pytest.ExitCode.TESTS_FAILED else []
    if not 0 < len(failed) <= MOST:
        return result
    print(f"once more, alone: {len(failed)}", flush=True)
    with held(lock, fcntl.LOCK_EX):
        result = run(["-n", "0", *failed], alone)
    print(*passed_alone(alone), sep="\n", flush=True)
    return result


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
