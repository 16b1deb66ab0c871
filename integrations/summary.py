#!/usr/bin/env python3
"""Tables of what the examples measured: `summary.py FILE.jsonl ...`, lines as the examples print them with --rounds.

Of each state (mesh and use) the ratio of the default's cost to the tuned one's, and of the one fixed configuration that is best over all
states of the files together: medians over rounds in which all ran in turns, with the interval between order statistics that
holds the median with 95 %. 1.10 means that the other takes 1.10 times as long. The last line has the geometric mean over all states
of each round, and its median over rounds. Below the table: the same for the fixed configuration that is best on the other meshes, which has not seen
the mesh it is judged on. "Repaid" is the number of frames after which the tuned program, trials included, has taken less time
than the default would have.
"""

import json
import math
import sys


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


def main():
    lines = [json.loads(line) for path in sys.argv[1:] for line in open(path, encoding="utf-8")]
    lines = [line for line in lines if line.get("fixed")]
    if not lines:
        sys.exit(__doc__)
    rows = [{name(one["configuration"]): one for one in line["fixed"]} for line in lines]

    def ratios(number, fixed):
        return [other / tuned for other, tuned in zip(rows[number][fixed]["costs"], lines[number]["tuned_costs"])]

    def middle(number, fixed):
        return median(ratios(number, fixed))

    states = range(len(lines))
    default = name(lines[0]["fixed"][0]["configuration"])

    def best_of(some):
        return min(rows[0], key=lambda one: mean([middle(state, one) for state in some]))

    best = best_of(states)
    others = [[other for other in states if lines[other]["scene"] != line["scene"]] for line in lines]
    unseen = [best_of(some or states) for some in others]
    hindsight = [min(rows[state], key=lambda one: middle(state, one)) for state in states]
    print(f"| mesh | use | tuned | default ({default}) | best fixed ({best}) | best in hindsight | repaid | differs |\n|---|---|---|---|---|---|---|---|")
    for state, line in enumerate(lines):
        paid = repaid(line["trial_costs"], median(rows[state][default]["costs"]), median(line["tuned_costs"]))
        cells = [line["scene"].removesuffix(".ply"), line["use"], name(line["tuned"]), interval(ratios(state, default)), interval(ratios(state, best))]
        cells += [f"{middle(state, hindsight[state]):.2f} {hindsight[state]}", paid, str(rows[state][default]["differs"])]
        print(f"| {' | '.join(cells)} |")
    rounds = range(min(len(line["tuned_costs"]) for line in lines))
    picks = (lambda state: default, lambda state: best, lambda state: hindsight[state], lambda state: unseen[state])
    means = [interval([mean([ratios(state, pick(state))[each] for state in states]) for each in rounds]) for pick in picks]
    print(f"| geometric mean | | | {' | '.join(means[:3])} | | |")
    print(f"\nOver the fixed configuration that is best on the other meshes: {means[3]}.")


if __name__ == "__main__":
    main()
