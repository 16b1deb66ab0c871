#!/usr/bin/env bash
# Tries the integrations with the real packages: the Python wheel, built and installed into an environment, with Optuna; the CMake package;
# tinybvh-rs; the SDK for Node and three-mesh-bvh. Fetches from PyPI and npm.
# From nothing, on two cores that others shared: programs 9 minutes, CMake 12 s, tinybvh-rs 5 minutes, Node 5. With everything compiled before and
# the programs linked anew: 163, 5, 1 and 29 s, and the wheel, which is made of what was compiled, 13 s without its tests.
set -euo pipefail
cd "$(dirname "$0")/.."
# Says what comes next, and how long what went before took.
begun=$SECONDS
step() {
    [ "$begun" = "$SECONDS" ] || printf -- '-- %s s\n' $((SECONDS - begun))
    begun=$SECONDS
    printf '\n== %s\n' "$*"
}

step "programs and libraries: a development build of everything; many minutes the first time, seconds afterwards"
cargo build --workspace --bins --lib --locked --quiet
work=$(mktemp -d)
"${CARGO_TARGET_DIR:-target}/debug/treewrightd" serve --listen 127.0.0.1:0 --database "$work/tuning.db" > "$work/address" 2> "$work/log" &
daemon=$!
trap 'kill $daemon; rm -rf "$work"' EXIT
until [ -s "$work/address" ]; do sleep 0.1; done
url=$(sed 's/.* //' "$work/address")

step "the Python wheel of what was built: packages from PyPI (minutes the first time), tests of the SDK and of the Optuna sampler, mypy"
built=$(cd "${CARGO_TARGET_DIR:-target}/debug" && pwd)
environment=target/integrations/python
[ -x "$environment/bin/pip" ] || python3 -m venv "$environment"
"$environment/bin/pip" install --quiet --requirement integrations/python/requirements.txt
TREEWRIGHT_BUILT=$built "$environment/bin/pip" wheel --quiet --no-deps --wheel-dir "$work/wheels" integrations/python
"$environment/bin/pip" install --quiet --force-reinstall --no-deps "$work"/wheels/*.whl
top=$PWD
python=$top/$environment/bin/python
(cd "$work" && "$python" "$top/integrations/python/tests/run.py" "$url")
"$environment/bin/mypy" --strict integrations/python/tests/typed.py

step "the CMake package: installed into a folder, found from there, linked shared and static, a study tuned by each; seconds"
integrations/c/install.sh "$work/prefix" "$built"
cmake="$PWD/$environment/bin/cmake"
"$cmake" -S integrations/c/tests/cmake -B "$work/cmake" -DCMAKE_PREFIX_PATH="$work/prefix" > "$work/cmake.log" || { cat "$work/cmake.log"; exit 1; }
"$cmake" --build "$work/cmake" > "$work/cmake.log" || { cat "$work/cmake.log"; exit 1; }
for kind in treewright static; do
    "$built/treewrightd" serve --listen 127.0.0.1:0 --database "$work/$kind.db" > "$work/$kind.address" 2>> "$work/log" &
    other=$!
    until [ -s "$work/$kind.address" ]; do sleep 0.1; done
    "$work/cmake/sdk_$kind" "$(sed 's/.* //' "$work/$kind.address")" || { kill $other; exit 1; }
    kill $other
done

step "Rust: tests of the builders with tinybvh-rs, which compiles C++ for this machine; minutes the first time"
if grep -qw avx2 /proc/cpuinfo 2> /dev/null; then
    cargo test --workspace --bin treewright-builders --features treewright-builders/tinybvh --locked --quiet
else
    echo "passed by: tinybvh-rs, because this processor has no AVX2"
fi

step "Node: packages from npm; what npm pack makes is installed and tested, its types too, and tunes three-mesh-bvh; five minutes the first time"
if command -v npm > /dev/null; then
    (cd integrations/javascript && npm ci --no-audit --no-fund --silent && npm pack --silent --pack-destination "$work" > /dev/null)
    mkdir "$work/node"
    cp integrations/javascript/test/run.js "$work/node/run.mjs"
    cp integrations/javascript/test/typed.ts "$work/node"
    (cd "$work/node" && npm install --no-audit --no-fund --silent ../treewright-*.tgz)
    cp -r integrations/javascript/node_modules/{three,three-mesh-bvh,typescript} "$work/node/node_modules"
    (cd "$work/node" && node run.mjs "$url" &&
        node node_modules/typescript/bin/tsc --noEmit --strict --module nodenext --target es2022 typed.ts &&
        node node_modules/treewright/examples/three_mesh_bvh.js --url "$url" --trials 4 --rays 2000 --rounds 1)
else
    echo "passed by: Node, because there is no npm"
fi

step "done in $SECONDS s"
