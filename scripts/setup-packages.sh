#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# setup-packages.sh LIST: installs the Debian packages of LIST that are missing; without root prints the command that would.
set -euo pipefail

mapfile -t wanted < <(sed 's/[[:space:]]*#.*//; /^[[:space:]]*$/d' "$1")

if ! command -v dpkg-query apt-get >/dev/null; then
	echo "setup: this is not a Debian system; install what these packages contain, then type touch build/packages.done:"
	echo "  ${wanted[*]}"
	exit 2
fi >&2

missing=()
for package in "${wanted[@]}"; do
	status=$(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null) || status=unknown
	[[ $status == installed ]] || missing+=("$package")
done
[[ ${#missing[@]} -gt 0 ]] || exit 0

install=(apt-get install --yes --no-install-recommends "${missing[@]}")
if [[ $EUID -ne 0 ]]; then
	become=$(command -v sudo >/dev/null && echo "sudo sh" || echo su)
	echo "setup: ${#missing[@]} Debian packages are missing, and only root can install them. Type this, then make again:"
	echo "  $become -c 'apt-get update && ${install[*]}'"
	exit 2
fi >&2

# Of several lists that a make brings at once, one at a time: so it is with dpkg.
mkdir -p build
exec {lock}>build/packages.lock
flock "$lock"

# wireshark-common would ask who may capture packets
export DEBIAN_FRONTEND=noninteractive
# shellcheck disable=SC2016 # the inner shell's
scripts/logged.sh "$(basename "$1" .txt)" bash -c 'apt-get update && "$@"' - "${install[@]}"
