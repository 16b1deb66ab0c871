#!/usr/bin/env python3
"""Makes the tables of docs/measurements/paper-*.md from the record of the paper's evaluation: no figure there is older than its record.

    tools/evaluation_tables.py            write them
    tools/evaluation_tables.py --check    say whether they are what the record gives; a test asks

`lab/record/evaluation/README.json` says when, where and by which version it was measured. What predictors are worth was judged by
`treewright-lab report`; conditions, cameras and what searches gained are read off the record itself.
"""

import argparse
import json
import lzma
import math
import pathlib
import statistics
import sys
import textwrap

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGES, RECORD = ROOT / "docs" / "measurements", ROOT / "lab" / "record" / "evaluation"
BEGIN, END = "<!-- evaluation: made by tools/evaluation_tables.py -->", "<!-- end of evaluation -->"
SPLITS = {"random": "known scenes", "scene": "unseen scenes"}
# What was aimed at before anything was measured: share of the roofline, share of the overhead saved, median gain of a search.
ROOFLINE, OVERHEAD, SEARCH = {"render": 0.97, "total": 0.95}, 0.95, 0.11
# Of whom the goals are asked: chosen before anything was measured. The tables of predictors hold everybody.
ASKED = ("nearest_neighbour", "rbf_greedy_gq", "auto")


def share(value):
    return f"{value * 100:.1f} %"


def shares(mean):
    interval = f" [{mean['interval'][0] * 100:.1f}, {mean['interval'][1] * 100:.1f}]" if mean["interval"] else ""
    return share(mean["mean"]) + interval


def met(holds):
    return "reached" if holds else "**missed**"


def whole(standings, objective, split):
    return {one["entrant"]: one for one in standings if (one["objective"], one["split"], one["scene"]) == (objective, split, None)}


class Record:
    """Searches and fixed configurations of the cameras that have both, by objective and place."""

    def __init__(self, path):
        self.searches, self.pairs, self.parts, self.again, fixed = {}, [], {}, {}, {}
        with lzma.open(path, "rt", encoding="utf-8") as lines:
            for line in map(json.loads, lines):
                if "conditions" in line:
                    self.conditions = line["conditions"]
                if "search" in line:
                    search = line["search"]
                    self.searches.setdefault(search["objective"], {})[place(search)] = search["iterations"]
                if "pair" in line:
                    self.pairs.append(line["pair"])
                if "part" in line:
                    search = line["part"]["search"]
                    self.parts.setdefault((search["place"]["scene"], line["part"]["part"]), []).append(search)
                if "group" in line and line["group"]["kind"] == "fixed":
                    fixed[place(line["group"])] = line["group"]["members"]
                if "group" in line and line["group"]["kind"] == "parts":
                    self.again[place(line["group"])[0]] = line["group"]["members"]
        complete = set(fixed).intersection(*self.searches.values())
        self.fixed = {where: fixed[where] for where in sorted(complete)}

    def costs(self, objective, where):
        """Median cost of each configuration in the rounds at a place, the recommended default first."""
        return {key(one): statistics.median(cost(objective, times) for times in one["rounds"])
                for one in self.fixed[where] if one["rounds"] and not one.get("failure")}

    def gains(self, objective):
        """What the search's best, measured again, gains at each camera: over the default, and over the best fixed configuration of
        the other scenes, by the geometric mean over the default."""
        costs = {where: self.costs(objective, where) for where in self.fixed}
        over_default, over_fixed = [], []
        for where, own in costs.items():
            tried = [one for one in self.searches[objective][where] if one.get("times")]
            found = own[key(min(tried, key=lambda one: cost(objective, one["times"])))]
            others = [costs[other] for other in costs if other[0] != where[0]]
            everywhere = set(others[0]).intersection(*others[1:])
            best = min(sorted(everywhere), key=lambda one: sum(math.log(other[one] / next(iter(other.values()))) for other in others))
            over_default.append(next(iter(own.values())) / found)
            over_fixed.append(own[best] / found)
        return over_default, over_fixed


def place(of):
    return of["place"]["scene"], of["place"]["camera"]


def key(of):
    return json.dumps(of["configuration"], sort_keys=True)


def cost(objective, times):
    return times["render_ms"] + (times["build_ms"] if objective == "total" else 0)


def mean(ratios):
    return f"geometric mean {statistics.geometric_mean(ratios):.3f}, least {min(ratios):.2f}"


def goals(record, standings):
    lines = ["| a search gains, median of the cameras | over | goal | measured | |", "|---|---|---|---|---|"]
    for name in ROOFLINE:
        over_default, over_fixed = record.gains(name)
        for ratios, whom in [(over_default, "the recommended default"), (over_fixed, "the best fixed configuration of the other scenes")]:
            gain = statistics.median(ratios) - 1
            lines.append(f"| {name} time | {whom} | {share(SEARCH)} | {share(gain)} ({mean(ratios)}) | {met(gain >= SEARCH)} |")
    lines += ["", f"| an answer without a search | predictor | of the roofline; goal | of the paper's | overhead saved; goal {share(OVERHEAD)} |",
              "|---|---|---|---|---|"]
    for name, goal in ROOFLINE.items():
        for split, where in SPLITS.items():
            for entrant in ASKED:
                one = whole(standings, name, split)[entrant]
                reached, saved = one["of_roofline"]["mean"], one["overhead_reduction"]
                lines.append(f"| {name} time, {where} | {entrant} | {shares(one['of_roofline'])}; {share(goal)} {met(reached >= goal)} | "
                             f"{share(one['of_roofline_once']['mean'])} | {share(saved)} {met(saved >= OVERHEAD)} |")
    return "\n".join(lines)


def everybody(standings, objective, split):
    lines = [f"| {objective} time, {SPLITS[split]} | of the roofline | of the paper's | over default | over best fixed | overhead saved | break-even |",
             "|---|---|---|---|---|---|---|"]
    for entrant, one in whole(standings, objective, split).items():
        even = one["break_even"]["median"]
        lines.append(f"| {entrant} | {shares(one['of_roofline'])} | {share(one['of_roofline_once']['mean'])} | {one['over_default']['mean']:.2f} | "
                     f"{one['over_fixed']['mean']:.2f} | {share(one['overhead_reduction'])} | {'–' if even is None else f'{even:.0f}'} |")
    return "\n".join(lines)


def median_ms(of, name):
    return statistics.median(times[name] for times in of["rounds"])


def splitting(record):
    """The paper's 4.1: how splitting changes the total time at frames of several sizes, in paired rounds."""
    found, heights = {}, set()
    for pair in record.pairs:
        height = pair["versus"].get("height")
        if height:
            without, split = pair["group"]["members"]
            ratios = [cost("total", b) / cost("total", a) - 1 for a, b in zip(without["rounds"], split["rounds"], strict=True)]
            found.setdefault(pair["group"]["place"]["scene"], {})[height] = ratios
            heights.add(height)
    if not found:
        return []
    heights = sorted(heights)
    change = lambda ratios: f"{statistics.median(ratios) * 100:+.0f} % [{min(ratios) * 100:+.0f}, {max(ratios) * 100:+.0f}]"
    lines = ["| splitting: change of total time at | " + " | ".join(f"{height} pixels" for height in heights) + " |", "|---|" + "---|" * len(heights)]
    for scene, by_height in sorted(found.items()):
        lines.append(f"| {scene} | " + " | ".join(change(by_height[height]) if height in by_height else "–" for height in heights) + " |")
    return ["\n".join(lines)]


def alone(record):
    """The paper's 4.2: what the best of each search over a few parameters gains over the default, both measured again in the same rounds,
    and where searches end, which is the last quarter of their iterations."""
    titles = {"leaves": "leaf sizes", "costs": "SAH costs", "costs_and_block": "SAH costs and block size"}
    names = {"min_leaf_size": "least", "max_leaf_size": "most", "traversal_cost": "traversal", "intersection_cost": "intersection",
             "sah_block_size": "block"}
    lines = ["| scene | searched alone | searches | gain | where they end |", "|---|---|---|---|---|"]
    for (scene, part), searches in sorted(record.parts.items()):
        tried = [[one for one in search["iterations"] if one.get("times")] for search in searches]
        ends = [one for own in tried for one in own[-(len(own) // 4):]]
        middle = {name: statistics.quantiles([one["configuration"][name] for one in ends], n=4, method="inclusive")
                  for name in names if name in ends[0]["configuration"]}
        where = ", ".join(f"{names[name]} {low:.3g} to {high:.3g}" for name, (low, _, high) in middle.items())
        lines.append(f"| {scene} | {titles[part]} | {len(searches)} | {gained(record.again.get(scene), searches[0]['objective'], tried)} | {where} |")
    return ["\n".join(lines)] if record.parts else []


def gained(members, objective, tried):
    """The median over the rounds of what the best of each search gains over the default, least and most; a dash where the record lacks
    those rounds."""
    if not members:
        return "–"
    default = members[0]["configuration"]
    costs = {key(one): [cost(objective, times) for times in one["rounds"]] for one in members}
    best = [min(own, key=lambda one: cost(objective, one["times"]))["configuration"] for own in tried]
    found = [costs[key({"configuration": default | one})] for one in best]
    ratios = [own / statistics.geometric_mean(others) - 1 for own, *others in zip(costs[key(members[0])], *found, strict=True)]
    return f"{statistics.median(ratios) * 100:+.1f} % [{min(ratios) * 100:+.1f}, {max(ratios) * 100:+.1f}]"


def needles(record):
    """The paper's 4.3: the range of times over a round of the cylinder."""
    found = {}
    for pair in record.pairs:
        if "needles" in pair["versus"]:
            found.setdefault((pair["group"]["place"]["scene"], pair["versus"]["needles"]["angles"]), []).append(pair["group"]["members"])
    span = lambda all, which, name: "{:.0f} to {:.0f}".format(*(of(median_ms(one[which], name) for one in all) for of in (min, max)))
    lines = [f"| {scene} | " + " | ".join(span(all, which, name) for name in ("build_ms", "render_ms") for which in (0, 1)) + " |"
             for (scene, angles), all in sorted(found.items()) if len(all) == angles]
    head = ["| needles in, ms | build | build with splitting | render | render with splitting |", "|---|---|---|---|---|"]
    return ["\n".join(head + lines)] if lines else []


def made():
    """Each page with its tables, by its path."""
    about = json.loads((RECORD / "README.json").read_text())
    standings = json.loads((RECORD / about["judged"]).read_text())
    record = Record(RECORD / about["record"])
    under = record.conditions
    counts = {}
    for scene, _ in record.fixed:
        counts[scene] = counts.get(scene, 0) + 1
    cameras = ", ".join(f"{scene} {count}" for scene, count in sorted(counts.items()))
    searches = len(record.fixed) * len(record.searches)
    conditions = (f"{about['machine']}, {about['date']}, version {about['version']}. {under['size'][0]}×{under['size'][1]} pixels, "
                  f"{under['bounces']} bounces, {under['threads']} render threads, searches of {under['iterations']} iterations in the "
                  f"{under['space']} space, by the clock on the wall. {searches} searches; cameras of each scene: {cameras}.")
    return {PAGES / f"paper-{name}.md": filled(PAGES / f"paper-{name}.md", parts) for name, parts in {
        "goals": [textwrap.fill(conditions, 110), goals(record, standings)],
        "predictors": [everybody(standings, objective, split) for objective in ROOFLINE for split in SPLITS],
        "parameters": splitting(record) + alone(record) + needles(record),
    }.items()}


def filled(page, parts):
    before, _, rest = page.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    if not after:
        sys.exit(f"evaluation_tables: {page} has no place for the record; write the lines {BEGIN} and {END} where it belongs")
    return f"{before}{BEGIN}\n" + "\n\n".join(parts) + f"\n{END}{after}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; fail where something is older than the record")
    is_check = parser.parse_args().check
    for page, text in made().items():
        if not is_check:
            page.write_text(text)
        elif page.read_text() != text:
            sys.exit(f"evaluation_tables: {page.relative_to(ROOT)} is not what the record gives; run tools/evaluation_tables.py")


if __name__ == "__main__":
    main()
