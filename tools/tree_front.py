#!/usr/bin/env python3
"""Finds the Pareto front of frame time and memory of the renderer's tree, as an example of `treewright exec --front`.

    tools/tree_front.py --scene builtin:gallery --svg front.svg

A run is `treewright-render bench` of one configuration beside the start of searches, in interleaved rounds. What it
prints for `exec` are the medians of the rounds' ratios of their frame times and the bytes of its tree for each
triangle. At the end all configurations of the front are measured again in shared rounds, and printed as a table with
the 95 % interval of their speed over the start. The programs are those of target/release; the daemon and its database
are the script's own.
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile

from rounds import ratio

ROOT = pathlib.Path(__file__).resolve().parent.parent
METRICS = ["frame_ratio", "bytes_per_triangle"]
# Of the careful builder with the best grouping, which is the start's; each with its default there.
PARAMETERS = [
    "min_leaf_size=1..32:8:log", "max_leaf_size=1..32:32:log", "block_width=4|8:8", "node_width=2|4|8|16:16",
    "traversal_cost=0.1..10.0:1.0:log", "sah_block_size=1|2|4|8|16|32:4", "reinsertion_passes=0..16:4",
]


def bench(options, configurations, rounds):
    """Measures configurations by name in shared rounds. Returns each one's part of the results, and the triangles."""
    with tempfile.TemporaryDirectory(prefix="tree-front-") as made:
        folder = pathlib.Path(made)
        command = [options.built / "treewright-render", "bench", "--scene", options.scene, "--size", options.size]
        command += ["--rounds", str(rounds), "--only", ",".join(configurations), "--json", folder / "bench.json"]
        for name, configuration in configurations.items():
            file = folder / f"{name}.json"
            file.write_text(json.dumps(configuration))
            command += ["--contender", f"{name}=full:{file}"]
        # What is printed is the last word of a run.
        subprocess.run(command, check=True, stdout=sys.stderr)
        done = json.loads((folder / "bench.json").read_text())
    return {one["name"]: one for one in done["render"]}, done["triangles"]


def run(options):
    """One run of `exec`."""
    configuration = {name: json.loads(value) for name, _, value in (word.partition("=") for word in options.run)}
    found, triangles = bench(options, {"start": {}, "run": configuration}, options.rounds)
    if found["run"]["failure"]:
        print(json.dumps({"infeasible": found["run"]["failure"]}))
        return
    median, _ = ratio(found["run"]["undelayed_ms"], found["start"]["undelayed_ms"])
    print(json.dumps({"frame_ratio": median, "bytes_per_triangle": found["run"]["structure_bytes"] / triangles}))


def search(options, url):
    """The front that `exec` finds."""
    names = [parameter.partition("=")[0] for parameter in PARAMETERS]
    own = [sys.executable, pathlib.Path(__file__).resolve(), "--scene", options.scene, "--size", options.size]
    own += ["--rounds", str(options.rounds), "--built", options.built, "--run", *(f"{name}={{{name}}}" for name in names)]
    command = [options.built / "treewright", "--json", "--server", url, "exec", "tree", "--metric", "json"]
    command += ["--front", ",".join(METRICS), "--trials", str(options.trials)]
    command += [word for parameter in PARAMETERS for word in ("--tune", parameter)]
    command += ["--constraint", "min_leaf_size <= max_leaf_size", "--", *own]
    done = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    if options.svg:
        drawn = [options.built / "treewright", "--server", url, "front", "tree", "--svg", options.svg]
        subprocess.run(drawn, check=True, stdout=subprocess.DEVNULL)
    return done["front"]


def table(options, front):
    """The front, measured again."""
    default = front["default"]["configuration"] if front["default"] else {}
    found = {f"point-{place}": point["configuration"] for place, point in enumerate(front["points"], 1)}
    measured, triangles = bench(options, {"start": {}, **found}, options.final_rounds)
    lines = ["| bytes a triangle | speed over the start [95 %] | differs from the start in |", "|--:|--:|---|"]
    for name in ("start", *found):
        one = measured[name]
        if one["failure"]:
            continue
        median, (low, high) = ratio(measured["start"]["undelayed_ms"], one["undelayed_ms"])
        changed = {key: value for key, value in found.get(name, {}).items() if value != default.get(key)}
        words = ", ".join(f"{key} {value:.3g}" for key, value in changed.items())
        speed = "1" if name == "start" else f"{median:.3f} [{low:.3f}, {high:.3f}]"
        lines.append(f"| {one['structure_bytes'] / triangles:.1f} | {speed} | {words or '–'} |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="builtin:gallery")
    parser.add_argument("--size", default="320x180", metavar="WxH")
    parser.add_argument("--trials", type=int, default=80)
    parser.add_argument("--rounds", type=int, default=7, help="rounds of a run")
    parser.add_argument("--final-rounds", type=int, default=21, help="rounds of the measurement at the end")
    parser.add_argument("--svg", type=pathlib.Path, metavar="FILE", help="also draw the front that was found")
    parser.add_argument("--built", type=pathlib.Path, default=ROOT / "target" / "release", help="folder of the programs")
    parser.add_argument("--run", nargs="+", metavar="NAME=VALUE", help="measure one configuration, as exec asks")
    options = parser.parse_args()
    options.built = options.built.resolve()
    if options.run:
        run(options)
        return
    with tempfile.TemporaryDirectory(prefix="tree-front-") as folder:
        command = [options.built / "treewrightd", "serve", "--listen", "127.0.0.1:0", "--database", f"{folder}/tuning.db"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as daemon:
            try:
                url = re.search(r"http:\S+", daemon.stdout.readline()).group(0)
                front = search(options, url)
            finally:
                daemon.terminate()
    volume = "none" if front["hypervolume"] is None else f"{front['hypervolume']:.4f}"
    print(f"{front['runs']} runs, {front['configurations']} configurations, hypervolume {volume}\n\n{table(options, front)}")


if __name__ == "__main__":
    main()
