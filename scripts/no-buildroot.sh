#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# no-buildroot.sh KAS_FILE: what to do when the checkout that it pins could not be made.
set -euo pipefail

value() {
	sed -n "s/^ *$1: *\"\?\([^\"]*\)\"\?$/\1/p" "$2"
}

cat >&2 <<TEXT
checkout: Buildroot could not be brought from $(value url "$1"); the line above says why.
  Without it the images cannot be built. All else works: make run, make test, make bench.
  With a checkout of commit $(value commit "$1"): make image-buildroot BUILDROOT_DIR=folder
  or make image-offline BUILDROOT_DIR=folder, which needs nothing else but Debian's archive
  Building the images also fetches the sources of the kernel, the toolchain and the packages; what is fetched
  already is taken from BR2_DL_DIR=folder.
TEXT
