#!/usr/bin/env python3
"""Tables of what the examples measured: `summary.py FILE.jsonl ...`, lines with `fixed` as the examples print them with --rounds.

Of each state (mesh and use) the ratio of the default's cost to the tuned one, and of the one fixed configuration that is best over all
states of the files together. Ratios are medians over rounds in which all ran in turns; 1.10 means that the other takes 1.10 times as long.
"""

import json
import math
import sys


def name(configuration):
    if isinstance(configuration, str):
        return configuration
    return " ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in configuration.values())


def mean(ratios):
    return math.exp(sum(map(math.log, ratios)) / len(ratios))


def main():
    lines = [json.loads(line) for path in sys.argv[1:] for line in open(path, encoding="utf-8")]
    lines = [line for line in lines if line.get("fixed")]
    if not lines:
        sys.exit(__doc__)
    rows = [{name(one["configuration"]): one["over_tuned"] for one in line["fixed"]} for line in lines]
    default = name(lines[0]["fixed"][0]["configuration"])
    best = min(rows[0], key=lambda one: mean([row[one] for row in rows]))
    print(f"| mesh | use | tuned | default ({default}) | best fixed ({best}) | best in hindsight |\n|---|---|---|---|---|---|")
    for line, row in zip(lines, rows):
        use = f"{line['rays']:,} rays" if "rays" in line else f"{line['size']}²"
        hindsight = min(row, key=row.get)
        tuned = name(line["tuned"])
        print(f"| {line['scene'].removesuffix('.ply')} | {use} | {tuned} | {row[default]:.2f} | {row[best]:.2f} | {row[hindsight]:.2f} {hindsight} |")
    columns = [[row[one] for row in rows] for one in (default, best)] + [[min(row.values()) for row in rows]]
    print("| geometric mean | | | " + " | ".join(f"{mean(column):.2f}" for column in columns) + " |")


if __name__ == "__main__":
    main()
