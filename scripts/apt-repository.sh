#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# apt-repository.sh OUT DEB...: these Debian packages as a repository of apt's, in the new folder OUT, which any web server can
# serve. The suite has the name of this machine's release of Debian; SOURCE_DATE_EPOCH dates it.
#
# With APT_KEY in the environment, an OpenPGP private key without a pass phrase, InRelease is signed and openrtu.gpg is the
# public key. Without, there is Release alone, which apt takes from a source with `trusted=yes` only.
set -euo pipefail

out=$(realpath -m "$1")
suite=$(sed -n 's/^VERSION_CODENAME=//p' /etc/os-release)
: "${SOURCE_DATE_EPOCH:?}"

fail() {
	echo "apt-repository: $*" >&2
	exit 1
}

# For each architecture, what is for it and for all.
write_packages() {
	local architecture folder
	for architecture in $(for deb in pool/*.deb; do dpkg-deb --field "$deb" Architecture; done | sort -u); do
		[[ $architecture != all ]] || continue
		folder=dists/$suite/main/binary-$architecture
		mkdir -p "$folder"
		dpkg-scanpackages --arch "$architecture" pool 2>/dev/null >"$folder/Packages"
		gzip --no-name --best --keep "$folder/Packages"
	done
}

write_release() {
	local file
	cat <<-END
		Origin: OpenRTU
		Label: OpenRTU
		Suite: $suite
		Codename: $suite
		Date: $(LC_ALL=C date --utc --date="@$SOURCE_DATE_EPOCH" '+%a, %d %b %Y %H:%M:%S UTC')
		Architectures: $(cd main && echo binary-* | sed 's/binary-//g')
		Components: main
		Description: OpenRTU's packages
		SHA256:
	END
	for file in main/*/Packages*; do
		echo " $(sha256sum "$file" | cut -d ' ' -f 1) $(stat -c %s "$file") $file"
	done
}

openpgp() {
	gpg --homedir "$keys" --batch --quiet --no-options "$@"
}

# As of the packages' date, or of the key's where that is later: the same key signs the same bytes.
sign() {
	local made
	keys=$(mktemp -d)
	trap 'gpgconf --homedir "$keys" --kill all; rm -rf "$keys"' EXIT
	printf '%s\n' "$APT_KEY" | openpgp --import 2>/dev/null || fail "APT_KEY is not an OpenPGP private key: gpg --armor --export-secret-keys"
	made=$(openpgp --with-colons --list-secret-keys | awk -F : '$1 == "sec" { print $6; exit }')
	[[ -n $made ]] || fail "APT_KEY is not an OpenPGP private key: gpg --armor --export-secret-keys writes one"
	((made > SOURCE_DATE_EPOCH)) || made=$SOURCE_DATE_EPOCH
	openpgp --faked-system-time "$made!" --pinentry-mode loopback --passphrase '' --digest-algo SHA256 --clearsign \
		--output "dists/$suite/InRelease" "dists/$suite/Release" 2>/dev/null || fail "APT_KEY cannot sign: it may have no pass phrase"
	openpgp --export >openrtu.gpg
}

[[ ! -e $out ]] || fail "$out is there already: a repository is made in a new folder"
mkdir -p "$out/pool"
cp "${@:2}" "$out/pool"
cd "$out"
write_packages
(cd "dists/$suite" && write_release >Release)
if [[ -n ${APT_KEY:-} ]]; then
	sign
else
	echo "apt-repository: APT_KEY is not set, so the repository is not signed" >&2
fi
