#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-for-board.sh NAME DEBIAN FOLDER: a program or a library of others for the gateway board, from Debian's unpacked source.
#
# scripts/for-board/NAME.sh says why it is not Debian's own package and what is in it: its options, the files that they are
# read from, and a function `build`, which runs in a copy of the source and calls the functions below. FOLDER/root gets what the
# board does; of a library (into_sysroot=yes) the sysroot that the gateway is built against does, too.
set -euo pipefail

debian=$(realpath -e "$2")
folder=$(realpath -m "$3")
tree=$(realpath -e "$(dirname "$0")/..")
rows=$tree/scripts/for-board
sysroot=$tree/build/arm-sysroot
prefix=${CROSS_COMPILE:-arm-linux-gnueabi-}
# As the gateway's own programs are compiled (package/openrtu/src/meson.build), with time beyond 2038.
cflags="-march=armv5te -mfloat-abi=soft -marm -Os -fstack-protector-strong"
cppflags="-D_FORTIFY_SOURCE=2 -D_TIME_BITS=64 -D_FILE_OFFSET_BITS=64"
ldflags="-Wl,-z,relro -Wl,-z,now"
options=()
files=("$rows/$1.sh")
config=
given=()
into_sysroot=no
# shellcheck source=/dev/null
. "$rows/$1.sh"

inputs() {
	echo "$debian $prefix"
	sha256sum "$debian/debian/changelog" "$0" "${files[@]}"
}

# The host's pkg-config would name the host's libraries.
configure() {
	CC="${prefix}gcc --sysroot=$sysroot" AR="${prefix}ar" RANLIB="${prefix}ranlib" PKG_CONFIG=false \
		CFLAGS="$cflags" CPPFLAGS="$cppflags" LDFLAGS="$ldflags" ./configure --prefix=/usr "${options[@]}"
}

# compile MAKE'S WORDS...
compile() {
	make --jobs="$(nproc)" "$@"
}

# kconfig GOAL...: with what Kconfig of BusyBox and of SWUpdate calls them. ${given[@]} is the row's.
kconfig() {
	compile "CROSS_COMPILE=$prefix" "CONFIG_EXTRA_CFLAGS=--sysroot=$sysroot $cflags $cppflags" \
		"CONFIG_EXTRA_LDFLAGS=--sysroot=$sysroot $ldflags" "${given[@]}" "$@"
}

# Ends if there is a setting of $config that .config has not taken over.
refuse_lost() {
	local lost
	lost=$(grep -E '^CONFIG_' "$config" | grep -vxFf .config) || return 0
	printf '%s has lines that this release does not take (%s.dsc names it):\n%s\n' "$config" "$debian" "$lost" >&2
	exit 1
}

# program FILE PATH
program() {
	install -D -m 755 "$1" "$folder/root/$2"
	"${prefix}strip" "$folder/root/$2"
}

# library FILE NAME DESCRIPTION LINKED: NAME.pc of the source has its version.
library() {
	local to=usr/lib/arm-linux-gnueabi
	install -D -m 644 "$1" "$folder/root/$to/$(basename "$1")"
	mkdir -p "$folder/root/$to/pkgconfig"
	cat >"$folder/root/$to/pkgconfig/$2.pc" <<-END
		Name: $2
		Description: $3
		Version: $(sed -n 's/^Version: //p' "$2.pc")
		Cflags: -I/usr/include
		Libs: -L/$to $4
	END
}

if ! [[ -e $folder/inputs && $(inputs) == "$(<"$folder/inputs")" ]]; then
	rm -rf "$folder/build" "$folder/root" "$folder/inputs"
	mkdir -p "$folder/build" "$folder/root"
	cp -a "$debian/." "$folder/build"
	(
		cd "$folder/build"
		SOURCE_DATE_EPOCH=$(dpkg-parsechangelog --show-field Timestamp)
		# BusyBox tells that date in the time zone of whoever builds it.
		export SOURCE_DATE_EPOCH TZ=UTC LC_ALL=C
		umask 022
		build
	)
	inputs >"$folder/inputs"
fi
[[ $into_sysroot == no ]] || cp -R "$folder/root/." "$sysroot/"
