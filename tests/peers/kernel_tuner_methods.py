"""Strategies of Kernel Tuner, called as its own `tune_kernel` calls them, without a GPU."""

import random

import numpy

from interface import Driver

# Most repeats in succession of what a strategy has measured already, before it begins anew.
REPEATS_MAX = 1000


class Runner:
    """What Kernel Tuner's strategies take for a device. As in its simulations, a repeat is answered by the first measurement
    and costs no trial, and what fails is told as a failure at run time."""

    def __init__(self, method):
        self.method, self.known, self.repeats = method, {}, 0

    def add_strategy_time(self, seconds):
        pass

    def run(self, chosen, tuning):
        return [None if tuning.budget.is_done() else self._result(tuple(values), tuning.budget) for values in chosen]

    def _result(self, values, budget):
        from kernel_tuner.util import RuntimeFailedConfig, StopCriterionReached

        configuration = {each.name: value for each, value in zip(self.method.parameters, values)}
        self.repeats = self.repeats + 1 if values in self.known else 0
        if self.repeats > REPEATS_MAX:
            raise StopCriterionReached("it repeats itself")
        if values not in self.known:
            self.known[values] = self.method.measured(configuration)
            budget.add_evaluations(1)
        cost = self.known[values]
        return {**configuration, **({"__error__": RuntimeFailedConfig()} if cost is None else {"time": cost})}


class AdaptiveTabuGreyWolf(Driver):
    """The strategy in its own search space, which holds what the constraints allow. The default is the first configuration
    that it samples: some strategies take no other start. One that ends before the budget does begins anew. All have their
    default settings; a `budget` of 80 in place of 5000 did not help on `grid-told` and `kernel-told`."""

    takes_constraints = True
    strategy = "adaptive_tabu_greywolf"

    @classmethod
    def takes(cls, problem):
        """It has lists of values only, and no conditions."""
        return all(each.kind in ("choice", "switch") and not each.active_if for each in problem.parameters)

    def _space(self):
        from kernel_tuner.searchspace import Searchspace

        values = {each.name: list(each.values) or [False, True] for each in self.parameters}
        space = Searchspace(values, list(self.constraints), max_threads=2**31)
        sample, default = space.get_random_sample, tuple(self.default().values())

        def first(count):
            space.get_random_sample = sample
            return [default] + [each for each in sample(count) if each != default][:count - 1]

        space.get_random_sample = first
        return space

    def search(self):
        from kernel_tuner.interface import Options, strategy_map
        from kernel_tuner.util import TuningBudget

        random.seed(self.seed)
        numpy.random.seed(self.seed)
        space, runner = self._space(), Runner(self)
        while len(runner.known) < space.size:
            tuning = Options(strategy_options=Options(max_fevals=self.budget), objective=["time"],
                             objective_higher_is_better=[False], verbose=False, budget=TuningBudget(max_fevals=self.budget))
            strategy_map[self.strategy].tune(space, runner, tuning)
        while True:  # everything is known
            self.measured(self.recommend())


class HybridVndx(AdaptiveTabuGreyWolf):
    """The other strategy that its authors had designed by a language model (arXiv:2510.17899)."""

    strategy = "hybrid_vndx"


class GreedyIls(AdaptiveTabuGreyWolf):
    """Its iterated local search."""

    strategy = "greedy_ils"
