#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-deb.sh FOLDER [ARCHITECTURE...]: the Debian packages for this machine, or for those architectures, and what lintian
# says of them, into FOLDER. The same commit gives the same bytes.
#
# For another architecture they are compiled in a root of their own (scripts/build-root.sh): this machine's dpkg need not
# know it.
set -euo pipefail

folder=$(realpath -m "$1")
tree=$(realpath -e "$(dirname "$0")/..")
version=$(PYTHONPATH="$tree/scripts" python3 -m release.version debian)
machine=$(dpkg --print-architecture)
date=$("$tree/scripts/source-date.sh")
architectures=("${@:2}")
[[ ${#architectures[@]} -gt 0 ]] || architectures=("$machine")

changelog() {
	cat <<-END
		openrtu ($version) unstable; urgency=medium

		  * CHANGELOG.md has what is new.

		 -- $(sed -n 's/^Maintainer: //p' debian/control)  $(date --utc --rfc-email --date="@$date")
	END
}

# The commands of a wheel, as programs of Debian's Python that find what they import in a folder of their own.
unpack_commands() {
	local name module function
	mkdir bin
	while IFS=: read -r name module function; do
		cat >"bin/$name" <<-END
			#!/usr/bin/python3
			# SPDX-License-Identifier: GPL-3.0-or-later
			import sys

			sys.path.insert(0, "/usr/share/openrtu-tools")

			from $module import $function

			sys.exit($function())
		END
		chmod 755 "bin/$name"
	done < <(sed -n '/console_scripts/,/^$/s/ = /:/p' "$1")
}

# The tools as pip would install them, and beside them what they import and Debian does not have, or too old.
unpack_tools() {
	local wheel=("$tree"/build/wheels/openrtu_tools-*.whl)
	if [[ ! -f ${wheel[0]} || ! -d $tree/build/deb-vendored ]]; then
		echo "build-deb: build/wheels or build/deb-vendored is missing: make deb makes them" >&2
		return 1
	fi
	python3 -m zipfile --extract "${wheel[0]}" tools
	unpack_commands tools/*.dist-info/entry_points.txt
	rm -r tools/*.dist-info
	cp -a "$tree"/build/deb-vendored/{paho,pyfdt,tftpy} tools
}

# The folder of the source package, as dpkg-buildpackage wants it. dpkg would keep the dates of what was cloned before the last commit.
unpack_source() {
	rm -rf "$source"
	mkdir "$source"
	(
		cd "$source"
		cp -a "$tree/package/openrtu"/{src,debian} .
		cp -aL "$tree/package/openrtu/python" . # its VERSION is a link
		cp -a "$tree/docs/examples/modules" examples
		cp -a "$tree/centre/systemd" centre
		unpack_tools
		changelog >debian/changelog
		find . -exec touch --no-dereference --date="@$date" {} +
	)
}

# With this machine's packages, not with a Python or a compiler of one's own that comes first on PATH.
here() {
	(cd "$source" && PATH=/usr/sbin:/usr/bin:/sbin:/bin "$@")
}

in_root() {
	# shellcheck disable=SC2016 # the inner shell's
	"$tree/scripts/build-root.sh" "$architecture" "$work" sh -euc 'cd "/mnt/$0" && exec "$@"' "${source##*/}" "$@"
}

# build NAME WHERE OPTION...: the packages that dpkg-buildpackage makes with these options, into FOLDER.
build() {
	local log=$folder/$1.log
	unpack_source
	if ! "$2" dpkg-buildpackage --no-sign "${@:3}" >"$log" 2>&1; then
		tail -n 20 "$log" >&2
		echo "build-deb: dpkg-buildpackage failed: $log" >&2
		return 1
	fi
	mv "$work"/*.deb "$folder"
}

# Not below the tree: pybuild takes no path with a space.
work=$(mktemp --directory)
trap 'rm -rf "$work"' EXIT
source=$work/openrtu-$version
rm -rf "$folder"
mkdir -p "$folder"
build all here --build=all
for architecture in "${architectures[@]}"; do
	where=in_root
	[[ $architecture != "$machine" ]] || where=here
	build "$architecture" "$where" --build=any --host-arch="$architecture"
done
lintian --fail-on error,warning --tag-display-limit 0 "$folder"/*.deb | tee "$folder/lintian.log"
ls "$folder"/*.deb
