#!/usr/bin/env python3
"""What searches cost and brought: a Markdown table of files that `treewright-render tune --json` wrote, a row each.

    treewright-render tune --scene SCENE --start native --worth inf --json SCENE.json
    tools/search_table.py SCENE.json ...

Files of earlier versions are read, too, so that two versions can be set side by side. Frames are those that were
rendered, repeats and the race of the best few included. *Dear* is the share of them that cost more than 1.1 times the
start, *worst* the dearest over the start, *session* the time of a hundred frames, search included, over that of the
baseline, and *until* the trials after which the answer is shown to be 1.3 times as fast as the start.
"""

import argparse
import json
import pathlib
import statistics

DEAR_ABOVE, STARTS_LEAST, SESSION, FASTER = 1.1, 3, 100, 1.3


def cost(trial):
    """What a trial cost, or had cost when it was stopped; None for one that could not be built."""
    outcome = trial["outcome"]
    return outcome["aborted"]["lower_bound"] if isinstance(outcome, dict) and "aborted" in outcome else trial["cost"]


def frames(trial, results):
    """The frames that a trial rendered to their end."""
    return (trial["times"].get("frames") or results["frames_per_trial"]) if trial["times"] else 0


def start_cost(results):
    """Of its own trials where there are enough of them, else by the final rounds."""
    own = [trial["cost"] for trial in results["trials"] if trial["cost"] and trial["configuration"] == results["start"]]
    if len(own) >= STARTS_LEAST:
        return statistics.median(own)
    median = {standing["name"]: standing["frame_ms"]["median"] for standing in results["standings"]}
    # Who is not in the rounds has no cost.
    start, baseline = (median.get(results[who]) for who in ("start_name", "baseline"))
    return results["reference_ms"] * start / baseline if start and baseline else None


def dear(results):
    """Share of dear frames, and the dearest over the start."""
    start = start_cost(results)
    ran = [(frames(trial, results) or 1, cost(trial)) for trial in results["trials"] if cost(trial) is not None]
    if not start or not ran:
        return "–", "–"
    above = sum(count for count, own in ran if own > DEAR_ABOVE * start)
    return f"{above / sum(count for count, _ in ran):.2f}", f"{max(own for _, own in ran) / start:.2f}"


def session(results, shown):
    """Time of the first frames over that of the baseline; more frames than those of the search run its answer."""
    pay = results["break_even"]
    default = pay["default_setup_ms"] + SESSION * pay["default_frame_ms"]
    if shown > SESSION or not default:
        return "–"
    spent = pay["tuning_ms"] + pay["tuned_setup_ms"] + (SESSION - shown) * pay["tuned_frame_ms"]
    return f"{spent / default:.2f}"


def until(results):
    """As the program tells it: the answer stays that fast."""
    first = "–"
    for milestone in reversed(results["milestones"]):
        interval = (milestone["over_start"] or {}).get("interval")
        if not interval or interval[0] < FASTER:
            break
        first = str(milestone["trials"])
    return first


def gain(results):
    over = results["gains"]["over_start"]
    if not over:
        return "–"
    ends = over["interval"]
    return f"{over['median']:.2f}" + (f" [{ends[0]:.2f}, {ends[1]:.2f}]" if ends else "")


def row(results):
    objective = results["objective"]
    objective = objective if isinstance(objective, str) else " ".join(f"{name} {count}" for name, count in objective.items())
    shown = sum(frames(trial, results) for trial in results["trials"])
    seconds = sum(trial["total_ms"] for trial in results["trials"]) / 1000
    cells = [results["scene"]["name"], objective, results["start_name"], len(results["trials"]), shown, f"{seconds:.1f}",
             *dear(results), session(results, shown), until(results), gain(results)]
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", nargs="+", type=pathlib.Path)
    print("| scene | objective | start | trials | frames | seconds | dear | worst | session | until | gain over the start |")
    print("|---|---|---|--:|--:|--:|--:|--:|--:|--:|---|")
    for path in parser.parse_args().file:
        print(row(json.loads(path.read_text())))


if __name__ == "__main__":
    main()
