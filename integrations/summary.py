#!/usr/bin/env python3
"""Tables of what the examples measured, from lines as the examples print them with --rounds.

    summary.py FILE.jsonl ...    print every state of the files
    summary.py --page            write the tables by use in docs/measurements, from recorded/
    summary.py --check           say whether those tables are what the records give; a test asks

Of each state (mesh and use) the ratio of the default's cost to the tuned one's, and of the one fixed configuration that is best over all
states of the files together: medians over rounds in which all ran in turns, with the interval between order statistics that
holds the median with 95 %. 1.10 means that the other takes 1.10 times as long. The last line has the geometric mean over all states
of each round, and its median over rounds. Below the table: the same for the fixed configuration that is best on the other meshes, which has not seen
the mesh it is judged on. "Repaid" is the number of frames after which the tuned program, trials included, has taken less time
than the default would have.
"""

import json
import math
import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
FOLDER = HERE.parent / "docs" / "measurements"
BEGIN, END = "<!-- integrations: made by integrations/summary.py -->", "<!-- end of integrations -->"
PAGES = {
    "integrations.md": {
        "embree.jsonl": "C++ on Embree",
        "builders.jsonl": "Rust builders",
        "embreex.jsonl": "Python, embreex",
        "embree_caster.jsonl": "Python, Embree by ctypes",
        "three_mesh_bvh.jsonl": "Node, three-mesh-bvh",
    },
    "warp.md": {"warp.jsonl": "Python, NVIDIA Warp"},
}


def name(configuration):
    if isinstance(configuration, str):
        return configuration
    return " ".join(f"{value:.3g}" if isinstance(value, float) else str(value) for value in configuration.values())


def median(values):
    values = sorted(values)
    middle = len(values) // 2
    return values[middle] if len(values) % 2 else (values[middle - 1] + values[middle]) / 2


def mean(ratios):
    return math.exp(sum(map(math.log, ratios)) / len(ratios))


def interval(values):
    """Between which order statistics the median lies with 95 %: the sign test, turned around."""
    values, outside, cut = sorted(values), 0.0, 0
    while cut < len(values) // 2:
        outside += 2 * math.comb(len(values), cut) / 2 ** len(values)
        if outside > 0.05:
            break
        cut += 1
    cut = max(cut - 1, 0)
    return f"{median(values):.2f} [{values[cut]:.2f}, {values[-1 - cut]:.2f}]"


def repaid(trials, default, tuned):
    """After how many frames the time lost by trying is won back."""
    spent = 0.0
    since = None
    for number, cost in enumerate(trials, 1):
        spent += cost - default
        since = None if spent > 0 else since or number
    if since:
        return str(since)
    return str(len(trials) + math.ceil(spent / (default - tuned))) if tuned < default else "never"


class Case:
    """The states of some files, and the costs of what ran in turns in each."""

    def __init__(self, paths):
        lines = [json.loads(line) for path in paths for line in open(path, encoding="utf-8")]
        self.lines = [line for line in lines if line.get("fixed")]
        if not self.lines:
            sys.exit(__doc__)
        self.rows = [{name(one["configuration"]): one for one in line["fixed"]} for line in self.lines]
        self.states = range(len(self.lines))
        self.default = name(self.lines[0]["fixed"][0]["configuration"])
        self.best = self.best_of(self.states)

    def ratios(self, state, fixed):
        return [other / tuned for other, tuned in zip(self.rows[state][fixed]["costs"], self.lines[state]["tuned_costs"])]

    def middle(self, state, fixed):
        return median(self.ratios(state, fixed))

    def best_of(self, states):
        return min(self.rows[0], key=lambda one: mean([self.middle(state, one) for state in states]))

    def mean_over(self, states, pick):
        """The geometric mean over some states of each round, and its median with its interval."""
        rounds = range(min(len(self.lines[state]["tuned_costs"]) for state in states))
        return interval([mean([self.ratios(state, pick(state))[each] for state in states]) for each in rounds])


def every_state(case):
    lines, rows, states, default, best = case.lines, case.rows, case.states, case.default, case.best
    others = [[other for other in states if lines[other]["scene"] != line["scene"]] for line in lines]
    unseen = [case.best_of(some or states) for some in others]
    hindsight = [min(rows[state], key=lambda one: case.middle(state, one)) for state in states]
    print(f"| mesh | use | tuned | default ({default}) | best fixed ({best}) | best in hindsight | repaid | differs |\n|---|---|---|---|---|---|---|---|")
    for state, line in enumerate(lines):
        paid = repaid(line["trial_costs"], median(rows[state][default]["costs"]), median(line["tuned_costs"]))
        cells = [line["scene"].removesuffix(".ply"), line["use"], name(line["tuned"]),
                 interval(case.ratios(state, default)), interval(case.ratios(state, best))]
        cells += [f"{case.middle(state, hindsight[state]):.2f} {hindsight[state]}", paid, str(rows[state][default]["differs"])]
        print(f"| {' | '.join(cells)} |")
    picks = (lambda _: default, lambda _: best, hindsight.__getitem__, unseen.__getitem__)
    means = [case.mean_over(states, pick) for pick in picks]
    print(f"| geometric mean | | | {' | '.join(means[:3])} | | |")
    print(f"\nOver the fixed configuration that is best on the other meshes: {means[3]}.")


def by_use(cases):
    lines = ["| case: default; best fixed | use | meshes | over the default | over the best fixed |", "|---|---|--:|---|---|"]
    for file, title in cases.items():
        case = Case([HERE / "recorded" / file])
        uses = {}
        for state in case.states:
            uses.setdefault(case.lines[state]["use"], []).append(state)
        for use, states in [("all", list(case.states)), *uses.items()]:
            meshes = len({case.lines[state]["scene"] for state in states})
            over = [case.mean_over(states, lambda _: one) for one in (case.default, case.best)]
            lines.append(f"| {f'{title}: {case.default}; {case.best}' if use == 'all' else ''} | {use} | {meshes} | {' | '.join(over)} |")
    return "\n".join(lines)


def page(name):
    before, _, rest = (FOLDER / name).read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    if not after:
        sys.exit(f"summary: {name} has no place for the table; write the lines {BEGIN} and {END} where it belongs")
    return f"{before}{BEGIN}\n{by_use(PAGES[name])}\n{END}{after}"


def main():
    if sys.argv[1:] == ["--page"]:
        for name in PAGES:
            (FOLDER / name).write_text(page(name))
    elif sys.argv[1:] == ["--check"]:
        wrong = [name for name in PAGES if (FOLDER / name).read_text() != page(name)]
        if wrong:
            sys.exit(f"summary: {', '.join(wrong)} in docs/measurements: not what the records give; run integrations/summary.py --page")
    else:
        every_state(Case(sys.argv[1:]))


if __name__ == "__main__":
    main()
