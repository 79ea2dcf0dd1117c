# SPDX-License-Identifier: GPL-3.0-or-later
# shellcheck shell=bash
# Sourced: an apt root of one's own. It knows the mirrors of this machine, and neither touches the host's apt nor needs root.

private_apt_keyring=/usr/share/keyrings/debian-archive-keyring.gpg
private_apt_suite=$(sed -n 's/^VERSION_CODENAME=//p' /etc/os-release)

# The mirrors that the host's sources name for this suite. `apt-get indextargets` would need an updated host.
private_apt_mirrors() {
	apt-get update --print-uris -o Debug::NoLocking=1 |
		sed -n "s|^'\(.*\)/dists/$private_apt_suite/InRelease'.*|\1|p" | sort -u
}

# private_apt_root FOLDER: an empty root, its apt.conf; more settings are the caller's to append.
# The host's apt.conf.d is not read with a Dir of one's own: its proxy would be lost.
private_apt_root() {
	mkdir -p "$1"/etc/{apt.conf.d,preferences.d} "$1"/lists/partial "$1"/cache/archives/partial
	: >"$1/status"
	apt-config dump | grep -E '^Acquire::https?::' >"$1/apt.conf" || true
	cat >>"$1/apt.conf" <<-END
		APT::Sandbox::User "root";
		Dir "$1";
		Dir::Etc "etc";
		Dir::State "$1";
		Dir::State::status "$1/status";
		Dir::Cache "cache";
	END
}

# private_apt_source FOLDER deb|deb-src MIRROR: the only source of the root.
# Signed by Debian: a third party's repository can have a suite of the same name.
private_apt_source() {
	echo "$2 [signed-by=$private_apt_keyring] $3 $private_apt_suite main" >"$1/etc/sources.list"
}
