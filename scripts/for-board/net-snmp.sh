# shellcheck shell=bash disable=SC2034,SC2154
# SPDX-License-Identifier: GPL-3.0-or-later
# Net-SNMP's library. Debian's own package brings libperl, libsensors and libpci. rtu-snmp needs BER, USM and sessions over UDP,
# and has them in itself: neither an agent, nor MIBs that are read at run time, nor programs are built.
into_sysroot=yes
cflags+=" -fPIE -ffunction-sections -fdata-sections"
options=("--host=${prefix%-}" --enable-static --disable-shared --with-defaults
	--disable-agent --disable-applications --disable-manuals --disable-scripts --disable-mibs --disable-mib-loading
	--disable-embedded-perl --without-perl-modules --disable-debugging --disable-snmpv1 --disable-snmpv2c
	--with-openssl --enable-blumenthal-aes --with-transports=UDP --with-security-modules=usm
	--without-rpm --without-libwrap --without-zlib --without-nl
	--enable-ipv6 --with-endianness=little --with-logfile=none --with-persistent-directory=/var/lib/snmp)

build() {
	configure
	compile -C snmplib
	# Its own target for that configures once more.
	mkdir -p "$folder/root/usr/include"
	cp -R include/net-snmp "$folder/root/usr/include/"
	library snmplib/.libs/libnetsnmp.a netsnmp "Net-SNMP's library alone, static" "-lnetsnmp -lcrypto"
}
