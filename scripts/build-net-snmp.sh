#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-net-snmp.sh DEBIAN FOLDER [agent]: Net-SNMP's library for the gateway board, from Debian's unpacked source.
# With "agent" it is built with its own agent for `make bench`, in FOLDER/build, and goes nowhere.
#
# Debian's own package brings libperl, libsensors and libpci. rtu-snmp needs BER, USM and sessions over UDP, and has them in
# itself: neither an agent, nor MIBs that are read at run time, nor programs are built.
# FOLDER/root gets the library, its headers and netsnmp.pc, and so does the sysroot that the gateway is built against.
set -euo pipefail

debian=$(realpath -e "$1")
folder=$(realpath -m "$2")
agent=${3:-}
tree=$(realpath -e "$(dirname "$0")/..")
sysroot=$tree/build/arm-sysroot
prefix=${CROSS_COMPILE:-arm-linux-gnueabi-}
library=usr/lib/arm-linux-gnueabi
# Marked as the gateway's own programs are (package/openrtu/src/meson.build), with time beyond 2038.
cflags="--sysroot=$sysroot -march=armv5te -mfloat-abi=soft -marm -Os -fPIE -ffunction-sections -fdata-sections"
cflags+=" -fstack-protector-strong -D_FORTIFY_SOURCE=2 -D_TIME_BITS=64 -D_FILE_OFFSET_BITS=64"
options=("--host=${prefix%-}" --prefix=/usr --enable-static --disable-shared --with-defaults
	--disable-agent --disable-applications --disable-manuals --disable-scripts --disable-mibs --disable-mib-loading
	--disable-embedded-perl --without-perl-modules --disable-debugging --disable-snmpv1 --disable-snmpv2c
	--with-openssl --enable-blumenthal-aes --with-transports=UDP --with-security-modules=usm --without-rpm --without-libwrap --without-zlib --without-nl
	--enable-ipv6 --with-endianness=little --with-logfile=none --with-persistent-directory=/var/lib/snmp)

[ -z "$agent" ] || options+=(--enable-agent --enable-mini-agent --enable-snmpv1 --enable-snmpv2c
	"--with-mib-modules=snmpv3mibs mibII/vacm_vars mibII/vacm_conf")

inputs() {
	echo "$debian $prefix $cflags ${options[*]}"
	sha256sum "$debian/debian/changelog" "$tree/scripts/build-net-snmp.sh"
}

build() {
	rm -rf "$folder/build" "$folder/root"
	mkdir -p "$folder/build"
	cp -a "$debian/." "$folder/build"
	cd "$folder/build"
	# The host's pkg-config would name the host's libraries.
	CC="${prefix}gcc" AR="${prefix}ar" RANLIB="${prefix}ranlib" CFLAGS="$cflags" LDFLAGS="--sysroot=$sysroot" \
		PKG_CONFIG=false ./configure "${options[@]}"
	make --jobs="$(nproc)" -C snmplib
	[ -z "$agent" ] || make --jobs="$(nproc)" -C agent libnetsnmpagent.la libnetsnmpmibs.la
	# Its own target for that configures once more.
	mkdir -p "$folder/root/usr/include"
	cp -R include/net-snmp "$folder/root/usr/include/"
	install -D -m 644 snmplib/.libs/libnetsnmp.a "$folder/root/$library/libnetsnmp.a"
	mkdir -p "$folder/root/$library/pkgconfig"
	cat >"$folder/root/$library/pkgconfig/netsnmp.pc" <<-END
		Name: netsnmp
		Description: Net-SNMP's library alone, static
		Version: $(sed -n 's/^Version: //p' netsnmp.pc)
		Cflags: -I/usr/include
		Libs: -L/$library -lnetsnmp -lcrypto
	END
}

if ! [[ -e $folder/inputs && $(inputs) == "$(<"$folder/inputs")" ]]; then
	mkdir -p "$folder"
	rm -f "$folder/inputs"
	(build)
	inputs >"$folder/inputs"
fi
[ -n "$agent" ] || cp -R "$folder/root/." "$sysroot/"
