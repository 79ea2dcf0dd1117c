# SPDX-License-Identifier: GPL-3.0-or-later
# shellcheck shell=bash
# Sourced: roots of Debian of one's own, of this machine's release, from its own mirror. What was downloaded for one of them
# is there for the next. Neither touches what is installed on this machine.
# shellcheck source=scripts/private-apt.sh
. "$(dirname "${BASH_SOURCE[0]}")/private-apt.sh"

private_root_archives=$(realpath -m "$(dirname "${BASH_SOURCE[0]}")/../build/debian-archives")

# private_root_tar TAR OPTION...: what mmdebstrap makes with these options. Without root it needs uidmap's programs.
private_root_tar() {
	local tar=$1 mirror mirrors proxies proxy options=()
	shift
	mkdir -p "$private_root_archives" "$(dirname "$tar")"
	mapfile -t mirrors < <(private_apt_mirrors)
	mapfile -t proxies < <(apt-config dump | grep -E '^Acquire::https?::' || true)
	for proxy in "${proxies[@]}"; do
		options+=("--aptopt=$proxy")
	done
	for mirror in "${mirrors[@]}"; do
		# shellcheck disable=SC2016 # the hooks' shell's: what reaches it by the environment needs no quotes
		if ARCHIVES=$private_root_archives mmdebstrap --variant=minbase --format=tar --keyring="$private_apt_keyring" \
			--skip=essential/unlink "${options[@]}" \
			--setup-hook='mkdir -p "$1/var/cache/apt/archives"' \
			--setup-hook='cp -l "$ARCHIVES"/*.deb "$1/var/cache/apt/archives" || cp "$ARCHIVES"/*.deb "$1/var/cache/apt/archives" || true' \
			"$@" \
			--customize-hook='cp --update "$1"/var/cache/apt/archives/*.deb "$ARCHIVES" 2> /dev/null || true' \
			--customize-hook='rm -f "$1/etc/apt/apt.conf.d/99mmdebstrap"' \
			"$private_apt_suite" "$tar" "$mirror"; then
			return
		fi
	done
	rm -f "$tar"
	echo "setup: no mirror of this machine (${mirrors[*]:-none found}) gave a root of Debian $private_apt_suite" >&2
	return 1
}

# private_root_unpack TAR FOLDER: with this user as the owner of all of it, so that this user can remove it.
private_root_unpack() {
	rm -rf "$2"
	mkdir -p "$2"
	tar --extract --file "$1" --directory "$2" --no-same-owner --exclude='./dev/*'
}

# private_root_run ROOT FOLDER COMMAND...: there, with FOLDER as /mnt, as somebody who takes himself for root.
private_root_run() {
	local as=()
	[[ $EUID -eq 0 ]] || as=(--map-root-user)
	# shellcheck disable=SC2016 # the inner shell's
	unshare --mount "${as[@]}" sh -euc '
		root=$1
		mount --rbind /dev "$root/dev"
		mount --rbind /proc "$root/proc"
		mount --rbind "$2" "$root/mnt"
		shift 2
		exec env --ignore-environment PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp LC_ALL=C.UTF-8 TERM=dumb \
			${DEB_BUILD_OPTIONS:+DEB_BUILD_OPTIONS="$DEB_BUILD_OPTIONS"} \
			${DEB_CFLAGS_APPEND:+DEB_CFLAGS_APPEND="$DEB_CFLAGS_APPEND"} \
			chroot "$root" "$@"' - "$@"
}
