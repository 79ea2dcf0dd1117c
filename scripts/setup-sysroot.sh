#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# setup-sysroot.sh FOLDER: the armel libraries to cross-compile against, from this machine's own Debian mirror.
#
# An apt root of its own: as a foreign architecture on the host they would not install, because Multi-Arch wants
# equal versions and the security archive carries no armel.
set -euo pipefail
# shellcheck source=scripts/private-apt.sh
. "$(dirname "$0")/private-apt.sh"

packages=(libc6-dev libcap-dev libcmocka-dev libconfig-dev libjansson-dev libmtd-dev libseccomp-dev libssl-dev libubi-dev)
sysroot=$(realpath -m "$1")
root=$sysroot.apt

rm -rf "$root" "$sysroot"
private_apt_root "$root" armel
private_apt_fetch "$root" deb "armel packages" \
	apt-get -qq install --yes --no-install-recommends --download-only "${packages[@]}"
for deb in "$root"/cache/archives/*.deb; do
	dpkg-deb --extract "$deb" "$sysroot"
done
rm -rf "$root"
