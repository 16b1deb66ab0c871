"""Runs the package's documentation tests and what they do not show, against a running daemon: ``run.py URL``.

The package is the one that the interpreter finds. Optuna is tried where it is installed.
"""

import doctest
import importlib
import importlib.util
import os
import sys
import threading


def documentation() -> None:
    for name in ("treewright", "treewright.aio", "treewright.autotune"):
        result = doctest.testmod(importlib.import_module(name), optionflags=doctest.ELLIPSIS)
        assert result.attempted > 3 and result.failed == 0, (name, result)
        print(f"{name}: {result.attempted} examples hold")


def stubs() -> None:
    """The stubs name what the native module has, and nothing else."""
    import ast

    import treewright
    from treewright import _native

    path = os.path.join(os.path.dirname(treewright.__file__), "_native.pyi")
    with open(path, encoding="utf-8") as file:
        tree = ast.parse(file.read())
    public = lambda names: {name for name in names if not name.startswith("_")}
    classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
    assert public(classes) == public(dir(_native)), public(classes) ^ public(dir(_native))
    for name, node in classes.items():
        if issubclass(getattr(_native, name), Exception):
            continue
        told = {each.name for each in node.body if isinstance(each, ast.FunctionDef)}
        there = public(dir(getattr(_native, name)))
        assert public(told) == there, (name, public(told) ^ there)


def trials(url: str) -> None:
    import treewright

    client = treewright.Client(url, client_id="python-test", deadline_ms=20000)
    space = treewright.Space().choice("split", ["sah", "median"], default="sah")
    space.float("cost", 0.5, 4.0, default=1.0, active_if=("split", "sah")).choice("budget", [1.2, 2.0], default=1.2)
    space.integer("low", 1, 9, default=2).integer("high", 1, 9, default=5).less_or_equal("low", "high")
    study = client.study("python", space, minimise={"ms": 1.0}, policy={"confirm_rounds": 0})
    for _ in range(30):
        with study.suggest() as trial:
            values = trial.configuration
            assert trial.source == "daemon" and trial.problem is None and trial.reason
            assert values["low"] <= values["high"] and ("cost" in values) == (values["split"] == "sah"), values
            assert isinstance(values["low"], int) and isinstance(values["budget"], float)
            trial.report({"ms": values["low"]}, extra=1.0)
        assert not trial.is_open
    with study.suggest() as given_back:
        pass
    assert not given_back.is_open
    try:
        with study.suggest():
            raise RuntimeError("the lamp went out")
    except RuntimeError:
        pass
    for problem, wrong in (
        (treewright.Invalid, lambda: trial.report(ms=1)),
        (treewright.Invalid, lambda: study.suggest().report(ms=float("nan"))),
        (treewright.Invalid, lambda: study.suggest().report({"ms": -1.0})),
        (treewright.Refused, lambda: study.trial_of({"split": "other"})),
        (treewright.Refused, lambda: client.existing_study("nowhere")),
        (treewright.Invalid, lambda: treewright.Client(url, deadline_ms=-1)),
        (treewright.Unreachable, lambda: treewright.Client("http://127.0.0.1:1").ping_ms()),
    ):
        try:
            wrong()
        except problem as error:
            assert isinstance(error, treewright.TreewrightError) and str(error)
        else:
            raise AssertionError(problem)
    client.flush(20000)
    stats = client.stats()
    assert stats["acknowledged"] >= 31 and stats["abandoned"] >= 2 and stats["dropped"] == 0, stats
    assert study.best()[1] >= 1 and "python" in client.studies()


def threads(url: str) -> None:
    import treewright

    client = treewright.Client(url, client_id="python-threads", deadline_ms=20000)
    space = treewright.Space().integer("leaf", 1, 32, default=8)
    study = client.study("python-threads", space, minimise={"ms": 1.0}, indicators={"size": (0.0, 100.0)})
    problems = []

    def work(size: int) -> None:
        try:
            tuner = study.tuner()
            for _ in range(20):
                suggestion = tuner.next({"size": size * 25.0})
                tuner.finish(suggestion, ms=suggestion["leaf"])
        except Exception as error:  # told by the main thread
            problems.append(error)

    workers = [threading.Thread(target=work, args=(size,)) for size in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert not problems, problems
    client.flush(20000)
    stats = client.stats()
    assert stats["acknowledged"] + stats["unreported"] == 80, stats
    client.delete_study("python-threads")


def optuna_sampler(url: str) -> None:
    if importlib.util.find_spec("optuna") is None:
        return print("passed by: the Optuna sampler, because Optuna is not installed")
    import optuna
    import treewright
    from treewright.optuna import TreewrightSampler

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    search_space = {
        "x": optuna.distributions.FloatDistribution(-4, 4),
        "n": optuna.distributions.IntDistribution(1, 64, log=True),
        "step": optuna.distributions.FloatDistribution(0, 1, step=0.25),
        "kind": optuna.distributions.CategoricalDistribution(["a", None, 3]),
    }
    client = treewright.Client(url, client_id="optuna", deadline_ms=20000)
    sampler = TreewrightSampler(search_space, client, "optuna", policy={"epsilon": 1.0})

    def objective(trial: "optuna.Trial") -> float:
        x, n = trial.suggest_float("x", -4, 4), trial.suggest_int("n", 1, 64, log=True)
        step, kind = trial.suggest_float("step", 0, 1, step=0.25), trial.suggest_categorical("kind", ["a", None, 3])
        if trial.number == 5:
            trial.report(9.0, 1)
            raise optuna.TrialPruned
        return x * x + abs(n - 8) + step + (0 if kind is None else 1)

    study = optuna.create_study(sampler=sampler)
    study.optimize(objective, n_trials=40)
    client.flush(20000)
    first, best = study.trials[0].value, study.best_value
    # The first trial is the default: x 0, n 8, step 0.5, and of the categories the one in the middle.
    assert best <= first, (first, best)
    assert client.existing_study("optuna").best()[1] <= first
    print(f"Optuna: {first} to {best} in 40 trials")


if __name__ == "__main__":
    os.environ["TREEWRIGHT_URL"] = sys.argv[1]
    documentation()
    stubs()
    trials(sys.argv[1])
    threads(sys.argv[1])
    optuna_sampler(sys.argv[1])
    print("ok")
