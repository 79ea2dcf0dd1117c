#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# post-image.sh IMAGES: what Buildroot runs at the end. The board's MAC addresses into the device tree, the manifest,
# which refuses what the board could not boot, and the folder for nuc980-netboot.
set -euo pipefail

images=$1
board=$(realpath "$(dirname "$0")")
tree=$images/nuc980-gateway.dtb

# Buildroot compiles every tree of dts/nuvoton, those of other boards too.
find "$images" -maxdepth 1 -name '*.dtb' ! -name nuc980-gateway.dtb -delete

"$board/place-macs.sh" "$tree"

# Nothing of an image that is refused is left where nuc980-netboot looks.
rm -rf "$images/netboot"
PYTHONPATH="$board/../../scripts" python3 -m image.manifest --images "$images" --config "$BR2_CONFIG" \
	--limits "$board/image-limits.toml" --out "$images/manifest.json"
install -D -m 644 -t "$images/netboot" "$images/uImage" "$tree" "$images/manifest.json"
