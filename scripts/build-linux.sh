#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-linux.sh DEBIAN [FOLDER [FRAGMENT...]]: Linux for the gateway board, from Debian's unpacked source.
#
# The folder `source` beside DEBIAN becomes DEBIAN with its own PREEMPT_RT series and patches/linux/6.1 applied, with
# dts/bindings among its bindings, and with the drivers of board/nuc980/linux. FOLDER gets zImage, vmlinux and .config: nuc980_defconfig and the fragments. Without FOLDER
# nothing is compiled.
set -euo pipefail

debian=$(realpath -e "$1")
folder=${2:+$(realpath -m "$2")}
shift "$(($# < 2 ? $# : 2))"
tree=$(realpath -e "$(dirname "$0")/..")
source=${debian%/*}/source
ours=("$tree"/board/nuc980/linux/{arch,drivers,include})
rt=$debian/debian/patches-rt
changelog=$debian/debian/changelog
export ARCH=arm CROSS_COMPILE=${CROSS_COMPILE:-arm-linux-gnueabi-}

series() {
	sed "s|^|$rt/|" <(grep --invert-match '^#' "$rt/series")
	ls "$tree"/patches/linux/6.1/*.patch
}

# Of the source; it is the same for every FOLDER.
source_inputs() {
	sha256sum "$changelog" "$tree"/patches/linux/6.1/*.patch "$tree"/scripts/{build-linux,patched-source}.sh
	find "$tree/dts/bindings" "${ours[@]}" -type f -exec sha256sum {} + | sort
}

# Of the build; the files of an initramfs are the caller's to name, by a fragment that changes with them.
inputs() {
	cat "$source.inputs"
	echo "$CROSS_COMPILE"
	sha256sum "$@"
}

stage() {
	local overlay=$source.overlay patches
	mapfile -t patches < <(series)
	rm -rf "$overlay" "$source.inputs"
	mkdir -p "$overlay/Documentation/devicetree"
	cp --archive "$tree/dts/bindings" "$overlay/Documentation/devicetree/"
	cp --archive "${ours[@]}" "$overlay"
	"$tree/scripts/patched-source.sh" "$debian" "$overlay" "$source" "${patches[@]}"
	rm -rf "$overlay"
	source_inputs >"$source.inputs"
}

# Each symbol's last line in the files.
wanted() {
	awk '{ symbol = $1 == "#" ? $2 : substr($0, 1, index($0, "=") - 1) }
		symbol ~ /^CONFIG_/ { last[symbol] = $0 }
		END { for (symbol in last) print last[symbol] }' "$@"
}

# Kconfig drops a line silently when something that it depends on is off; what is off must be off or unknown.
check_configured() {
	local config=$folder/build/.config
	{
		wanted "$@" | grep '^CONFIG_' | grep --invert-match --line-regexp --fixed-strings --file="$config"
		wanted "$@" | sed -n 's/^# \(CONFIG_[^ ]*\) is not set$/^\1=/p' | grep --file=- "$config"
	} >"$folder/config.lost" || true
	[ ! -s "$folder/config.lost" ] || {
		echo "this did not come into $config as the defconfig and the fragments have it:"
		cat "$folder/config.lost"
		exit 1
	} >&2
}

build() {
	local date defconfig=$source/arch/arm/configs/nuc980_defconfig
	date=$(dpkg-parsechangelog --file "$changelog" --show-field Date)
	export KBUILD_BUILD_TIMESTAMP=$date KBUILD_BUILD_USER=openrtu KBUILD_BUILD_HOST=openrtu KBUILD_BUILD_VERSION=1
	local linux=(make --directory="$source" "O=$folder/build")
	mkdir -p "$folder/build"
	cat "$defconfig" "$@" >"$folder/build/.config"
	"${linux[@]}" olddefconfig
	check_configured "$defconfig" "$@"
	"${linux[@]}" --jobs="$(nproc)" zImage
	install --target-directory="$folder" "$folder"/build/{arch/arm/boot/zImage,vmlinux,.config}
}

if ! [[ -e $source.inputs && $(source_inputs) == "$(<"$source.inputs")" ]]; then
	stage
fi
[ -n "$folder" ] || exit 0
mkdir -p "$folder"
if [[ -e $folder/inputs && $(inputs "$@") == "$(<"$folder/inputs")" ]]; then
	exit 0
fi
rm -f "$folder/inputs"
build "$@"
inputs "$@" >"$folder/inputs"
