#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# debian-package.sh FOLDER PACKAGE...: Debian packages unpacked, from this machine's own mirror, without what they need.
#
# For programs that must not be installed: their packages would start a service. No root is needed. ARCHITECTURE in the
# environment is that of the packages, if not this machine's. FOLDER.versions has a line for each: name, version.
set -euo pipefail
# shellcheck source=scripts/private-apt.sh
. "$(dirname "$0")/private-apt.sh"

folder=$(realpath -m "$1")
shift
root=$folder.apt

rm -rf "$root" "$folder"
private_apt_root "$root" "${ARCHITECTURE:-}"
private_apt_fetch "$root" deb "$*" apt-get -qq download "$@"
for deb in "$root"/cache/*.deb; do
	dpkg-deb --extract "$deb" "$folder"
	# shellcheck disable=SC2016 # dpkg's variables
	dpkg-deb --show --showformat='${Package} ${Version}\n' "$deb"
done >"$folder.versions"
rm -rf "$root"
