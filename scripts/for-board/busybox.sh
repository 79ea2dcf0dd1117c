# shellcheck shell=bash disable=SC2034,SC2154
# SPDX-License-Identifier: GPL-3.0-or-later
# BusyBox. What is in it says board/nuc980/busybox.config. FOLDER gets it, and busybox.links, the paths of
# its applets.
config=$tree/board/nuc980/busybox.config
files+=("$config")

# Our lines instead of those that are off.
configure_lines() {
	kconfig allnoconfig
	mv .config .config.off
	sed -nE 's/^(CONFIG_[A-Z0-9_]+)=.*/\1/p' "$config" | grep -vwFf - .config.off | cat - "$config" >.config
	kconfig oldconfig </dev/null
}

build() {
	configure_lines
	refuse_lost
	# One goal after the other: its Makefile would run both at once, and each probe for libcrypt removes the other's file.
	kconfig busybox
	kconfig busybox.links
	install --target-directory="$folder" busybox busybox.links
}
