#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# setup-python.sh LIST: the Python packages of LIST into .venv, in the versions of requirements.txt. Those of scripts/python.txt go
# into a fresh one, the others are added.
set -euo pipefail

# --clear empties what a link leads to, which is somebody else's.
if [[ -L .venv ]]; then
	echo "setup: .venv is a link; remove it, and make again" >&2
	exit 2
fi

# A python3 of one's own before Debian's comes first on PATH, and may be too old or lack venv.
make_fresh() {
	local python
	for python in python3 /usr/bin/python3; do
		if "$python" -c 'import sys, ensurepip, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
			"$python" -m venv --clear .venv
			return
		fi
	done
	echo "setup: no python3 of at least 3.11 with venv was found; install Debian's python3-venv (Debian 12 or newer)" >&2
	exit 2
}

# Of several lists that a make brings at once, one at a time: pip does not lock.
mkdir -p build
exec {lock}>build/python.lock
flock "$lock"

name=$(basename "$1" .txt)
[[ $name != python ]] || make_fresh
scripts/logged.sh "$name" .venv/bin/python -m pip install --disable-pip-version-check --constraint requirements.txt --requirement "$1"
