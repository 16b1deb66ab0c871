#!/bin/sh
# Compiles tinybvh for this machine as target/native/libtreewright_tinybvh.so, a further peer of the benchmark of rays:
#
#   tools/tinybvh.sh
#   TREEWRIGHT_TINYBVH=target/native/libtreewright_tinybvh.so cargo bench -p treewright-accel -- $PWD/*.rays
#
# The header is that of the crate tinybvh-rs, which this repository's lock file pins.
set -eu
cd "$(dirname "$0")/.."
header=$(cargo metadata --locked --format-version 1 --all-features | python3 -c '
import json, os, sys
found = [package["manifest_path"] for package in json.load(sys.stdin)["packages"] if package["name"] == "tinybvh-rs"]
print(os.path.join(os.path.dirname(found[0]), "ffi", "tinybvh"))')
mkdir -p target/native
"${CXX:-c++}" -std=c++20 -O3 -march=native -DNDEBUG -shared -fPIC -w -I "$header" \
    renderer/accel/benches/rays/tinybvh.cpp -o target/native/libtreewright_tinybvh.so
echo "target/native/libtreewright_tinybvh.so"
