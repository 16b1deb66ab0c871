#!/usr/bin/env python3
"""What searches cost and brought: a Markdown table of files that `treewright-render tune --json` wrote, a row each.

    treewright-render tune --scene SCENE --start native --worth inf --json SCENE.json
    tools/search_table.py SCENE.json ...

Files of earlier versions are read, too, so that two versions can be set side by side. Frames are those that were
rendered, repeats and the race of the best few included. *Dear* is the share of them that cost more than 1.1 times the
start, *worst* the dearest over the start. *Session* is the time of a session, search included, over that of the baseline
(which is the start, where that is not the recommended one): the most that it is from the hundredth frame on. *Until* is
the number of frames after which the answer is shown to be 1.3 times as fast as the start.
"""

import argparse
import json
import pathlib
import statistics

DEAR_ABOVE, STARTS_LEAST, SESSION, FASTER = 1.1, 3, 100, 1.3
COLUMNS = ("scene", "objective", "start", "trials", "frames", "seconds", "dear", "worst", "session", "until",
           "gain over the start")
NOTHING = "–"


def cost(trial):
    """What a trial cost, or had cost when it was stopped; None for one that could not be built."""
    outcome = trial["outcome"]
    return outcome["aborted"]["lower_bound"] if isinstance(outcome, dict) and "aborted" in outcome else trial["cost"]


def frames(trial, results):
    """The frames that a trial rendered to their end; 0 where its frame was known."""
    own = (trial["times"] or {"frames": 0}).get("frames")
    return results["frames_per_trial"] if own is None else own


def shown(results):
    """The frames of all trials."""
    return sum(frames(trial, results) for trial in results["trials"])


def seconds(results):
    """The time of all trials."""
    return sum(trial["total_ms"] for trial in results["trials"]) / 1000


def start_cost(results):
    """Of its own trials where there are enough of them, else by the final rounds."""
    own = [trial["cost"] for trial in results["trials"] if trial["cost"] and trial["configuration"] == results["start"]]
    if len(own) >= STARTS_LEAST:
        return statistics.median(own)
    median = {standing["name"]: standing["frame_ms"]["median"] for standing in results["standings"]}
    # Who is not in the rounds has no cost.
    start, baseline = (median.get(who) for who in (results.get("start_name"), results["baseline"]))
    return results["reference_ms"] * start / baseline if start and baseline else None


def dear(results):
    """Share of dear frames, and the dearest over the start; None where there are none or the start has no cost."""
    start = start_cost(results)
    ran = [(frames(trial, results) or 1, cost(trial)) for trial in results["trials"] if cost(trial) is not None]
    if not start or not ran:
        return None
    above = sum(count for count, own in ran if own > DEAR_ABOVE * start)
    return above / sum(count for count, _ in ran), max(own for _, own in ran) / start


def session(results):
    """The most that the time spent by a frame is over that of the baseline, from the hundredth frame on."""
    pay = results["break_even"]
    if not pay["default_frame_ms"]:
        return None
    ratios, spent, count = [], 0, 0

    def over(spent, count):
        return spent / (pay["default_setup_ms"] + count * pay["default_frame_ms"])

    for trial in results["trials"]:
        spent += trial["total_ms"]
        count += frames(trial, results)
        if count >= SESSION:
            ratios.append(over(spent, count))
    # Frames with the answer follow: the ratio goes one way from there to that of single frames.
    first = max(SESSION, count)
    ratios.append(over(spent + pay["tuned_setup_ms"] + (first - count) * pay["tuned_frame_ms"], first))
    return max(*ratios, pay["tuned_frame_ms"] / pay["default_frame_ms"])


def until(results):
    """The first milestone from which on the answer stays that fast, as the program tells it, in frames; else None."""
    first = None
    for milestone in reversed(results.get("milestones", [])):
        interval = (milestone["over_start"] or {}).get("interval")
        if not interval or interval[0] < FASTER:
            break
        first = milestone["trials"]
    ran = [frames(trial, results) for trial in results["trials"] if trial["number"] <= (first or 0)]
    return sum(ran) if first else None


def gain(results):
    """The answer's speed over the start's. Before there was a choice, that was the best fixed configuration."""
    gains = results["gains"]
    over = gains["over_start"] if "over_start" in gains else gains["over_best_fixed"]
    if not over:
        return NOTHING
    ends = over["interval"]
    return f"{over['median']:.2f}" + (f" [{ends[0]:.2f}, {ends[1]:.2f}]" if ends else "")


def number(value):
    return NOTHING if value is None else f"{value:.2f}"


def cells(results):
    objective = results["objective"]
    objective = objective if isinstance(objective, str) else " ".join(f"{name} {count}" for name, count in objective.items())
    reached = until(results)
    start = results.get("start_name", "best fixed configuration")
    return [results["scene"]["name"], objective, start, len(results["trials"]), shown(results), f"{seconds(results):.1f}",
            *map(number, dear(results) or (None, None)), number(session(results)), NOTHING if reached is None else reached,
            gain(results)]


def row(cells):
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def head(columns):
    """The first two lines of a table whose last column has words."""
    return row(columns) + "\n|" + "---|" * 3 + "--:|" * (len(columns) - 4) + "---|"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", nargs="+", type=pathlib.Path)
    print(head(COLUMNS))
    for path in parser.parse_args().file:
        print(row(cells(json.loads(path.read_text()))))


if __name__ == "__main__":
    main()
