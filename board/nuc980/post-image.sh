#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# post-image.sh IMAGES: what Buildroot runs at the end. The board's MAC addresses into the device tree, the manifest,
# which refuses what the board could not boot, and the folder for nuc980-netboot. NUC980_BOARD names the board, if it is not the gateway.
set -euo pipefail

images=$1
board=$(realpath "$(dirname "$0")")
name=${NUC980_BOARD:-gateway}
tree=$images/nuc980-$name.dtb
limits=$board/boards/$name/image-limits.toml
compiled=$images/../device-trees

# Buildroot compiles every tree of dts/nuvoton, and only with the kernel: those of other boards wait for a build for them.
mkdir -p "$compiled"
find "$images" -maxdepth 1 -name '*.dtb' -exec mv -t "$compiled" {} +
if ! cp "$compiled/${tree##*/}" "$tree"; then
	echo "post-image: Buildroot compiles it with the kernel: make -C $(realpath "$images/..") linux-rebuild" >&2
	exit 1
fi

"$board/place-macs.sh" "$tree"

# Nothing of an image that is refused is left where nuc980-netboot looks.
rm -rf "$images/netboot"
PYTHONPATH="$board/../../scripts" python3 -m image.manifest --images "$images" --config "$BR2_CONFIG" \
	--limits "$limits" --out "$images/manifest.json"
install -D -m 644 -t "$images/netboot" "$images/uImage" "$tree" "$images/manifest.json"
