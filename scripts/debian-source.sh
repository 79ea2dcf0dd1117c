#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# debian-source.sh PACKAGE[=VERSION] FOLDER: a Debian source package, patched as Debian builds it, from this machine's
# own mirror.
#
# Nothing is asked of the host's apt: it needs no deb-src line. apt checks the mirror's signature and every file's hash.
# When the mirror no longer has VERSION, what it has instead is taken. FOLDER.dsc names the version that came.
set -euo pipefail
# shellcheck source=scripts/private-apt.sh
. "$(dirname "$0")/private-apt.sh"

wanted=$1
package=${wanted%=*}
folder=$(realpath -m "$2")
root=$folder.apt

rm -rf "$root" "$folder"
private_apt_root "$root"
download() {
	apt-get -qq source --download-only "$wanted" || {
		[ "$wanted" != "$package" ] || return 1
		echo "setup: the mirror has no $wanted: its newest $package is taken instead" >&2
		apt-get -qq source --download-only "$package"
	}
}

private_apt_fetch "$root" deb-src "the source of $package" download
dsc=("$root/cache/$package"_*.dsc)
dpkg-source --no-check --extract "${dsc[0]}" "$folder" >"$root/unpack.log"
rm -f "$(dirname "$folder")/$package"_*.orig.tar.*
cp "${dsc[0]}" "$folder.dsc"
rm -rf "$root"
