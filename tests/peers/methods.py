"""Optimisers behind one interface: `ask()` gives a configuration, `tell(configuration, cost)` takes what came of it
(None where it could not be run), `recommend()` says what would be used now.

Every peer is used as its own documentation shows it, with its default settings and the seed given. All are treated alike:
the first trial of each is the default configuration, which counts like every other; who is able to say what it would use by
a model of its own is asked for that (`recommends`), and all others are taken at the best they measured; who has a word for
noise is told of it. All know the order of a choice of numbers, and all that take constraints are told the same ones; who
takes none is not asked where there are some (`takes`). Where a peer has no word for "cannot be run", it is told a cost twice
as bad as the worst it has seen, which is the usual advice.
"""

import json
import math
import os
import pathlib
import subprocess
import warnings

import numpy

from interface import Driver, Method, from_unit, is_ordered, to_unit
from kernel_tuner_methods import AdaptiveTabuGreyWolf, GreedyIls, HybridVndx
from problems import active, broken

# Most proposals in succession that break constraints, and how many of them a sampler does not learn from.
REFUSALS_MAX, REFUSALS_UNLEARNT = 1000, 50
ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
ASK_TELL = pathlib.Path(os.environ.get("ASK_TELL", ROOT / "target" / "release" / "examples" / "ask_tell"))


class Treewright(Method):
    """The tuner itself, driven through `examples/ask_tell`: one client in one state that always explores. It measures the
    default first by itself."""

    search = "auto"
    program = ASK_TELL
    recommends = "own model"
    takes_constraints = True

    def __init__(self, parameters, constraints, budget, seed):
        super().__init__(parameters, constraints, budget, seed)
        self.process = subprocess.Popen([str(self.program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.nanoseconds = 0
        study = {
            "display_name": "", "state_tolerance": 0.01, "seed": seed,
            "space": {"parameters": [self._parameter(each) for each in parameters],
                      "constraints": [{"expression": each} for each in constraints]},
            "indicators": [],
            "objective": [{"metric": "cost", "weight": 1.0}],
            "policy": {"epsilon": 1.0, "search": self.search, "predictor": "nearest_neighbour",
                       "trials_per_state": budget, "replicates": 1, "lease_s": 60, "pinned": None},
        }
        self._call({"open": study})

    def _value(self, value):
        if isinstance(value, bool):
            return {"boolean": value}
        if isinstance(value, int):
            return {"integer": value}
        return {"float": value} if isinstance(value, float) else {"text": value}

    def _parameter(self, parameter):
        scale = "log" if parameter.log else "linear"
        domain = {
            "switch": "boolean",
            "choice": {"categorical": {"values": [self._value(value) for value in parameter.values]}},
            "integer": {"integer": {"min": int(parameter.low), "max": int(parameter.high), "scale": scale}},
            "float": {"float": {"min": parameter.low, "max": parameter.high, "scale": scale}},
        }[parameter.kind]
        condition = None
        if parameter.active_if:
            condition = {"parameter": parameter.active_if[0], "any_of": [self._value(each) for each in parameter.active_if[1]]}
        return {"name": parameter.name, "domain": domain, "default": self._value(parameter.default), "active_if": condition}

    def _call(self, request):
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        answer = json.loads(self.process.stdout.readline())
        if "error" in answer:
            raise RuntimeError(answer["error"])
        self.nanoseconds += answer["nanoseconds"]
        return answer

    def _filled(self, configuration):
        return {**self.default(), **configuration}

    def ask(self):
        answer = self._call({"ask": {}})
        self.trial = answer["trial"]
        configuration = self._filled(answer["configuration"])
        if not self.told and configuration != self.default():
            raise RuntimeError(f"the first trial is not the default but {configuration}")
        return configuration

    def tell(self, configuration, cost):
        super().tell(configuration, cost)
        self._call({"tell": {"trial": self.trial, "cost": cost}})

    def recommend(self):
        best = self._call({"best": {}})["configuration"]
        return self.default() if best is None else self._filled(best)

    def close(self):
        self.process.stdin.close()
        self.process.wait()


class TreewrightNelderMead(Treewright):
    search = "nelder_mead"


class TreewrightModel(Treewright):
    search = "model"


class TreewrightBestMeasured(Treewright):
    """The same search, taken at the best that it measured, as most peers are: shows what its recommendation adds or costs."""

    recommends = "best measured"

    def recommend(self):
        return Method.recommend(self)


class Random(Method):
    """Points among those that constraints allow."""

    takes_constraints = True

    def __init__(self, parameters, constraints, budget, seed):
        super().__init__(parameters, constraints, budget, seed)
        self.random = numpy.random.default_rng([1, seed])

    def propose(self):
        while True:
            configuration = {each.name: from_unit(each, self.random.random()) for each in self.parameters}
            if not broken(self.constraints, configuration):
                return configuration


class ScipySobol(Method):
    """The points of a scrambled Sobol sequence."""

    def __init__(self, parameters, constraints, budget, seed):
        from scipy.stats import qmc

        super().__init__(parameters, constraints, budget, seed)
        sequence = qmc.Sobol(len(parameters), seed=seed)
        self.points = iter(sequence.random_base2(math.ceil(math.log2(budget))))

    def propose(self):
        return {each.name: from_unit(each, u) for each, u in zip(self.parameters, next(self.points))}


class ScipyNelderMead(Driver):
    """The default and a Latin hypercube, together a quarter of the budget, then scipy's Nelder-Mead from its best point."""

    method = "Nelder-Mead"
    options = {"initial_simplex": None, "xatol": 1e-9, "fatol": 0.0, "maxfev": 10_000}

    def _cost(self, x):
        return self.penalty(self.measured({each.name: from_unit(each, u) for each, u in zip(self.parameters, x)}))

    def search(self):
        from scipy.optimize import minimize
        from scipy.stats import qmc

        dimension = len(self.parameters)
        design = qmc.LatinHypercube(dimension, seed=self.seed).random(max(self.budget // 4, 2))
        design[0] = [to_unit(each, each.default) for each in self.parameters]
        costs = [self._cost(x) for x in design]
        start = design[int(numpy.argmin(costs))]
        seed = self.seed
        while True:
            minimize(self._cost, start, method=self.method, bounds=[(0.0, 1.0)] * dimension, options=self.options)
            seed += 1
            start = numpy.random.default_rng(seed).random(dimension)


class ScipyPowell(ScipyNelderMead):
    """The same with Powell's method, which searches along one axis after the other before it learns directions."""

    method = "Powell"
    options = {"xtol": 1e-3, "ftol": 0.0, "maxfev": 10_000}


class Optuna(Method):
    """The tree-structured Parzen estimator; from version 5 on it is multivariate by default. Numbers of a choice are told as
    places, so that it knows their order. What breaks a constraint costs no trial and is proposed anew. It is told by
    `set_constraint` only where the sampler proposes nothing else: always told, it found less in 80 trials on `grid-told` and
    `kernel-told`."""

    takes_constraints = True

    def sampler(self):
        import optuna

        return optuna.samplers.TPESampler(seed=self.seed)

    def __init__(self, parameters, constraints, budget, seed):
        import optuna

        super().__init__(parameters, constraints, budget, seed)
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        warnings.simplefilter("ignore")
        self.study = optuna.create_study(sampler=self.sampler())
        on = active(parameters, self.default())
        place = lambda each: each.values.index(each.default) if is_ordered(each) else each.default
        self.study.enqueue_trial({each.name: place(each) for each in parameters if each.name in on})

    def ask(self):
        import optuna

        for refusals in range(REFUSALS_MAX):
            configuration = self._suggested()
            refused = broken(self.constraints, configuration)
            if not refused:
                return configuration
            is_learnt = refusals >= REFUSALS_UNLEARNT
            for each in refused if is_learnt else []:
                self.trial.set_constraint(each, 1.0)
            self.study.tell(self.trial, state=optuna.trial.TrialState.PRUNED if is_learnt else optuna.trial.TrialState.FAIL)
        raise RuntimeError(f"{REFUSALS_MAX} configurations in succession break constraints")

    def _suggested(self):
        self.trial = self.study.ask()
        configuration, on = self.default(), set()
        for each in self.parameters:
            condition = each.active_if
            if condition and not (condition[0] in on and configuration[condition[0]] in condition[1]):
                continue
            on.add(each.name)
            if each.kind == "float":
                value = self.trial.suggest_float(each.name, each.low, each.high, log=each.log)
            elif each.kind == "integer":
                value = self.trial.suggest_int(each.name, int(each.low), int(each.high), log=each.log)
            elif is_ordered(each):
                value = each.values[self.trial.suggest_int(each.name, 0, len(each.values) - 1)]
            elif each.kind == "choice":
                value = self.trial.suggest_categorical(each.name, list(each.values))
            else:
                value = self.trial.suggest_categorical(each.name, [False, True])
            configuration[each.name] = value
        return configuration

    def tell(self, configuration, cost):
        import optuna

        super().tell(configuration, cost)
        if cost is None:
            self.study.tell(self.trial, state=optuna.trial.TrialState.FAIL)
        else:
            self.study.tell(self.trial, cost)


class OptunaLimited(Optuna):
    """The same, which hears of each run by how much it exceeds the limits: more than all others hear, who only hear that it
    cannot be used. Such a run is told as pruned, since failed trials are not learnt from."""

    @classmethod
    def takes(cls, problem):
        return bool(problem.limits)

    def exceeds(self, excess):
        for name, amount in excess.items():
            self.trial.set_constraint(name, amount)

    def tell(self, configuration, cost):
        import optuna

        if cost is not None:
            return super().tell(configuration, cost)
        Method.tell(self, configuration, cost)
        self.study.tell(self.trial, state=optuna.trial.TrialState.PRUNED)


class OptunaIndependent(Optuna):
    """Each parameter by itself, as the sampler was before Optuna 5 made the multivariate one its default."""

    def sampler(self):
        import optuna

        return optuna.samplers.TPESampler(seed=self.seed, multivariate=False)


class OptunaCmaEs(Optuna):
    def sampler(self):
        import optuna

        return optuna.samplers.CmaEsSampler(seed=self.seed)


class OptunaGp(Optuna):
    """Its Gaussian process takes costs for noisy unless it is told otherwise."""

    def sampler(self):
        import optuna

        return optuna.samplers.GPSampler(seed=self.seed)


class Nevergrad(Method):
    optimizer = "NGOpt"
    recommends = "own model"

    def __init__(self, parameters, constraints, budget, seed):
        import nevergrad as ng

        super().__init__(parameters, constraints, budget, seed)
        warnings.simplefilter("ignore")

        def one(each):
            if each.kind == "switch":
                return ng.p.Choice([False, True])
            if each.kind == "choice":
                return (ng.p.TransitionChoice if is_ordered(each) else ng.p.Choice)(list(each.values))
            if each.log:
                scalar = ng.p.Log(lower=each.low, upper=each.high)
            else:
                scalar = ng.p.Scalar(lower=each.low, upper=each.high)
            return scalar.set_integer_casting() if each.kind == "integer" else scalar

        space = ng.p.Dict(**{each.name: one(each) for each in parameters})
        space.random_state.seed(seed)
        self.inner = ng.optimizers.registry[self.optimizer](parametrization=space, budget=budget)
        self.inner.suggest(self.default())

    def ask(self):
        self.candidate = self.inner.ask()
        return {**self.default(), **self.candidate.value}

    def tell(self, configuration, cost):
        super().tell(configuration, cost)
        self.inner.tell(self.candidate, self.penalty(cost))

    def recommend(self):
        found = self.inner.provide_recommendation()
        configuration = self.default() if found is None else {**self.default(), **found.value}
        # Its own recommendation averages noise away, but knows nothing of what cannot be run.
        failed = any(cost is None and told == configuration for told, cost in self.told)
        return super().recommend() if failed else configuration


class NevergradCma(Nevergrad):
    optimizer = "CMA"


class Smac(Method):
    """SMAC3's hyperparameter optimisation facade: random forest, log expected improvement. It is told that costs are noisy:
    it measures promising configurations again, and its incumbent is the best by the mean."""

    recommends = "mean of repeats"

    def __init__(self, parameters, constraints, budget, seed):
        import logging
        import tempfile

        from ConfigSpace import Categorical, ConfigurationSpace, EqualsCondition, Float, InCondition, Integer
        from smac import HyperparameterOptimizationFacade as Facade
        from smac import Scenario

        super().__init__(parameters, constraints, budget, seed)
        logging.disable(logging.WARNING)
        warnings.simplefilter("ignore")
        space = ConfigurationSpace(seed=seed)
        made = {}
        for each in parameters:
            if each.kind == "float":
                made[each.name] = Float(each.name, (each.low, each.high), log=each.log, default=each.default)
            elif each.kind == "integer":
                made[each.name] = Integer(each.name, (int(each.low), int(each.high)), log=each.log, default=each.default)
            elif each.kind == "choice":
                made[each.name] = Categorical(each.name, list(each.values), default=each.default, ordered=is_ordered(each))
            else:
                made[each.name] = Categorical(each.name, [False, True], default=bool(each.default))
        space.add(list(made.values()))
        for each in parameters:
            if each.active_if:
                name, values = each.active_if
                condition = (EqualsCondition(made[each.name], made[name], values[0]) if len(values) == 1
                             else InCondition(made[each.name], made[name], list(values)))
                space.add(condition)
        self.folder = tempfile.TemporaryDirectory()
        scenario = Scenario(space, n_trials=budget, seed=seed, deterministic=False, output_directory=pathlib.Path(self.folder.name))
        self.space = space
        self.inner = Facade(scenario, lambda configuration, seed=0: 0.0, overwrite=True, logging_level=40)

    def _plain(self, configuration):
        values = {name: value.item() if hasattr(value, "item") else value for name, value in dict(configuration).items()}
        return {**self.default(), **values}

    def ask(self):
        from smac.runhistory.dataclasses import TrialInfo

        if self.told:
            self.info = self.inner.ask()
        else:
            # What is told before the first question is a warm start; its seed becomes one of those that it repeats.
            self.info = TrialInfo(self.space.get_default_configuration(), seed=0)
        return self._plain(self.info.config)

    def tell(self, configuration, cost):
        from smac.runhistory.dataclasses import TrialValue
        from smac.runhistory.enumerations import StatusType

        super().tell(configuration, cost)
        status = StatusType.CRASHED if cost is None else StatusType.SUCCESS
        self.inner.tell(self.info, TrialValue(cost=self.penalty(cost), status=status))

    def recommend(self):
        incumbents = self.inner.intensifier.get_incumbents()
        return self._plain(incumbents[0]) if incumbents else self.default()

    def close(self):
        self.folder.cleanup()


METHODS = {
    "treewright": Treewright,
    "treewright-nelder-mead": TreewrightNelderMead,
    "treewright-model": TreewrightModel,
    "treewright-best-measured": TreewrightBestMeasured,
    "random": Random,
    "scipy-sobol": ScipySobol,
    "scipy-lhs-nm": ScipyNelderMead,
    "scipy-lhs-powell": ScipyPowell,
    "optuna-tpe": Optuna,
    "optuna-tpe-limited": OptunaLimited,
    "optuna-tpe-independent": OptunaIndependent,
    "optuna-cma": OptunaCmaEs,
    "optuna-gp": OptunaGp,
    "nevergrad-ngopt": Nevergrad,
    "nevergrad-cma": NevergradCma,
    "smac-forest": Smac,
    "kernel-tuner-greywolf": AdaptiveTabuGreyWolf,
    "kernel-tuner-vndx": HybridVndx,
    "kernel-tuner-ils": GreedyIls,
}

__all__ = ["METHODS", "active"]
