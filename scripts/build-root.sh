#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-root.sh ARCHITECTURE FOLDER COMMAND...: runs COMMAND in a root of Debian that has what our Debian packages need to be
# compiled for ARCHITECTURE; FOLDER is /mnt there. The root is made once, and again when what they need has changed.
set -euo pipefail
# shellcheck source=scripts/private-root.sh
. "$(dirname "$0")/private-root.sh"

architecture=$1
shift
tree=$(realpath -e "$(dirname "$0")/..")
export CONTROL=$tree/package/openrtu/debian/control
root=$tree/build/deb-roots/$architecture

needs() {
	sed -n '/^Build-Depends:/,/^[A-Z]/p' "$CONTROL"
}

if ! cmp -s <(needs) "$root.needs"; then
	# shellcheck disable=SC2016 # the inner shells'
	"$tree/scripts/logged.sh" "deb-root-$architecture" bash -c '. "$0" && private_root_tar "$@"' "$tree/scripts/private-root.sh" \
		"$root.tar" --architectures="$(dpkg --print-architecture),$architecture" --include="build-essential,crossbuild-essential-$architecture,qemu-user" \
		--customize-hook='mkdir -p "$1/needs/debian" && cp "$CONTROL" "$1/needs/debian"' \
		--customize-hook="chroot \"\$1\" apt-get build-dep --yes --no-install-recommends --arch-only --host-architecture=$architecture /needs" \
		--customize-hook='rm -r "$1/needs"'
	private_root_unpack "$root.tar" "$root"
	rm "$root.tar"
	needs >"$root.needs"
fi
private_root_run "$root" "$@"
