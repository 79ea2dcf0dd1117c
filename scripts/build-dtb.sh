#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-dtb.sh SOURCE DTB [NAME=VALUE ...]: compiles a device tree; a warning is an error.
set -euo pipefail

source=$1 dtb=$2
shift 2
mkdir -p "$(dirname "$dtb")"
log=$(mktemp)
trap 'rm -f "$log"' EXIT

# Two devices that share an address, as smart card and its UART do, are wrong only when both are on. dtc 1.6.1 has no
# -Werror, so whatever it says is one.
cpp -nostdinc -undef -D__DTS__ "${@/#/-D}" -x assembler-with-cpp -I "$(dirname "$source")" "$source" |
	dtc -I dts -O dtb -o "$dtb.new" -Wdeprecated_gpio_property -Wno-unique_unit_address \
		-Wunique_unit_address_if_enabled - 2>"$log" || echo "not compiled" >>"$log"
if [[ -s $log ]]; then
	rm -f "$dtb.new"
	cat "$log" >&2
	exit 1
fi
mv "$dtb.new" "$dtb"
echo "$dtb: $(stat --format=%s "$dtb") bytes"
