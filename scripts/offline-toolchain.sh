#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# offline-toolchain.sh FOLDER ARMEL: Debian's cross compiler for armel, in the layout that Buildroot takes as a toolchain.
#
# FOLDER has bin, lib/gcc-cross and arm-linux-gnueabi/sysroot. Debian's own layout will not do: its C library is not in a
# sysroot, and Buildroot refuses a compiler that was configured with the sysroot /. ARMEL is the sysroot of make setup.
set -euo pipefail

target=arm-linux-gnueabi
version=12
root=${DEBIAN_ROOT:-} # a test's stand-in for /
folder=$(realpath -m "$1")
armel=$(realpath -e "$2")
sysroot=$folder/$target/sysroot

[[ -x $root/usr/bin/$target-gcc-$version && -e $root/usr/$target/lib/libc.a ]] || {
	echo "offline: this machine has no gcc-$version-$target with libc6-dev-armel-cross; make setup brings both" >&2
	exit 2
}

rm -rf "$folder"
mkdir -p "$folder"/{bin,real,lib/gcc-cross,"$target"/bin} "$sysroot"/{lib,usr/lib}

# gcc finds its parts relative to itself: real/ is as far from lib/ as /usr/bin is.
cp --archive "$root/usr/lib/gcc-cross/$target" "$folder/lib/gcc-cross/"
for program in "$root/usr/bin/$target"-*; do
	name=${program##*/}
	cp --dereference --preserve=timestamps "$program" "$folder/real/$name"
done

# The compiler for its sysroot, with what makes it another than Debian's left out of what it says of itself.
cat >"$folder/compiler" <<'END'
#!/bin/sh
folder=${0%/*}/..
program=$folder/real/${0##*/}
if [ "$*" = -v ]; then
	"$program" -v 2>&1 | sed 's, --with-sysroot=/ , ,' >&2
	exit
fi
exec "$program" --sysroot="$folder/arm-linux-gnueabi/sysroot" "$@"
END
chmod +x "$folder/compiler"
for program in "$folder/real/$target"-*; do
	name=${program##*/}
	case $name in
	"$target-gcc" | "$target-gcc-$version" | "$target-cpp" | "$target-cpp-$version") cp "$folder/compiler" "$folder/bin/$name" ;;
	*) ln -s "../real/$name" "$folder/bin/$name" ;;
	esac
done
cp "$folder/compiler" "$folder/bin/$target-cc"
ln -s "$target-gcc" "$folder/real/$target-cc"
rm "$folder/compiler"
# ccache knows a compiler by its time: the same in each tree and run.
for program in "$folder"/bin/*; do
	[[ -L $program ]] || touch --reference="$folder/real/${program##*/}" "$program"
done
for name in ar as ld ld.bfd nm objcopy objdump ranlib readelf strip; do
	ln -s "../../real/$target-$name" "$folder/$target/bin/$name"
done

cp --archive "$root/usr/$target/include" "$sysroot/usr/"
# What a program is linked with into usr/lib, what it runs with into lib.
for file in "$root/usr/$target"/lib/*; do
	name=${file##*/}
	case $name in
	*.a | *.o | libc.so) cp --archive "$file" "$sysroot/usr/lib/" ;;
	*.so) if [[ -L $file ]]; then
		ln -s "../../lib/$(basename "$(readlink "$file")")" "$sysroot/usr/lib/$name"
	else
		cp --archive "$file" "$sysroot/lib/"
	fi ;;
	*.so.*) cp --archive "$file" "$sysroot/lib/" ;;
	esac
done
# Debian's cross package has the C library as it was at Debian's release; what was mended since is in armel's own.
for file in "$sysroot"/{lib,usr/lib}/*; do
	mended=$armel/${file#"$sysroot/"}
	mended=${mended%/*}/arm-linux-gnueabi/${file##*/}
	[[ -L $file || ${file##*/} == libc.so || ! -f $mended ]] || cp --dereference "$mended" "$file"
done
# A linker script names its parts from the sysroot on.
sed -i "s,/usr/$target/lib/\([^ ]*\.a\),/usr/lib/\1,g; s,/usr/$target/lib/,/lib/,g" "$sysroot/usr/lib/libc.so"
# The compiler's links to its own libraries, which are beside the C library.
while IFS= read -r link; do
	name=$(basename "$(readlink "$link")")
	[[ ! -e $sysroot/lib/$name ]] || ln -sfn "../../../../$target/sysroot/lib/$name" "$link"
done < <(find "$folder/lib/gcc-cross" -xtype l)
touch "$folder/done"
