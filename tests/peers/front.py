#!/usr/bin/env python3
"""Compares Pareto fronts: `treewright exec --front` beside Optuna's NSGA-II and TPE, and random points.

    python3 -m venv target/peers/env && target/peers/env/bin/pip install optuna==5.0.0 numpy
    target/peers/env/bin/python tests/peers/front.py --bin target/release --seeds 5

Problems have four parameters from 0 to 1 and two objectives above 0: ZDT1 (convex), ZDT2 (concave) and ZDT3 (in pieces) of
Zitzler, Deb and Thiele (2000), and a made-up tree with a build time and a frame time, all with log-normal noise of 2 %. Every
method runs each problem so many times with the same default as its first run. What counts is the hypervolume below the
point (2, 2) that the runs dominate without their noise, on logarithmic axes down to the least value of each objective, over
that of 200,000 random points.
"""

import argparse
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy

FLOOR, CEILING, NOISE = 0.1, 2.0, 0.02


def zdt(x, kind):
    first, g = x[0], 1 + 9 * sum(x[1:]) / (len(x) - 1)
    ratio = first / g
    shape = {1: 1 - math.sqrt(ratio), 2: 1 - ratio**2, 3: 1.4 - math.sqrt(ratio) - 0.4 * ratio * math.sin(10 * math.pi * first)}
    return FLOOR + first, FLOOR + g * shape[kind] / 2


def tree(x):
    """A build that costs more the more careful it is, frames that cost less, and two parameters with a best value."""
    care = x[0]
    build = 0.1 * 2 ** (4 * care) * (1 + (x[1] - 0.3) ** 2) * (1.5 - 0.5 * x[3])
    frame = 0.2 + 1.5 * (1 - care) ** 2 * (1 + 2 * abs(x[2] - 0.7)) + 0.3 * x[3]
    return build, frame


PROBLEMS = {"zdt1": lambda x: zdt(x, 1), "zdt2": lambda x: zdt(x, 2), "zdt3": lambda x: zdt(x, 3), "tree": tree}
AXES, DEFAULT = 4, 0.5


def volume(points):
    """The share of the box between floor and ceiling, on logarithmic axes, that is dominated."""
    log = lambda value: math.log(min(max(value, FLOOR), CEILING) / FLOOR) / math.log(CEILING / FLOOR)
    ends, found = 1.0, 0.0
    for x, y in sorted((log(a), log(b)) for a, b in points):
        if y < ends:
            found += (1.0 - x) * (ends - y)
            ends = y
    return found


def measured(problem, x, random):
    return [value * math.exp(NOISE * random.standard_normal()) for value in PROBLEMS[problem](x)]


def by_optuna(sampler, problem, trials, random):
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(directions=["minimize"] * 2, sampler=sampler)
    study.enqueue_trial({f"x{axis}": DEFAULT for axis in range(AXES)})
    ran = []

    def objective(trial):
        x = [trial.suggest_float(f"x{axis}", 0, 1) for axis in range(AXES)]
        ran.append(x)
        return measured(problem, x, random)

    study.optimize(objective, n_trials=trials)
    return ran


def by_treewright(arguments, problem, trials, seed):
    with tempfile.TemporaryDirectory() as folder:
        log = pathlib.Path(folder) / "runs"
        command = [arguments.bin / "treewright", "--server", arguments.server, "exec", f"{problem}-{seed}-{os.getpid()}"]
        command += ["--front", "first,second", "--metric", "json", "--trials", trials]
        for axis in range(AXES):
            command += ["--tune", f"x{axis}=0.0..1.0:{DEFAULT}"]
        own = [sys.executable, os.path.abspath(__file__), "--evaluate", problem, "--seeds", seed, "--log", log]
        command += ["--", *own, *(f"{{x{axis}}}" for axis in range(AXES))]
        done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
        if done.returncode:
            sys.exit(done.stderr)
        return [json.loads(line) for line in log.read_text().splitlines()]


def evaluate(arguments):
    x = [float(value) for value in arguments.values]
    with open(arguments.log, "a") as log:
        log.write(json.dumps(x) + "\n")
    random = numpy.random.default_rng([arguments.seeds, *(int(1e9 * value) for value in x), time.time_ns()])
    first, second = measured(arguments.evaluate, x, random)
    print(json.dumps({"first": first, "second": second}))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, default=pathlib.Path("target/release"), help="folder of treewright and treewrightd")
    parser.add_argument("--server", default="local", help="the daemon")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--trials", type=int, default=80)
    parser.add_argument("--evaluate", help=argparse.SUPPRESS)
    parser.add_argument("--log", help=argparse.SUPPRESS)
    parser.add_argument("values", nargs="*", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.evaluate:
        return evaluate(arguments)
    import optuna

    samplers = {
        "random": lambda seed: optuna.samplers.RandomSampler(seed=seed),
        "NSGA-II": lambda seed: optuna.samplers.NSGAIISampler(seed=seed),
        "NSGA-II, population 10": lambda seed: optuna.samplers.NSGAIISampler(population_size=10, seed=seed),
        "TPE": lambda seed: optuna.samplers.TPESampler(seed=seed),
    }
    methods = ["treewright", *samplers]
    print("| problem | " + " | ".join(methods) + " |")
    print("|---|" + "--:|" * len(methods))
    everything = {method: [] for method in methods}
    for problem, of in PROBLEMS.items():
        reference = volume(of(x) for x in numpy.random.default_rng(1).random((200_000, AXES)))
        shares = {method: [] for method in methods}
        for seed in range(arguments.seeds):
            for method in methods:
                random = numpy.random.default_rng(seed)
                if method == "treewright":
                    ran = by_treewright(arguments, problem, arguments.trials, seed)
                else:
                    ran = by_optuna(samplers[method](seed), problem, arguments.trials, random)
                assert len(ran) == arguments.trials, f"{method} ran {len(ran)} times"
                shares[method].append(volume(of(x) for x in ran) / reference)
        cells = (f"{numpy.mean(shares[method]):.3f} ± {numpy.std(shares[method], ddof=1) / math.sqrt(arguments.seeds):.3f}" for method in methods)
        print(f"| {problem} | " + " | ".join(cells) + " |", flush=True)
        for method in methods:
            everything[method] += shares[method]
    print("| all | " + " | ".join(f"{numpy.mean(everything[method]):.3f}" for method in methods) + " |")


if __name__ == "__main__":
    main()
