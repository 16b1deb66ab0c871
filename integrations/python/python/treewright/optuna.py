"""A sampler for Optuna whose trials come from a Treewright daemon, and so from every process and machine that works on the study.

    import optuna, treewright
    from treewright.optuna import TreewrightSampler

    search_space = {"x": optuna.distributions.FloatDistribution(-10, 10)}
    sampler = TreewrightSampler(search_space, treewright.Client(deadline_ms=5000), "my-study")
    study = optuna.create_study(sampler=sampler)
    study.optimize(objective, n_trials=50)

Like the samplers of OptunaHub it takes the whole search space at the start, since a tuning study is defined once. It minimises one
value, which must not be negative (a cost, as the daemon keeps them); each trial that Optuna completes, prunes or fails is reported as that.
Pruned trials are told as stopped at their last intermediate value, failed ones as failures that say nothing about their parameters.
"""

from typing import Any, Mapping, Optional, Sequence

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.samplers import BaseSampler, RandomSampler
from optuna.trial import FrozenTrial, TrialState

from ._native import Client, Space, Suggestion

__all__ = ["TreewrightSampler"]

METRIC = "value"


def _middle(low: float, high: float, log: bool) -> float:
    return (low * high) ** 0.5 if log else (low + high) / 2


class _Choice:
    """Distributions with steps become lists of choices; so are categories by their number, since they may be anything."""

    def __init__(self, values: Sequence[Any]) -> None:
        self.values = list(values)

    def add(self, space: Space, name: str, default: int) -> None:
        space.integer(name, 0, len(self.values) - 1, default=default)

    def read(self, value: Any) -> Any:
        return self.values[value]


class _Category(_Choice):
    def add(self, space: Space, name: str, default: int) -> None:
        space.choice(name, [str(each) for each in range(len(self.values))], default=str(default))

    def read(self, value: Any) -> Any:
        return self.values[int(value)]


class TreewrightSampler(BaseSampler):
    """Samples ``search_space`` by the study ``study_id`` of a daemon. ``indicators`` describe the input, as names and numbers."""

    def __init__(
        self,
        search_space: Mapping[str, BaseDistribution],
        client: Client,
        study_id: str,
        *,
        indicators: Optional[Mapping[str, float]] = None,
        indicator_ranges: Optional[Mapping[str, tuple]] = None,
        policy: Optional[Mapping[str, Any]] = None,
        seed: int = 0,
    ) -> None:
        self._search_space = dict(search_space)
        self._names = {f"p{index}": name for index, name in enumerate(self._search_space)}
        self._readers: "dict[str, _Choice]" = {}
        self._indicators = dict(indicators or {})
        self._open: "dict[int, Suggestion]" = {}
        self._rest = RandomSampler(seed=seed)
        space = Space()
        for short, name in self._names.items():
            self._add(space, short, self._search_space[name])
        ranges = dict(indicator_ranges or {name: (0.0, max(2 * abs(value), 1.0)) for name, value in self._indicators.items()})
        self._study = client.study(
            study_id, space, minimise={METRIC: 1.0}, indicators=ranges, policy=dict(policy or {}), seed=seed
        )

    def _add(self, space: Space, short: str, one: BaseDistribution) -> None:
        if isinstance(one, CategoricalDistribution):
            self._readers[short] = _Category(one.choices)
        elif one.step is not None and not (isinstance(one, IntDistribution) and one.step == 1):
            count = int(round((one.high - one.low) / one.step)) + 1
            self._readers[short] = _Choice([one.low + index * one.step for index in range(count)])
        elif isinstance(one, IntDistribution):
            middle = int(_middle(one.low, one.high, one.log))
            return space.integer(short, one.low, one.high, default=max(one.low, middle), log=one.log) and None
        elif isinstance(one, FloatDistribution):
            return space.float(short, one.low, one.high, default=_middle(one.low, one.high, one.log), log=one.log) and None
        else:
            raise TypeError(f"{one} is no distribution that this sampler knows")
        reader = self._readers[short]
        reader.add(space, short, (len(reader.values) - 1) // 2)

    def infer_relative_search_space(self, study: "optuna.Study", trial: FrozenTrial) -> "dict[str, BaseDistribution]":
        return self._search_space

    def sample_relative(
        self, study: "optuna.Study", trial: FrozenTrial, search_space: "dict[str, BaseDistribution]"
    ) -> "dict[str, Any]":
        if len(study.directions) != 1 or study.direction != optuna.study.StudyDirection.MINIMIZE:
            raise ValueError("TreewrightSampler minimises one value")
        suggestion = self._study.suggest(self._indicators)
        self._open[trial.number] = suggestion
        values = suggestion.configuration
        return {
            name: self._readers[short].read(values[short]) if short in self._readers else values[short]
            for short, name in self._names.items()
        }

    def sample_independent(
        self, study: "optuna.Study", trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """A parameter that is not in the search space: at random, and nothing is learnt about it."""
        return self._rest.sample_independent(study, trial, param_name, param_distribution)

    def after_trial(
        self, study: "optuna.Study", trial: FrozenTrial, state: TrialState, values: Optional[Sequence[float]]
    ) -> None:
        suggestion = self._open.pop(trial.number, None)
        if suggestion is None:
            return
        if state == TrialState.COMPLETE and values:
            if values[0] < 0:
                suggestion.abandon()
                raise ValueError(f"{values[0]} is negative; TreewrightSampler takes costs of 0 and above")
            suggestion.report({METRIC: values[0]})
        elif state == TrialState.PRUNED and trial.intermediate_values:
            suggestion.aborted(max(0.0, trial.intermediate_values[max(trial.intermediate_values)]))
        elif state == TrialState.FAIL:
            suggestion.failed("the objective raised an error")
        else:
            suggestion.abandon()
