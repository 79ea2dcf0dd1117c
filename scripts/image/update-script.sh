#!/bin/sh
# SPDX-License-Identifier: GPL-3.0-or-later
#
# What an update file has beside its images: SWUpdate runs it on the board, once all of the file is known to be good.
# update-script.sh preinst|postinst SLOT KERNEL-BYTES KERNEL-SHA256 TREE-BYTES TREE-SHA256 DATA-FORMAT \
#   [ROOT-BYTES ROOT-SHA256 VOLUME-BYTES]
#
# The slot's tree is the first thing that is erased and the last that is written: a slot that is in between has none,
# and U-Boot passes over it. So it never starts a new kernel with an old tree, or with an old root in UBI.
#

partition() {
	sed -n "s/^mtd\([0-9]*\):.* \"$1\"\$/\/dev\/mtd\1/p" /proc/mtd | grep .
}

fail() {
	echo "$*" >&2
	exit 1
}

# same NAME SHA256: what comes from the standard input
same() {
	sum=$(sha256sum)
	[ "${sum%% *}" = "$2" ] || fail "$1 is not read back as it was written"
}

# read_back PARTITION BYTES SHA256
read_back() {
	nanddump -l "$2" "$(partition "$1")" | head -c "$2" | same "$1" "$3" || exit
}

# The UBI device of the partition for it, as ubi0.
ubi() {
	device=$(partition rootfs) &&
		grep -lx "${device#/dev/mtd}" /sys/class/ubi/ubi*/mtd_num | sed 's,^/sys/class/ubi/\(.*\)/mtd_num$,\1,' | grep .
}

# The device of a slot's volume in it.
volume() {
	grep -lx "root_$2" /sys/class/ubi/"$1"_*/name | sed 's,^/sys/class/ubi/\(.*\)/name$,/dev/\1,' | grep .
}

# has_room UBI BYTES
has_room() {
	cd "/sys/class/ubi/$1" && [ $(($(cat avail_eraseblocks) * $(cat eraseblock_size))) -ge "$2" ]
}

# check_place SLOT VOLUME-BYTES: of a root in UBI.
check_place() {
	grep -q " openrtu.root=" /proc/cmdline || fail "no place for a root in UBI: the boot command does not know one"
	ubi=$(ubi) || fail "no place for a root in UBI: there is no UBI"
	volume "$ubi" "$1" >/dev/null || has_room "$ubi" "$2" ||
		fail "no place for a root in UBI: it has no room for a volume of $(($2 / 1048576)) MiB"
}

# The version that runs must be able to read /data again if it has to come back.
check_data_format() {
	reads=$(sed -n 's/^reads=//p' /usr/share/openrtu/data-format)
	[ "$1" -le "$reads" ] || fail "it writes data format $1, and what runs reads up to $reads"
}

case $1 in
preinst)
	check_data_format "$7"
	[ $# -eq 7 ] || check_place "$2" "${10}"
	: >"$TMPDIR/begun"
	flash_eraseall -q "$(partition trial)" && flash_eraseall -q "$(partition "tree-$2")"
	;;
postinst)
	read_back "kernel-$2" "$3" "$4"
	read_back "tree-$2" "$5" "$6"
	[ $# -eq 7 ] || head -c "$8" "$(volume "$(ubi)" "$2")" | same "root_$2" "$9" || exit
	;;
esac
