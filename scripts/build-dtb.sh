#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-dtb.sh SOURCE DTB [SWITCH=0|1 ...]: compiles a device tree; a warning is an error.
# build-dtb.sh --check SOURCE [SWITCH=0|1 ...]: says whether SOURCE has these switches.
set -euo pipefail

if [[ $1 == --check ]]; then
	source=$2 dtb=
else
	source=$1 dtb=$2
fi
shift 2
switches=$(sed -n 's/^#ifndef //p' "$source" | paste -sd ' ')
for switch in "$@"; do
	if [[ ! $switch =~ ^([A-Z_]+)=[01]$ || " $switches " != *" ${BASH_REMATCH[1]} "* ]]; then
		echo "$switch: $source has the switches ${switches:-none}; each is 0 or 1, as in NAME=1" >&2
		exit 2
	fi
done
[[ -n $dtb ]] || exit 0

mkdir -p "$(dirname "$dtb")"
log=$(mktemp)
trap 'rm -f "$log"' EXIT

# Two devices that share an address, as smart card and its UART do, are wrong only when both are on. dtc 1.6.1 has no
# -Werror, so whatever it says is one.
cpp -Werror -nostdinc -undef -D__DTS__ "${@/#/-D}" -x assembler-with-cpp -I "$(dirname "$source")" "$source" |
	dtc -I dts -O dtb -o "$dtb.new" -Wdeprecated_gpio_property -Wno-unique_unit_address \
		-Wunique_unit_address_if_enabled - 2>"$log" || echo "not compiled" >>"$log"
if [[ -s $log ]]; then
	rm -f "$dtb.new"
	cat "$log" >&2
	exit 1
fi
mv "$dtb.new" "$dtb"
echo "$dtb: $(stat --format=%s "$dtb") bytes"
