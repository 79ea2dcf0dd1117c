#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# debian-source.sh PACKAGE FOLDER: a Debian source package, patched as Debian builds it, from this machine's own mirror.
#
# Nothing is asked of the host's apt: it needs no deb-src line. apt checks the mirror's signature and every file's hash.
# FOLDER.dsc names the version that came.
set -euo pipefail
# shellcheck source=scripts/private-apt.sh
. "$(dirname "$0")/private-apt.sh"

package=$1
folder=$(realpath -m "$2")
root=$folder.apt

rm -rf "$root" "$folder"
private_apt_root "$root"
private_apt_fetch "$root" deb-src "the source of $package" apt-get -qq source --download-only "$package"
dsc=("$root/cache/$package"_*.dsc)
dpkg-source --no-check --extract "${dsc[0]}" "$folder" >"$root/unpack.log"
rm -f "$(dirname "$folder")/$package"_*.orig.tar.*
cp "${dsc[0]}" "$folder.dsc"
rm -rf "$root"
