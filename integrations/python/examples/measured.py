"""What the examples share: meshes, trials, and rounds in which the tuned configuration and the fixed ones run in turns."""

import json
import random

import numpy


def read(path):
    """The PLY that integrations/scenes.py writes: positions, and corners of the triangles."""
    with open(path, "rb") as file:
        counts = {}
        while (line := file.readline()) != b"end_header\n":
            if line.startswith(b"element"):
                counts[line.split()[1]] = int(line.split()[2])
        vertices = numpy.fromfile(file, "<f4", 3 * counts[b"vertex"]).reshape(-1, 3)
        faces = numpy.fromfile(file, numpy.dtype([("count", "u1"), ("corners", "<i4", 3)]), counts[b"face"])
    return vertices, numpy.ascontiguousarray(faces["corners"])


def repeated(run, configuration):
    """The run with the median cost out of several, as many as fit into a third of a second, with its result and the costs of all."""
    runs, spent_ms = [], 0.0
    while len(runs) % 2 == 0 or (len(runs) < 9 and spent_ms < 330):
        cost, result = run(configuration)
        runs.append((sum(cost.values()), cost, result))
        spent_ms += runs[-1][0]
    _, cost, result = sorted(runs, key=lambda one: one[0])[len(runs) // 2]
    return cost, result, [one[0] for one in runs]


def tune(client, study, known, run, fixed, trials):
    """Trials of one state: first what is known to be good somewhere, then the search, and in the last quarter the best so far and the best known
    setting in turns, which tells merit from luck. Returns what each run of them took in milliseconds, and the best configuration. `run` takes a
    configuration and returns its measurements and its result."""
    costs, medians = [], []

    def measure(trial):
        with trial:
            cost, _result, all_costs = repeated(run, trial.configuration)
            trial.report(cost)
        costs.extend(all_costs)
        medians.append(sum(cost.values()))

    for each in fixed[:trials]:
        measure(study.trial_of(each, known))
    best_known = fixed[medians.index(min(medians))]
    pairs = min(trials // 8, (trials - len(medians)) // 2)
    for _ in range(trials - len(medians) - 2 * pairs):
        measure(study.suggest(known))
    for _ in range(pairs):
        client.flush(20000)
        measure(study.trial_of(study.best(known)[0], known))
        measure(study.trial_of(best_known, known))
    client.flush(20000)
    return costs, study.best(known)[0]


def compare(run, tuned, fixed, rounds):
    """The tuned configuration and the fixed ones, in turns within each round; and in how many hits each differs from the tuned one."""
    turns = [{"configuration": each, "costs": []} for each in [tuned, *fixed]]
    hits, order = {}, random.Random(3)
    for _ in range(rounds):
        # In another order each time: what ran before leaves its mark on caches and memory.
        for turn in order.sample(range(len(turns)), len(turns)):
            cost, hits[turn], _all_costs = repeated(run, turns[turn]["configuration"])
            turns[turn]["costs"].append(sum(cost.values()))
    for turn, one in enumerate(turns):
        one["differs"] = int((hits[turn] != hits[0]).sum())
    return {"tuned_costs": turns[0]["costs"], "fixed": turns[1:]}


def show(path, triangles, use, costs, tuned, compared):
    """One line of JSON, as integrations/summary.py reads it."""
    name = path.rsplit("/", 1)[-1]
    print(json.dumps({"scene": name, "triangles": triangles, "use": use, "trial_costs": costs, "tuned": tuned, **compared}), flush=True)
