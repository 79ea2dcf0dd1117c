#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# post-build.sh [TARGET]: what Buildroot runs before it makes the file-system images. The settings of a site, from the
# folder SITE_SETTINGS; configs/README.md names the files. Without TARGET it only checks them. NUC980_BOARD names the board, if it
# is not the gateway; boards/NUC980_BOARD/interfaces are its addresses unless the site has some.
set -euo pipefail
shopt -s nullglob

target=${1:-}
tree=$(realpath -e "$(dirname "$0")/../..")
board=${NUC980_BOARD:-gateway}
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

# What is judged on the board too, by the same words: rtu-site. A gateway of this machine knows about its configuration.
check_settings() {
	local file why
	for file in "$site"/*; do
		[ -f "$file" ] || continue
		why=$(RTUD=$tree/build/native/rtud/rtud "$tree/board/nuc980/rootfs-overlay/usr/sbin/rtu-site" check "${file##*/}" "$file") ||
			fail "$file: $why"
	done
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

# Which OpenRTU it is, in os-release(5)'s words for that; Buildroot's own lines stay. An image that takes updates is newer than
# each before it: its version has the next number of its site.
name_image() {
	local version number=
	[ -f "$target/etc/os-release" ] || return 0
	sed -i --follow-symlinks '/^IMAGE_/d' "$target/etc/os-release"
	if [ -f "$site/update.pem" ]; then
		number=$((10#$(cat "$site/update-number" 2>/dev/null || echo 0) + 1))
	fi
	version=$(PYTHONPATH="$tree/scripts" python3 -m release.version swupdate ${number:+--build "$number"})
	printf 'IMAGE_ID=openrtu\nIMAGE_VERSION=%s\n' "$version" >>"$target/etc/os-release"
	[ -z "$number" ] || echo "$number" >"$site/update-number"
}

check_update_number() {
	[ -f "$site/update-number" ] || return 0
	[[ $(<"$site/update-number") =~ ^[0-9]{1,5}$ ]] ||
		fail "$site/update-number is not the number of the site's last image that takes updates: at most 65535"
}

# Updates are for a board and a site: SWUpdate compares both with what is in the file.
check_update() {
	[ -f "$site/update.pem" ] || return 0
	grep -q '^-----BEGIN CERTIFICATE-----$' "$site/update.pem" ||
		fail "$site/update.pem has no certificate: docs/update.md tells how to make one"
	[[ ${site##*/} =~ ^[A-Za-z0-9._-]+$ ]] ||
		fail "$site: the folder's name is the site's in its updates, of letters, digits, '.', '_' and '-'"
}

# A board asks its own server only, over HTTPS, and shows a word that the server knows.
check_update_server() {
	[ -f "$site/update-server" ] || return 0
	[ -f "$site/update.pem" ] || fail "$site/update-server: boards without update.pem take no updates (docs/update.md)"
	grep -q '^-----BEGIN CERTIFICATE-----$' "$site/update-server.pem" 2>/dev/null ||
		fail "$site/update-server: update-server.pem must have the certificate of who signs the server's"
	! wrong=$(grep -vE '^(url https://[A-Za-z0-9.:[_-]+]?(/[A-Za-z0-9._~-]+)+|token (Gateway|Target)Token [A-Za-z0-9._~+/=-]+)$' \
		"$site/update-server") ||
		fail "$site/update-server: \"$wrong\" is neither \"url https://SERVER/TENANT/controller/v1\" nor \"token GatewayToken WORD\""
	[ "$(cut -d ' ' -f 1 "$site/update-server" | sort | paste -sd ' ')" = "token url" ] ||
		fail "$site/update-server: it must have a line with \"url\" and one with \"token\""
}

name_site() {
	[ -f "$site/update.pem" ] || return 0
	install -D -m 644 "$site/update.pem" "$target/etc/openrtu/update.pem"
	echo "nuc980-$board ${site##*/}" >"$target/etc/hwrevision"
}

check_site() {
	[ -d "$site" ] || fail "SITE_SETTINGS: $site is not a folder"
	for file in "$site"/*; do
		case ${file##*/} in
		config.json | interfaces | authorized_keys | hostname | ntp | root-password | macs | update.pem | update-number | update-server | update-server.pem) ;;
		board-ip | environment*.txt | flash-*) ;; # nuc980-netboot's, which shares the folder
		*) fail "$file is not a setting of a site: configs/README.md lists them" ;;
		esac
	done
	check_settings
	check_root_password
	check_update
	check_update_number
	check_update_server
}

[ -z "$site" ] || check_site
[ -n "$target" ] || exit 0

# The agent is there for the SNMP module that is to use it; started as it is, it would listen for nobody.
rm -f "$target/etc/init.d/S59snmpd"

# Nothing writes U-Boot's environment in service.
rm -f "$target"/usr/{bin,sbin}/fw_setenv

# It would write a seed onto the root at each start, by an applet that BusyBox 1.35 lacks: S00random gathers.
rm -f "$target/etc/init.d/S01seedrng"

# rtu-update runs SWUpdate for one file at a time; started as it is, it would wait for updates of anybody on the board.
rm -rf "$target/etc/init.d/S80swupdate" "$target/usr/lib/swupdate" "$target/etc/swupdate"

# Buildroot's own would start chronyd without servers, too: S45chronyd does not.
rm -f "$target"/etc/init.d/S49chrony*

# A gateway without one of its programs runs the others; who builds it is to know that before a board has it.
check_programs() {
	local lacks
	if [ ! -d "$target/usr/libexec/openrtu" ] || lacks=$(PYTHONPATH="$tree/scripts" python3 -m image.gateway "$site" "$target"); then
		return 0
	fi
	fail "$site/config.json needs what this image has not: ${lacks//$'\n'/ }: choose its option (BR2_PACKAGE_OPENRTU_…), or another image"
}

[ -z "$site" ] || check_programs
name_image

# Buildroot's own would make a key of each kind, on the root and before rtud: S85sshd does not.
rm -f "$target/etc/init.d/S50sshd"

# Those of the overlay name both ports of the gateway.
interfaces=$tree/board/nuc980/boards/$board/interfaces
[ ! -f "$interfaces" ] || install -D -m 644 "$interfaces" "$target/etc/network/interfaces"

# Where S15data mounts the data.
install -d "$target/data"

# A setting of an earlier build must not stay.
rm -rf "$target/etc/openrtu" "$target/root/.ssh" "$target/etc/chrony" "$target/etc/hwrevision"
[ -n "$site" ] || exit 0

place config.json 644 etc/openrtu/gateway.json
place ntp 644 etc/chrony/site.conf
place interfaces 644 etc/network/interfaces
place hostname 644 etc/hostname
place authorized_keys 600 root/.ssh/authorized_keys
[ ! -d "$target/root/.ssh" ] || chmod 700 "$target/root/.ssh"
place update-server 600 etc/openrtu/update-server
place update-server.pem 644 etc/openrtu/update-server.pem
set_root_password
name_site
