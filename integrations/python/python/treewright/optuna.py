"""A sampler for Optuna whose trials come from a Treewright daemon, and so from every process and machine that works on the study.

    import optuna, treewright
    from treewright.optuna import TreewrightSampler

    search_space = {"x": optuna.distributions.FloatDistribution(-10, 10)}
    sampler = TreewrightSampler(search_space, treewright.Client(deadline_ms=5000), "my-study")
    study = optuna.create_study(sampler=sampler)
    study.optimize(objective, n_trials=50, n_jobs=4)

Like the samplers of OptunaHub it takes the search space at the start, since a tuning study is defined once. With ``None`` in its place the space is
what all completed trials have in common, as for Optuna's own samplers; the first trial is then random, and each space that is met is a
study of its own, called ``my-study-`` and a number.

One value is minimised or maximised. Minimised values are the daemon's costs and must not be negative; ``values="any"`` takes values of any sign,
and is how maximised ones are taken: the daemon then minimises ``s + sqrt(s * s + 1)`` with ``s`` the value, or minus the value.

A trial that ran with other parameters than the daemon wanted (``study.enqueue_trial``, ``PartialFixedSampler``) is recorded at its own
point. While no daemon answers, parameters are drawn at random, and each such trial warns.

Each trial that Optuna completes, prunes or fails is reported as that: pruned trials as stopped at their last intermediate value, failed ones as failures
that say nothing about their parameters. A value that is infinitely bad, or too bad to be a number, says that its parameters cannot be used.
"""

import hashlib
import math
import re
import threading
import warnings
from typing import Any, Mapping, Optional, Sequence, Union

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.samplers import BaseSampler, RandomSampler
from optuna.search_space import IntersectionSearchSpace
from optuna.trial import FrozenTrial, TrialState

from ._native import Client, Refused, Space, Study, Suggestion, Unreachable

__all__ = ["TreewrightSampler"]

METRIC = "value"
# Most values of a choice, and most characters of a name and of a text, that a study may have.
CHOICES_MAX, NAME_MAX, TEXT_MAX = 64, 64, 256


def _middle(low: float, high: float, log: bool) -> float:
    return (low * high) ** 0.5 if log else (low + high) / 2


class _Range:
    """A range of numbers, as it is."""

    def __init__(self, one: Union[FloatDistribution, IntDistribution]) -> None:
        self._one = one

    def add(self, space: Space, name: str) -> None:
        one = self._one
        middle = _middle(one.low, one.high, one.log)
        if isinstance(one, IntDistribution):
            space.integer(name, one.low, one.high, default=min(max(one.low, int(middle)), one.high), log=one.log)
        else:
            space.float(name, one.low, one.high, default=min(max(one.low, middle), one.high), log=one.log)

    def read(self, value: Any) -> Any:
        return min(max(value, self._one.low), self._one.high)

    def write(self, value: Any) -> Any:
        return int(value) if isinstance(self._one, IntDistribution) else float(value)


class _Steps:
    """A grid of numbers, by the number of the step."""

    def __init__(self, one: Union[FloatDistribution, IntDistribution]) -> None:
        self._one = one
        self._last = int(round((one.high - one.low) / one.step))

    def add(self, space: Space, name: str) -> None:
        space.integer(name, 0, self._last, default=self._last // 2)

    def read(self, value: Any) -> Any:
        return min(self._one.low + value * self._one.step, self._one.high)

    def write(self, value: Any) -> Any:
        return int(round((value - self._one.low) / self._one.step))


class _Choice:
    """Categories by their own values where a study can hold them: words, numbers of one kind, true and false; else by what they look like."""

    def __init__(self, one: CategoricalDistribution) -> None:
        self._one = one
        self._held = self._holdable(list(one.choices))

    @staticmethod
    def _holdable(choices: "list[Any]") -> "list[Any]":
        kinds = {type(each) for each in choices}
        fits = len(choices) <= CHOICES_MAX
        if kinds == {bool} and len(choices) == 2:
            return choices
        if fits and (kinds == {int} or (kinds == {float} and all(map(math.isfinite, choices)))):
            return choices
        words = [str(each) for each in choices]
        if fits and len(set(words)) == len(words) and all(0 < len(word) <= TEXT_MAX and word.isprintable() for word in words):
            return words
        return list(range(len(choices)))

    def add(self, space: Space, name: str) -> None:
        held, middle = self._held, self._held[(len(self._held) - 1) // 2]
        if isinstance(middle, bool):
            space.boolean(name, default=middle)
        elif len(held) > CHOICES_MAX:
            space.integer(name, 0, len(held) - 1, default=middle)
        else:
            space.choice(name, held, default=middle)

    def read(self, value: Any) -> Any:
        return self._one.choices[self._held.index(value)]

    def write(self, value: Any) -> Any:
        return self._held[int(self._one.to_internal_repr(value))]


def _carrier(one: BaseDistribution) -> "Union[_Range, _Steps, _Choice]":
    if isinstance(one, CategoricalDistribution):
        return _Choice(one)
    if not isinstance(one, (FloatDistribution, IntDistribution)):
        raise TypeError(f"{one} is no distribution that this sampler knows")
    return _Range(one) if one.step is None or (isinstance(one, IntDistribution) and one.step == 1) else _Steps(one)


def _names(wanted: "list[str]") -> "dict[str, str]":
    """Parameters are called as in Optuna, as far as the daemon's rule for names allows it."""
    names: "dict[str, str]" = {}
    for name in wanted:
        # Letters and digits of any script.
        plain = re.sub(r"[^\w.-]", "_", name)
        plain = (plain if re.match(r"[^\W\d]", plain) else f"p_{plain}")[:NAME_MAX]
        number, unique = 1, plain
        while unique in names.values():
            number += 1
            unique = f"{plain[: NAME_MAX - 8]}_{number}"
        names[name] = unique
    return names


class _Bound:
    """A study of the daemon over one search space."""

    def __init__(self, client: Client, study_id: str, search_space: Mapping[str, BaseDistribution], **definition: Any) -> None:
        self.distributions = {name: one for name, one in search_space.items() if not one.single()}
        self.names = _names(list(self.distributions))
        self._carriers = {name: _carrier(one) for name, one in self.distributions.items()}
        space = Space()
        for name, carrier in self._carriers.items():
            carrier.add(space, self.names[name])
        self.study: Study = client.study(study_id, space, minimise={METRIC: 1.0}, **definition)

    def read(self, configuration: Mapping[str, Any]) -> "dict[str, Any]":
        return {name: carrier.read(configuration[self.names[name]]) for name, carrier in self._carriers.items()}

    def write(self, params: Mapping[str, Any]) -> "dict[str, Any]":
        return {self.names[name]: carrier.write(params[name]) for name, carrier in self._carriers.items()}

    def holds(self, params: Mapping[str, Any]) -> bool:
        """Whether what the objective asked for lies in the space."""
        try:
            return all(
                one._contains(one.to_internal_repr(params[name])) for name, one in self.distributions.items() if name in params
            )
        except ValueError:
            # It is none of the choices, or no number.
            return False

    def middle(self) -> "dict[str, Any]":
        """Values for parameters that nobody asked for."""
        ends = lambda one: one.choices[0] if isinstance(one, CategoricalDistribution) else one.low
        return {name: ends(one) for name, one in self.distributions.items()}


class TreewrightSampler(BaseSampler):
    """Samples ``search_space`` by the study ``study_id`` of a daemon; see the module.

    ``indicators`` describe the input, as names and numbers; what is learnt for one is used for those near it. ``indicator_ranges`` and
    ``policy`` are those of ``Client.study``. ``values`` is ``"costs"`` (not negative, minimised) or ``"any"``; by default the
    first for studies that minimise and the second for those that maximise. May be shared between threads and used in forked processes.
    """

    def __init__(
        self,
        search_space: Optional[Mapping[str, BaseDistribution]],
        client: Client,
        study_id: str,
        *,
        indicators: Optional[Mapping[str, float]] = None,
        indicator_ranges: Optional[Mapping[str, tuple]] = None,
        policy: Optional[Mapping[str, Any]] = None,
        values: Optional[str] = None,
        seed: int = 0,
    ) -> None:
        if values not in (None, "costs", "any"):
            raise ValueError(f'values={values!r} is none of "costs" and "any"')
        self._client, self._study_id, self._values = client, study_id, values
        self._indicators = dict(indicators or {})
        ranges = dict(indicator_ranges or {name: (0.0, max(2 * abs(value), 1.0)) for name, value in self._indicators.items()})
        self._definition = {"indicators": ranges, "policy": dict(policy or {}), "seed": seed}
        self._search_space = None if search_space is None else dict(search_space)
        self._common = IntersectionSearchSpace()
        self._rest = RandomSampler(seed=seed)
        self._lock = threading.Lock()
        self._bound: "dict[str, _Bound]" = {}
        # Of trials that run: the study they are of, and the suggestion unless they are without one.
        self._open: "dict[tuple, tuple[_Bound, Optional[Suggestion]]]" = {}
        if self._search_space is not None:
            self._bind(self._search_space)

    def _bind(self, search_space: Mapping[str, BaseDistribution]) -> _Bound:
        key = repr(sorted(search_space.items(), key=lambda each: each[0]))
        with self._lock:
            if key not in self._bound:
                given = self._search_space is not None
                study_id = self._study_id if given else f"{self._study_id}-{hashlib.sha256(key.encode()).hexdigest()[:8]}"
                self._bound[key] = _Bound(self._client, study_id, search_space, **self._definition)
            return self._bound[key]

    def _cost(self, study: "optuna.Study", value: float) -> float:
        maximises = study.direction == optuna.study.StudyDirection.MAXIMIZE
        if (self._values or ("any" if maximises else "costs")) == "any":
            signed = -value if maximises else value
            # Of two forms of the same the one that does not cancel.
            root = math.hypot(signed, 1.0)
            return signed + root if signed >= 0 else 1.0 / (root - signed)
        if maximises:
            raise ValueError('costs are minimised; use values="any" to maximise')
        if value < 0:
            raise ValueError(f'{value} is negative, which no cost is; use values="any" for values of any sign')
        return value

    @staticmethod
    def _check(study: "optuna.Study") -> None:
        if len(study.directions) != 1:
            raise ValueError("TreewrightSampler is for studies of one objective")

    def reseed_rng(self) -> None:
        self._rest.reseed_rng()

    def infer_relative_search_space(self, study: "optuna.Study", trial: FrozenTrial) -> "dict[str, BaseDistribution]":
        if self._search_space is not None:
            return self._search_space
        with self._lock:
            common = self._common.calculate(study)
        return {name: one for name, one in common.items() if not one.single()}

    def sample_relative(
        self, study: "optuna.Study", trial: FrozenTrial, search_space: "dict[str, BaseDistribution]"
    ) -> "dict[str, Any]":
        self._check(study)
        fixed = {name: one.high if hasattr(one, "high") else one.choices[0] for name, one in search_space.items() if one.single()}
        if len(fixed) == len(search_space):
            return fixed
        bound = self._bind(search_space)
        suggestion = bound.study.suggest(self._indicators)
        key = (study.study_name, trial.number)
        if suggestion.source != "daemon":
            self._open[key] = (bound, None)
            warnings.warn(
                f"trial {trial.number} is sampled at random, because {suggestion.problem}", RuntimeWarning, stacklevel=2
            )
            return {}
        self._open[key] = (bound, suggestion)
        return {**fixed, **bound.read(suggestion.configuration)}

    def sample_independent(
        self, study: "optuna.Study", trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """A parameter that is not in the search space, or while no daemon answers: at random."""
        self._check(study)
        return self._rest.sample_independent(study, trial, param_name, param_distribution)

    def after_trial(
        self, study: "optuna.Study", trial: FrozenTrial, state: TrialState, values: Optional[Sequence[float]]
    ) -> None:
        bound, suggestion = self._open.pop((study.study_name, trial.number), (None, None))
        if bound is None and self._search_space is not None:
            # Every parameter was fixed, so that nobody asked for a suggestion.
            bound = self._bind(self._search_space)
        if bound is None or not bound.distributions:
            return
        try:
            suggestion = self._at_its_point(bound, suggestion, trial, state)
        except (Refused, Unreachable) as problem:
            warnings.warn(f"trial {trial.number} is not learnt from, because {problem}", RuntimeWarning, stacklevel=2)
            return
        if suggestion is not None:
            self._end(study, trial, state, values, suggestion)

    def _at_its_point(
        self, bound: _Bound, suggestion: Optional[Suggestion], trial: FrozenTrial, state: TrialState
    ) -> Optional[Suggestion]:
        """The suggestion, if the trial ran with it; else a trial of what it ran with."""
        wanted = bound.middle() if suggestion is None else bound.read(suggestion.configuration)
        ran = {**wanted, **{name: trial.params[name] for name in wanted if name in trial.params}}
        is_held = bound.holds(ran)
        if suggestion is not None and is_held and bound.write(wanted) == bound.write(ran):
            return suggestion
        if suggestion is not None:
            suggestion.abandon()
        if not is_held:
            problem = "it ran with values beyond the search space"
            warnings.warn(f"trial {trial.number} is not learnt from, because {problem}", RuntimeWarning, stacklevel=2)
        if state not in (TrialState.COMPLETE, TrialState.PRUNED) or not is_held:
            return None
        return bound.study.trial_of(bound.write(ran), self._indicators)

    def _end(
        self,
        study: "optuna.Study",
        trial: FrozenTrial,
        state: TrialState,
        values: Optional[Sequence[float]],
        suggestion: Suggestion,
    ) -> None:
        try:
            if state == TrialState.COMPLETE and values:
                cost = self._cost(study, values[0])
                if math.isfinite(cost):
                    suggestion.report({METRIC: cost})
                else:
                    suggestion.infeasible(f"its value is {values[0]}")
            elif state == TrialState.PRUNED and trial.intermediate_values:
                last = trial.intermediate_values[max(trial.intermediate_values)]
                if math.isfinite(last) and math.isfinite(bound := self._cost(study, last)):
                    suggestion.aborted(bound)
            elif state == TrialState.FAIL:
                suggestion.failed("the objective raised an error")
        finally:
            # Where there was nothing to tell, or a value that is no cost; else this does nothing.
            suggestion.abandon()
