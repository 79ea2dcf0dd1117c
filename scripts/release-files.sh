#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# release-files.sh [--make] OUT BUILD: what a release publishes, of a folder as `build` is, into the new folder OUT, and SHA256SUMS
# over its files. PARTS in the environment names the parts [all but buildroot]; one whose files are missing is an error. --make:
# makes them before.
#
# RELEASE_TAG, where it is set, must be v and this tree's version. With RELEASE_KEY, an OpenSSH private key, SHA256SUMS gets a
# signature: SHA256SUMS.sig (docs/release.md). APT_KEY: scripts/apt-repository.sh.
set -euo pipefail
shopt -s nullglob

making=
[[ $1 != --make ]] || { making=yes && shift; }
out=$1
build=$2
tree=$(realpath -e "$(dirname "$0")/..")
version=$(<"$tree/package/openrtu/src/VERSION")
# Part, the files that it publishes, and what makes them.
debs='deb/*_all.deb deb/*_amd64.deb deb/*_arm64.deb deb/*_armhf.deb'
# One make for what needs them: make containers alone would compile them once more, for this machine only.
make_debs="make deb containers DEB_ARCHS='amd64 arm64 armhf'"
parts=(
	"source|.|true"
	"wheels|wheels/*.whl|make wheels"
	"packages|$debs|$make_debs"
	"apt|$debs|$make_debs"
	"containers|containers/*.oci.tar containers/compose.yaml containers/show|$make_debs"
	"pages|pages/html|make site"
	"gateway|system/uImage system/nuc980-gateway.dtb system/manifest.json system.cdx.json|make image-debian"
	"numaker|boards/numaker/system/uImage boards/numaker/system/nuc980-numaker.dtb boards/numaker/system/manifest.json boards/numaker/system.cdx.json|make image-debian BOARD=numaker"
	"buildroot|nuc980_*|make image-buildroot sbom" # as they are: they take hours, and Buildroot's servers
)
all=$(for part in "${parts[@]}"; do echo "${part%%|*}"; done | tr '\n' ' ')

fail() {
	echo "release-files: $*" >&2
	exit 1
}

# take FILE IMAGE: under a name in the release, in which the folder would be lost.
take() {
	cp "$1" "$out/openrtu-$version-$2-$(basename "$1")"
}

# The same bytes for the same files: their order, times and owners are none of the machine's.
packed() {
	tar --sort=name --mtime="@$SOURCE_DATE_EPOCH" --owner=0 --group=0 --numeric-owner --mode=go=rX,u+rw --format=gnu --create "$@" |
		gzip --no-name --best
}

take_source() {
	[[ -z $(git -C "$tree" status --porcelain) ]] || fail "source: the tree has changes that are in no commit"
	git -C "$tree" archive --prefix="openrtu-$version/" HEAD | gzip --no-name --best >"$out/openrtu-$version.tar.gz"
}

take_apt() {
	"$tree/scripts/apt-repository.sh" "$out/apt" "$@"
	packed --directory "$out" apt >"$out/openrtu-$version-apt.tar.gz"
}

take_pages() {
	packed --directory "$build/pages" --transform "s,^html,openrtu-$version-pages," html >"$out/openrtu-$version-pages.tar.gz"
}

take_image() {
	local board=$1 file
	shift
	for file in "$@"; do take "$file" "$board"; done
}

take_gateway() { take_image gateway "$@"; }
take_numaker() { take_image numaker "$@"; }
take_wheels() { cp "$@" "$out"; }
take_packages() { cp "$@" "$out"; }

take_containers() {
	local file
	for file in "$@"; do
		[[ $file != *.oci.tar ]] || cp "$file" "$out/openrtu-$version-${file##*/openrtu-}"
	done
	packed --directory "$build/containers" --transform "s,^,openrtu-$version-compose/," compose.yaml show \
		>"$out/openrtu-$version-compose.tar.gz"
}

take_buildroot() {
	local image file name
	for image in "$@"; do
		name=$(basename "$image")
		[[ $name != *-development ]] || continue
		[[ -f $image/images/manifest.json ]] || fail "$image has no manifest: make image-buildroot refuses what does not boot"
		[[ -f $image/sbom.cdx.json ]] || fail "$image has no bill of materials: make sbom IMAGE=$name"
		for file in "$image"/images/* "$image/sbom.cdx.json"; do
			[[ ! -f $file ]] || take "$file" "$name"
		done
	done
}

[[ ! -e $out ]] || fail "$out is there already: a release is made of a new folder"
[[ -z ${RELEASE_TAG:-} || $RELEASE_TAG == "v$version" ]] ||
	fail "the tag $RELEASE_TAG is not v$version, which package/openrtu/src/VERSION says"
wanted=${PARTS:-${all/buildroot /}}
for name in $wanted; do
	[[ " $all " == *" $name "* ]] || fail "PARTS: there is no part $name; there are $all"
done
SOURCE_DATE_EPOCH=$("$tree/scripts/source-date.sh")
export SOURCE_DATE_EPOCH
mkdir -p "$out"
for part in "${parts[@]}"; do
	IFS='|' read -r name patterns maker <<<"$part"
	[[ " $wanted " == *" $name "* ]] || continue
	files=()
	if [[ -n $making && $name != buildroot && $maker != "${made:-}" ]]; then
		(cd "$tree" && env -u RELEASE_KEY -u APT_KEY bash -euc "$maker") || fail "part $name: $maker failed"
		made=$maker
	fi
	read -ra patterns <<<"$patterns"
	for pattern in "${patterns[@]}"; do
		mapfile -t found < <(compgen -G "$build/$pattern")
		[[ ${#found[@]} -gt 0 ]] || fail "part $name: $build has no $pattern: $maker; or name the parts in PARTS"
		files+=("${found[@]}")
	done
	"take_$name" "${files[@]}"
done
sums=$(cd "$out" && find . -maxdepth 1 -type f -printf '%P\0' | sort --zero-terminated | xargs --null sha256sum --)
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
