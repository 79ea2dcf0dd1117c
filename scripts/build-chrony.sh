#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-chrony.sh DEBIAN FOLDER: chrony for the gateway board, from Debian's unpacked source.
#
# Debian's own package would bring GnuTLS for NTS, 5 MB of libraries that nothing else names. What is left out here is what
# a client without a clock of its own does not need. A receiver's time comes by a socket (refclock SOCK); libcap stays, so that
# it runs as a user with CAP_SYS_TIME alone.
# FOLDER/root gets usr/sbin/chronyd and usr/bin/chronyc, stripped.
set -euo pipefail

debian=$(realpath -e "$1")
folder=$(realpath -m "$2")
tree=$(realpath -e "$(dirname "$0")/..")
sysroot=$tree/build/arm-sysroot
prefix=${CROSS_COMPILE:-arm-linux-gnueabi-}
# Marked as the gateway's own programs are (package/openrtu/src/meson.build), with time beyond 2038.
cflags="--sysroot=$sysroot -march=armv5te -mfloat-abi=soft -marm -Os -fPIE -fstack-protector-strong -D_FORTIFY_SOURCE=2"
cflags+=" -D_TIME_BITS=64 -D_FILE_OFFSET_BITS=64"
ldflags="--sysroot=$sysroot -pie -Wl,-z,relro -Wl,-z,now"
options=(--prefix=/usr --localstatedir=/var --chronyrundir=/run/chrony --chronyvardir=/data/chrony
	--host-system=Linux --host-release=6.1 --host-machine=armv5tel --with-user=chrony
	--disable-nts --without-nettle --without-nss --without-tomcrypt --without-gnutls --without-editline --without-seccomp
	--disable-phc --disable-pps)

inputs() {
	echo "$debian $prefix $cflags $ldflags ${options[*]}"
	sha256sum "$debian/debian/changelog" "$tree/scripts/build-chrony.sh"
}

build() {
	rm -rf "$folder/build" "$folder/root"
	mkdir -p "$folder/build"
	cp -a "$debian/." "$folder/build"
	cd "$folder/build"
	# The compiler's path and date would be in the version that chronyd prints.
	CC="${prefix}gcc" CFLAGS="$cflags" LDFLAGS="$ldflags" ./configure "${options[@]}"
	grep -q FEAT_PRIVDROP config.h || {
		echo "chrony could not give up root: its configure has not found libcap"
		return 1
	}
	make --jobs="$(nproc)" chronyd chronyc
	install -D -m 755 chronyd "$folder/root/usr/sbin/chronyd"
	install -D -m 755 chronyc "$folder/root/usr/bin/chronyc"
	"${prefix}strip" "$folder/root/usr/sbin/chronyd" "$folder/root/usr/bin/chronyc"
}

if [[ -e $folder/inputs && $(inputs) == "$(<"$folder/inputs")" ]]; then
	exit 0
fi
mkdir -p "$folder"
rm -f "$folder/inputs"
(build)
inputs >"$folder/inputs"
