#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# patched-source.sh DEBIAN PATCHES OVERLAY SOURCE: a source tree to build in.
#
# SOURCE becomes what DEBIAN is, with the patches of the folder PATCHES applied and OVERLAY's files laid over it. Only
# what differs is copied there, so that a build rebuilds just what it must.
set -euo pipefail

debian=$1
patches=$2
overlay=$3
source=$4
stage=$source.stage

# The files that a patch changes, without those that it adds.
patched() {
	sed -n 's|^--- a/||p' "$patches"/*.patch | sort --unique
}

rm -rf "$stage"
mkdir -p "$stage" "$source"
patched | (cd "$debian" && xargs cp --archive --parents --target-directory="$stage")
for patch in "$patches"/*.patch; do
	patch --directory="$stage" --strip=1 --fuzz=0 --quiet --no-backup-if-mismatch <"$patch" || {
		echo "$patch does not fit Debian's source ($debian.dsc names its version)" >&2
		exit 1
	}
done
cp --archive "$overlay/." "$stage"
# Where both have a file, the first one's is taken.
rsync --archive --no-times --checksum --delete "$stage/" "$debian/" "$source/"
rm -rf "$stage"
