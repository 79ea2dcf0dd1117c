#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# setup-python.sh FOLDER REQUIREMENTS: a fresh virtual environment with exactly the pinned packages.
set -euo pipefail

# --clear empties what a link leads to, which is somebody else's.
if [[ -L $1 ]]; then
	echo "setup: $1 is a link; remove it, and make again" >&2
	exit 2
fi

# A python3 of one's own before Debian's comes first on PATH, and may be too old or lack venv.
for python in python3 /usr/bin/python3; do
	if "$python" -c 'import sys, ensurepip, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
		"$python" -m venv --clear "$1"
		exec scripts/logged.sh python "$1/bin/python" -m pip install --disable-pip-version-check --requirement "$2"
	fi
done
echo "setup: no python3 of at least 3.11 with venv was found; install Debian's python3-venv (Debian 12 or newer)" >&2
exit 2
