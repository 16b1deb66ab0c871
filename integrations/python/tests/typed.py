"""What a type checker makes of the package: checked with ``mypy --strict``, never run."""

import treewright
import treewright.aio


def tune(client: treewright.Client) -> float:
    space = treewright.Space().integer("leaf", 1, 32, default=8, log=True).choice("split", ["sah", "median"], default="sah")
    study = client.study("typed", space, minimise={"ms": 1.0}, indicators={"size": (0.0, 9.0), "count": (0.0, 1e6, "log")})
    with study.suggest({"size": 1.0}) as trial:
        study.extend_lease(trial)
        leaf = trial.configuration["leaf"]
        assert isinstance(leaf, int)
        trial.report(ms=float(leaf))
    study.set_policy(epsilon=0.1, lease_s=None)
    best = treewright.tune(study, lambda values: {"ms": float(len(values))}, trials=3, callbacks=[lambda ran: ran.number > 1])
    names: list[str] = sorted(best.configuration)
    low, high = best.cost_interval or (best.cost, best[1])
    return high - low + len(names)


async def look(study: treewright.aio.Study) -> float:
    found = await study.front(("time_ms", "1/rate"), reference=[8.0, 5.0])
    return found.hypervolume or 0.0
