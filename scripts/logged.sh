#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# logged.sh NAME COMMAND...: one step of a build. Its output goes to build/log/NAME.log; the terminal gets how long it has
# run and how much is built. A step that fails shows the end of its log. Exit code: the command's.
set -euo pipefail

name=$1
shift
log=build/log/$name.log
if [[ -t 1 && -z ${CI:-} ]]; then live=yes; else live=; fi
# A log of continuous integration may be all that is left of it.
if [[ -n ${CI:-} ]]; then tail=200; else tail=40; fi

# What the log says of the progress, as "12 of 345 objects": ninja, make in the manner of the kernel, apt, pip, meson
# test, Buildroot.
progress() {
	awk '
		{ sub(/\r$/, "") } # apt ends its lines so where it finds a terminal
		/^\[[0-9]+\/[0-9]+\] / { split(substr($1, 2), n, "[/\\]]"); done = n[1]; all = n[2]; unit = "objects" }
		/^ +(HOST)?(CC|AS)( +\[M\])? +[^ ]+$/ { done++; unit = "objects" }
		/^[0-9]+ upgraded, [0-9]+ newly installed, / { done = 0; all = $1 + $3; unit = "packages" }
		/^Setting up .*\.\.\.$/ { done++ }
		/^Collecting / { done++; unit = "packages" }
		/^ *[0-9]+\/[0-9]+ .* (OK|FAIL|SKIP|TIMEOUT|ERROR) / { split($1, n, "/"); done = n[1]; all = n[2]; unit = "tests" }
		/^(\033\[7m)?>>> / { sub(/.*>>> /, ""); gsub(/\033\[[0-9;]*m/, ""); latest = $0 }
		END {
			if (latest) print latest
			else if (all) printf "%d of %d %s\n", done, all, unit
			else if (done) printf "%d %s\n", done, unit
		}' "$log"
}

say() {
	echo "${live:+$'\r\e[K'}   * $name: $*"
}

# Its sleep holds nobody's pipe.
watch() {
	local so_far next=$((SECONDS + 10))
	sleep 2 >&- 2>&-
	say "started; log: $log"
	while kill -0 $$; do
		if [[ -n $live ]]; then
			so_far=$(progress)
			printf '\r\e[K     %4d s  %.60s' "$SECONDS" "$so_far"
		elif ((SECONDS >= next)); then
			so_far=$(progress)
			printf '     %4d s  %s%.60s\n' "$SECONDS" "$name" "${so_far:+: $so_far}"
			next=$((next + 10))
		fi
		sleep 1 >&- 2>&-
	done 2>/dev/null
}

mkdir -p "${log%/*}"
: >"$log"
# A process group for each, so that who ends this ends all that the command has started.
set -m
"$@" >"$log" 2>&1 </dev/null &
command=$!
stopped=
trap 'stopped=yes; kill -- "-$command"' INT TERM HUP
watch &
watcher=$!
trap 'kill -- "-$watcher"' EXIT
code=0
until wait "$command" || code=$?; ! kill -0 "$command"; do :; done 2>/dev/null

[[ -z $stopped ]] || exit "$code"
so_far=$(progress)
if ((code == 0)); then
	say "done${so_far:+, $so_far}$( ((SECONDS < 2)) || echo ", $SECONDS s")"
else
	{
		say "failed after $SECONDS s; the end of $log:"
		tail -n "$tail" "$log" | sed 's/^/     | /'
	} >&2
fi
exit "$code"
