#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# post-build.sh TARGET: what Buildroot runs before it makes the file-system images. The settings of a site, from the
# folder OPENRTU_SITE; configs/README.md names the files.
set -euo pipefail
shopt -s nullglob

target=$1
site=${OPENRTU_SITE:-}

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
		fail "$site/ntp: \"$wrong\" is no server: \"server ADDRESS iburst\", or pool, one a line"
	grep -qE '^(server|pool) ' "$site/ntp" || fail "$site/ntp names no server: \"server ADDRESS iburst\", or pool"
}

set_root_password() {
	[ -f "$site/root-password" ] || return 0
	hash=$(<"$site/root-password")
	[[ $hash =~ ^\$[0-9a-z]+\$[./0-9A-Za-z$=,]+$ ]] ||
		fail "$site/root-password is no hash of crypt(5): make one with \"openssl passwd -6\""
	sed -i "s|^root:[^:]*:|root:$hash:|" "$target/etc/shadow"
}

# The agent is there for the SNMP module that is to use it; started as it is, it would listen for nobody.
rm -f "$target/etc/init.d/S59snmpd"

# Buildroot's own would start chronyd without servers, too: S45chronyd does not.
rm -f "$target"/etc/init.d/S49chrony*

# Where S15data mounts the data.
install -d "$target/data"

# A setting of an earlier build must not stay.
rm -rf "$target/etc/openrtu" "$target/root/.ssh" "$target/etc/chrony"
[ -n "$site" ] || exit 0

[ -d "$site" ] || fail "OPENRTU_SITE: $site is no folder"
for file in "$site"/*; do
	case ${file##*/} in
	config.json | interfaces | authorized_keys | ntp | root-password | macs) ;;
	*) fail "$file is no setting of a site: configs/README.md has the list" ;;
	esac
done
check_ntp
place config.json 644 etc/openrtu/gateway.json
place ntp 644 etc/chrony/site.sources
place interfaces 644 etc/network/interfaces
place authorized_keys 600 root/.ssh/authorized_keys
[ ! -d "$target/root/.ssh" ] || chmod 700 "$target/root/.ssh"
set_root_password
