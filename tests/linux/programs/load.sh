#!/bin/sh
# SPDX-License-Identifier: GPL-3.0-or-later
# load.sh SECONDS HOST...: work for every driver at once, beside what the gateway does. Each line of it must succeed.
# shellcheck disable=SC2317 # again() calls them

seconds=$1
shift
end=$(($(date +%s) + seconds))

again() {
	while [ "$(date +%s)" -lt $end ]; do
		"$@" || {
			echo "$*: status $?"
			return 1
		}
	done
}

flash() {
	dd if=/dev/urandom of=/tmp/flash/file bs=64k count=8 2>/dev/null && sync && rm /tmp/flash/file
}

network() {
	ping -q -c 10 -i 0.05 -s 4000 "$1" >/dev/null && tftp -g -r load -l /dev/null "$1"
}

clock() {
	hwclock -u -w && hwclock -u -r >/dev/null
}

lines() {
	/gpio-lines set 34=1 197=0 && /gpio-lines set 34=0 197=1
}

# What only debugfs reads takes locks as well.
look() {
	cat /proc/interrupts /proc/tty/driver/* /sys/kernel/debug/gpio /sys/kernel/debug/clk/clk_summary \
		/sys/kernel/debug/pinctrl/*/pins /sys/kernel/debug/dmaengine/summary >/dev/null && sleep 0.2
}

kill_a_module() {
	sleep 3
	pid=$(pidof rtu-modbus) && kill -9 "${pid%% *}"
}

jobs=
start() {
	again "$@" &
	jobs="$jobs $!"
}

for host; do
	start network "$host"
done
for work in flash clock lines look kill_a_module; do
	start $work
done
status=0
for job in $jobs; do
	wait "$job" || status=1
done
exit $status
