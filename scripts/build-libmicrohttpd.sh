#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-libmicrohttpd.sh DEBIAN FOLDER: libmicrohttpd for the gateway board, from Debian's unpacked source.
#
# Debian's own package is linked with GnuTLS, which brings seven more libraries. rtu-web has TLS from OpenSSL, in front of the
# library, and has the library in itself.
# FOLDER/root gets it, its header and libmicrohttpd.pc, and so does the sysroot that the gateway is built against.
set -euo pipefail

debian=$(realpath -e "$1")
folder=$(realpath -m "$2")
tree=$(realpath -e "$(dirname "$0")/..")
sysroot=$tree/build/arm-sysroot
prefix=${CROSS_COMPILE:-arm-linux-gnueabi-}
library=usr/lib/arm-linux-gnueabi
# Marked as the gateway's own programs are (package/openrtu/src/meson.build), with time beyond 2038.
cflags="--sysroot=$sysroot -march=armv5te -mfloat-abi=soft -marm -Os -fPIE -ffunction-sections -fdata-sections"
cflags+=" -fstack-protector-strong -D_FORTIFY_SOURCE=2 -D_TIME_BITS=64 -D_FILE_OFFSET_BITS=64"
options=("--host=${prefix%-}" --prefix=/usr --enable-static --disable-shared --disable-https --disable-bauth --disable-dauth
	--disable-postprocessor --disable-messages --disable-doc --disable-examples --disable-curl --disable-httpupgrade
	--enable-epoll --disable-sendfile)

inputs() {
	echo "$debian $prefix $cflags ${options[*]}"
	sha256sum "$debian/debian/changelog" "$tree/scripts/build-libmicrohttpd.sh"
}

build() {
	rm -rf "$folder/build" "$folder/root"
	mkdir -p "$folder/build"
	cp -a "$debian/." "$folder/build"
	cd "$folder/build"
	# The host's pkg-config would name the host's libraries.
	CC="${prefix}gcc" AR="${prefix}ar" RANLIB="${prefix}ranlib" CFLAGS="$cflags" LDFLAGS="--sysroot=$sysroot" \
		PKG_CONFIG=false ./configure "${options[@]}"
	make --jobs="$(nproc)" -C src/microhttpd libmicrohttpd.la
	install -D -m 644 src/include/microhttpd.h "$folder/root/usr/include/microhttpd.h"
	install -D -m 644 src/microhttpd/.libs/libmicrohttpd.a "$folder/root/$library/libmicrohttpd.a"
	mkdir -p "$folder/root/$library/pkgconfig"
	cat >"$folder/root/$library/pkgconfig/libmicrohttpd.pc" <<-END
		Name: libmicrohttpd
		Description: libmicrohttpd without TLS, static
		Version: $(sed -n 's/^Version: //p' libmicrohttpd.pc)
		Cflags: -I/usr/include
		Libs: -L/$library -lmicrohttpd
	END
}

if ! [[ -e $folder/inputs && $(inputs) == "$(<"$folder/inputs")" ]]; then
	mkdir -p "$folder"
	rm -f "$folder/inputs"
	(build)
	inputs >"$folder/inputs"
fi
cp -R "$folder/root/." "$sysroot/"
