"""Runs the package's documentation tests and what they do not show, against a running daemon: ``run.py URL``.

The package is the one that the interpreter finds. Optuna is tried where it is installed.
"""

import doctest
import importlib
import importlib.util
import math
import os
import sys
import threading
import time
import warnings


def raises(problem, wrong, *words: str) -> None:
    """Whether a call fails as it should; the error names its cause, in one of these words where there are any."""
    try:
        wrong()
    except problem as error:
        assert str(error) and (not words or any(each in str(error) for each in words)), error
    else:
        raise AssertionError((problem, wrong))


def documentation() -> None:
    for name in ("treewright", "treewright.aio", "treewright.autotune", "treewright.front", "treewright.loop", "treewright.plot"):
        result = doctest.testmod(importlib.import_module(name), optionflags=doctest.ELLIPSIS)
        assert result.attempted > 1 and result.failed == 0, (name, result)
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
        there = getattr(_native, name)
        assert there.__doc__ and "stubs" not in there.__doc__, name
        if issubclass(there, Exception):
            continue
        told = {each.name for each in node.body if isinstance(each, ast.FunctionDef)}
        assert public(told) == public(dir(there)), (name, public(told) ^ public(dir(there)))
        for each in public(told):
            assert getattr(there, each).__doc__, f"{name}.{each} has no docstring"
    for name in ("treewright", *(f"treewright.{each}" for each in ("aio", "autotune", "front", "loop", "optional", "plot", "programs", "trials"))):
        module = importlib.import_module(name)
        for each in (module, *(getattr(module, part) for part in module.__all__ if part != "__version__")):
            assert each.__doc__, f"{each} has no docstring"
            parts = vars(each).items() if isinstance(each, type) and each.__module__.startswith("treewright.") else ()
            for part, there in parts:
                assert part.startswith("_") or there.__doc__, f"{name}: {each.__name__}.{part} has no docstring"
    # A frame loop is of one thread, and ``aio.local`` makes the client of the user's own daemon.
    for name, elsewhere in (("Client", {"local"}), ("Study", {"tuner"})):
        lacks = public(dir(getattr(treewright, name))) - public(dir(getattr(treewright.aio, name)))
        assert lacks == elsewhere, (name, lacks)
    version = treewright.__version__.split(".")
    assert len(version) == 3 and all(part.isdigit() for part in version), version


def trials(url: str) -> None:
    import treewright

    client = treewright.Client(url, client_id="python-test", deadline_ms=20000)
    space = treewright.Space().choice("split", ["sah", "median"], default="sah")
    space.float("cost", 0.5, 4.0, default=1.0, active_if=("split", "sah")).choice("budget", [1.2, 2.0], default=1.2)
    space.integer("low", 1, 9, default=2, setup=True).integer("high", 1, 9, default=5).less_or_equal("low", "high")
    space.integer("blockSize", 8, 72, default=24, step=16)
    space.constraint("low * high <= 20 and (low % 2 == 0 or split == 'median')")
    limits = {"mb": (None, 99.0)}
    study = client.study("python", space, minimise={"ms": 1.0}, limits=limits, policy={"confirm_rounds": 0})
    built = None
    for _ in range(30):
        with study.suggest() as trial:
            values = trial.configuration
            assert trial.source == "daemon" and trial.problem is None and trial.reason
            assert trial.is_prepared == (values["low"] == built), (values, built)
            built = values["low"]
            assert values["blockSize"] % 16 == 8, values
            assert values["low"] * values["high"] <= 20 and (values["low"] % 2 == 0 or values["split"] == "median")
            assert values["low"] <= values["high"] and ("cost" in values) == (values["split"] == "sah"), values
            assert isinstance(values["low"], int) and isinstance(values["budget"], float)
            trial.report({"ms": values["low"], "mb": 10.0}, extra=1.0)
        assert not trial.is_open
    rate = client.study("python-rate", treewright.Space().integer("level", 1, 9, default=5), maximise={"fps": 1000.0})
    with rate.suggest() as trial:
        trial.report({"fps": 50.0})
    client.flush(20000)
    best = rate.best()
    assert best.cost == 20.0 and best.value == 50.0 and "fps (higher is better) 50" in repr(best), best
    assert rate.cost({"fps": 50.0}) == 20.0 and rate.value(20.0) == 50.0 and study.value_title == "cost", rate.value_title
    with study.suggest() as given_back:
        pass
    with study.suggest() as beyond:
        beyond.report({"ms": 0.5, "mb": 100.0})
    client.flush(20000)
    (refused,) = study.trials("outcome = INFEASIBLE")
    assert refused["measurements"]["mb"] == 100.0 and refused["cost"] is None, refused
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
        (treewright.Invalid, lambda: study.suggest({"low": 1.0})),
        (treewright.Invalid, lambda: study.tuner().next({"low": 1.0})),
        (treewright.Invalid, lambda: study.trial_of({"split": "sah"}, {"low": 1.0})),
        (treewright.Invalid, lambda: study.predict({"low": 1.0})),
        (treewright.Invalid, lambda: study.best({"low": 1.0})),
        (treewright.Invalid, lambda: study.set_policy(epsilom=1)),
        (treewright.Invalid, lambda: study.set_policy(epsilon=2)),
        (treewright.Invalid, lambda: study.pin({"leaf": 2})),
        (treewright.Invalid, lambda: study.set_start({"leaf": 2})),
        (IndexError, lambda: study.predict()[2]),
        (treewright.Refused, lambda: study.trial_of({"split": "other"})),
        (treewright.Refused, lambda: client.existing_study("nowhere")),
        (treewright.Invalid, lambda: treewright.Client(url, deadline_ms=-1)),
        (treewright.Invalid, lambda: treewright.Client(url, token_file="/nowhere/token")),
        (treewright.Invalid, lambda: treewright.Client(url, token="tw1_a", token_file=__file__)),
        (treewright.Invalid, lambda: treewright.Client(url, certificate_file=__file__)),
        (treewright.Invalid, lambda: treewright.Client(url, key_file=__file__)),
        (treewright.Invalid, lambda: treewright.Client(url, certificate_file="/nowhere/cert.pem", key_file=__file__)),
        (treewright.Unreachable, lambda: treewright.Client("http://127.0.0.1:1").ping_ms()),
    ):
        assert issubclass(problem, (treewright.TreewrightError, IndexError))
        raises(problem, wrong)
    for unused in ({"authority_file": __file__}, {"certificate_file": __file__, "key_file": __file__}):
        for words in ("only used with TLS", "write https://localhost:1"):
            raises(treewright.Invalid, lambda: treewright.Client("http://localhost:1", **unused), words)
    client.flush(20000)
    stats = client.stats()
    assert stats["acknowledged"] >= 31 and stats["abandoned"] >= 2 and stats["dropped"] == 0, stats
    best = study.best()
    assert best[1] == best.cost >= 1 and best[0] == best.configuration and len(best) == 2 and "python" in client.studies()
    known = study.predict()
    assert known[0] == known.configuration and known[1] == known.predicted_cost and len(known) == 2, known
    assert known.mode == "exploit" and known.reason, known
    low, high = best.cost_interval
    assert low <= high and best.measurements >= 1 and best.verdict and best.stage and best.status, best
    mappings(url, client)
    trials = study.trials("state = COMPLETED AND outcome = OK", "cost")
    assert len(trials) == 30 and trials[0]["cost"] == min(each["cost"] for each in trials) and trials[0]["outcome"] == "ok", trials
    row = trials.rows()[0]
    assert row["config.low"] == row["measurement.ms"] == row["cost"] and row["client_id"].startswith("python-test"), row
    if importlib.util.find_spec("pandas") is not None:
        table = study.trials().to_pandas()
        assert table.index.name == "number" and table["cost"].min() == row["cost"] and str(table["create_time"].dt.tz) == "UTC", table
    assert best.gain_interval[0] <= best.gain <= best.gain_interval[1] and not best.nothing_better, best


def mappings(url: str, client) -> None:
    """Every mapping is taken, not only a dictionary; what is none is refused."""
    import collections
    import types

    import treewright

    fixed = lambda **named: types.MappingProxyType(named)
    treewright.Client(url, software=fixed(python="3"))
    space = treewright.Space().integer("leaf", 1, 32, default=8)
    study = client.study(
        "python-mappings",
        space,
        minimise=fixed(ms=1.0),
        indicators=fixed(size=(0.0, 9.0)),
        limits=fixed(mb=(None, 99.0)),
        policy=fixed(confirm_rounds=0),
    )
    study.set_start(fixed(leaf=3))
    with study.suggest(fixed(size=1.0)) as trial:
        assert trial.configuration["leaf"] == 3, trial
        trial.report(collections.ChainMap({"ms": 2.0}, {"ms": 3.0}), mb=1.0)
    study.set_start()
    study.trial_of(fixed(leaf=3), collections.UserDict(size=2.0)).report(fixed(ms=4.0, mb=1.0))
    client.flush(20000)
    assert study.cost(fixed(ms=5.0)) == 5.0 and study.beyond(fixed(mb=100.0)), study
    assert sorted(each["cost"] for each in study.trials("state = COMPLETED")) == [2.0, 4.0]
    for wrong in ([("size", 1.0)], "size", 1.0):
        raises(TypeError, lambda: study.suggest(wrong), "Mapping")


def steering(url: str) -> None:
    import treewright

    client = treewright.Client(url, client_id="python-steering", deadline_ms=20000)
    space = treewright.Space().integer("leaf", 1, 32, default=8, log=True).boolean("compact", default=False)
    study = client.study("python-steering", space, minimise={"ms": 1.0, "mb": 0.5}, policy={"epsilon": 0.5})
    assert client.url == url and study.metrics == {"ms": 1.0, "mb": 0.5}
    assert study.policy()["epsilon"] == "0.5"
    study.set_policy(epsilon=None, confirm_rounds=0)
    usual = study.policy()
    assert usual["epsilon"] != "0.5" and usual["confirm_rounds"] == "0" and usual["operation"] == "tune", usual
    study.set_texts(note="at\nnight", tags=["b", "a", "b"])
    study.set_texts(display_name="leaves")
    assert (study.note(), study.tags()) == ("at\nnight", ["a", "b"])
    study.pin({"leaf": 3})
    assert study.suggest().configuration == {"leaf": 3, "compact": False}
    study.unpin()
    study.freeze()
    assert study.policy() == {**usual, "operation": "freeze"}
    assert {study.suggest()["leaf"] for _ in range(5)} == {8}
    study.thaw()
    assert study.policy() == usual
    # What a study spells with capitals is pinned so, and what was read can be written.
    space = treewright.Space().choice("splitKind", ["SAH", "median"], default="median")
    kinds = client.study("python-pinned", space, minimise={"ms": 1.0})
    kinds.set_policy(pinned="splitKind=SAH", track_speed=True)
    assert kinds.suggest().configuration == {"splitKind": "SAH"}
    kinds.set_policy(**kinds.policy())
    assert kinds.policy()["pinned"] == "splitKind=SAH" and kinds.policy()["track_speed"] == "true", kinds.policy()


def frozen(url: str) -> None:
    """Of a frozen study a client gets what ran in its state and works; in a new one what ran in another, or the default."""
    import treewright

    client = treewright.Client(url, client_id="python-frozen", deadline_ms=20000)
    space = treewright.Space().integer("leaf", 1, 32, default=8, log=True).integer("window", 1, 15, default=8)
    policy = {"epsilon": 0.8, "confirm_rounds": 0}
    study = client.study("python-frozen", space, minimise={"ms": 1.0}, indicators={"size": (0, 100)}, policy=policy)
    ran, failed = {10: set(), 50: set(), 90: set()}, set()

    def frame(size: int) -> tuple:
        suggestion = study.suggest({"size": size})
        assert suggestion.source == "daemon", suggestion.problem
        values = (suggestion["leaf"], suggestion["window"])
        # The cheapest lie just beside those that cannot be used.
        if sum(values) > 24:
            failed.add(values)
            suggestion.infeasible("its output grows")
        else:
            ran[size].add(values)
            suggestion.report(ms=60.0 - sum(values))
        return values

    for each in range(40):
        frame(90 if each % 4 == 3 else 10)
    client.flush(20000)
    assert len(ran[10]) > 4 and len(failed) > 0, (ran, failed)
    study.freeze()
    for size in (10, 90, 50):
        works = set(ran[size]) if ran[size] else {(8, 8), *ran[10], *ran[90]}
        for _ in range(3):
            assert frame(size) in works - failed, (size, works, failed)


def only_its_own_study(url: str) -> None:
    """A handle goes by the identity of its study: no call of it reaches another that has the name by now."""
    import treewright

    client = treewright.Client(url, client_id="python-identity", deadline_ms=20000)
    space = lambda: treewright.Space().integer("leaf", 1, 32, default=8)
    before = client.study("python-identity", space(), minimise={"ms": 1.0})
    client.delete_study("python-identity")
    after = client.study("python-identity", space(), minimise={"ms": 2.0})
    policy = after.policy()
    for call in (
        lambda: before.set_texts(note="of before"),
        lambda: before.set_policy(epsilon=0.5),
        lambda: before.pin({"leaf": 3}),
        *(before.unpin, before.freeze, before.thaw, before.trials, before.note, before.tags, before.policy),
    ):
        raises(treewright.Refused, call, "created again")
    assert (after.note(), after.policy(), after.trials().rows()) == ("", policy, [])
    client.delete_study("python-identity")


def across_a_change_of_the_space(url: str) -> None:
    """A program of before goes on in the space that it knows, and one of today gets the new parameter."""
    import treewright

    client = treewright.Client(url, client_id="python-space", deadline_ms=20000)
    space = lambda: treewright.Space().integer("level", 1, 9, default=5)
    before = client.study("python-space", space(), minimise={"ms": 1.0})
    first = before.suggest()
    first.report(ms=5.0)
    client.flush(20000)
    wider = space().integer("threads", 1, 4, default=2)
    told = {"kept_trials": 1, "outside_trials": 0, "given_back_trials": 0}
    assert client.change_space("python-space", wider, only_try=True) == {"revision": 1, **told}
    assert client.change_space("python-space", wider, fixed={"threads": 3}) == {"revision": 2, **told}
    after = client.study("python-space", wider, minimise={"ms": 1.0})
    assert after.best().configuration == {**first.configuration, "threads": 3}, after.best()
    for study, names in ((before, {"level"}), (after, {"level", "threads"})):
        suggestion = study.suggest()
        assert suggestion.source == "daemon" and suggestion.configuration.keys() == names, suggestion.problem
        suggestion.report(ms=4.0)
        client.flush(20000)
    raises(treewright.Invalid, lambda: client.change_space("python-space", treewright.Space()))
    raises(treewright.Refused, lambda: client.change_space("nowhere", wider))
    client.delete_study("python-space")


def leases(url: str) -> None:
    """Work that takes longer than a lease renews it."""
    import asyncio

    import treewright
    import treewright.aio

    space = treewright.Space().integer("leaf", 1, 32, default=8)
    definition = {"minimise": {"ms": 1.0}, "policy": {"lease_s": 3, "confirm_rounds": 0}}
    client = treewright.Client(url, client_id="python-leases", deadline_ms=20000)
    study = client.study("python-leases", space, **definition)

    async def beside(trial) -> None:
        client = await treewright.aio.connect(url, deadline_ms=20000)
        await (await client.existing_study("python-leases")).extend_lease(trial)

    trial = study.suggest()
    for _ in range(4):
        time.sleep(1)
        study.extend_lease(trial)
    asyncio.run(beside(trial))
    trial.report(ms=1.0)
    client.flush(20000)
    (told,) = study.trials()
    assert told["state"] == "completed" and not told["late"], told
    raises(treewright.Invalid, lambda: study.extend_lease(trial), "already")
    away = treewright.Client("http://127.0.0.1:1", deadline_ms=50, call_deadline_ms=500)
    study = away.study("python-leases", space, **definition)
    study.extend_lease(study.suggest())


def loop(url: str) -> None:
    import treewright

    client = treewright.Client(url, client_id="python-loop", deadline_ms=20000)
    space = treewright.Space().integer("leaf", 1, 32, default=8, log=True)
    study = client.study("python-loop", space, minimise={"ms": 1.0, "mb": 0.5}, policy={"epsilon": 1.0, "confirm_rounds": 0})

    def objective(values: dict) -> dict:
        if values["leaf"] > 30:
            raise OSError("too large")
        return {"ms": values["leaf"], "mb": 2.0}

    ran = []
    best = treewright.tune(study, objective, trials=60, callbacks=[ran.append, lambda one: one.number == 39], catch=(OSError,))
    assert [one.number for one in ran] == list(range(40)) and best.cost == min(one.cost for one in ran if one.measured)
    assert all(one.cost == one.suggestion["leaf"] + 1 for one in ran if one.measured)
    assert treewright.tune(study, objective, seconds=0, catch=(OSError,)).cost <= best.cost
    raises(ValueError, lambda: treewright.tune(study, objective))
    raises(TypeError, lambda: treewright.tune(study, lambda values: 1.0, trials=1))
    raises(OSError, lambda: treewright.tune(study, lambda values: objective({"leaf": 31}), trials=1))
    client.flush(20000)
    last = study.trials(order_by="number desc")[0]
    assert last["outcome"] == "failed", last
    without_answers(space, objective)
    beyond_a_limit(client)
    episodes(client)
    tables_and_figures(client, study)


def fronts(url: str) -> None:
    """Two metrics at once: the runs, what is refused, and the table."""
    import treewright
    from treewright import plot

    client = treewright.Client(url, client_id="python-front", deadline_ms=20000, call_deadline_ms=20000)
    space = treewright.Space().integer("level", 1, 50, default=25)
    metrics = ["time_ms", "1/rate"]
    front = treewright.Front(client, "python-front", space, metrics, trials=10)
    assert front.metrics == ["time_ms", "rate"] and front.suggest().trial == front.suggest().trial
    measured = lambda trial: {"time_ms": 100.0 / trial["level"], "rate": 1000.0 / trial["level"] ** 2}
    ran = 0
    while (trial := front.suggest()) is not None:
        with trial:
            if ran == 0:
                for wrong in ({"time_ms": 1.0}, {"time_ms": 1.0, "rate": 0.0}):
                    raises(treewright.Invalid, lambda: trial.report(wrong), "above 0")
                    assert trial.is_open, wrong
            trial.report(measured(trial))
        ran += 1
        assert not trial.is_open
    assert ran == 10
    try:
        trial = treewright.Front(client, "python-front", space, metrics, trials=1).suggest()
        with trial:
            raise RuntimeError("the lamp went out")
    except RuntimeError:
        assert not trial.is_open
    found = treewright.Front(client, "python-front", space, metrics, trials=0).found()
    assert found.runs == 10 and found.maximised == ["rate"] and found.default is not None, found
    # Every level is quicker than those below, and does less: none is dominated.
    assert found.dominated == [] and [one["metrics"]["time_ms"] for one in found] == sorted(one["metrics"]["time_ms"] for one in found)
    assert 0 <= found.hypervolume <= 1 and found.rows()[0]["config.level"] == found[0]["configuration"]["level"]
    # The stored trials have the same front, of the metrics that the study was made for or of named ones.
    study = client.existing_study("python-front")
    assert study.front() == found and study.front(metrics).hypervolume == found.hypervolume
    assert study.front(reference=[1e-9, 1e9]).hypervolume == 0
    other = client.study("python-front-none", space, minimise={"time_ms": 1.0})
    for ask in (other.front, lambda: study.front(["time_ms"]), lambda: study.front(reference=[1.0])):
        raises(treewright.Invalid, ask, "two or three", "for each metric")
    for wrong in (["time_ms"], ["time_ms", "memory_mb"]):
        raises(treewright.TreewrightError, lambda: treewright.Front(client, "python-front", space, wrong))
    # A program that knows an earlier space still has the default beside its front, as it is in the present one.
    wider = treewright.Space().integer("level", 1, 50, default=25).integer("threads", 1, 4, default=2)
    client.change_space("python-front", wider)
    again = treewright.Front(client, "python-front", space, metrics, trials=0).found()
    assert again.default["configuration"] == {"level": 25, "threads": 2} and again.hypervolume == found.hypervolume, again.default
    if importlib.util.find_spec("pandas") is not None:
        assert len(found.to_pandas(dominated=True)) == len(found)
    if importlib.util.find_spec("matplotlib") is not None:
        import matplotlib

        matplotlib.use("agg")
        assert len(plot.front(found).lines[1].get_xdata()) == len(found)


def without_answers(space, objective) -> None:
    """Trials that teach nothing say so."""
    import treewright

    away = treewright.Client("http://127.0.0.1:1", deadline_ms=50, call_deadline_ms=500)
    study = away.study("python-loop", space, minimise={"ms": 1.0, "mb": 0.5})
    ran = []
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        raises(treewright.Unreachable, lambda: treewright.tune(study, objective, trials=3, callbacks=[ran.append]))
    assert len(ran) == 3, ran
    words = [str(each.message) for each in told if each.category is RuntimeWarning]
    assert len(words) == 3 and all("is not learnt from, because" in each for each in words), words


def beyond_a_limit(client) -> None:
    """What is beyond a limit has no cost, not even where its rate is 0, and the loop goes on."""
    import types
    from unittest import mock

    import treewright

    shown = []

    class Bar:
        def __init__(self, **named) -> None: ...
        def update(self) -> None: ...
        def close(self) -> None: ...
        def set_postfix(self, best) -> None:
            shown.append(best)

    space = treewright.Space().choice("size", ["fits", "idle", "huge"], default="fits")
    policy, limits = {"epsilon": 1.0, "confirm_rounds": 0}, {"memory_mb": (None, 2000.0)}
    study = client.study("python-limits", space, maximise={"rate": 1.0}, limits=limits, policy=policy)
    sizes = {"fits": (50.0, 100.0), "idle": (0.0, 3000.0), "huge": (900.0, 3000.0)}
    objective = lambda values: dict(zip(("rate", "memory_mb"), sizes[values["size"]]))
    assert study.beyond(objective({"size": "fits"})) is None and "memory_mb is 3000" in study.beyond(objective({"size": "huge"}))
    ran = []
    with mock.patch.dict(sys.modules, {"tqdm.auto": types.SimpleNamespace(tqdm=Bar)}):
        best = treewright.tune(study, objective, trials=12, callbacks=[ran.append], progress=True)
    assert {one.suggestion["size"]: one.cost for one in ran} == {"fits": 0.02, "idle": None, "huge": None}, ran
    assert all(one.measured == objective(one.suggestion.configuration) for one in ran), ran
    assert len(shown) == 12 and set(shown) <= {None, 50.0}, shown
    assert best.configuration == {"size": "fits"} and abs(best.value - 50) < 1e-9, best


def tables_and_figures(client, study) -> None:
    """What needs packages of others says so where they are not."""
    import treewright
    from treewright import plot

    space = treewright.Space().integer("leaf", 1, 32, default=8)
    mixed = client.study("python-mixed", space, minimise={"ms": 1.0, "mb": 0.5}, maximise={"fps": 1000.0})
    assert mixed.maximised == ["fps"] and study.maximised == []
    assert sorted(plot._unit(mixed).split(" + ")) == ["0.5 mb", "1000 / fps", "ms"], plot._unit(mixed)
    table = study.trials("outcome = OK")
    uses = {
        "pandas": lambda: table.to_pandas(),
        "pyarrow": lambda: table.to_arrow(),
        "matplotlib": lambda: plot.best_so_far(study),
        "tqdm": lambda: treewright.tune(study, lambda values: {"ms": 1, "mb": 1}, trials=1, progress=True),
    }
    for package, use in uses.items():
        if importlib.util.find_spec(package) is None:
            try:
                use()
            except ImportError as problem:
                assert problem.name == package and f"needs the package {package}: pip install 'treewright[" in str(problem), problem
                continue
            raise AssertionError(f"{package} is not there")
        use()
    if importlib.util.find_spec("pyarrow") is not None:
        arrow = table.to_arrow()
        assert arrow.num_rows == len(table) and min(arrow["cost"].to_pylist()) == min(each["cost"] for each in table)
        assert str(arrow.schema.field("create_time").type) == "timestamp[us, tz=UTC]"
    if importlib.util.find_spec("matplotlib") is not None:
        import matplotlib

        matplotlib.use("agg")
        figure = plot.best_so_far(study)
        assert len(figure.patches) == 1, "the answer's interval"
        everything, line, lowered = figure.lines
        assert len(everything.get_xdata()) == len(study.trials("outcome = OK")) and lowered.get_ydata()[-1] == line.get_ydata()[-1]
        assert sorted(line.get_ydata(), reverse=True) == list(line.get_ydata())
        assert set(plot.slice(study, "leaf").lines[0].get_xdata()) == {each["configuration"]["leaf"] for each in study.trials("outcome = OK")}
        ranked = [{"parameter": name, "first_order": share} for name, share in (("leaf", 0.9), ("none", None), ("warps", 0.2))]
        analysis = {"study": "s", "conditions": [{"metrics": [{"name": "ms", "parameters": ranked}]}]}
        assert [bar.get_width() for bar in plot.importances(analysis).patches] == [0.2, 0.9]
        figure = plot._axes(None)
        plot._robust(figure, range(50), [*range(49), 1e6])
        (marked,) = figure.collections
        assert figure.get_ylim()[1] < 60 and marked.get_offsets().tolist() == [[49, figure.get_ylim()[1]]], figure.get_ylim()


def episodes(client) -> None:
    """A loop keeps a trial for its frames, and reports their means."""
    import treewright

    space = treewright.Space().integer("leaf", 1, 32, default=8)
    study = client.study("python-episodes", space, minimise={"ms": 1.0}, indicators={"size": (0.0, 9.0)}, episode_frames=4)
    tuner, trials = study.tuner(), []
    for frame in range(8):
        suggestion = tuner.next({"size": 1.0})
        assert suggestion.source == "daemon", suggestion.problem
        trials.append(suggestion.trial)
        tuner.finish(suggestion, ms=1.0 + frame % 4)
    assert study.episode_frames == 4 and trials == 4 * trials[:1] + 4 * trials[4:5] and trials[0] != trials[4], trials
    unfinished = tuner.next({"size": 1.0})
    raises(treewright.Invalid, lambda: unfinished.report(ms=1.0), "its trial has more frames")
    client.flush(20000)
    assert [trial["measurements"]["ms"] for trial in study.trials("outcome = OK")] == [2.5, 2.5]


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


SHARED = """
import os, sys, threading
import treewright
client = treewright.Client(sys.argv[1], client_id=sys.argv[2], deadline_ms=20000, call_deadline_ms=20000)
space = treewright.Space().integer("leaf", 1, 4000, default=8)
study = client.study("python-shared", space, minimise={"ms": 1.0}, policy={"epsilon": 1.0, "confirm_rounds": 0})
"""


def shared(url: str, name: str, then: str) -> "list[str]":
    """Runs a program of its own on one study, and returns what it says."""
    import subprocess

    return subprocess.run([sys.executable, "-c", SHARED + then, url, name], check=True, stdout=subprocess.PIPE, text=True).stdout.split()


def a_trial_each(url: str) -> None:
    """Each user of a shared study runs trials of its own: threads, tasks, and the children of a fork."""
    threads = """
gate, trials = threading.Barrier(4), []
def work():
    for _ in range(10):
        trial = study.suggest()
        assert trial.source == "daemon", trial.problem
        trials.append(trial.trial)
        gate.wait()
        trial.report(ms=trial["leaf"])
workers = [threading.Thread(target=work) for _ in range(4)]
for each in workers: each.start()
for each in workers: each.join()
client.flush(20000)
print(len(trials), len(set(trials)), client.stats()["acknowledged"])
"""
    assert shared(url, "threads", threads) == ["40", "40", "40"]
    tasks = """
import asyncio, treewright.aio
async def main():
    client = await treewright.aio.connect(sys.argv[1], client_id=sys.argv[2], deadline_ms=20000, call_deadline_ms=20000)
    study = await client.existing_study("python-shared")
    async def one():
        async with study.suggest() as trial:
            await asyncio.sleep(0.01)
            trial.report(ms=trial["leaf"])
            return trial.trial
    trials = await asyncio.gather(*(one() for _ in range(40)))
    await client.flush(20000)
    print(len(set(trials)), client.stats()["acknowledged"])
asyncio.run(main())
"""
    assert shared(url, "tasks", tasks) == ["40", "40"]
    forked = """
import multiprocessing
ours, tuner = study.suggest(), study.tuner()
tuner.finish(tuner.next(), ms=9)
def work(number):
    trials = []
    for _ in range(5):
        with study.suggest() as trial:
            assert trial.source == "daemon", trial.problem
            trials.append(trial.trial)
            trial.report(ms=trial["leaf"])
    last = tuner.next()
    trials.append(last.trial)
    tuner.finish(last, ms=9)
    for end in (lambda: ours.report(ms=1), lambda: ours.failed("x")):
        try:
            end()
        except treewright.Invalid as problem:
            assert "forked" in str(problem) or "already" in str(problem), problem
        else:
            raise AssertionError("a child reported its parent's trial")
    client.flush(20000)
    assert client.stats()["acknowledged"] == 5, client.stats()
    return trials
with multiprocessing.get_context("fork").Pool(4, maxtasksperchild=1) as pool:
    trials = [ours.trial, *(each for part in pool.map(work, range(4), chunksize=1) for each in part)]
ours.report(ms=5)
client.flush(20000)
print(len(trials), len(set(trials)))
"""
    assert shared(url, "forked", forked) == ["25", "25"]


def recognised_after_a_crash(url: str) -> None:
    """Who starts again with as many threads is given the trials that it left."""
    crash = """
trials, gate = [], threading.Barrier(3)
def work():
    trials.append(study.suggest())
    gate.wait()
workers = [threading.Thread(target=work) for _ in range(3)]
for each in workers: each.start()
for each in workers: each.join()
print(*sorted(each.trial for each in trials), flush=True)
os._exit(0)
"""
    import treewright

    left = shared(url, "crashed", crash)
    assert len(set(left)) == 3, left

    client = treewright.Client(url, client_id="crashed", deadline_ms=20000)
    beside = [client.existing_study("python-shared").suggest() for _ in range(3)]
    assert sorted(each.trial for each in beside) == left
    # Two programs of one name that run at the same time are not taken for each other.
    assert not set(shared(url, "crashed", crash)) & set(left)


def helion_cache(url: str) -> None:
    """The cache for Helion, by stand-ins that call it as Helion 1.5 calls its caches."""
    import types

    import treewright

    class Tensor:
        is_cuda, dtype = False, "f4"

        def __init__(self, *shape: int) -> None:
            self.shape = shape

    class AutotuneCacheBase:
        def __init__(self, autotuner, *, autotuner_factory=None) -> None:
            self.autotuner, self.kernel, self.args = autotuner, autotuner.kernel, autotuner.args

        def autotune(self) -> str:
            config = self.get()
            if config is None:
                config = self.autotuner.autotune()
                self.put(config)
            return config

    class FiniteSearch:
        """Times that a kernel with blocks of that size would take; a block larger than the tensor does not compile."""

        benchmarked = 0

        def __init__(self, kernel, args, configs) -> None:
            self.kernel, self.args, self.configs = kernel, args, configs

        def benchmark_batch(self, configs, *, desc: str = "") -> list:
            FiniteSearch.benchmarked += len(configs)
            size = self.args[0].shape[0]
            cost = lambda block: float("inf") if block > size else size / 1e3 * (1 + abs(block - 256) / 256)
            return [types.SimpleNamespace(config=each, perf=cost(int(each))) for each in configs]

        def autotune(self) -> str:
            return min(self.benchmark_batch(self.configs, desc="Benchmarking"), key=lambda result: result.perf).config

    def module(name: str, **parts) -> types.ModuleType:
        made = types.ModuleType(name)
        vars(made).update(parts)
        return made

    cuda = types.SimpleNamespace(is_available=lambda: False)
    stand_ins = [
        module("torch", Tensor=Tensor, cuda=cuda),
        module("helion", __path__=[]),
        module("helion.language"),
        module("helion.autotuner", FiniteSearch=FiniteSearch, __path__=[]),
        module("helion.autotuner.base_cache", AutotuneCacheBase=AutotuneCacheBase, BoundKernelInMemoryCacheKey=dict),
    ]
    before = dict(sys.modules)
    sys.modules.update({each.__name__: each for each in stand_ins})
    try:
        path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "examples", "helion_cache.py")
        example = module("helion_cache")
        with open(path, encoding="utf-8") as file:
            exec(compile(file.read(), path, "exec"), vars(example))
    finally:
        sys.modules.clear()
        sys.modules.update(before)
    client = treewright.Client(url, client_id="helion", deadline_ms=20000, call_deadline_ms=20000)
    tuned = example.tuned_by(client, ["64", "128", "256", "2048"])
    kernel = types.SimpleNamespace(kernel=types.SimpleNamespace(name="add"))
    ask = lambda size: tuned(kernel, [Tensor(size), Tensor(size), 3]).autotune()
    measured = []
    for size in (1024, 4096, 1024, 2048, 3000, 1500):
        assert ask(size) == "256", size
        measured.append(FiniteSearch.benchmarked)
    # Helion measured a few shapes; the one that it had and those between them were answered.
    assert measured[1] == measured[2], measured
    assert measured[-1] <= 4 * 3, measured
    print(f"Helion's cache: {measured[-1] // 4} of 6 shapes were measured")


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
        "Kind of tree": optuna.distributions.CategoricalDistribution(["a", None, 3]),
        "block": optuna.distributions.CategoricalDistribution([16, 32]),
        "compact": optuna.distributions.CategoricalDistribution([True, False]),
    }
    client = treewright.Client(url, client_id="optuna", deadline_ms=20000, call_deadline_ms=20000)
    sampler = TreewrightSampler(search_space, client, "optuna", policy={"epsilon": 1.0, "confirm_rounds": 0})

    def objective(trial: "optuna.Trial") -> float:
        x, n = trial.suggest_float("x", -4, 4), trial.suggest_int("n", 1, 64, log=True)
        step, kind = trial.suggest_float("step", 0, 1, step=0.25), trial.suggest_categorical("Kind of tree", ["a", None, 3])
        block, compact = trial.suggest_categorical("block", [16, 32]), trial.suggest_categorical("compact", [True, False])
        if trial.number == 5:
            trial.report(9.0, 1)
            raise optuna.TrialPruned
        return x * x + abs(n - 8) + step + (0 if kind is None else 1) + block / 16 + compact

    study = optuna.create_study(sampler=sampler)
    study.optimize(objective, n_trials=40)
    client.flush(20000)
    first, best = study.trials[0].value, study.best_value
    assert best <= first, (first, best)
    known = client.existing_study("optuna").best()
    assert known.cost <= first
    # Parameters and categories are called as in Optuna, as far as the daemon takes such names.
    configuration = known.configuration
    assert set(configuration) == {"x", "n", "step", "Kind_of_tree", "block", "compact"}, configuration
    assert configuration["Kind_of_tree"] in ("a", "None", "3") and configuration["block"] in (16, 32), configuration
    assert isinstance(configuration["compact"], bool) and -4 <= configuration["x"] <= 4, configuration
    print(f"Optuna: {first} to {best} in 40 trials")
    at_its_own_point(client, optuna, TreewrightSampler)
    in_parallel(client, optuna, TreewrightSampler)
    in_processes(url, client, optuna)
    maximised(client, optuna, TreewrightSampler)
    infinitely_bad(client, optuna, TreewrightSampler)
    without_daemon(optuna, treewright, TreewrightSampler)
    optunas_own_cases(url)


def at_its_own_point(client, optuna, TreewrightSampler) -> None:
    """What a trial cost is booked on what it ran with, from every source."""
    space = {"x": optuna.distributions.FloatDistribution(-4, 4), "y": optuna.distributions.IntDistribution(0, 9)}
    cost = lambda x, y: (x - 1.5) ** 2 + y + 1
    objective = lambda trial: cost(trial.suggest_float("x", -4, 4), trial.suggest_int("y", 0, 9))
    sampler = TreewrightSampler(space, client, "optuna-own-point", policy={"epsilon": 1.0, "confirm_rounds": 0})
    study = optuna.create_study(sampler=sampler)
    for wanted in ({"x": 1.5, "y": 0}, {"x": -2.0}, {"y": 7}):
        study.enqueue_trial(wanted)
        study.optimize(objective, n_trials=2)
    client.flush(20000)
    for each in study.trials:
        assert each.value == cost(**each.params)
    best = client.existing_study("optuna-own-point").best()
    assert (best.configuration, best.cost) == ({"x": 1.5, "y": 0}, 1.0) and client.stats()["refused"] == 0, best
    # What lies beyond the space that the sampler was given is not learnt from, and the study goes on.
    narrow = {"kind": optuna.distributions.CategoricalDistribution(["a", "b"])}
    sampler = TreewrightSampler(narrow, client, "optuna-beyond", policy={"epsilon": 1.0, "confirm_rounds": 0})
    study = optuna.create_study(sampler=sampler)
    study.enqueue_trial({"kind": "c"})
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        study.optimize(lambda trial: float(len(trial.suggest_categorical("kind", ["a", "b", "c"]))), n_trials=1)
    assert study.trials[0].params == {"kind": "c"} and any("beyond the search space" in str(each.message) for each in told), told


def in_parallel(client, optuna, TreewrightSampler) -> None:
    """With ``n_jobs`` each trial of Optuna is one of the daemon."""
    sampler = TreewrightSampler(
        {"x": optuna.distributions.FloatDistribution(-4, 4)}, client, "optuna-jobs", policy={"epsilon": 1.0, "confirm_rounds": 0}
    )
    study = optuna.create_study(sampler=sampler)
    before = client.stats()["acknowledged"]

    def objective(trial: "optuna.Trial") -> float:
        x = trial.suggest_float("x", -4, 4)
        time.sleep(0.02)
        return x * x

    study.optimize(objective, n_trials=24, n_jobs=4)
    client.flush(20000)
    # A trial that two had shared would have been told twice.
    assert client.stats()["acknowledged"] - before == len(study.trials) == 24 and client.stats()["duplicates"] == 0


OF_A_PROCESS = """
import sys
import optuna, treewright
from treewright.optuna import TreewrightSampler
optuna.logging.set_verbosity(optuna.logging.ERROR)
url, name, path = sys.argv[1:]
client = treewright.Client(url, client_id=f"optuna-{name}", deadline_ms=20000, call_deadline_ms=20000)
space = {"x": optuna.distributions.FloatDistribution(-4, 4)}
sampler = TreewrightSampler(space, client, "optuna-processes", policy={"epsilon": 1.0, "confirm_rounds": 0})
storage = optuna.storages.JournalStorage(optuna.storages.journal.JournalFileBackend(path))
study = optuna.load_study(study_name="shared", storage=storage, sampler=sampler)
study.optimize(lambda trial: trial.suggest_float("x", -4, 4) ** 2, n_trials=8)
client.flush(20000)
stats = client.stats()
print(stats["acknowledged"], stats["duplicates"], stats["fallbacks"])
"""


def in_processes(url: str, client, optuna) -> None:
    """Processes that share a storage of Optuna share the daemon's study: each trial is one of it, and is learnt once at its own point."""
    import subprocess
    import tempfile

    if not hasattr(optuna.storages, "journal"):
        return print("passed by: Optuna in several processes, because this Optuna has no storage in a journal")
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "journal")
        storage = optuna.storages.JournalStorage(optuna.storages.journal.JournalFileBackend(path))
        study = optuna.create_study(study_name="shared", storage=storage)
        command = lambda name: [sys.executable, "-c", OF_A_PROCESS, url, name, path]
        running = [subprocess.Popen(command(name), stdout=subprocess.PIPE, text=True) for name in ("first", "second", "third")]
        said = [each.communicate(timeout=300)[0].split() for each in running]
        assert said == [["8", "0", "0"]] * 3, said
        ran = sorted((each.params["x"], each.value) for each in study.trials)
    learnt = client.existing_study("optuna-processes").trials("state = COMPLETED")
    assert ran == sorted((each["configuration"]["x"], each["cost"]) for each in learnt) and len(ran) == 24, (ran, learnt)


def maximised(client, optuna, TreewrightSampler) -> None:
    sampler = TreewrightSampler(
        {"x": optuna.distributions.FloatDistribution(-4, 4)}, client, "optuna-maximised", policy={"epsilon": 1.0, "confirm_rounds": 0}
    )
    study = optuna.create_study(sampler=sampler, direction="maximize")
    study.optimize(lambda trial: 30 - (trial.suggest_float("x", -4, 4) - 1) ** 2, n_trials=25)
    client.flush(20000)
    assert study.best_value > 29.5, study.best_value
    assert abs(client.existing_study("optuna-maximised").best().configuration["x"] - 1) < 1
    costs = TreewrightSampler({"x": optuna.distributions.FloatDistribution(-4, 4)}, client, "optuna-costs")
    study = optuna.create_study(sampler=costs)
    negative = lambda trial: -1 - trial.suggest_float("x", -4, 4) ** 2
    raises(ValueError, lambda: study.optimize(negative, n_trials=1), 'values="any"')


def infinitely_bad(client, optuna, TreewrightSampler) -> None:
    """Optuna takes infinite values, by which objectives say that a point is of no use; the search goes on."""
    space = {"x": optuna.distributions.IntDistribution(-4, 4)}
    for number, (direction, worst) in enumerate((("minimize", math.inf), ("maximize", -math.inf), ("maximize", -1e308))):
        name = f"optuna-infinite-{number}"
        sampler = TreewrightSampler(space, client, name, policy={"epsilon": 1.0, "confirm_rounds": 0})
        study = optuna.create_study(sampler=sampler, direction=direction)
        study.optimize(lambda trial: worst if trial.suggest_int("x", -4, 4) < 0 else 1.0, n_trials=12)
        client.flush(20000)
        outcomes = {trial["configuration"]["x"]: trial["outcome"] for trial in client.existing_study(name).trials("state = COMPLETED")}
        assert outcomes and all(outcome == ("infeasible" if x < 0 else "ok") for x, outcome in outcomes.items()), outcomes
        assert any(x < 0 for x in outcomes), outcomes


def without_daemon(optuna, treewright, TreewrightSampler) -> None:
    """It says so, and goes on at random instead of with one point."""
    away = treewright.Client("http://127.0.0.1:1", deadline_ms=50, call_deadline_ms=500)
    sampler = TreewrightSampler({"x": optuna.distributions.FloatDistribution(-4, 4)}, away, "optuna-away")
    study = optuna.create_study(sampler=sampler)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        study.optimize(lambda trial: trial.suggest_float("x", -4, 4) ** 2, n_trials=20)
    at_random = [each for each in told if "at random, because no daemon answers" in str(each.message)]
    assert len(at_random) == 20 and sum("is not learnt from" in str(each.message) for each in told) == 20, told
    assert len({trial.params["x"] for trial in study.trials}) == 20


def optunas_own_cases(url: str) -> None:
    if importlib.util.find_spec("pytest") is None or importlib.util.find_spec("optuna.testing.pytest_samplers") is None:
        return print("passed by: Optuna's own test cases, because pytest or this part of Optuna is not installed")
    import subprocess

    cases = os.path.join(os.path.dirname(os.path.abspath(__file__)), "optuna_cases.py")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", cases]
    result = subprocess.run(command, env={**os.environ, "TREEWRIGHT_URL": url}, stdout=subprocess.PIPE, text=True)
    assert result.returncode == 0, result.stdout
    print(f"Optuna's own cases: {result.stdout.strip().splitlines()[-1]}")


if __name__ == "__main__":
    os.environ["TREEWRIGHT_URL"] = sys.argv[1]
    documentation()
    stubs()
    trials(sys.argv[1])
    steering(sys.argv[1])
    frozen(sys.argv[1])
    only_its_own_study(sys.argv[1])
    across_a_change_of_the_space(sys.argv[1])
    leases(sys.argv[1])
    loop(sys.argv[1])
    fronts(sys.argv[1])
    threads(sys.argv[1])
    a_trial_each(sys.argv[1])
    recognised_after_a_crash(sys.argv[1])
    helion_cache(sys.argv[1])
    optuna_sampler(sys.argv[1])
    print("ok")
