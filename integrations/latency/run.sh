#!/usr/bin/env bash
# Round trips from every SDK in one run, over one daemon: `run.sh FOLDER [COUNT]`, FOLDER holding treewrightd, libtreewright.so,
# libtreewright_native.so and examples/round_trips. Median and 99th percentile of Predict, which writes nothing, and of Suggest, which is on
# the disk before it is answered; the report is sent and waited for in between, and is not counted.
set -euo pipefail
built=$(cd "${1:?usage: run.sh FOLDER [COUNT]}" && pwd)
count=${2:-1000}
cd "$(dirname "$0")"
work=$(mktemp -d)
"$built/treewrightd" serve --listen 127.0.0.1:0 --database "$work/tuning.db" > "$work/address" 2> "$work/log" &
daemon=$!
trap 'kill $daemon; rm -rf "$work"' EXIT
until [ -s "$work/address" ]; do sleep 0.1; done
url=$(sed 's/.* //' "$work/address")
../c/install.sh "$work" "$built" > /dev/null
for each in c cpp; do
    compiler=$([ $each = c ] && echo "cc -std=gnu99" || echo "c++ -std=c++17")
    $compiler -O2 -I"$work/include" latency.$each -o "$work/latency_$each" -L"$work/lib" -ltreewright -Wl,-rpath,"$work/lib"
done
mkdir "$work/python" && cp -r ../python/python/treewright "$work/python/"
cp "$built/libtreewright_native.so" "$work/python/treewright/_native.abi3.so"
"$built/examples/round_trips" "$url" "$count"
"$work/latency_c" "$url" "$count"
"$work/latency_cpp" "$url" "$count"
PYTHONPATH="$work/python" python3 latency.py "$url" "$count"
node latency.js "$url" "$count"
