#!/usr/bin/env python3
"""Tunes the evaluation scenes for both objectives and prints the comparison as Markdown.

    make build
    SCENES=FOLDER tools/bench.py [--scenes NAME,...] [--iterations 80] [--rounds 9] [--verify] [--out FILE.md]

Scenes are the built-in hall and city, and, when SCENES names a folder that holds NAME/NAME.glb,
sponza, fireplace_room, living_room and bmw-m6. Every run has a daemon and a database of its own. After
the search, the default, native Embree and the winner are measured again side by side in interleaved
rounds: those are the figures printed, never the best of the search.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
BIN = pathlib.Path(os.environ.get("BIN", ROOT / "target" / "release"))
FILES = ["sponza", "fireplace_room", "living_room", "bmw-m6"]
BUILTIN = ["hall", "city"]


def scenes(chosen):
    folder = pathlib.Path(os.environ["SCENES"]) if os.environ.get("SCENES") else None
    found = {name: f"builtin:{name}" for name in BUILTIN}
    for name in FILES:
        file = folder / name / f"{name}.glb" if folder else None
        if file and file.exists():
            found[name] = str(file)
    if chosen:
        missing = [name for name in chosen if name not in found]
        if missing:
            sys.exit(f"bench: no such scene: {', '.join(missing)}; there are {', '.join(found)} (set SCENES for real ones)")
        found = {name: found[name] for name in chosen}
    return found


class Daemon:
    """A daemon on a fresh database, for the length of a with block."""

    def __enter__(self):
        self.folder = tempfile.TemporaryDirectory()
        database = str(pathlib.Path(self.folder.name) / "tuning.db")
        self.process = subprocess.Popen([str(BIN / "treewrightd"), "serve", "--listen", "127.0.0.1:0", "--database", database],
                                        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        line = self.process.stdout.readline()
        if "http://" not in line:
            sys.exit("bench: treewrightd did not start; run: make build")
        return line.split()[-1]

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait()
        self.folder.cleanup()


def tune(scene, objective, options):
    with Daemon() as url, tempfile.TemporaryDirectory() as folder:
        result = pathlib.Path(folder) / "run.json"
        command = [str(BIN / "treewright-render"), "tune", "--server", url, "--scene", scene, "--objective", objective,
                   "--iterations", str(options.iterations), "--rounds", str(options.rounds),
                   "--size", options.size, "--json", str(result)]
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if done.returncode != 0:
            sys.exit(f"bench: tuning {scene} for {objective} failed:\n{done.stderr}")
        return json.loads(result.read_text())


def verify(scene):
    done = subprocess.run([str(BIN / "treewright-render"), "verify", "--scene", scene, "--json"], capture_output=True, text=True)
    return done.returncode == 0, done.stdout


def quartiles(summary, digits=2):
    return f"{summary['median']:.{digits}f} [{summary['lower_quartile']:.{digits}f}, {summary['upper_quartile']:.{digits}f}]"


def row(name, objective, run):
    """One line of the table: medians in ms, ratios as median [quartiles] of pairs."""
    standing = {each["name"]: each for each in run["standings"]}
    cost = lambda each: each["frame_ms"]["median"]
    default, tuned = standing["recommended default"], standing["tuned"]
    native = standing["native Embree default"]
    against_native = cost(native) / cost(tuned)
    prediction = run["prediction"]
    predicted = prediction["standings"][-1]["speedup"]["median"] if prediction else float("nan")
    failed = sum(trial["cost"] is None for trial in run["trials"])
    breaks = run["break_even_frame"]
    return (f"| {name} | {objective} | {cost(default):.1f} | {cost(native):.1f} | {cost(standing['native Embree high']):.1f} "
            f"| **{cost(tuned):.1f}** | {quartiles(tuned['speedup'])} | {against_native:.2f} | {predicted:.2f} "
            f"| {failed} | {run['overhead']['waiting_ms']['median']:.2f} ({100 * run['overhead']['share_of_frame']:.1f} %) "
            f"| {'never' if breaks is None else breaks} |")


HEAD = """| scene | objective | default ms | native medium ms | native high ms | tuned ms | default / tuned | native medium / tuned | default / predicted, fresh camera | infeasible trials | tuning overhead ms (share of frame) | break-even frame |
|---|---|---|---|---|---|---|---|---|---|---|---|"""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=lambda text: text.split(","), help="only these, e.g. hall,sponza")
    parser.add_argument("--objectives", type=lambda text: text.split(","), default=["render", "total"])
    parser.add_argument("--iterations", type=int, default=80)
    parser.add_argument("--rounds", type=int, default=9, help="paired rounds of the final measurement")
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--verify", action="store_true", help="also compare hits and pictures between accelerators")
    parser.add_argument("--out", type=pathlib.Path, help="write the table and the raw results (.json) there as well")
    options = parser.parse_args()
    runs, lines = {}, [HEAD]
    for name, scene in scenes(options.scenes).items():
        for objective in options.objectives:
            begun = time.time()
            run = tune(scene, objective, options)
            runs[f"{name} {objective}"] = run
            lines.append(row(name, objective, run))
            print(lines[-1], f"({time.time() - begun:.0f} s)", file=sys.stderr, flush=True)
        if options.verify:
            agrees, told = verify(scene)
            runs[f"{name} verify"] = json.loads(told) if told.startswith("{") else told
            print(f"{name}: accelerators {'agree' if agrees else 'DO NOT AGREE'}", file=sys.stderr, flush=True)
    table = "\n".join(lines)
    print(table)
    if options.out:
        options.out.write_text(table + "\n")
        options.out.with_suffix(".json").write_text(json.dumps(runs, indent=1))


if __name__ == "__main__":
    main()
