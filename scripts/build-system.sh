#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-system.sh FOLDER GATEWAY [FRAGMENT...]: the image for a board from Debian's packages, of what `make image-debian` made in
# build. GATEWAY is what it has of build/root: gateway, or gateway-tls with OpenSSL, Net-SNMP and libmicrohttpd. It is the kernel of build/linux, which has these fragments, once more with the root file system inside.
#
# FOLDER gets uImage, nuc980-BOARD.dtb and manifest.json, FOLDER.cdx.json is its bill of materials; FOLDER.parts the root file
# system and the licences of what is in it. SITE_SETTINGS in the environment names a folder with the settings of a site; with "update.pem" there the image
# takes updates, with "update-server" it fetches them. NUC980_BOARD names the board, if it is not the gateway.
set -euo pipefail

folder=$(realpath -m "$1")
gateway=$2
shift 2
tree=$(realpath -e "$(dirname "$0")/..")
board=$tree/board/nuc980
name=${NUC980_BOARD:-gateway}
device_tree=nuc980-$name.dtb
limits=$board/boards/$name/image-limits.toml
build=$tree/build
parts=$folder.parts
kernel=$build/linux-system
update=
[ ! -f "${SITE_SETTINGS:-}/update.pem" ] || update=yes
pull=
[ ! -f "${SITE_SETTINGS:-}/update-server" ] || pull=yes
fragments=("$@" "$board/system.fragment" "$parts/initramfs.fragment")
sources=(linux busybox chrony ${update:+swupdate} ${pull:+curl})
[ "$gateway" != gateway-tls ] || sources+=(net-snmp libmicrohttpd)
umask 022

image_tool() {
	PYTHONPATH="$tree/scripts" python3 -m "image.$1" "${@:2}"
}

inputs() {
	echo "$folder $name $gateway ${SITE_SETTINGS:-}"
	{
		find "$board"/{skeleton,rootfs-overlay,"boards/$name"} "$build/root/$gateway" -type f -print0
		printf '%s\0' "$build"/{root/packages.versions,busybox/busybox,chrony/inputs,linux/inputs,"dtb/$device_tree"} \
			${update:+"$build/swupdate/inputs"} ${pull:+"$build/curl/inputs"}
		printf '%s\0' "$board"/{system.toml,users,post-build.sh,place-macs.sh,system.fragment}
		printf '%s\0' "$tree"/package/openrtu/{S80rtud,openrtu.mk} "$tree/configs/parts/system.config"
		printf '%s\0' "$tree"/scripts/{build-system.sh,build-linux.sh,image/cpio.py,image/gateway.py,image/rootfs.py}
		# Not what an image takes of it, nor what nuc980-netboot keeps there.
		[ -z "${SITE_SETTINGS:-}" ] || find "$SITE_SETTINGS" -maxdepth 1 -type f ! -name update-number \
			! -name 'environment*.txt' ! -name board-ip -print0
	} | sort --zero-terminated | xargs --null sha256sum
}

make_root() {
	rm -rf "$parts"
	mkdir -p "$parts/root"
	image_tool rootfs make --packages "$build/root/packages" --busybox "$build/busybox" \
		--chrony "$build/chrony" --gateway "$build/root/$gateway" ${update:+--swupdate "$build/swupdate"} \
		${pull:+--curl "$build/curl"} "$parts/root"
	"$board/post-build.sh" "$parts/root"
	image_tool cpio "$parts/root" "$parts/initramfs.cpio"
	cat >"$parts/initramfs.fragment" <<-END
		# $(sha256sum <"$parts/initramfs.cpio")
		CONFIG_INITRAMFS_SOURCE="../initramfs.cpio"
	END
}

# What an initramfs changes is built, and linked, in a copy of the kernel's objects. It lies beside them, since its path is in
# the kernel's own copy of its configuration: an absolute one makes another kernel in each folder.
make_kernel() {
	if ! cmp --quiet "$build/linux/inputs" "$kernel/of"; then
		rm -f "$kernel/inputs"
		mkdir -p "$kernel/build"
		rsync --archive --delete "$build/linux/build/" "$kernel/build/"
		cp "$build/linux/inputs" "$kernel/of"
	fi
	cp "$parts/initramfs.cpio" "$kernel"
	"$tree/scripts/build-linux.sh" "$build/linux/debian" "$kernel" "${fragments[@]}"
}

make_images() {
	local epoch
	epoch=$(dpkg-parsechangelog --file "$build/linux/debian/debian/changelog" --show-field Timestamp)
	SOURCE_DATE_EPOCH=$epoch mkimage -A arm -O linux -T kernel -C none -a 0x8000 -e 0x8000 \
		-n "Linux-$(<"$kernel/build/include/config/kernel.release")" -d "$kernel/zImage" "$folder/uImage" >"$parts/mkimage.log"
	install -m 644 "$build/dtb/$device_tree" "$folder/$device_tree"
	"$board/place-macs.sh" "$folder/$device_tree"
}

# Name and version of those that the image has files of.
packages() {
	local without=()
	[ "$gateway" = gateway-tls ] || without+=(--without-tls)
	[ -n "$update" ] || without+=(--without-update)
	[ -n "$pull" ] || without+=(--without-pull)
	image_tool rootfs packages "${without[@]}" | tr ' ' '\n' |
		awk 'NR == FNR { taken[$1]; next } $1 in taken' - "$build/root/packages.versions"
}

licences() {
	local package
	mkdir -p "$parts/licences"
	while read -r package _; do
		cp "$build/root/packages/usr/share/doc/$package/copyright" "$parts/licences/$package"
	done < <(packages)
	for package in "${sources[@]}"; do
		cp "$build/$package/debian/debian/copyright" "$parts/licences/$package"
	done
	# What chronyd and swupdate have in themselves.
	cp "$build/arm-sysroot/usr/share/doc/libcap-dev/copyright" "$parts/licences/libcap"
	[ -z "$update" ] || cp "$build/arm-sysroot/usr/share/doc/libmtd-dev/copyright" "$parts/licences/libmtd"
	cp "$tree/LICENSES/GPL-3.0-or-later.txt" "$parts/licences/openrtu"
}

versions() {
	packages
	for part in "${sources[@]}"; do
		sed -nE 's/^(Source|Version): //p' "$build/$part/debian.dsc" | paste -sd ' '
	done
}

mkdir -p "$folder"
# One at a time: the kernel's objects are the same for every site.
exec {lock}>"$build/system.lock"
flock "$lock"
if ! [[ -e $folder.inputs && $(inputs) == "$(<"$folder.inputs")" ]]; then
	rm -f "$folder.inputs"
	make_root
	make_kernel
	make_images
	licences
	versions >"$parts/versions"
	inputs >"$folder.inputs"
fi
image_tool manifest --images "$folder" --versions "$parts/versions" --target "$parts/root" \
	--limits "$limits" --out "$folder/manifest.json"
SOURCE_DATE_EPOCH=$("$tree/scripts/source-date.sh") image_tool bill "$folder/manifest.json" "$folder.cdx.json" "${sources[@]}"
