#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# post-image.sh IMAGES: what Buildroot runs at the end. The board's MAC addresses into the device tree, the manifest,
# which refuses what the board could not boot, and the folder for nuc980-netboot.
set -euo pipefail
shopt -s inherit_errexit

images=$1
board=$(realpath "$(dirname "$0")")
macs=${OPENRTU_SITE:+$OPENRTU_SITE/macs}
tree=$images/nuc980-gateway.dtb

fail() {
	echo "post-image: $*" >&2
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

# The vendor's drivers take them from the kernel's arguments only; without, all boards have the same pair.
mac_arguments() {
	local eth0 eth1
	eth0=$(mac_of eth0)
	eth1=$(mac_of eth1)
	[ "${eth0,,}" != "${eth1,,}" ] || fail "$macs gives both ports $eth0"
	echo " ethaddr0=$eth0 ethaddr1=$eth1"
}

# What an earlier build put there goes first: this one may be for another site.
arguments=$("$HOST_DIR/bin/fdtget" -t s -d "" "$tree" /chosen bootargs | sed -E 's/ ?ethaddr[01]=[^ ]*//g')
if [ -f "$macs" ]; then
	arguments+=$(mac_arguments)
fi
"$HOST_DIR/bin/fdtput" -p -t s "$tree" /chosen bootargs "${arguments# }"

# Nothing of an image that is refused is left where nuc980-netboot looks.
rm -rf "$images/netboot"
"$board/../../scripts/image/manifest.py" --images "$images" --config "$BR2_CONFIG" \
	--limits "$board/image-limits.toml" --out "$images/manifest.json"
install -D -m 644 -t "$images/netboot" "$images/uImage" "$tree" "$images/manifest.json"
