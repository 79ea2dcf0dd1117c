#!/bin/sh
# SPDX-License-Identifier: GPL-3.0-or-later
#
# What an update file has beside its images: SWUpdate runs it on the board, once all of the file is known to be good.
# update-script.sh preinst|postinst SLOT KERNEL-BYTES KERNEL-SHA256 TREE-BYTES TREE-SHA256 DATA-FORMAT
#
# The slot's tree is the first thing that is erased and the last that is written: a slot that is in between has none,
# and U-Boot passes over it. So it never starts a new kernel with an old tree.
#

partition() {
	sed -n "s/^mtd\([0-9]*\):.* \"$1\"\$/\/dev\/mtd\1/p" /proc/mtd | grep .
}

# read_back PARTITION BYTES SHA256
read_back() {
	sum=$(nanddump -l "$2" "$(partition "$1")" | head -c "$2" | sha256sum)
	[ "${sum%% *}" = "$3" ] || {
		echo "$1 is not read back as it was written" >&2
		exit 1
	}
}

# The version that runs must be able to read /data again if it has to come back.
check_data_format() {
	reads=$(sed -n 's/^reads=//p' /usr/share/openrtu/data-format)
	[ "$1" -le "$reads" ] || {
		echo "it writes data format $1, and what runs reads up to $reads" >&2
		exit 1
	}
}

case $1 in
preinst)
	check_data_format "$7"
	: >"$TMPDIR/begun"
	flash_eraseall -q "$(partition trial)" && flash_eraseall -q "$(partition "tree-$2")"
	;;
postinst)
	read_back "kernel-$2" "$3" "$4"
	read_back "tree-$2" "$5" "$6"
	;;
esac
