# shellcheck shell=bash disable=SC2034,SC2154
# SPDX-License-Identifier: GPL-3.0-or-later
# curl. Debian's own package would bring 20 libraries, for protocols that no update server speaks. Ours speaks HTTPS and HTTP,
# and names OpenSSL alone. No folder of certificates is built in: who may serve says the site.
cflags+=" -fPIE"
ldflags+=" -pie"
absent=(ftp file ldap ldaps rtsp dict telnet tftp pop3 imap smb smtp gopher mqtt manual ntlm ntlm-wb tls-srp
	unix-sockets alt-svc hsts doh netrc cookies proxy ares crypto-auth get-easy-options dnsshuffle libcurl-option
	dependency-tracking)
without=(zlib brotli zstd libpsl libidn2 nghttp2 librtmp libssh2 libgsasl ca-bundle ca-path)
options=("--host=${prefix%-}" --disable-shared --enable-static --with-openssl "${absent[@]/#/--disable-}"
	"${without[@]/#/--without-}")

build() {
	configure
	compile -C lib
	compile -C src
	program src/curl usr/bin/curl
}
