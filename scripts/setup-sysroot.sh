#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# setup-sysroot.sh FOLDER: the armel libraries to cross-compile against, from this machine's own Debian mirror.
#
# An apt root of its own: as a foreign architecture on the host they would not install, because Multi-Arch wants
# equal versions and the security archive carries no armel.
set -euo pipefail
# shellcheck source=scripts/private-apt.sh
. "$(dirname "$0")/private-apt.sh"

packages=(libc6-dev libcmocka-dev libjansson-dev)
sysroot=$(realpath -m "$1")
root=$sysroot.apt

mapfile -t mirrors < <(private_apt_mirrors)
rm -rf "$root" "$sysroot"
private_apt_root "$root"
cat >>"$root/apt.conf" <<-END
	APT::Architecture "armel";
	APT::Architectures { "armel"; };
END
export APT_CONFIG=$root/apt.conf
for mirror in "${mirrors[@]}"; do
	private_apt_source "$root" deb "$mirror"
	if apt-get -qq update && apt-get -qq install --yes --no-install-recommends --download-only "${packages[@]}"; then
		for deb in "$root"/cache/archives/*.deb; do
			dpkg-deb --extract "$deb" "$sysroot"
		done
		rm -rf "$root"
		exit 0
	fi
done
echo "setup: no mirror of this machine (${mirrors[*]:-none found}) gave armel packages of Debian $private_apt_suite;" \
	"check the network and the proxy of apt (apt-config dump)" >&2
exit 1
