#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# build-musl.sh FOLDER LIBRARY...: libraries for musl, from Debian's unpacked sources, which are in FOLDER too.
#
# Debian has musl and its compiler's wrapper, but no library for it.
# FOLDER/root gets them, and the host's headers of the kernel.
set -euo pipefail

folder=$(realpath -e "$1")
tree=$(realpath -e "$(dirname "$0")/..")
multiarch=$(gcc -print-multiarch)
root=$folder/root
libraries=("${@:2}")

kernel_headers() {
	mkdir -p "$root/include"
	ln -s /usr/include/linux /usr/include/asm-generic "/usr/include/$multiarch/asm" "$root/include"
}

build() {
	local library=$1
	cd "$folder/$library"
	if [[ -e CMakeLists.txt ]]; then
		cmake -B "$folder/$library.build" -DCMAKE_C_COMPILER=musl-gcc -DCMAKE_C_FLAGS="-isystem $root/include" \
			-DCMAKE_INSTALL_PREFIX="$root" -DCMAKE_INSTALL_LIBDIR=lib -DCMAKE_BUILD_TYPE=Release -DWITH_EXAMPLES=OFF \
			-DJANSSON_BUILD_SHARED_LIBS=ON -DJANSSON_BUILD_DOCS=OFF -DJANSSON_EXAMPLES=OFF -DJANSSON_WITHOUT_TESTS=ON
		cmake --build "$folder/$library.build" --parallel "$(nproc)"
		cmake --install "$folder/$library.build"
	else
		CC=musl-gcc CPPFLAGS="-isystem $root/include" ./configure --prefix="$root" --disable-static --disable-python
		make --jobs="$(nproc)"
		make install
	fi
}

inputs() {
	sha256sum "${libraries[@]/%/.dsc}" "$tree/scripts/build-musl.sh"
	musl-gcc -v 2>&1
}

cd "$folder"
if ! [[ -e $folder/inputs && $(inputs) == "$(<"$folder/inputs")" ]]; then
	rm -rf inputs root ./*.build
	kernel_headers
	for library in "${libraries[@]}"; do
		(build "$library")
	done
	inputs >"$folder/inputs"
fi
