#!/usr/bin/env python3
"""Makes the tables of docs/measurements/peers-*.md from the runs in `results/`, so that no figure there is older than its runs.

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
import textwrap

HERE = pathlib.Path(__file__).resolve().parent
PAGES, RESULTS = HERE.parent.parent / "docs" / "measurements", HERE / "results"
BEGIN, END = "<!-- peers: made by tests/peers/tables.py -->", "<!-- end of peers -->"
CHECKPOINTS = (20, 40, 80)
# Of suites with a limit, whose table also has what failed.
MARKS_OF_LIMITS, WITH_LIMITS = (10, *CHECKPOINTS), ("zlib",)
# COCO's own precision: what is closer is not told apart.
LEAST_GAP = 1e-8
# The same search taken another way: ranked in the place of the method named, and not counted when others are ranked.
VARIANTS = {"treewright-best-measured": "treewright"}
# Which page has the tables of a suite: `peers-NAME.md`.
SUITES = {"floor-held-out": "lasting-noise", "bbob-held-out": "vanishing-noise", "grid-held-out": "grids",
          "grid-told-held-out": "grids", "made-kernels": "kernels", "zlib": "limits"}
# What stands above the tables of suites that tell constraints or limits. Their runs may be missing.
TITLES = {"grid-told-held-out": "The same grids, told what can be run.", "made-kernels": "Told the constraints.",
          "zlib": "Shares of the optimum: of what is recommended, and of the best that ran."}


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


def table(found, suite, methods=None, shown=None):
    """Mean ranks among the methods over problems and seeds, and mean qualities, at each checkpoint; of some methods only, or of all."""
    found = [row for row in found if row["suite"] == suite]
    methods = methods or sorted({row["method"] for row in found})
    cases = complete(found, methods)
    if not cases:
        return f"{suite}: no case was run by every method yet"
    if suite in WITH_LIMITS:
        return table_of_limits(cases, methods)
    relative = is_relative(suite)
    label = "optimum / cost" if relative else "log10 gap"
    mean = lambda of: statistics.fmean(of(runs) for runs in cases.values())
    problems, seeds = {index for index, _ in cases}, {seed for _, seed in cases}
    lines = [f"{len(cases)} cases: {len(problems)} problems, {len(seeds)} seed{'s' if len(seeds) > 1 else ''}, {len(methods)} methods.", "",
             "| method | " + " | ".join(f"rank at {trial}" for trial in CHECKPOINTS) + " | "
             + " | ".join(f"{label} at {trial}" for trial in CHECKPOINTS) + " | ms a trial |",
             "|---|" + "---|" * (2 * len(CHECKPOINTS) + 1)]
    last = CHECKPOINTS[-1]
    for method in sorted(methods, key=lambda method: mean(lambda runs: rank(runs, method, last))):
        def quality(trial):
            gap = lambda runs: runs[method]["gap"][str(trial)]
            return mean(lambda runs: 1 / gap(runs) if relative else math.log10(max(gap(runs), LEAST_GAP)))
        if shown and method not in shown:
            continue
        ranks = [f"{mean(lambda runs: rank(runs, method, trial)):.2f}" for trial in CHECKPOINTS]
        ranks[-1] += f" ± {spread(cases, lambda runs: rank(runs, method, last)):.2f}"
        spent = statistics.median(runs[method]["ms_per_trial"] for runs in cases.values())
        lines.append(f"| {method} | " + " | ".join(ranks) + " | "
                     + " | ".join(f"{quality(trial):.3f}" for trial in CHECKPOINTS) + f" | {spent:.2f} |")
    return "\n".join(lines)


def table_of_limits(cases, methods):
    """Mean shares of the optimum after each mark and the runs that exceeded a limit, with half of its 95 % interval by cases.
    What cannot be used has no share."""
    mean = lambda of: statistics.fmean(of(runs) for runs in cases.values())
    problems, seeds = {index for index, _ in cases}, {seed for _, seed in cases}
    columns = [*(f"recommended at {mark}" for mark in MARKS_OF_LIMITS), *(f"ran at {mark}" for mark in MARKS_OF_LIMITS)]
    lines = [f"{len(cases)} cases: {len(problems)} problems, {len(seeds)} seeds.", "",
             "| method | " + " | ".join(columns) + " | failed of 80 | ms a trial |", "|---|" + "---|" * (len(columns) + 2)]
    for method in methods:
        share = lambda what, mark: mean(lambda runs: 1 / runs[method][what][str(mark)])
        shares = [f"{share(what, mark):.3f}" for what in ("gap", "ran") for mark in MARKS_OF_LIMITS]
        failed = [runs[method]["failed"] for runs in cases.values()]
        error = 1.96 * statistics.stdev(failed) / math.sqrt(len(failed)) if len(failed) > 1 else math.nan
        spent = statistics.median(runs[method]["ms_per_trial"] for runs in cases.values())
        lines.append(f"| {method} | {' | '.join(shares)} | {statistics.fmean(failed):.1f} ± {error:.1f} | {spent:.2f} |")
    return "\n".join(lines)


def made():
    """Each page with its tables, by its path."""
    about = json.loads((RESULTS / "README.json").read_text())
    pages = {}
    for suite, name in SUITES.items():
        found, page = rows(RESULTS / f"{suite}.jsonl.xz"), PAGES / f"peers-{name}.md"
        if suite in TITLES and not found:
            continue
        conditions = f"{about['machine']}, {about['date']}, version {about['version']}; {about['peers']}. {about['remark']}"
        conditions = about["conditions"].get(suite, conditions)
        parts = pages.setdefault(page, [textwrap.fill(conditions, 110)])
        parts += [TITLES[suite]] if suite in TITLES else []
        earlier = set()
        for methods in about["tables"][suite]:
            # A table with a method that few cases could afford shows that method and ours.
            parts.append(table(found, suite, methods, set(methods) - earlier | {"treewright"}))
            earlier |= set(methods)
    return {page: filled(page, parts) for page, parts in pages.items()}


def filled(page, parts):
    before, _, rest = page.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    if not after:
        sys.exit(f"tables: {page} has no place for them; write the lines {BEGIN} and {END} where it belongs")
    return f"{before}{BEGIN}\n" + "\n\n".join(parts) + f"\n{END}{after}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; fail where something is older than the runs")
    is_check = parser.parse_args().check
    for page, text in made().items():
        if not is_check:
            page.write_text(text)
        elif page.read_text() != text:
            sys.exit(f"tables: docs/measurements/{page.name} is not what the runs give; run tests/peers/tables.py")


if __name__ == "__main__":
    main()
