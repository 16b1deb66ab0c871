#!/usr/bin/env python3
"""Compares Pareto fronts: `treewright exec --front` beside Optuna's NSGA-II and TPE, and random points.

    python3 -m venv target/peers/env && target/peers/env/bin/pip install optuna==5.0.0 numpy
    target/peers/env/bin/python tests/peers/front.py --bin target/release --seeds 5

The made-up problems have four parameters from 0 to 1 and two objectives above 0: ZDT1 (convex), ZDT2 (concave) and ZDT3 (in
pieces) of Zitzler, Deb and Thiele (2000), and a tree with a build time and a frame time. `--recorded` takes pairs that were
measured (`record_pairs.py`; trees by `record.py`) on grids, each as a multiple of what the default needs. All have log-normal
noise of 2 %, and every method begins with the default. What counts is the hypervolume below the point (2, 2) that the runs
dominate without their noise, on logarithmic axes down to a floor, over that of 200,000 random points (made-up problems) or of
the whole grid.
"""

import argparse
import dataclasses
import itertools
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import time
import typing

import numpy

from problems import Recorded

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


@dataclasses.dataclass
class Problem:
    """Parameters with their values, or None for 0 to 1; their default; and a function of both objectives."""

    parameters: dict
    default: dict
    of: typing.Callable

    def volume(self, ran):
        return volume(self.of(list(of.values())) for of in ran)

    def whole(self):
        """The hypervolume that the shares are of."""
        if None in self.parameters.values():
            return volume(self.of(x) for x in numpy.random.default_rng(1).random((200_000, len(self.parameters))))
        return volume(self.of(list(values)) for values in itertools.product(*self.parameters.values()))


def made_up(of):
    names = [f"x{axis}" for axis in range(4)]
    return Problem(dict.fromkeys(names), dict.fromkeys(names, 0.5), of)


MADE_UP = {"zdt1": made_up(lambda x: zdt(x, 1)), "zdt2": made_up(lambda x: zdt(x, 2)), "zdt3": made_up(lambda x: zdt(x, 3)),
           "tree": made_up(tree)}


def zlib_pair(path):
    """What `record_pairs.py` wrote."""
    pair = json.loads(path.read_text())
    every = itertools.product(*pair["parameters"].values())
    known = dict(zip(every, zip(pair["first"], pair["second"])))
    return Problem(pair["parameters"], pair["default"], lambda x: known[tuple(x)])


def tree_pair(path):
    """Frames beside frames with a whole build, as `record.py` wrote both; what has no tree costs three times the default."""
    both = [Recorded(path.parent / f"quick-{what}.json") for what in ("render", "total")]
    grid = both[0].parameters
    parameters = {each.name: [False, True] if each.kind == "switch" else list(each.values) for each in grid}

    def costs(x):
        of = dict(zip(parameters, x))
        return [min(each.gap(of) * each.best, 3.0) for each in both]

    return Problem(parameters, {each.name: each.default for each in grid}, costs)


RECORDED = {"zlib-words-size": zlib_pair, "zlib-mesh-size": zlib_pair, "zlib-words-memory": zlib_pair, "quick-tree": tree_pair}


def load(name):
    return MADE_UP[name] if name in MADE_UP else RECORDED[name](FOLDER / f"{name}.json")


FOLDER = pathlib.Path(__file__).resolve().parent / "recorded"


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
    return [value * math.exp(NOISE * random.standard_normal()) for value in problem.of(x)]


def by_optuna(sampler, problem, trials, random):
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(directions=["minimize"] * 2, sampler=sampler)
    # Numbers of a grid are told as places, so that samplers know their order.
    ordered = {name: values and not isinstance(values[0], (str, bool)) for name, values in problem.parameters.items()}
    first = {name: problem.parameters[name].index(value) if ordered[name] else value for name, value in problem.default.items()}
    study.enqueue_trial(first)
    ran = []

    def suggest(trial, name, values):
        if values is None:
            return trial.suggest_float(name, 0, 1)
        return values[trial.suggest_int(name, 0, len(values) - 1)] if ordered[name] else trial.suggest_categorical(name, values)

    def objective(trial):
        ran.append({name: suggest(trial, name, values) for name, values in problem.parameters.items()})
        return measured(problem, list(ran[-1].values()), random)

    study.optimize(objective, n_trials=trials)
    return ran


def domain(values, default):
    """How `--tune` writes it."""
    if values is None:
        return f"0.0..1.0:{default}"
    if isinstance(default, bool):
        return f"bool:{str(default).lower()}"
    return "|".join(map(str, values)) + f":{default}"


def by_treewright(arguments, name, problem, trials, seed):
    with tempfile.TemporaryDirectory() as folder:
        log = pathlib.Path(folder) / "runs"
        command = [arguments.bin / "treewright", "--server", arguments.server, "exec", f"{name}-{seed}-{os.getpid()}"]
        command += ["--front", "first,second", "--metric", "json", "--trials", trials]
        for parameter, values in problem.parameters.items():
            command += ["--tune", f"{parameter}={domain(values, problem.default[parameter])}"]
        own = [sys.executable, os.path.abspath(__file__), "--evaluate", name, "--seeds", seed, "--log", log]
        command += ["--", *own, *(f"{{{parameter}}}" for parameter in problem.parameters)]
        done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
        if done.returncode:
            sys.exit(done.stderr)
        return [json.loads(line) for line in log.read_text().splitlines()]


def evaluate(arguments):
    problem = load(arguments.evaluate)
    value = lambda values, text: float(text) if values is None else next(of for of in values if str(of).lower() == text)
    of = {name: value(values, text) for (name, values), text in zip(problem.parameters.items(), arguments.values)}
    with open(arguments.log, "a") as log:
        log.write(json.dumps(of) + "\n")
    random = numpy.random.default_rng([arguments.seeds, time.time_ns()])
    first, second = measured(problem, list(of.values()), random)
    print(json.dumps({"first": first, "second": second}))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, default=pathlib.Path("target/release"), help="folder of treewright and treewrightd")
    parser.add_argument("--server", default="local", help="the daemon")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--trials", type=int, default=80)
    parser.add_argument("--recorded", action="store_true", help="measured pairs in place of the made-up problems")
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
    for name in RECORDED if arguments.recorded else MADE_UP:
        problem = load(name)
        reference = problem.whole()
        shares = {method: [] for method in methods}
        for seed in range(arguments.seeds):
            for method in methods:
                random = numpy.random.default_rng(seed)
                if method == "treewright":
                    ran = by_treewright(arguments, name, problem, arguments.trials, seed)
                else:
                    ran = by_optuna(samplers[method](seed), problem, arguments.trials, random)
                assert len(ran) == arguments.trials, f"{method} ran {len(ran)} times"
                shares[method].append(problem.volume(ran) / reference)
        cells = (f"{numpy.mean(shares[method]):.3f} ± {numpy.std(shares[method], ddof=1) / math.sqrt(arguments.seeds):.3f}" for method in methods)
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)
        for method in methods:
            everything[method] += shares[method]
    print("| all | " + " | ".join(f"{numpy.mean(everything[method]):.3f}" for method in methods) + " |")


if __name__ == "__main__":
    main()
