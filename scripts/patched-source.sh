#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# patched-source.sh DEBIAN OVERLAY SOURCE PATCH...: a source tree to build in.
#
# SOURCE becomes what DEBIAN is, with the patches applied in this order and OVERLAY's files laid over it. Only what
# differs is copied there, so that a build rebuilds just what it must.
set -euo pipefail

debian=$1
overlay=$2
source=$3
shift 3
stage=$source.stage

# The files of Debian's that the patches change.
patched() {
	sed -n 's|^--- a/||p' "$@" | sort --unique | while read -r file; do
		[ ! -e "$debian/$file" ] || echo "$file"
	done
}

rm -rf "$stage"
mkdir -p "$stage" "$source"
patched "$@" | (cd "$debian" && xargs cp --archive --parents --target-directory="$stage")
for patch; do
	patch --directory="$stage" --strip=1 --fuzz=0 --quiet --no-backup-if-mismatch <"$patch" || {
		echo "$patch does not fit Debian's source ($debian.dsc names its version)" >&2
		exit 1
	}
done
cp --archive "$overlay/." "$stage"
# Where both have a file, the first one's is taken.
rsync --archive --no-times --checksum --delete "$stage/" "$debian/" "$source/"
rm -rf "$stage"
