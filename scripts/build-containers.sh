#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-containers.sh FOLDER DEBS [NAME...]: images for containers, of this machine's architecture, from the Debian packages in
# DEBS: gateway, centre, show. Each is an archive of OCI's layout; beside them is compose.yaml, which starts a show of them all.
# Neither a container engine nor a registry is needed.
set -euo pipefail
shopt -s nullglob
umask 022 # what is mounted is read by a user of the container's
# shellcheck source=scripts/private-root.sh
. "$(dirname "$0")/private-root.sh"

folder=$(realpath -m "$1")
debs=$(realpath -e "$2")
names=("${@:3}")
[[ ${#names[@]} -gt 0 ]] || names=(gateway centre show)
tree=$(realpath -e "$(dirname "$0")/..")
version=$(<"$tree/package/openrtu/src/VERSION")
machine=$(dpkg --print-architecture)
SOURCE_DATE_EPOCH=$("$tree/scripts/source-date.sh")
export SOURCE_DATE_EPOCH

declare -A packages=(
	[gateway]='openrtu libopenrtu0 python3-openrtu'
	[show]='openrtu libopenrtu0 python3-openrtu'
	[centre]='openrtu-centre openrtu-tools openrtu'
)
declare -A programs=(
	[gateway]='package/openrtu/container/gateway-start package/openrtu/container/gateway-health'
	[show]='package/openrtu/container/gateway-start package/openrtu/container/gateway-health
		package/openrtu/container/show-start build/linesim/linesim'
	[centre]='package/openrtu/container/centre-start'
)
declare -A options=(
	[gateway]='--port 2404 -- gateway-start'
	[show]='--port 2404 -- show-start'
	[centre]='--port 8104 --user openrtu-centre -- centre-start'
)
# Of Debian, what they only recommend.
declare -A needed=([centre]=python3-asyncpg)
# What a user of its own writes into; a volume gets its owner from there.
declare -A owned=([centre]='openrtu-centre /var/lib/openrtu-centre')
declare -A go_names=([amd64]=amd64 [arm64]=arm64 [armhf]=arm)

# The files of the words that follow, in a folder of their own.
put_into() {
	local into=$1 file
	shift
	rm -rf "$into"
	mkdir -p "$into"
	for file in "$@"; do
		[[ -f $file ]] || {
			echo "build-containers: $file is not there: make containers makes it" >&2
			return 1
		}
		cp "$file" "$into"
	done
}

packages_of() {
	local name found
	for name in ${packages[$1]}; do
		found=("$debs/${name}_"*_"$machine.deb" "$debs/${name}_"*_all.deb)
		echo "${found[0]:-$debs/$name}"
	done
}

# What reaches the hooks by the environment needs no quotes. What an import of Python leaves behind has other bytes each time. The
# last hook takes out what mmdebstrap has of this machine: its mirror, its name, its name servers. apt asks Debian's own instead.
make_root() {
	local part=$1 root=$2
	mapfile -t files < <(packages_of "$part")
	put_into "$root.debs" "${files[@]}"
	# shellcheck disable=SC2086 # words
	mapfile -t files < <(printf '%s\n' ${programs[$part]})
	files=("${files[@]/#/$tree/}")
	put_into "$root.programs" "${files[@]}"
	export ROOT_DEBS=$root.debs ROOT_PROGRAMS=$root.programs ROOT_OWNED=${owned[$part]:-}
	# shellcheck disable=SC2016 # the hooks' shell's
	private_root_tar "$root.tar" --include="systemd-standalone-sysusers${needed[$part]:+,${needed[$part]}}" \
		--dpkgopt='path-exclude=/usr/share/man/*' --dpkgopt='path-exclude=/usr/share/locale/*' \
		--dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-include=/usr/share/doc/*/copyright' \
		--dpkgopt='path-include=/usr/share/doc/apt/examples/sources.list' \
		--customize-hook='mkdir "$1/debs" && cp "$ROOT_DEBS"/*.deb "$1/debs"' \
		--customize-hook='chroot "$1" env PYTHONDONTWRITEBYTECODE=1 sh -c "apt-get install --yes --no-install-recommends /debs/*.deb"' \
		--customize-hook='rm -r "$1/debs"' \
		--customize-hook='[ -z "$ROOT_OWNED" ] || chroot "$1" install --directory --owner $ROOT_OWNED' \
		--customize-hook='install -m 755 "$ROOT_PROGRAMS"/* "$1/usr/local/bin"' \
		--customize-hook='mv "$1/usr/share/doc/apt/examples/sources.list" "$1/etc/apt"' \
		--customize-hook='rm "$1/etc/hostname" "$1/etc/resolv.conf"'
	rm -r "$root.debs" "$root.programs"
}

# The show is that of `make run`. Its station listens to all of its network.
make_show() {
	rm -rf "$folder/show"
	cp -r "$tree/package/openrtu/container/show" "$folder"
	cp "$tree/tests/fixtures/chapter5/values.json" "$folder/show"
	sed 's/"address": "127.0.0.1", "port": 2404/"address": "0.0.0.0", "port": 2404/' \
		"$tree/tests/fixtures/chapter5/gateway.json" >"$folder/show/gateway.json"
	sed "s/@VERSION@/$version/" "$tree/package/openrtu/container/compose.yaml" >"$folder/compose.yaml"
}

mkdir -p "$folder"
make_show
for name in "${names[@]}"; do
	image=openrtu-$name
	make_root "$name" "$folder/$image"
	# shellcheck disable=SC2086 # words
	"$tree/scripts/oci-archive.py" "$folder/$image.tar" "$folder/$image.oci.tar" --name "$image:$version" \
		--architecture "${go_names[$machine]}" --created "$SOURCE_DATE_EPOCH" ${options[$name]}
	rm "$folder/$image.tar"
done
ls "$folder"/*.oci.tar
