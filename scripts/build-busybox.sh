#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-busybox.sh DEBIAN FOLDER: BusyBox for the gateway board, from Debian's unpacked source.
#
# What is in it says board/nuc980/busybox.config.
# FOLDER gets busybox, stripped, and busybox.links, the paths of its applets.
set -euo pipefail

debian=$(realpath -e "$1")
folder=$(realpath -m "$2")
tree=$(realpath -e "$(dirname "$0")/..")
config=$tree/board/nuc980/busybox.config
sysroot=$tree/build/arm-sysroot
prefix=${CROSS_COMPILE:-arm-linux-gnueabi-}
# Marked as the gateway's own programs are (package/openrtu/src/meson.build), with time beyond 2038.
cflags="--sysroot=$sysroot -march=armv5te -mfloat-abi=soft -marm -Os -fstack-protector-strong -D_FORTIFY_SOURCE=2"
cflags+=" -D_TIME_BITS=64 -D_FILE_OFFSET_BITS=64"
ldflags="--sysroot=$sysroot -Wl,-z,relro -Wl,-z,now"

inputs() {
	echo "$debian $prefix $cflags $ldflags"
	sha256sum "$debian/debian/changelog" "$config" "$tree/scripts/build-busybox.sh"
}

# configure MAKE...: our lines instead of those that are off.
configure() {
	local off=$folder/build/.config.off
	"$@" allnoconfig
	mv "$folder/build/.config" "$off"
	sed -nE 's/^(CONFIG_[A-Z0-9_]+)=.*/\1/p' "$config" | grep -vwFf - "$off" | cat - "$config" >"$folder/build/.config"
	"$@" oldconfig </dev/null
}

# The settings that BusyBox did not take over.
lost() {
	grep -E '^CONFIG_' "$config" | grep -vxFf "$folder/build/.config" || true
}

build() {
	local make=(make --directory="$debian" "O=$folder/build" "CROSS_COMPILE=$prefix"
		"CONFIG_EXTRA_CFLAGS=$cflags" "CONFIG_EXTRA_LDFLAGS=$ldflags")
	SOURCE_DATE_EPOCH=$(dpkg-parsechangelog --file "$debian/debian/changelog" --show-field Timestamp)
	export SOURCE_DATE_EPOCH
	rm -rf "$folder/build"
	mkdir -p "$folder/build"
	configure "${make[@]}"
	if [[ -n $(lost) ]]; then
		echo "$config has lines that this BusyBox does not take ($debian.dsc names its version):"
		lost
		exit 1
	fi >&2
	# One goal after the other: its Makefile would run both at once, and each probe for libcrypt removes the other's file.
	"${make[@]}" --jobs="$(nproc)" busybox
	"${make[@]}" busybox.links
	install --target-directory="$folder" "$folder/build"/{busybox,busybox.links}
}

if [[ -e $folder/inputs && $(inputs) == "$(<"$folder/inputs")" ]]; then
	exit 0
fi
mkdir -p "$folder"
rm -f "$folder/inputs"
build
inputs >"$folder/inputs"
