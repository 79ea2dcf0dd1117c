#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# as-user.sh [COMMAND...]: the README's two commands, or others, as its reader types them who is not root: in the files of a
# release without .git, in a folder with a space and an umlaut, with the PATH that Debian gives its users. What the commands tell
# root to install, root installs. It takes root to begin, as it becomes nobody.
set -euo pipefail

[[ $EUID -eq 0 ]] || {
	echo "as-user.sh: only root can become a user without rights" >&2
	exit 2
}
cd "$(dirname "$0")/../.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
tree=$folder/"mein träe"
mkdir -p "$tree" "$folder/home"
git -c safe.directory='*' archive HEAD | tar -x -C "$tree"
chmod 755 "$folder"
chown -R nobody: "$tree" "$folder/home"

type_as_user() {
	(cd "$tree" && runuser -u nobody -- env -i HOME="$folder/home" USER=nobody LANG=C.UTF-8 ${CI:+CI="$CI"} \
		PATH=/usr/local/bin:/usr/bin:/bin:/usr/local/games:/usr/games bash -c "$1")
}

# What a command that lacks packages prints: the line for root, without the su around it.
line_for_root() {
	sed -n "s/^  \(su\|sudo sh\) -c '\(.*\)'$/\2/p" "$1"
}

[[ $# -gt 0 ]] || set -- "make run-native" "make test-quick"
for command; do
	echo "nobody types: $command"
	code=0
	type_as_user "$command" 2>&1 | tee "$folder/said" || code=$?
	if ((code != 0)); then
		install=$(line_for_root "$folder/said")
		[[ -n $install ]] || exit "$code"
		echo "root types: $install"
		DEBIAN_FRONTEND=noninteractive bash -ec "$install" >"$folder/installed" || {
			tail "$folder/installed"
			exit 1
		}
		type_as_user "$command"
	fi
done
