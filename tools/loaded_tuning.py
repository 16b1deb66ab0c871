#!/usr/bin/env python3
"""Searches while other programs come and go: is what they find as good as what quiet searches find?

    make build
    taskset -c 2,3 tools/loaded_tuning.py --scene builtin:hall --objective render [--runs 10] [--out loaded.json]

Each search has a fresh daemon and database, so nothing is known beforehand. Beside the loaded ones 0 to 2 busy processes
run on the same processors; how many changes every 5 to 20 seconds, as drawn from --seed. Afterwards all winners and the
start run in interleaved rounds on the quiet machine, and a ratio is taken within a round: a winner over the median of
the quiet searches' winners, and over the start. 95 % intervals of medians are from the signs of the rounds.

A winner is near when its median is at most 1.03; it is below the start when the whole interval is above 1.
Run it where nothing else does; taskset keeps it to some processors.
"""

import argparse
import json
import pathlib
import random
import statistics
import subprocess
import sys
import tempfile
import threading

from rounds import ratio
from tune_scenes import BIN, Failed, render, served

START = "start"
NEAR = 1.03


class Load:
    """Busy processes whose number changes."""

    def __init__(self, seed, most):
        self.random = random.Random(seed)
        self.most = most
        self.processes = []
        self.changes = []
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.run)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.ended.set()
        self.thread.join()
        self.have(0)

    def have(self, count):
        while len(self.processes) > count:
            process = self.processes.pop()
            process.kill()
            process.wait()
        while len(self.processes) < count:
            self.processes.append(subprocess.Popen([sys.executable, "-c", "while True: pass"]))

    def run(self):
        while True:
            count = self.random.randint(0, self.most)
            self.changes.append(count)
            self.have(count)
            if self.ended.wait(self.random.uniform(5, 20)):
                return


def search(arguments, folder, seed):
    """One search with a fresh daemon; what `tune --json` tells."""
    results = folder / "run.json"
    with served(BIN, folder / f"{seed}.db") as url:
        render(BIN, "tune", "--server", url, "--scene", arguments.scene, "--objective", arguments.objective,
               "--iterations", str(arguments.iterations), "--worth", "inf", "--threads", str(arguments.threads),
               "--size", arguments.size, "--rounds", str(arguments.tune_rounds), "--json", results)
    return json.loads(results.read_text())


def side_by_side(arguments, folder, named):
    """Milliseconds of each configuration in each round."""
    command = ["bench", "--scene", arguments.scene, "--threads", str(arguments.threads), "--size", arguments.size,
               "--rounds", str(arguments.rounds), "--only", ",".join(named), "--json", folder / "bench.json"]
    for name, configuration in named.items():
        path = folder / f"{name}.json"
        path.write_text(json.dumps(configuration))
        command += ["--contender", f"{name}=full:{path}"]
    render(BIN, *command)
    rows = json.loads((folder / "bench.json").read_text())[arguments.objective]
    return {row["name"]: row["rounds_ms"] for row in rows if row["name"] in named}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="builtin:hall")
    parser.add_argument("--objective", choices=["render", "total"], default="render")
    parser.add_argument("--runs", type=int, default=10, help="loaded searches")
    parser.add_argument("--quiet-runs", type=int, default=3, help="quiet searches")
    parser.add_argument("--iterations", type=int, default=60)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--load", type=int, default=2, help="most busy processes")
    parser.add_argument("--tune-rounds", type=int, default=21, help="rounds in which tune compares its winner, load included")
    parser.add_argument("--rounds", type=int, default=15, help="quiet rounds of all winners")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=pathlib.Path, help="write everything as JSON")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        named, told, gains = {}, {}, {}
        for number in range(arguments.quiet_runs + arguments.runs):
            is_quiet = number < arguments.quiet_runs
            name = f"quiet-{number + 1}" if is_quiet else f"loaded-{number + 1 - arguments.quiet_runs}"
            with Load(arguments.seed * 1000 + number, 0 if is_quiet else arguments.load) as load:
                run = search(arguments, folder, number)
            named.setdefault(START, run["start"])
            named[name] = run["tuned"]
            told[name] = {"gain": run["confirmation"]["gain"], "nothing_better": run["confirmation"]["nothing_better"],
                          "jumps": run["confirmation"]["disturbances"], "load": load.changes}
            kept = "the start" if run["tuned"] == run["start"] else "another configuration"
            print(f"{name}: kept {kept}; busy processes {load.changes}", file=sys.stderr, flush=True)
        costs = side_by_side(arguments, folder, named)
    quiet = [name for name in named if name.startswith("quiet")]
    reference = [statistics.median(values) for values in zip(*(costs[name] for name in quiet))]
    near = below = 0
    print("| search | over the quiet winners | over the start |\n|---|---|---|")
    for name in named:
        over_quiet, over_start = ratio(costs[name], reference), ratio(costs[name], costs[START])
        gains[name] = {"over_quiet": over_quiet, "over_start": over_start}
        shown = [f"{median:.3f}" + f" [{ends[0]:.3f}, {ends[1]:.3f}]" for median, ends in (over_quiet, over_start)]
        print(f"| {name} | {shown[0]} | {shown[1]} |")
        if name.startswith("loaded"):
            near += over_quiet[0] <= NEAR
            below += over_start[1][0] > 1
    print(f"\n{near} of {arguments.runs} within 3 % of the quiet winners' median; {below} below the start beyond doubt")
    if arguments.out:
        everything = {"arguments": {key: str(value) for key, value in vars(arguments).items()}, "told": told,
                      "configurations": named, "rounds_ms": costs, "ratios": gains, "near": near, "below_start": below}
        arguments.out.write_text(json.dumps(everything, indent=1) + "\n")


if __name__ == "__main__":
    try:
        main()
    except Failed as failed:
        sys.exit(f"loaded_tuning: {failed}")
