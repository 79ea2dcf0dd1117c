# shellcheck shell=bash disable=SC2034,SC2154
# SPDX-License-Identifier: GPL-3.0-or-later
# chrony. Debian's own package would bring GnuTLS for NTS, 5 MB of libraries that nothing else names. What is left out here is
# what a client without a clock of its own does not need. A receiver's time comes by a socket (refclock SOCK); libcap stays,
# so that it runs as a user with CAP_SYS_TIME alone.
cflags+=" -fPIE"
ldflags+=" -pie"
options=(--localstatedir=/var --chronyrundir=/run/chrony --chronyvardir=/data/chrony
	--host-system=Linux --host-release=6.1 --host-machine=armv5tel --with-user=chrony
	--disable-nts --without-nettle --without-nss --without-tomcrypt --without-gnutls --without-editline --without-seccomp
	--disable-phc --disable-pps)

build() {
	configure
	grep -q FEAT_PRIVDROP config.h || {
		echo "chrony could not give up root: its configure has not found libcap" >&2
		exit 1
	}
	compile chronyd chronyc
	program chronyd usr/sbin/chronyd
	program chronyc usr/bin/chronyc
}
