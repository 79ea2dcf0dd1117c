#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-swupdate.sh DEBIAN FOLDER: SWUpdate for the gateway board, from Debian's unpacked source.
#
# Debian's own package brings libcurl, libarchive, Lua, a web server and U-Boot's environment. What is in ours says
# board/nuc980/swupdate.config.
# FOLDER/root gets usr/bin/swupdate, stripped.
set -euo pipefail

debian=$(realpath -e "$1")
folder=$(realpath -m "$2")
tree=$(realpath -e "$(dirname "$0")/..")
config=$tree/board/nuc980/swupdate.config
sysroot=$tree/build/arm-sysroot
prefix=${CROSS_COMPILE:-arm-linux-gnueabi-}
# Marked as the gateway's own programs are (package/openrtu/src/meson.build), with time beyond 2038.
cflags="--sysroot=$sysroot -march=armv5te -mfloat-abi=soft -marm -Os -fPIC -fstack-protector-strong -D_FORTIFY_SOURCE=2"
cflags+=" -D_TIME_BITS=64 -D_FILE_OFFSET_BITS=64"
ldflags="--sysroot=$sysroot -Wl,-z,relro -Wl,-z,now"
# It asks for each library by such a variable, and takes for there what is not "n".
absent=(LUA LIBARCHIVE LIBCURL LIBFDISK LIBBLKID LIBGPIOD LIBEXT2FS LIBZEROMQ LIBSYSTEMD ZLIB ZSTD ZCK WOLFSSL
	MBEDTLS P11KIT JSON_C LIBWEBSOCKETS LIBRSYNC URIPARSER)

inputs() {
	echo "$debian $prefix $cflags $ldflags ${absent[*]}"
	sha256sum "$debian/debian/changelog" "$config" "$tree/scripts/build-swupdate.sh"
}

# The settings that SWUpdate did not take over.
lost() {
	grep -E '^CONFIG_' "$config" | grep -vxFf .config || true
}

build() {
	local without=("${absent[@]/%/=n}")
	local make=(make "${without[@]/#/HAVE_}" "CROSS_COMPILE=$prefix" "SWU_VER=$(dpkg-parsechangelog --show-field Version)"
		"CONFIG_EXTRA_CFLAGS=$cflags" "CONFIG_EXTRA_LDFLAGS=$ldflags")
	cp "$config" configs/openrtu_defconfig
	"${make[@]}" allnoconfig
	"${make[@]}" openrtu_defconfig
	if [[ -n $(lost) ]]; then
		echo "$config has lines that this SWUpdate does not take ($debian.dsc names its version):"
		lost
		exit 1
	fi >&2
	"${make[@]}" --jobs="$(nproc)" swupdate
	install -D -m 755 swupdate "$folder/root/usr/bin/swupdate"
	"${prefix}strip" "$folder/root/usr/bin/swupdate"
}

if [[ -e $folder/inputs && $(inputs) == "$(<"$folder/inputs")" ]]; then
	exit 0
fi
rm -rf "$folder/build" "$folder/root" "$folder/inputs"
mkdir -p "$folder/build"
cp -a "$debian/." "$folder/build"
(cd "$folder/build" && build)
inputs >"$folder/inputs"
