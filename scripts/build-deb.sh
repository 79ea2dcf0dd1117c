#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-deb.sh FOLDER: the gateway as a Debian package for this machine, and what lintian says of it, into FOLDER.
set -euo pipefail

folder=$(realpath -m "$1")
tree=$(realpath -e "$(dirname "$0")/..")
version=$(PYTHONPATH="$tree/scripts" python3 -m release.version debian)
source=$folder/openrtu-$version

# Of the last commit, or of now in a tree without git: what dates the package's files.
moment() {
	git -c safe.directory='*' -C "$tree" log -1 --format=%ct 2>/dev/null || date +%s
}

changelog() {
	cat <<-END
		openrtu ($version) unstable; urgency=medium

		  * CHANGELOG.md has what is new.

		 -- $(sed -n 's/^Maintainer: //p' "$source/debian/control")  $(date --utc --rfc-email --date="@$(moment)")
	END
}

rm -rf "$folder"
mkdir -p "$source"
cp -a "$tree/package/openrtu"/{src,debian} "$source"
changelog >"$source/debian/changelog"
log=$folder/build.log
if ! (cd "$source" && dpkg-buildpackage --build=binary --no-sign) >"$log" 2>&1; then
	tail -n 20 "$log" >&2
	echo "build-deb: dpkg-buildpackage failed: $log" >&2
	exit 1
fi
lintian --fail-on error --tag-display-limit 0 "$folder"/openrtu_*.deb | tee "$folder/lintian.log"
ls "$folder"/openrtu_*.deb
