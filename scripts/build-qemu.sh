#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-qemu.sh DEBIAN FOLDER: QEMU with the machine nuc980, from Debian's unpacked source.
#
# FOLDER/source is DEBIAN with patches/qemu applied and board/nuc980/qemu laid over it; only what differs is copied
# there, so that a change rebuilds just what it must. The programs land in FOLDER/bin.
set -euo pipefail

debian=$(realpath -e "$1")
folder=$(realpath -m "$2")
tree=$(realpath -e "$(dirname "$0")/..")

# The files of QEMU that a patch changes.
patched() {
	sed -n 's|^+++ b/||p' "$tree"/patches/qemu/*.patch | sort -u
}

stage() {
	rm -rf "$folder/stage"
	mkdir -p "$folder/stage" "$folder/source"
	patched | (cd "$debian" && xargs cp --archive --parents --target-directory="$folder/stage")
	for patch in "$tree"/patches/qemu/*.patch; do
		patch --directory="$folder/stage" --strip=1 --fuzz=0 --quiet --no-backup-if-mismatch <"$patch" || {
			echo "qemu: $patch does not fit Debian's source ($debian.dsc names its version)" >&2
			return 1
		}
	done
	cp --archive "$tree/board/nuc980/qemu/." "$folder/stage"
	(cd "$folder/stage" && find . -type f -printf '/%P\n') >"$folder/ours"
	rsync --archive --delete --exclude-from="$folder/ours" "$debian/" "$folder/source/"
	rsync --archive --no-times --checksum "$folder/stage/" "$folder/source/"
}

# Only what the machine needs: no other device, no display, no sound. slirp is -nic user.
configure() {
	mkdir -p "$folder/build"
	cd "$folder/build"
	../source/configure --target-list=arm-softmmu --with-devices-arm=nuc980 --without-default-devices \
		--without-default-features --enable-tcg --enable-slirp --enable-fdt=system --enable-tools --enable-pie \
		--enable-stack-protector --enable-trace-backends=log --audio-drv-list= --disable-docs --disable-guest-agent \
		--disable-kvm --disable-debug-info --disable-install-blobs
}

stage
if ! [[ -e $folder/build/build.ninja ]]; then
	configure >"$folder/configure.log" 2>&1 || {
		rm -f "$folder/build/build.ninja"
		tail -n 20 "$folder/configure.log" >&2
		exit 1
	}
fi
ninja -C "$folder/build" qemu-system-arm qemu-img
install -D --target-directory="$folder/bin" "$folder/build"/{qemu-system-arm,qemu-img}
