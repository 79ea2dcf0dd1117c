# shellcheck shell=bash disable=SC2034,SC2154
# SPDX-License-Identifier: GPL-3.0-or-later
# libmicrohttpd. Debian's own package is linked with GnuTLS, which brings seven more libraries. rtu-web has TLS from OpenSSL,
# in front of the library, and has the library in itself.
into_sysroot=yes
cflags+=" -fPIE -ffunction-sections -fdata-sections"
options=("--host=${prefix%-}" --enable-static --disable-shared --disable-https --disable-bauth --disable-dauth
	--disable-postprocessor --disable-messages --disable-doc --disable-examples --disable-curl --disable-httpupgrade
	--enable-epoll --disable-sendfile)

build() {
	configure
	compile -C src/microhttpd libmicrohttpd.la
	install -D -m 644 src/include/microhttpd.h "$folder/root/usr/include/microhttpd.h"
	library src/microhttpd/.libs/libmicrohttpd.a libmicrohttpd "libmicrohttpd without TLS, static" -lmicrohttpd
}
