"""What a type checker makes of the package: checked with ``mypy --strict``, never run."""

import treewright


def tune(client: treewright.Client) -> float:
    space = treewright.Space().integer("leaf", 1, 32, default=8, log=True).choice("split", ["sah", "median"], default="sah")
    study = client.study("typed", space, minimise={"ms": 1.0}, indicators={"size": (0.0, 9.0), "count": (0.0, 1e6, "log")})
    with study.suggest({"size": 1.0}) as trial:
        leaf = trial.configuration["leaf"]
        assert isinstance(leaf, int)
        trial.report(ms=float(leaf))
    best = study.best()
    names: list[str] = sorted(best.configuration)
    low, high = best.cost_interval or (best.cost, best[1])
    return high - low + len(names)
