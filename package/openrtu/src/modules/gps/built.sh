#!/bin/sh
# SPDX-License-Identifier: GPL-3.0-or-later
# built.sh FILE: the day that dates this source, since 1970, as a header of C; a FILE that has it is left alone. It is that of all that
# is made of the tree. Who takes the source out of the tree names it, in SOURCE_DATE_EPOCH; else it is the time of VERSION.
set -eu

source=$(dirname "$0")/../..
if [ -x "$source/../../../scripts/source-date.sh" ]; then
	seconds=$("$source/../../../scripts/source-date.sh")
else
	seconds=${SOURCE_DATE_EPOCH:-$(stat -c %Y "$source/VERSION")}
fi
line="#define BUILT_DAYS $((seconds / 86400))"
if [ "$(cat "$1" 2>/dev/null)" != "$line" ]; then
	echo "$line" >"$1"
fi
