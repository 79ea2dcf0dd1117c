#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-uboot.sh DEBIAN FOLDER: U-Boot for a board, from Debian's unpacked source. NUC980_BOARD names the board, if it is not the
# gateway; its console is the same port.
#
# FOLDER/source is DEBIAN with patches/uboot applied, and board/nuc980/u-boot and dts/nuvoton laid over it. FOLDER gets
# u-boot.bin, its program u-boot with symbols, and u-boot.dtb.
set -euo pipefail

debian=$(realpath -e "$1")
folder=$(realpath -m "$2")
tree=$(realpath -e "$(dirname "$0")/..")
changelog=$debian/debian/changelog
board=${NUC980_BOARD:-gateway}
export CROSS_COMPILE=${CROSS_COMPILE:-arm-linux-gnueabi-}

# U-Boot's own make writes the default environment and links at every call.
inputs() {
	echo "$debian $CROSS_COMPILE $board"
	sha256sum "$tree"/patches/uboot/*.patch "$tree"/dts/nuvoton/*.dts* "$changelog" \
		"$tree"/scripts/{build-uboot,patched-source}.sh
	find "$tree/board/nuc980/u-boot" -type f -exec sha256sum {} + | sort
}

stage() {
	local dts=$folder/overlay/arch/arm/dts
	rm -rf "$folder/overlay"
	mkdir -p "$folder/overlay"
	cp --archive "$tree/board/nuc980/u-boot/." "$folder/overlay"
	cp --archive "$tree"/dts/nuvoton/*.dts* "$dts"
	"$tree/scripts/patched-source.sh" "$debian" "$folder/overlay" "$folder/source" "$tree"/patches/uboot/*.patch
	dts=$folder/source/arch/arm/dts
	[ "$board" = gateway ] || cp "$dts/nuc980-gateway-u-boot.dtsi" "$dts/nuc980-$board-u-boot.dtsi"
}

build() {
	local version
	version=$(dpkg-parsechangelog --file "$changelog" --show-field Version)
	SOURCE_DATE_EPOCH=$(dpkg-parsechangelog --file "$changelog" --show-field Timestamp)
	export SOURCE_DATE_EPOCH
	local uboot=(make --directory="$folder/source" "O=$folder/build" "LOCALVERSION=+${version#*+}")
	"${uboot[@]}" nuc980_gateway_defconfig
	sed -i "s/\"nuc980-gateway\"/\"nuc980-$board\"/" "$folder/build/.config"
	"${uboot[@]}" --jobs="$(nproc)" u-boot.bin u-boot.dtb
	install --target-directory="$folder" "$folder/build"/{u-boot.bin,u-boot,u-boot.dtb}
}

if [[ -e $folder/inputs && $(inputs) == "$(<"$folder/inputs")" ]]; then
	exit 0
fi
mkdir -p "$folder"
rm -f "$folder/inputs"
stage
build
inputs >"$folder/inputs"
