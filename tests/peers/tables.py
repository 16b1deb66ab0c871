#!/usr/bin/env python3
"""Makes the tables in README.md from the runs in `results/`, so that no figure there is older than its runs.

    tests/peers/tables.py            write them
    tests/peers/tables.py --check    say whether they are what the runs give; a test asks

`results/README.json` says when, where and with which versions the runs were made. `run.py` prints the same tables.
"""

import argparse
import collections
import json
import lzma
import math
import pathlib
import statistics
import sys

HERE = pathlib.Path(__file__).resolve().parent
PAGE, RESULTS = HERE / "README.md", HERE / "results"
BEGIN, END = "<!-- peers: made by tests/peers/tables.py -->", "<!-- end of peers -->"
CHECKPOINTS = (20, 40, 80)
# COCO's own precision: what is closer is not told apart.
LEAST_GAP = 1e-8
# The same search taken another way: ranked in the place of the method named, and not counted when others are ranked.
VARIANTS = {"treewright-best-measured": "treewright"}
TITLES = {
    "floor-held-out": "**Held out, and as a run time behaves**: eight functions of bbob on which no constant of the search was chosen, d = 2, 5 and 10, "
                      "another instance for each seed. A tenth of a random point's cost is always left, and 10 % of log-normal noise on the whole, "
                      "so that the noise does not vanish at the optimum",
    "bbob-held-out": "**Held out, noise that vanishes**: the same functions and instances with 10 % of noise on the distance to the optimum alone",
    "grid-held-out": "**Held-out instances** of integer grids most of which cannot be run; instances of the same kind were looked at while the search was made",
    "bbob": "**In-sample**: twelve functions of bbob that were looked at while the search was made (one step of its beginning was chosen on eleven of "
            "them); noise that vanishes",
}


def rows(path):
    """Runs in a file of JSON lines, compressed or not."""
    if not path.exists():
        return []
    with (lzma.open(path, "rt", encoding="utf-8") if path.suffix == ".xz" else path.open()) as lines:
        return [json.loads(line) for line in lines]


def is_relative(suite):
    """Whether what counts is a cost over the optimum's rather than a distance to it."""
    return suite not in ("bbob", "bbob-noiseless", "bbob-held-out")


def complete(found, methods):
    """Runs by method, of each problem and seed that every method ran."""
    by_case = collections.defaultdict(dict)
    for row in found:
        if row["method"] in methods:
            by_case[row["index"], row["seed"]][row["method"]] = row
    return {case: runs for case, runs in sorted(by_case.items()) if len(runs) == len(methods)}


def rank(runs, method, trial):
    """Among the methods of one case; those that are level share their places."""
    gap = lambda one: max(runs[one]["gap"][str(trial)], LEAST_GAP)
    ranked = [one for one in runs if one == method or one not in VARIANTS and one != VARIANTS.get(method)]
    better, same = sum(gap(other) < gap(method) for other in ranked), sum(gap(other) == gap(method) for other in ranked)
    return better + (same + 1) / 2


def spread(cases, of):
    """Half of a 95 % interval of a mean, from the means of the problems: seeds of one problem are alike."""
    by_problem = collections.defaultdict(list)
    for (index, _), runs in cases.items():
        by_problem[index].append(of(runs))
    means = [statistics.fmean(each) for each in by_problem.values()]
    return 1.96 * statistics.stdev(means) / math.sqrt(len(means)) if len(means) > 2 else math.nan


def table(found, suite, methods=None):
    """Mean ranks over problems and seeds, and mean qualities, at each checkpoint."""
    found = [row for row in found if row["suite"] == suite]
    methods = methods or sorted({row["method"] for row in found})
    cases = complete(found, methods)
    if not cases:
        return f"{suite}: no case was run by every method yet"
    relative = is_relative(suite)
    label = "optimum / cost" if relative else "log10 gap"
    mean = lambda of: statistics.fmean(of(runs) for runs in cases.values())
    problems, seeds = {index for index, _ in cases}, {seed for _, seed in cases}
    lines = [f"{len(cases)} cases: {len(problems)} problems, {len(seeds)} seed{'s' if len(seeds) > 1 else ''}.", "",
             "| method | " + " | ".join(f"rank at {trial}" for trial in CHECKPOINTS) + " | "
             + " | ".join(f"{label} at {trial}" for trial in CHECKPOINTS) + " | ms a trial |",
             "|---|" + "---|" * (2 * len(CHECKPOINTS) + 1)]
    last = CHECKPOINTS[-1]
    for method in sorted(methods, key=lambda method: mean(lambda runs: rank(runs, method, last))):
        def quality(trial):
            gap = lambda runs: runs[method]["gap"][str(trial)]
            return mean(lambda runs: 1 / gap(runs) if relative else math.log10(max(gap(runs), LEAST_GAP)))
        ranks = [f"{mean(lambda runs: rank(runs, method, trial)):.2f}" for trial in CHECKPOINTS]
        ranks[-1] += f" ± {spread(cases, lambda runs: rank(runs, method, last)):.2f}"
        spent = statistics.median(runs[method]["ms_per_trial"] for runs in cases.values())
        lines.append(f"| {method} | " + " | ".join(ranks) + " | "
                     + " | ".join(f"{quality(trial):.3f}" for trial in CHECKPOINTS) + f" | {spent:.2f} |")
    return "\n".join(lines)


def made():
    about = json.loads((RESULTS / "README.json").read_text())
    found = [row for path in sorted(RESULTS.glob("*.jsonl.xz")) for row in rows(path)]
    parts = [f"{about['machine']}, {about['date']}, version {about['version']}; {about['peers']}. {about['remark']}"]
    for suite, title in TITLES.items():
        for methods in about["tables"].get(suite, []):
            slow = sorted(set(methods).intersection(about["slow"]))
            parts.append(f"{title}{'; with ' + ', '.join(slow) + ' beside them' if slow else ''}. {table(found, suite, methods)}")
    before, _, rest = PAGE.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    if not after:
        sys.exit(f"tables: {PAGE} has no place for them; write the lines {BEGIN} and {END} where they belong")
    return f"{before}{BEGIN}\n" + "\n\n".join(parts) + f"\n{END}{after}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; fail where something is older than the runs")
    is_check, text = parser.parse_args().check, made()
    if not is_check:
        PAGE.write_text(text)
    elif PAGE.read_text() != text:
        sys.exit("tables: tests/peers/README.md is not what the runs give; run tests/peers/tables.py")


if __name__ == "__main__":
    main()
