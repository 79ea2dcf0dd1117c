#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# debian-package.sh FOLDER PACKAGE...: Debian packages unpacked, from this machine's own mirror, without what they need.
#
# For programs that must not be installed: their packages would start a service. No root is needed.
set -euo pipefail
# shellcheck source=scripts/private-apt.sh
. "$(dirname "$0")/private-apt.sh"

folder=$(realpath -m "$1")
shift
root=$folder.apt

mapfile -t mirrors < <(private_apt_mirrors)
rm -rf "$root" "$folder"
private_apt_root "$root"
export APT_CONFIG=$root/apt.conf
for mirror in "${mirrors[@]}"; do
	private_apt_source "$root" deb "$mirror"
	if apt-get -qq update && (cd "$root/cache" && apt-get -qq download "$@"); then
		for deb in "$root"/cache/*.deb; do
			dpkg-deb --extract "$deb" "$folder"
		done
		rm -rf "$root"
		exit 0
	fi
done
echo "setup: no mirror of this machine (${mirrors[*]:-none found}) gave $* of Debian $private_apt_suite;" \
	"check the network and the proxy of apt (apt-config dump)" >&2
exit 1
