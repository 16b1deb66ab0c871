#!/usr/bin/env bash
# Installs libtreewright with its headers, pkg-config file and CMake package: `install.sh PREFIX [FOLDER OF THE BUILT LIBRARIES]`.
# Without a folder they are those of the release archive that it lies in, or else are built first, optimised.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
prefix=${1:?usage: install.sh PREFIX [FOLDER]}
built=${2:-}
[ -n "$built" ] || [ ! -f "$here/lib/libtreewright.so" ] || built=$here/lib
if [ -z "$built" ]; then
    (cd "$here/../.." && cargo build --release --locked --quiet -p treewright-c)
    built=${CARGO_TARGET_DIR:-$here/../../target}/release
fi
version=$(sed -n 's/^#define TREEWRIGHT_VERSION_[A-Z]* //p' "$here/include/treewright.h" | paste -sd.)
mkdir -p "$prefix/include" "$prefix/lib/pkgconfig" "$prefix/lib/cmake/treewright"
prefix=$(cd "$prefix" && pwd)
cp "$here"/include/* "$prefix/include/"
# The library's name for the loader: see treewright.h on versions.
case $version in
    0.*) loaded=libtreewright.so.$(echo "$version" | cut -d. -f1,2) ;;
    *) loaded=libtreewright.so.${version%%.*} ;;
esac
cp "$built/libtreewright.so" "$prefix/lib/libtreewright.so.$version"
# Without symbols for debuggers it is a fraction of the size; what programs link with stays.
! command -v strip > /dev/null || strip --strip-unneeded "$prefix/lib/libtreewright.so.$version"
[ ! -f "$built/libtreewright.a" ] || cp "$built/libtreewright.a" "$prefix/lib/"
ln -sf "libtreewright.so.$version" "$prefix/lib/$loaded"
ln -sf "$loaded" "$prefix/lib/libtreewright.so"
sed -e "s|@PREFIX@|$prefix|; s|@VERSION@|$version|" "$here/treewright.pc.in" > "$prefix/lib/pkgconfig/treewright.pc"
cp "$here"/treewright-config*.cmake "$prefix/lib/cmake/treewright/"
echo "installed libtreewright $version below $prefix"
