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

# private_apt_root FOLDER [ARCHITECTURE]: an empty root, its apt.conf; more settings are the caller's to append.
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
	if [[ -n ${2:-} ]]; then
		cat >>"$1/apt.conf" <<-END
			APT::Architecture "$2";
			APT::Architectures { "$2"; };
		END
	fi
}

# private_apt_fetch FOLDER deb|deb-src WHAT COMMAND...: an apt-get command, run in the root's cache, with the first mirror
# that gives all of it. The mirror is the root's only source, and signed by Debian: a third party's repository can have a
# suite of the same name.
private_apt_fetch() {
	local root=$1 kind=$2 what=$3 mirror mirrors
	shift 3
	mapfile -t mirrors < <(private_apt_mirrors)
	local -x APT_CONFIG=$root/apt.conf
	for mirror in "${mirrors[@]}"; do
		echo "$kind [signed-by=$private_apt_keyring] $mirror $private_apt_suite main" >"$root/etc/sources.list"
		if apt-get -qq update && (cd "$root/cache" && "$@"); then
			return
		fi
	done
	echo "setup: no mirror of this machine (${mirrors[*]:-none found}) gave $what of Debian $private_apt_suite;" \
		"check the network and the proxy of apt (apt-config dump)" >&2
	return 1
}
