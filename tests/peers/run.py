#!/usr/bin/env python3
"""Compares Treewright's searches with other optimisers on identical problems, budgets and seeds.

    make peers                                     # everything, into target/peers/
    tests/peers/run.py --suite bbob --methods treewright,optuna-tpe --seeds 15 --out bbob.jsonl

Each line of the output is one run: the quality of what the optimiser would recommend after 20, 40 and 80 trials,
and the time it took to think. With limits (`--suite zlib`) also after 10, with the best that ran and the number that failed.
A run that is in the file already is not repeated, so an interrupted comparison goes
on where it stopped. The table at the end is made from the whole file (`tables.py`).
"""

import argparse
import collections
import concurrent.futures
import json
import math
import pathlib
import sys
import time

import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from methods import METHODS  # noqa: E402
from problems import SUITES, suite  # noqa: E402
from tables import CHECKPOINTS, MARKS_OF_LIMITS, rows, table  # noqa: E402


def run(suite_name, folder, index, method, seed, budget):
    """One optimiser on one problem."""
    problem = suite(suite_name, folder)[index](seed)
    random = numpy.random.default_rng([11, index, seed])  # the noise: the same for every optimiser
    optimiser = METHODS[method](problem.parameters, problem.constraints, budget, seed)
    marks = MARKS_OF_LIMITS if problem.limits else CHECKPOINTS
    quality, ran, failed, thinking_s = {}, {}, 0, 0.0
    least = math.inf
    for trial in range(1, budget + 1):
        begin = time.perf_counter()
        configuration = optimiser.ask()
        thinking_s += time.perf_counter() - begin
        cost = problem.measure(configuration, random)
        failed += cost is None
        least = min(least, problem.gap(configuration))
        begin = time.perf_counter()
        optimiser.exceeds(problem.excess(configuration))
        optimiser.tell(configuration, cost)
        thinking_s += time.perf_counter() - begin
        if trial in marks:
            quality[trial], ran[trial] = problem.gap(optimiser.recommend()), least
    optimiser.close()
    row = {"suite": suite_name, "problem": problem.name, "index": index, "method": method, "seed": seed, "gap": quality,
           "ms_per_trial": 1e3 * thinking_s / budget}
    return row | {"ran": ran, "failed": failed} if problem.limits else row


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suite", default="bbob", choices=SUITES)
    parser.add_argument("--folder", help="recorded landscapes, for --suite recorded")
    parser.add_argument("--methods", type=lambda text: text.split(","), default=list(METHODS))
    parser.add_argument("--seeds", type=int, default=15)
    parser.add_argument("--budget", type=int, default=80)
    parser.add_argument("--only", type=lambda text: [int(each) for each in text.split(",")], help="numbers of problems")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=pathlib.Path, required=True, help="a file of JSON lines; runs in it are not repeated")
    parser.add_argument("--fresh", type=lambda text: text.split(","), default=[], help="methods whose old rows are dropped")
    options = parser.parse_args()
    unknown = [method for method in options.methods if method not in METHODS]
    if unknown:
        raise SystemExit(f"there is no method {', '.join(unknown)}; there are {', '.join(METHODS)}")
    kept = [row for row in rows(options.out) if not (row["method"] in options.fresh and row["suite"] == options.suite)]
    options.out.write_text("".join(json.dumps(row) + "\n" for row in kept))
    done = {(row["suite"], row["index"], row["method"], row["seed"]) for row in kept}
    known = suite(options.suite, options.folder)
    problems = options.only if options.only is not None else range(len(known))
    examples = [known[index](0) for index in problems]
    untold = {method for method in options.methods if not all(map(METHODS[method].takes, examples))}
    if untold:
        print(f"left out, since they cannot be told these spaces: {', '.join(sorted(untold))}", file=sys.stderr)
    jobs = [(options.suite, options.folder, index, method, seed, options.budget)
            for seed in range(options.seeds) for index in problems for method in options.methods
            if method not in untold and (options.suite, index, method, seed) not in done]
    begun, failures = time.time(), collections.Counter()
    with concurrent.futures.ProcessPoolExecutor(options.jobs) as pool, options.out.open("a") as out:
        futures = {pool.submit(run, *job): job for job in jobs}
        for count, future in enumerate(concurrent.futures.as_completed(futures), 1):
            try:
                row = future.result()
            except Exception as error:  # one optimiser's failure must not end the comparison
                failures[futures[future][3], str(error)[:120]] += 1
            else:
                out.write(json.dumps(row) + "\n")
                out.flush()
            if sys.stderr.isatty() or count % 100 == 0:
                left = (time.time() - begun) / count * (len(jobs) - count)
                print(f"\r{count} of {len(jobs)} runs, {left:.0f} s left ", end="", file=sys.stderr, flush=True)
    for (method, error), count in failures.items():
        print(f"\n{method} failed {count} times: {error}", file=sys.stderr)
    print("\n" + table(rows(options.out), options.suite))


if __name__ == "__main__":
    main()
