#!/usr/bin/env python3
"""Records how fast a scene is rendered with every configuration of a grid of the paper's parameters.

    tests/peers/record.py --scene builtin:quick --detail 0.1 --out tests/peers/recorded

writes two landscapes, one for each objective: a frame with a thousandth of its build (`NAME-render.json`) and a frame
with a whole one (`NAME-total.json`). Configurations are measured by `treewright-render bench`, sixty beside the paper's
default at a time in interleaved rounds, in a shuffled order. A cost is the least of its rounds over the least of the
default's beside it: other work on the machine makes a frame slower, never faster, so the least is the truth about the
structure, and a machine that grows slower or faster does not show. Trees that cannot be built are recorded as such.
Pictures are small and one thread renders them: what is recorded is how a choice compares with another choice, not how
fast the machine is. Give it a processor of its own: on a machine that does other work at once, even the least of
many rounds is that of a frame which was interrupted.

A landscape holds `parameters`, the grid, and `costs`: a number for each configuration, the last parameter fastest and
those that mean nothing beside the others' values left out; null where there is no tree.
"""

import argparse
import json
import os
import pathlib
import random
import subprocess
import tempfile

from problems import Parameter, configurations

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
RENDER = pathlib.Path(os.environ.get("RENDER", ROOT / "target" / "release" / "treewright-render"))
TREE = ("compact", (False,))
SURFACE_AREA = ("quality", (2, 3))
GRID = [
    Parameter("compact", "switch", default=False),
    Parameter("quality", "choice", values=(1, 2, 3), default=2, active_if=TREE),
    Parameter("branching_factor", "choice", values=(2, 4, 8), default=2, active_if=TREE),
    Parameter("max_depth", "choice", values=(9, 12, 16, 20, 32), default=32, active_if=TREE),
    Parameter("sah_block_size", "choice", values=(1, 4, 16), default=1, active_if=SURFACE_AREA),
    Parameter("min_leaf_size", "choice", values=(1, 2, 4), default=1, active_if=TREE),
    Parameter("max_leaf_size", "choice", values=(4, 8, 16, 32), default=32, active_if=TREE),
    Parameter("traversal_cost", "choice", values=(0.5, 1.0, 3.0), default=1.0, active_if=SURFACE_AREA),
]
REFERENCE = "paper default"
AT_ONCE = 60  # the renderer's limit is 64


def measure(options, batch):
    """Costs of some configurations, by objective: multiples of the reference's, None where nothing could be built."""
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        command = [RENDER, "bench", "--scene", options.scene, "--detail", str(options.detail), "--size", options.size,
                   "--rounds", str(options.rounds), "--threads", "1", "--space", "paper", "--json", folder / "out.json"]
        for index, configuration in enumerate(batch):
            path = folder / f"{index}.json"
            path.write_text(json.dumps(configuration))
            command += ["--contender", f"c{index}=paper:{path}"]
        command += ["--only", ",".join([REFERENCE] + [f"c{index}" for index in range(len(batch))])]
        subprocess.run(list(map(str, command)), check=True, stdout=subprocess.DEVNULL)
        measured = json.loads((folder / "out.json").read_text())
    found = {}
    for objective in ("render", "total"):
        by_name = {each["name"]: each for each in measured[objective]}
        reference = min(by_name[REFERENCE]["rounds_ms"])
        found[objective] = []
        for index in range(len(batch)):
            own = by_name[f"c{index}"]
            found[objective].append(None if own["failure"] else round(min(own["rounds_ms"]) / reference, 4))
    return found, measured["triangles"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="builtin:quick", help="as for treewright-render")
    parser.add_argument("--detail", type=float, default=1.0)
    parser.add_argument("--size", default="48x36")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--out", type=pathlib.Path, required=True, help="a folder")
    options = parser.parse_args()
    every = list(configurations(GRID))
    order = list(range(len(every)))
    random.Random(1).shuffle(order)
    costs = {"render": [None] * len(every), "total": [None] * len(every)}
    triangles = 0
    for begin in range(0, len(order), AT_ONCE):
        places = order[begin:begin + AT_ONCE]
        found, triangles = measure(options, [every[place] for place in places])
        for objective, rows in found.items():
            for place, row in zip(places, rows):
                costs[objective][place] = row
        print(f"\r{begin + len(places)} of {len(every)}", end="", flush=True)
    name = pathlib.Path(options.scene.removeprefix("builtin:")).stem
    options.out.mkdir(parents=True, exist_ok=True)
    for objective, rows in costs.items():
        parameters = [{key: value for key, value in vars(each).items() if value not in ((), None)} for each in GRID]
        about = (f"{name}, {triangles} triangles, {options.size}, one thread, multiples of the paper's default, "
                 f"least of {options.rounds} rounds")
        landscape = {"name": f"{name}-{objective}", "about": about, "parameters": parameters,
                     "costs": rows}
        (options.out / f"{name}-{objective}.json").write_text(json.dumps(landscape) + "\n")
    print(f"\r{len(every)} configurations of {name}, {costs['render'].count(None)} cannot be built")


if __name__ == "__main__":
    main()
