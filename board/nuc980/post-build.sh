#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# post-build.sh [TARGET]: what Buildroot runs before it makes the file-system images. The settings of a site, from the
# folder SITE_SETTINGS; configs/README.md names the files. Without TARGET it only checks them.
set -euo pipefail
shopt -s nullglob

target=${1:-}
tree=$(realpath -e "$(dirname "$0")/../..")
site=${SITE_SETTINGS:-}

fail() {
	echo "post-build: $*" >&2
	exit 1
}

# place FILE MODE DESTINATION: into the root file system, when the site has the file.
place() {
	if [ -f "$site/$1" ]; then
		install -D -m "$2" "$site/$1" "$target/$3"
	fi
}

# In chrony's own words; any other directive, as "allow", would be a setting of the image.
check_ntp() {
	[ -f "$site/ntp" ] || return 0
	! wrong=$(grep -vE '^((server|pool) [^ ]|#|$)' "$site/ntp") ||
		fail "$site/ntp: \"$wrong\" does not name a server: write \"server ADDRESS iburst\" or \"pool ADDRESS iburst\", one a line"
	grep -qE '^(server|pool) ' "$site/ntp" || fail "$site/ntp names no server: write \"server ADDRESS iburst\" or \"pool ADDRESS iburst\""
}

check_root_password() {
	[ -f "$site/root-password" ] || return 0
	[[ $(<"$site/root-password") =~ ^\$[0-9a-z]+\$[./0-9A-Za-z$=,]+$ ]] ||
		fail "$site/root-password is not a hash of crypt(5): make one with \"openssl passwd -6\""
}

set_root_password() {
	[ -f "$site/root-password" ] || return 0
	sed -i "s|^root:[^:]*:|root:$(<"$site/root-password"):|" "$target/etc/shadow"
}

# Which OpenRTU it is, in os-release(5)'s words for that; Buildroot's own lines stay.
name_image() {
	[ -f "$target/etc/os-release" ] || return 0
	sed -i --follow-symlinks '/^IMAGE_/d' "$target/etc/os-release"
	printf 'IMAGE_ID=openrtu\nIMAGE_VERSION=%s\n' "$(<"$tree/package/openrtu/src/VERSION")" >>"$target/etc/os-release"
}

check_site() {
	[ -d "$site" ] || fail "SITE_SETTINGS: $site is not a folder"
	for file in "$site"/*; do
		case ${file##*/} in
		config.json | interfaces | authorized_keys | ntp | root-password | macs) ;;
		*) fail "$file is not a setting of a site: configs/README.md lists them" ;;
		esac
	done
	check_ntp
	check_root_password
}

[ -z "$site" ] || check_site
[ -n "$target" ] || exit 0

# The agent is there for the SNMP module that is to use it; started as it is, it would listen for nobody.
rm -f "$target/etc/init.d/S59snmpd"

# Buildroot's own would start chronyd without servers, too: S45chronyd does not.
rm -f "$target"/etc/init.d/S49chrony*

name_image

# Buildroot's own would make a key of each kind, on the root and before rtud: S85sshd does not.
rm -f "$target/etc/init.d/S50sshd"

# Where S15data mounts the data.
install -d "$target/data"

# A setting of an earlier build must not stay.
rm -rf "$target/etc/openrtu" "$target/root/.ssh" "$target/etc/chrony"
[ -n "$site" ] || exit 0

place config.json 644 etc/openrtu/gateway.json
place ntp 644 etc/chrony/site.sources
place interfaces 644 etc/network/interfaces
place authorized_keys 600 root/.ssh/authorized_keys
[ ! -d "$target/root/.ssh" ] || chmod 700 "$target/root/.ssh"
set_root_password
