#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# setup-packages.sh LIST...: installs the Debian packages of the lists that are missing; without root prints the command that
# would. In a list, `a | b` is one package by the names that it has in several releases of Debian.
set -euo pipefail

mapfile -t wanted < <(sed 's/[[:space:]]*#.*//; /^[[:space:]]*$/d; s/[[:space:]]*|[[:space:]]*/|/g' "$@" | sort -u)

if ! command -v dpkg-query apt-get >/dev/null; then
	echo "setup: this is not a Debian system; install what these packages contain, then type touch build/packages.done:"
	echo "  ${wanted[*]}"
	exit 2
fi >&2

is_installed() {
	[[ $(dpkg-query --show --showformat='${db:Status-Status}' "$1" 2>/dev/null) == installed ]]
}

# The name of a missing package that this release has, or nothing if one of its names is installed.
missing_name() {
	local name names
	IFS='|' read -ra names <<<"$1"
	for name in "${names[@]}"; do
		! is_installed "$name" || return 0
	done
	for name in "${names[@]}"; do
		if apt-cache show "$name" >/dev/null 2>&1; then
			echo "$name"
			return
		fi
	done
	echo "${names[0]}"
}

missing=()
for package in "${wanted[@]}"; do
	mapfile -t -O "${#missing[@]}" missing < <(missing_name "$package")
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
