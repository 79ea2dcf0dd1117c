#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# setup-sysroot.sh FOLDER: the armel libraries to cross-compile against, from this machine's own Debian mirror.
#
# An apt root of its own: as a foreign architecture on the host they would not install, because Multi-Arch wants
# equal versions and the security archive carries no armel. Neither the host's apt is touched, nor is root needed.
set -euo pipefail

packages=(libc6-dev libcmocka-dev libjansson-dev)
keyring=/usr/share/keyrings/debian-archive-keyring.gpg
sysroot=$(realpath -m "$1")
root=$sysroot.apt
suite=$(sed -n 's/^VERSION_CODENAME=//p' /etc/os-release)

# The mirrors that the host's sources name for this suite. `apt-get indextargets` would need an updated host.
mirrors() {
	apt-get update --print-uris -o Debug::NoLocking=1 | sed -n "s|^'\(.*\)/dists/$suite/InRelease'.*|\1|p" | sort -u
}

# The host's apt.conf.d is not read with a Dir of one's own: its proxy would be lost.
configure() {
	mkdir -p "$root"/etc/{apt.conf.d,preferences.d} "$root"/lists/partial "$root"/cache/archives/partial
	: >"$root/status"
	apt-config dump | grep -E '^Acquire::https?::' >"$root/apt.conf" || true
	cat >>"$root/apt.conf" <<-END
		APT::Architecture "armel";
		APT::Architectures { "armel"; };
		APT::Sandbox::User "root";
		Dir "$root";
		Dir::Etc "etc";
		Dir::State "$root";
		Dir::State::status "$root/status";
		Dir::Cache "cache";
	END
}

# download MIRROR: false when it is not Debian's (a third party's repository can have a suite of the same name).
download() {
	echo "deb [signed-by=$keyring] $1 $suite main" >"$root/etc/sources.list"
	apt-get -qq update && apt-get -qq install --yes --no-install-recommends --download-only "${packages[@]}"
}

mapfile -t candidates < <(mirrors)
rm -rf "$root" "$sysroot"
configure
export APT_CONFIG=$root/apt.conf
for mirror in "${candidates[@]}"; do
	if download "$mirror"; then
		for deb in "$root"/cache/archives/*.deb; do
			dpkg-deb --extract "$deb" "$sysroot"
		done
		rm -rf "$root"
		exit 0
	fi
done
echo "setup: no mirror of this machine (${candidates[*]:-none found}) gave armel packages of Debian $suite;" \
	"check the network and the proxy of apt (apt-config dump)" >&2
exit 1
