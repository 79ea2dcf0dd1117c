# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs what a change can reach: `changed.py [BASE]`, for `make test-changed`.

The change is what differs from BASE (origin/main, or where there is none HEAD~), with what is not committed
or not known to git yet. For each part it says why, and at the end which failed.
"""

import subprocess
import sys
from contextlib import suppress

from areas import ROOT, parts

REASONS = 3  # that are named; the others are counted


def git(*words: str) -> str:
    """What it says; raises CalledProcessError."""
    # A checkout that another user owns, as in a container, is no reason to stop.
    command = ["git", "-c", "safe.directory=*", *words]
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout


def known(revision: str) -> bool:
    with suppress(subprocess.CalledProcessError):
        return bool(git("rev-parse", "--quiet", "--verify", f"{revision}^{{commit}}"))
    return False


def changed(base: str) -> list[str]:
    """The files that differ from where this branch left the base; of a renamed one both names."""
    with suppress(subprocess.CalledProcessError):  # none where the clone is shallow
        base = git("merge-base", base, "HEAD").strip()
    differ = git("diff", "--name-only", "--no-renames", "-z", base)
    new = git("ls-files", "--others", "--exclude-standard", "-z")
    return sorted(filter(None, f"{differ}{new}".split("\0")))


def because(paths: list[str]) -> str:
    more = len(paths) - REASONS
    return f"{', '.join(paths[:REASONS])}{f' and {more} more' if more > 0 else ''} changed"


def main(arguments: list[str]) -> int:
    base = arguments[0] if arguments else "origin/main" if known("origin/main") else "HEAD~"
    if not known(base):
        print(f"test-changed: git knows no commit {base!r}: choose another with BASE=", file=sys.stderr)
        return 2
    paths = changed(base)
    chosen = parts(paths)
    if not chosen:
        print(f"test-changed: nothing differs from {base}")
    for target, reasons in chosen.items():
        for only, why in reasons.items():
            print(f"{only or target}: {because(why)}", flush=True)
    failed = [target for target, reasons in chosen.items() if not run(target, list(reasons))]
    if failed:
        print(f"test-changed: failed: {' '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def run(target: str, files: list[str]) -> bool:
    """Whether the target passed, for these files only, or for all of it."""
    return not subprocess.run(["make", target, f"FILES={' '.join(files)}"], cwd=ROOT).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
