#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# release-files.sh OUT BUILD: what a release publishes, from a folder as `build` is, into the new folder OUT: images, manifests
# and bills of materials of Buildroot's, the Debian packages, and SHA256SUMS over all of it.
#
# With RELEASE_KEY in the environment, an OpenSSH private key, SHA256SUMS gets a signature: SHA256SUMS.sig. Anybody checks it
# with `ssh-keygen -Y verify` (docs/image-buildroot.md).
set -euo pipefail
shopt -s nullglob

out=$1
build=$2
version=$(<"$(dirname "$0")/../package/openrtu/src/VERSION")

fail() {
	echo "release-files: $*" >&2
	exit 1
}

# take FILE IMAGE: under a name in the release, in which the folder would be lost.
take() {
	cp "$1" "$out/openrtu-$version-$2-$(basename "$1")"
}

[[ ! -e $out ]] || fail "$out is there already: a release is made of a new folder"
mkdir -p "$out"
for image in "$build"/nuc980_*; do
	name=$(basename "$image")
	[[ $name != *-development ]] || continue
	[[ -f $image/images/manifest.json ]] || fail "$image has no manifest: make image-buildroot refuses what does not boot"
	[[ -f $image/sbom.cdx.json ]] || fail "$image has no bill of materials: make sbom IMAGE=$name"
	for file in "$image"/images/* "$image/sbom.cdx.json"; do
		[[ ! -f $file ]] || take "$file" "$name"
	done
done
for deb in "$build"/deb/*.deb; do
	cp "$deb" "$out"
done
[[ -n $(ls "$out") ]] || fail "$build has neither an image nor a package"
sums=$(cd "$out" && sha256sum -- *)
echo "$sums" >"$out/SHA256SUMS"
if [[ -n ${RELEASE_KEY:-} ]]; then
	key=$(mktemp)
	trap 'rm -f "$key"' EXIT
	printf '%s\n' "$RELEASE_KEY" >"$key"
	ssh-keygen -q -Y sign -f "$key" -n openrtu-release "$out/SHA256SUMS" 2>/dev/null ||
		fail "RELEASE_KEY is not an OpenSSH private key without a passphrase: ssh-keygen -t ed25519 makes one"
else
	echo "release-files: RELEASE_KEY is not set, so SHA256SUMS has no signature" >&2
fi
