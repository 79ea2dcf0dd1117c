#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-uboot.sh DEBIAN FOLDER: U-Boot for the gateway board, from Debian's unpacked source.
#
# FOLDER/source is DEBIAN with patches/uboot applied and dts/nuvoton laid over it; only what differs is copied there, so
# that a change rebuilds just what it must. FOLDER gets u-boot.bin, its program u-boot with symbols, and u-boot.dtb.
set -euo pipefail

debian=$(realpath -e "$1")
folder=$(realpath -m "$2")
tree=$(realpath -e "$(dirname "$0")/..")
changelog=$debian/debian/changelog
export CROSS_COMPILE=${CROSS_COMPILE:-arm-linux-gnueabi-}

# U-Boot's own make writes the default environment and links at every call.
inputs() {
	echo "$debian $CROSS_COMPILE"
	sha256sum "$tree"/patches/uboot/*.patch "$tree"/dts/nuvoton/*.dts* "$tree/scripts/build-uboot.sh" "$changelog"
}

# The files of U-Boot that a patch changes, without those that it adds.
patched() {
	sed -n 's|^--- a/||p' "$tree"/patches/uboot/*.patch | sort --unique
}

stage() {
	rm -rf "$folder/stage"
	mkdir -p "$folder/stage" "$folder/source"
	patched | (cd "$debian" && xargs cp --archive --parents --target-directory="$folder/stage")
	for patch in "$tree"/patches/uboot/*.patch; do
		patch --directory="$folder/stage" --strip=1 --fuzz=0 --quiet --no-backup-if-mismatch <"$patch" || {
			echo "uboot: $patch does not fit Debian's source in $debian" >&2
			return 1
		}
	done
	cp --archive "$tree"/dts/nuvoton/*.dts* "$folder/stage/arch/arm/dts"
	# Where both have a file, the first one's is taken.
	rsync --archive --no-times --checksum --delete "$folder/stage/" "$debian/" "$folder/source/"
}

build() {
	local version
	version=$(dpkg-parsechangelog --file "$changelog" --show-field Version)
	SOURCE_DATE_EPOCH=$(dpkg-parsechangelog --file "$changelog" --show-field Timestamp)
	export SOURCE_DATE_EPOCH
	local uboot=(make --silent --directory="$folder/source" "O=$folder/build" "LOCALVERSION=+${version#*+}")
	"${uboot[@]}" nuc980_gateway_defconfig
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
