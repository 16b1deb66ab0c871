#!/usr/bin/env bash
# Shows in three acts what the service is worth to somebody who has tuned nothing, and leaves demo/report.html.
# `make demo` calls it.
#
#   DEMO_SCENE       what is tuned (default builtin:voxels; also a glTF, OBJ or PLY file)
#   DEMO_OTHER       what is answered without a search (default: another builtin:voxels)
#   DEMO_UNLIKE      a scene that wants something else (default builtin:statue with fewer triangles)
#   DEMO_ITERATIONS  how many trials each search runs (default 40)
#   DEMO_BIN         folder of the programs (default target/demo)
set -euo pipefail
cd "$(dirname "$0")/.."

scene=${DEMO_SCENE:-builtin:voxels}
# Each may be followed by options, such as --detail 0.3.
read -ra other <<<"${DEMO_OTHER:-builtin:voxels --scene-seed 9}"
read -ra unlike <<<"${DEMO_UNLIKE:-builtin:statue --detail 0.3}"
iterations=${DEMO_ITERATIONS:-40}
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
rm -f "$folder"/tuning.db* "$folder"/daemon.log "$folder"/{run,flight,unlike}.json "$folder"/{report,unlike}.html

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
# Certificates are for other daemons: this one has no TLS.
unset TREEWRIGHT_TLS_CA TREEWRIGHT_CLIENT_CERT TREEWRIGHT_CLIENT_KEY
url=$(sed -n 's/.*\(http:[^ ]*\).*/\1/p' "$folder/daemon.out" | head -n 1)
if [ -z "$url" ]; then
    echo "demo: the daemon did not say where it listens; see $folder/daemon.log" >&2
    exit 1
fi
rm -f "$folder/daemon.out"
echo "   listening on $url, database $folder/tuning.db"

tune() {
    "$bin/treewright-render" tune --server "$url" --start native --objective render --worth inf --frames 2 --size "$size" "$@"
}

say "2. From native Embree's default: every trial tries another way to build the tree of boxes that rays are tested against"
tune --scene "$scene" --iterations "$iterations" --json "$folder/run.json" --report "$folder/report.html"

say "3. Another scene of its kind and a camera that moves: answered at once from what was learnt, without any search"
"$bin/treewright-render" play --server "$url" --start native --scene "${other[@]}" --objective render --frames 12 --from 0.05 --to 0.6 \
    --size "$size" --epsilon 0 --compare --json "$folder/flight.json"

say "4. A scene unlike the others: their answer is wrong here, and a search of its own repairs that"
tune --scene "${unlike[@]}" --iterations "$iterations" --rounds 11 --json "$folder/unlike.json" --report "$folder/unlike.html"

say "5. Stopping the daemon"
stop
trap - EXIT
echo "   stopped; what it learned stays in $folder/tuning.db"

say "Done. Open $folder/report.html in a browser: it explains what happened, with pictures; $folder/unlike.html is of the last scene."
