#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# post-fakeroot.sh TARGET: what Buildroot runs where the root file system has its users and owners, before it is packed. What it holds
# is written beside the images' folder, to be compared with the image from Debian's packages.
set -euo pipefail

PYTHONPATH=$(dirname "$0")/../../scripts python3 -m image.contents list "$1" >"$BASE_DIR/contents.json"
