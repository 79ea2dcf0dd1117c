#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-qemu.sh DEBIAN FOLDER: QEMU with the machine nuc980, from Debian's unpacked source.
#
# FOLDER/source is DEBIAN with patches/qemu applied and board/nuc980/qemu laid over it. The programs land in FOLDER/bin.
set -euo pipefail

debian=$(realpath -e "$1")
folder=$(realpath -m "$2")
tree=$(realpath -e "$(dirname "$0")/..")

# Only what the machine needs: no other device, no display, no sound. slirp is -nic user.
configure() {
	mkdir -p "$folder/build"
	cd "$folder/build"
	../source/configure --target-list=arm-softmmu --with-devices-arm=nuc980 --without-default-devices \
		--without-default-features --enable-tcg --enable-slirp --enable-fdt=system --enable-tools --enable-pie \
		--enable-stack-protector --enable-trace-backends=log --audio-drv-list= --disable-docs --disable-guest-agent \
		--disable-kvm --disable-debug-info --disable-install-blobs
}

"$tree/scripts/patched-source.sh" "$debian" "$tree/board/nuc980/qemu" "$folder/source" "$tree"/patches/qemu/*.patch
if ! [[ -e $folder/build/build.ninja ]]; then
	(configure) || {
		rm -f "$folder/build/build.ninja"
		exit 1
	}
fi
ninja -C "$folder/build" qemu-system-arm qemu-img
install -D --target-directory="$folder/bin" "$folder/build"/{qemu-system-arm,qemu-img}
