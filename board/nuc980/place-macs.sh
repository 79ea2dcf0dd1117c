#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# place-macs.sh [DTB]: the MAC addresses of a site (SITE_SETTINGS/macs) into a device tree. Without a site it gets none, and
# loses those of another one. Without DTB it only checks the site's. The chip has two ports; a board may have one of them.
set -euo pipefail
shopt -s inherit_errexit

tree=${1:-}
macs=${SITE_SETTINGS:+$SITE_SETTINGS/macs}
tools=${HOST_DIR:+$HOST_DIR/bin/} # Buildroot has its own

fail() {
	echo "macs: $*" >&2
	exit 1
}

# mac_of PORT: its address, of one board (the first octet is even).
mac_of() {
	local mac
	mac=$(sed -n "s/^$1[[:space:]]\+//p" "$macs")
	[[ $mac =~ ^[0-9a-fA-F][02468aceACE](:[0-9a-fA-F]{2}){5}$ ]] ||
		fail "$macs has no line \"$1 XX:XX:XX:XX:XX:XX\" with the address of one board; it is \"$mac\""
	echo "$mac"
}

# node_of NUMBER: the port's node, by its alias; fails for a port that the board does not have.
node_of() {
	"${tools}fdtget" -t s "$tree" /aliases "ethernet$1" 2>/dev/null
}

# Our drivers, and U-Boot, know the property.
set_property() {
	local node
	node=$(node_of "$1") || return 0
	# shellcheck disable=SC2086 # six words
	"${tools}fdtput" -t bx "$tree" "$node" local-mac-address ${2//:/ }
}

clear_property() {
	local node
	node=$(node_of "$1") || return 0
	"${tools}fdtput" -d "$tree" "$node" local-mac-address 2>/dev/null || true
}

# The vendor's drivers take the kernel's arguments only; without, all boards have the same pair.
set_arguments() {
	local arguments
	arguments=$("${tools}fdtget" -t s -d "" "$tree" /chosen bootargs | sed -E 's/ ?ethaddr[01]=[^ ]*//g')
	arguments+=$1
	"${tools}fdtput" -p -t s "$tree" /chosen bootargs "${arguments# }"
}

if [ ! -f "$macs" ]; then
	[ -n "$tree" ] || exit 0
	clear_property 0
	clear_property 1
	set_arguments ""
	exit 0
fi
eth0=$(mac_of eth0)
eth1=$(mac_of eth1)
[ "${eth0,,}" != "${eth1,,}" ] || fail "$macs gives both ports $eth0"
[ -n "$tree" ] || exit 0
set_property 0 "$eth0"
set_property 1 "$eth1"
set_arguments " ethaddr0=$eth0 ethaddr1=$eth1"
