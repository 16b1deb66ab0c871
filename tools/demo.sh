#!/usr/bin/env bash
# Tunes a built-in scene with a fresh daemon, moves the camera, and leaves demo/report.html. `make demo` calls it.
#
#   DEMO_SCENE       what is tuned (default builtin:voxels; also a glTF, OBJ or PLY file)
#   DEMO_ITERATIONS  how many configurations are tried (default 50)
#   DEMO_BIN         folder of the programs (default target/demo)
set -euo pipefail
cd "$(dirname "$0")/.."

scene=${DEMO_SCENE:-builtin:voxels}
iterations=${DEMO_ITERATIONS:-50}
bin=${DEMO_BIN:-target/demo}
folder=demo
size=320x240

for program in treewrightd treewright-render; do
    if [ ! -x "$bin/$program" ]; then
        echo "demo: $bin/$program is missing; run: make demo" >&2
        exit 1
    fi
done

mkdir -p "$folder"
rm -f "$folder"/tuning.db* "$folder"/daemon.log "$folder"/run.json "$folder"/flight.json "$folder"/report.html

say() { printf '\n\033[1m%s\033[0m\n' "$*"; }

say "1. Starting the tuning daemon on a fresh database"
"$bin/treewrightd" serve --listen 127.0.0.1:0 --database "$folder/tuning.db" >"$folder/daemon.out" 2>"$folder/daemon.log" &
daemon=$!
stop() {
    # The daemon finishes what it has begun, then ends.
    kill -TERM "$daemon" 2>/dev/null || true
    wait "$daemon" 2>/dev/null || true
}
trap stop EXIT
trap 'exit 130' INT TERM
for _ in $(seq 100); do
    [ -s "$folder/daemon.out" ] && break
    if ! kill -0 "$daemon" 2>/dev/null; then
        echo "demo: the daemon did not start:" >&2
        cat "$folder/daemon.log" >&2
        exit 1
    fi
    sleep 0.1
done
url=$(sed -n 's/.*\(http:[^ ]*\).*/\1/p' "$folder/daemon.out" | head -n 1)
if [ -z "$url" ]; then
    echo "demo: the daemon did not say where it listens; see $folder/daemon.log" >&2
    exit 1
fi
rm -f "$folder/daemon.out"
echo "   listening on $url, database $folder/tuning.db"

say "2. Tuning: every trial tries another way to build the tree of boxes that rays are tested against"
"$bin/treewright-render" tune --server "$url" --scene "$scene" --objective render --iterations "$iterations" --frames 2 \
    --size "$size" --json "$folder/run.json" --report "$folder/report.html"

say "3. Moving the camera: the service has never seen these views, and answers at once from what it learned"
"$bin/treewright-render" play --server "$url" --scene "$scene" --objective render --frames 12 --from 0.05 --to 0.6 \
    --size "$size" --epsilon 0 --compare --json "$folder/flight.json"

say "4. Stopping the daemon"
stop
trap - EXIT
echo "   stopped; what it learned stays in $folder/tuning.db"

say "Done. Open $folder/report.html in a browser: it explains what happened, with pictures."
