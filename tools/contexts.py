#!/usr/bin/env python3
"""Our start over native Embree in other picture sizes, numbers of threads and instruction sets: docs/measurements/start-progressive.md.

    make build
    SCENES=FOLDER tools/contexts.py [--out contexts.json] [--only NAME,...] [--contexts 2@320x240,1@1280x720:avx2]
    tools/contexts.py --out contexts.json --table

Nothing is searched: each scene runs the configuration with which a search begins, beside native Embree's default and native
used well, in interleaved rounds, all with the same rays. Built-in scenes run always, real ones where SCENES names a folder that
holds NAME/*.glb or NAME/*.obj. A context is THREADS@WIDTHxHEIGHT and, after a colon, the instruction set for everybody.

Results go into the JSON file after every step; a run that was stopped goes on where it was.
"""

import argparse
import json
import math
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

from rounds import ratio

ROOT = pathlib.Path(__file__).resolve().parent.parent
BIN = pathlib.Path(os.environ.get("BIN", ROOT / "target" / "release"))
# Name, and what is asked for: among them instances (forest), cut-out leaves (grove) and one of eight million triangles.
BUILTIN = {
    "hall": [], "voxels": [], "gallery": [], "statue": [], "needles": [], "city": [], "model": [], "sea": ["--time", "0.3"], "quick": [],
    "forest": ["--detail", "0.3"], "forest-3": ["--scene-seed", "3", "--detail", "0.1"], "forest-10M": [],
    "grove": [], "statue-8M": ["--detail", "8"],
}
FILES = ["sponza", "fireplace_room", "living_room", "bmw-m6", "kitchen", "classroom"]
INSTANCED = ["forest", "forest-3", "forest-10M"]
OBJECTIVES = {"render": "Progressive: a frame with a thousandth of its build", "total": "Real time: a frame with its whole build"}
DEFAULT, USED_WELL, START = "native Embree default", "native used well", "best fixed configuration"
OVER = {"native default": DEFAULT, "native used well": USED_WELL}


def scenes(only):
    found = {name: ["--scene", f"builtin:{name.split('-')[0]}", *more] for name, more in BUILTIN.items()}
    folder = os.environ.get("SCENES")
    for name in FILES if folder else []:
        files = [*sorted((pathlib.Path(folder) / name).glob("*.glb")), *sorted((pathlib.Path(folder) / name).glob("*.obj"))]
        if files:
            found[name] = ["--scene", str(files[0])]
    missing = [name for name in only or [] if name not in found]
    if missing:
        sys.exit(f"contexts: no such scene: {', '.join(missing)}; there are {', '.join(found)}")
    return {name: found[name] for name in only} if only else found


def measure(scene, context, rounds):
    shape, _, isa = context.partition(":")
    threads, _, size = shape.partition("@")
    environment = os.environ | ({"TREEWRIGHT_ISA": isa} if isa else {})
    with tempfile.TemporaryDirectory() as folder:
        result = pathlib.Path(folder) / "bench.json"
        command = [BIN / "treewright-render", "bench", *scene, "--threads", threads, "--size", size, "--rounds", str(rounds),
                   "--only", ",".join([DEFAULT, USED_WELL, START]), "--json", result]
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment)
        if done.returncode:
            sys.exit(f"contexts: {' '.join(map(str, command))} failed:\n{done.stderr}")
        run = json.loads(result.read_text())
    return {"triangles": run["triangles"], "disturbed": run["disturbance"]["disturbed"],
            **{objective: {row["name"]: row["rounds_ms"] for row in run[objective] if row["name"] in (DEFAULT, USED_WELL, START)}
               for objective in OBJECTIVES}}


def gain(rows, other):
    """How many times as fast the start is as the other, and the interval."""
    return ratio(rows[other], rows[START])


def table(book):
    contexts = sorted({key.split(" ")[1] for key in book}, key=lambda context: (context.partition("@")[2], context))
    lines = []
    for objective, title in OBJECTIVES.items():
        lines += [f"**{title}**", "", "| median over the scenes (least) | scenes | " + " | ".join(f"over {name}" for name in OVER)
                  + " | over native used well: faster, slower beyond doubt | over native used well, instances |", "|---|---|---|---|---|---|"]
        for context in contexts:
            rows = {key.split(" ")[0]: each[objective] for key, each in book.items() if key.split(" ")[1] == context}
            cells = []
            for other in OVER.values():
                medians = [gain(row, other)[0] for row in rows.values()]
                cells.append(f"{statistics.median(medians):.2f} ({min(medians):.2f})")
            intervals = [gain(row, USED_WELL)[1] for row in rows.values()]
            sure = f"{sum(low > 1 for low, _ in intervals)}, {sum(high < 1 for _, high in intervals)}"
            placed = [gain(rows[name], USED_WELL)[0] for name in INSTANCED if name in rows]
            cells += [sure, " ".join(f"{each:.2f}" for each in placed)]
            lines.append(f"| {context} | {len(rows)} | {' | '.join(cells)} |")
        names = list(dict.fromkeys(key.split(" ")[0] for key in book))
        lines += ["", "| over native used well | triangles | " + " | ".join(contexts) + " |", "|---|---|" + "---|" * len(contexts)]
        for name in names:
            own = {context: book.get(f"{name} {context}") for context in contexts}
            triangles = next(each["triangles"] for each in own.values() if each)
            cells = []
            for each in own.values():
                if not each:
                    cells.append("–")
                    continue
                median, (low, high) = gain(each[objective], USED_WELL)
                interval = f" [{low:.2f}, {high:.2f}]" if math.isfinite(low) else ""
                cells.append(f"{median:.2f}{interval}" + (" *" if each["disturbed"] else ""))
            lines.append(f"| {name} | {triangles:,} | {' | '.join(cells)} |")
        lines.append("")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", type=lambda text: text.split(","), help="only these scenes")
    parser.add_argument("--contexts", type=lambda text: text.split(","), default=["2@320x240", "1@320x240:avx2", "2@1280x720", "1@1280x720:avx2"])
    parser.add_argument("--rounds", type=int, default=7, help="interleaved rounds; with fewer than 6 there are no 95 %% intervals")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("contexts.json"))
    parser.add_argument("--table", action="store_true", help="print the table of what is there, and measure nothing")
    options = parser.parse_args()
    book = json.loads(options.out.read_text()) if options.out.exists() else {}
    for context in options.contexts if not options.table else []:
        for name, scene in scenes(options.only).items():
            key = f"{name} {context}"
            if key not in book:
                begun = time.time()
                book[key] = measure(scene, context, options.rounds)
                options.out.write_text(json.dumps(book, indent=1))
                told = ", ".join(f"{objective} {gain(book[key][objective], USED_WELL)[0]:.2f}" for objective in OBJECTIVES)
                print(f"{key}: over native used well {told} ({time.time() - begun:.0f} s)", file=sys.stderr, flush=True)
    print(table(book))


if __name__ == "__main__":
    main()
