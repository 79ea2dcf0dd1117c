#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# source-date.sh: what dates all that is made of this tree, in seconds since 1970: SOURCE_DATE_EPOCH, or the last commit, or in the
# files of a release their change log. The same tree gives the same bytes.
set -euo pipefail

tree=$(realpath -e "$(dirname "$0")/..")
if [[ -n ${SOURCE_DATE_EPOCH:-} ]]; then
	echo "$SOURCE_DATE_EPOCH"
elif [[ -e $tree/.git ]]; then
	git -c safe.directory='*' -C "$tree" log -1 --format=%ct
else
	stat -c %Y "$tree/CHANGELOG.md"
fi
