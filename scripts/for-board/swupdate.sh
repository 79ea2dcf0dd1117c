# shellcheck shell=bash disable=SC2034,SC2154
# SPDX-License-Identifier: GPL-3.0-or-later
# SWUpdate. Debian's own package brings libcurl, libarchive, Lua, a web server and U-Boot's environment. What is in ours says
# board/nuc980/swupdate.config.
config=$tree/board/nuc980/swupdate.config
files+=("$config")
cflags+=" -fPIC"
# It asks for each library by such a variable, and takes for there what is not "n".
absent=(LUA LIBARCHIVE LIBCURL LIBFDISK LIBBLKID LIBGPIOD LIBEXT2FS LIBZEROMQ LIBSYSTEMD ZLIB ZSTD ZCK WOLFSSL
	MBEDTLS P11KIT JSON_C LIBWEBSOCKETS LIBRSYNC URIPARSER)

build() {
	given=("${absent[@]/#/HAVE_}")
	given=("${given[@]/%/=n}" "SWU_VER=$(dpkg-parsechangelog --show-field Version)")
	cp "$config" configs/openrtu_defconfig
	kconfig allnoconfig
	kconfig openrtu_defconfig
	refuse_lost
	kconfig swupdate
	program swupdate usr/bin/swupdate
}
