#!/usr/bin/env python3
"""Makes the results in docs/paper.md from the record of the paper's evaluation, so that no figure there is older than its record.

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

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE, RECORD = ROOT / "docs" / "paper.md", ROOT / "lab" / "record" / "evaluation"
BEGIN, END = "<!-- evaluation: made by tools/evaluation_tables.py -->", "<!-- end of evaluation -->"
SPLITS = {"random": "other cameras of known scenes", "scene": "scenes that were never seen"}
# What was aimed at before anything was measured: share of the roofline, share of the overhead saved, median gain of a search.
ROOFLINE, OVERHEAD, SEARCH = {"render": 0.97, "total": 0.95}, 0.95, 0.11
# Of whom the goals are asked: chosen before anything was measured. The tables hold everybody.
ASKED = {"nearest_neighbour": "nearest neighbour", "rbf_greedy_gq": "RBF model, Greedy-GQ", "auto": "what the service chooses by itself (`auto`)"}


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
        self.searches, self.pairs, self.parts, fixed = {}, [], {}, {}
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
    lines = ["| goal | measured | |", "|---|---|---|"]
    for name, goal in ROOFLINE.items():
        over_default, over_fixed = record.gains(name)
        for ratios, whom in [(over_default, "the recommended default"), (over_fixed, "the best fixed configuration of the other scenes")]:
            gain = statistics.median(ratios) - 1
            lines.append(f"| {name} time: a search over {whom}, median at least {share(SEARCH)} | {share(gain)} ({mean(ratios)}) | {met(gain >= SEARCH)} |")
        for split, where in SPLITS.items():
            for entrant, title in ASKED.items():
                one = whole(standings, name, split)[entrant]
                reached, saved = one["of_roofline"]["mean"], one["overhead_reduction"]
                lines += [f"| {name} time, {where}: {title}, at least {share(goal)} of the roofline | {shares(one['of_roofline'])}; "
                          f"of the paper's, the least of single measurements: {share(one['of_roofline_once']['mean'])} | {met(reached >= goal)} |",
                          f"| and at least {share(OVERHEAD)} of the search's overhead saved | {share(saved)} | {met(saved >= OVERHEAD)} |"]
    return "\n".join(lines)


def everybody(standings, objective, split):
    lines = [f"{objective.capitalize()} time, {SPLITS[split]}:", "",
             "| predictor | of the roofline | least | of the paper's roofline | over search | over default | over best fixed | overhead saved | "
             "break-even: median, never, late |", "|---|---|---|---|---|---|---|---|---|"]
    for entrant, one in whole(standings, objective, split).items():
        even = one["break_even"]
        median = "–" if even["median"] is None else f"{even['median']:.0f}"
        lines.append(f"| {entrant} | {shares(one['of_roofline'])} | {share(one['of_roofline_least'])} | {share(one['of_roofline_once']['mean'])} | "
                     f"{one['over_search']['mean']:.3f} | {one['over_default']['mean']:.3f} | {one['over_fixed']['mean']:.3f} | "
                     f"{share(one['overhead_reduction'])} | {median}, {even['never']}, {even['late']} of {one['answers']} |")
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
    lines = ["Splitting (4.1): change of build and render time together by frame size; median of paired rounds, least and most. The paper has, for "
             "sponza, 5.8 % slower at 480 pixels down and 8 % faster at 720.", "",
             "| scene | " + " | ".join(f"{height} pixels down" for height in heights) + " |", "|---|" + "---|" * len(heights)]
    for scene, by_height in sorted(found.items()):
        lines.append(f"| {scene} | " + " | ".join(change(by_height[height]) if height in by_height else "–" for height in heights) + " |")
    return ["\n".join(lines)]


def alone(record):
    """The paper's 4.2: where searches over a few parameters end, which is the last quarter of their iterations."""
    titles = {"leaves": "leaf sizes", "costs": "SAH costs", "costs_and_block": "SAH costs and block size"}
    names = {"min_leaf_size": "least", "max_leaf_size": "most triangles of a leaf", "traversal_cost": "traversal", "intersection_cost": "intersection",
             "sah_block_size": "block"}
    lines = ["A few parameters searched alone (4.2), the others at the recommended default, for render time: median of the last quarter of the iterations "
             "against the default, and the middle half of the values there. The paper gains up to 8 % with leaf sizes, which end at 4 to 7 for sponza.", "",
             "| scene | searched | searches | gain | where they end |", "|---|---|---|---|---|"]
    for (scene, part), searches in sorted(record.parts.items()):
        tried = [[one for one in search["iterations"] if one.get("times")] for search in searches]
        ends = [one for own in tried for one in own[-(len(own) // 4):]]
        # Whenever a search came by it.
        default = [one for own in tried for one in own if one["configuration"] == own[0]["configuration"]]
        gain = statistics.median(cost(searches[0]["objective"], one["times"]) for one in default) / statistics.median(cost(searches[0]["objective"], one["times"]) for one in ends) - 1
        middle = {name: statistics.quantiles([one["configuration"][name] for one in ends], n=4, method="inclusive")
                  for name in names if name in ends[0]["configuration"]}
        where = ", ".join(f"{names[name]} {low:.3g} to {high:.3g}" for name, (low, _, high) in middle.items())
        lines.append(f"| {scene} | {titles[part]} | {len(searches)} | {gain * 100:.1f} % | {where} |")
    return ["\n".join(lines)] if record.parts else []


def needles(record):
    """The paper's 4.3: the range of times over a round of the cylinder."""
    found = {}
    for pair in record.pairs:
        if "needles" in pair["versus"]:
            found.setdefault((pair["group"]["place"]["scene"], pair["versus"]["needles"]["angles"]), []).append(pair["group"]["members"])
    span = lambda all, which, name: "{:.0f} to {:.0f}".format(*(of(median_ms(one[which], name) for one in all) for of in (min, max)))
    lines = [f"| {scene} | " + " | ".join(span(all, which, name) for name in ("build_ms", "render_ms") for which in (0, 1)) + " |"
             for (scene, angles), all in sorted(found.items()) if len(all) == angles]
    head = ["The cylinder of needles, half as long as the scene's diagonal (4.3): least and most over the angles of a whole round, milliseconds.", "",
            "| scene | build | build with splitting | render | render with splitting |", "|---|---|---|---|---|"]
    return ["\n".join(head + lines)] if lines else []


def made():
    about = json.loads((RECORD / "README.json").read_text())
    standings = json.loads((RECORD / about["judged"]).read_text())
    record = Record(RECORD / about["record"])
    under = record.conditions
    counts = {}
    for scene, _ in record.fixed:
        counts[scene] = counts.get(scene, 0) + 1
    cameras = ", ".join(f"{scene} {count}" for scene, count in sorted(counts.items()))
    searches = len(record.fixed) * len(record.searches)
    parts = [f"{about['machine']}, {about['date']}, version {about['version']}. {under['size'][0]}×{under['size'][1]} pixels, {under['bounces']} bounces, "
             f"{under['threads']} render threads, searches of {under['iterations']} iterations in the {under['space']} space, by the clock on the wall. "
             f"{searches} searches; cameras of each scene: {cameras}. {about['remark']}"]
    parts.append(goals(record, standings))
    parts += [everybody(standings, objective, split) for objective in ROOFLINE for split in SPLITS]
    parts += splitting(record) + alone(record) + needles(record)
    before, _, rest = PAGE.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    if not rest or not after:
        sys.exit(f"evaluation_tables: {PAGE} has no place for the record; write the lines {BEGIN} and {END} where it belongs")
    return f"{before}{BEGIN}\n" + "\n\n".join(parts) + f"\n{END}{after}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; fail where something is older than the record")
    text = made()
    if parser.parse_args().check:
        if PAGE.read_text() != text:
            sys.exit(f"evaluation_tables: {PAGE.relative_to(ROOT)} is not what the record gives; run tools/evaluation_tables.py")
    else:
        PAGE.write_text(text)


if __name__ == "__main__":
    main()
