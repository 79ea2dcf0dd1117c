#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-curl.sh DEBIAN FOLDER: curl for the gateway board, from Debian's unpacked source.
#
# Debian's own package would bring 20 libraries, for protocols that no update server speaks. Ours speaks HTTPS and HTTP,
# and names OpenSSL alone. No folder of certificates is built in: who may serve says the site.
# FOLDER/root gets usr/bin/curl, stripped.
set -euo pipefail

debian=$(realpath -e "$1")
folder=$(realpath -m "$2")
tree=$(realpath -e "$(dirname "$0")/..")
sysroot=$tree/build/arm-sysroot
prefix=${CROSS_COMPILE:-arm-linux-gnueabi-}
# Marked as the gateway's own programs are (package/openrtu/src/meson.build), with time beyond 2038.
cflags="-march=armv5te -mfloat-abi=soft -marm -Os -fPIE -fstack-protector-strong"
cppflags="-D_FORTIFY_SOURCE=2 -D_TIME_BITS=64 -D_FILE_OFFSET_BITS=64"
ldflags="-pie -Wl,-z,relro -Wl,-z,now"
options=("--host=${prefix%-}" --prefix=/usr --disable-shared --enable-static --with-openssl --without-ca-bundle --without-ca-path)
for part in ftp file ldap ldaps rtsp dict telnet tftp pop3 imap smb smtp gopher mqtt manual ntlm ntlm-wb tls-srp \
	unix-sockets alt-svc hsts doh netrc cookies proxy ares crypto-auth get-easy-options dnsshuffle libcurl-option \
	dependency-tracking; do
	options+=("--disable-$part")
done
for library in zlib brotli zstd libpsl libidn2 nghttp2 librtmp libssh2 libgsasl; do
	options+=("--without-$library")
done

inputs() {
	echo "$debian $prefix $cflags $cppflags $ldflags ${options[*]}"
	sha256sum "$debian/debian/changelog" "$tree/scripts/build-curl.sh"
}

build() {
	rm -rf "$folder/build" "$folder/root"
	mkdir -p "$folder/build"
	cp -a "$debian/." "$folder/build"
	cd "$folder/build"
	# The host's pkg-config would name the host's OpenSSL.
	CC="${prefix}gcc --sysroot=$sysroot" CFLAGS="$cflags" CPPFLAGS="$cppflags" LDFLAGS="$ldflags" \
		PKG_CONFIG=false ./configure "${options[@]}"
	make --jobs="$(nproc)" -C lib
	make --jobs="$(nproc)" -C src
	install -D -m 755 src/curl "$folder/root/usr/bin/curl"
	"${prefix}strip" "$folder/root/usr/bin/curl"
}

if [[ -e $folder/inputs && $(inputs) == "$(<"$folder/inputs")" ]]; then
	exit 0
fi
mkdir -p "$folder"
rm -f "$folder/inputs"
(build)
inputs >"$folder/inputs"
