# shellcheck shell=bash disable=SC2034,SC2154
# SPDX-License-Identifier: GPL-3.0-or-later
# Net-SNMP with its own agent, for `make bench`: it goes nowhere.
# shellcheck source=scripts/for-board/net-snmp.sh
. "$rows/net-snmp.sh"
files+=("$rows/net-snmp.sh")
into_sysroot=no
options+=(--enable-agent --enable-mini-agent --enable-snmpv1 --enable-snmpv2c
	"--with-mib-modules=snmpv3mibs mibII/vacm_vars mibII/vacm_conf")

build() {
	configure
	compile -C snmplib
	compile -C agent libnetsnmpagent.la libnetsnmpmibs.la
}
