"""Figures for notebooks, by matplotlib: each function draws on ``ax``, or on a figure of its own, and returns the axes.

>>> import treewright.plot
>>> sorted(treewright.plot.__all__)
['best_so_far', 'front', 'importances', 'slice']
"""

import json
import math
from typing import Any, Iterable, Mapping, Optional, Sequence, Union

from ._native import Study, TreewrightError
from .front import ParetoFront
from .optional import needed

__all__ = ["best_so_far", "front", "importances", "slice"]


def _axes(ax: Any) -> Any:
    pyplot = needed("matplotlib.pyplot", "a figure", "plot")
    return pyplot.subplots()[1] if ax is None else ax


def _by_state(study: Study) -> "dict[int, list[dict[str, Any]]]":
    """Trials that were measured, by number, of each state: costs of different inputs cannot be compared."""
    states: "dict[int, list[dict[str, Any]]]" = {}
    for trial in study.trials("state = COMPLETED AND outcome = OK"):
        if trial["cost"] is not None and trial["exclusion"] is None:
            states.setdefault(trial["state_id"], []).append(trial)
    return states


def _robust(ax: Any, places: Sequence[Any], values: "Sequence[float]", others: "Iterable[float]" = ()) -> None:
    """Ends the axis above all values but the largest one in 25, and above the others, so that a few bad ones do not flatten the rest.
    They are marked at its edge."""
    shown = [*sorted(values)[: len(values) - len(values) // 25], *others]
    low, high = min(shown), max(shown)
    room = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
    beyond = [place for place, value in zip(places, values) if value > high + room]
    if beyond:
        ax.set_ylim(low - room, high + room)
        ax.scatter(beyond, [high + room] * len(beyond), marker="^", color="0.3", clip_on=False, label="beyond the axis")


def _answer(study: Study, trials: "list[dict[str, Any]]") -> "Optional[tuple[float, float]]":
    """The cost of the answer in the state of these trials by all measurements: the ends of its 95 % interval."""
    try:
        best = study.best(trials[-1]["indicators"])
    except TreewrightError:
        return None
    # The same input on another machine is another state.
    is_here = int(best.trial.rpartition("/")[2]) in {trial["number"] for trial in trials}
    return best.value_interval if is_here else None


def best_so_far(study: Study, *, state: Optional[int] = None, ax: Any = None) -> Any:
    """The cost of each trial, the least so far as a line, and the trials that lowered it as larger points. Of a study that maximises
    one metric and nothing else it is that metric, and the line is the highest so far. The line follows luck; the band is the 95 %
    interval of what the answer costs by all measurements, as ``Study.best`` tells it.

    ``state`` is the number of the state, ``state_id`` of its trials; by default the one with most trials."""
    states, ax = _by_state(study), _axes(ax)
    if state is None and states:
        state = max(states, key=lambda each: len(states[each]))
    trials = states.get(state, []) if state is not None else []
    numbers, costs = [trial["number"] for trial in trials], [trial["cost"] for trial in trials]
    least: "list[float]" = []
    for cost in costs:
        least.append(min(cost, least[-1]) if least else cost)
    lowered = [place for place in range(len(costs)) if place == 0 or least[place] < least[place - 1]]
    values, best = [study.value(cost) for cost in costs], [study.value(cost) for cost in least]
    ax.plot(numbers, values, ".", color="0.6", label="trial")
    ax.step(numbers, best, where="post", label="best so far")
    ax.plot([numbers[place] for place in lowered], [values[place] for place in lowered], "o", label="incumbent")
    title = study.name if len(states) < 2 else f"{study.name}, state {state}"
    ax.set(xlabel="trial", ylabel=_unit(study), title=title)
    if trials:
        answer = _answer(study, trials)
        if answer is not None:
            ax.axhspan(*answer, color="C0", alpha=0.2, label="answer by all measurements, 95 %")
        if study.value_title == "cost":
            _robust(ax, numbers, values, answer or ())
        ax.legend()
    return ax


def slice(study: Study, parameter: str, *, ax: Any = None) -> Any:
    """The cost of each trial over the value that it gave one parameter, as a multiple of the least of its state; of a study that
    maximises one metric and nothing else that metric, as a multiple of the highest."""
    values, costs = [], []
    for trials in _by_state(study).values():
        least = min(trial["cost"] for trial in trials)
        here = [trial for trial in trials if parameter in trial["configuration"] and least > 0]
        values += [trial["configuration"][parameter] for trial in here]
        costs += [study.value(trial["cost"]) / study.value(least) for trial in here]
    if not values:
        raise ValueError(f"no measured trial of {study.name} has a parameter {parameter}")
    ax = _axes(ax)
    # Words, and what else has no order, side by side.
    ordered = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values)
    places = values if ordered else [str(value) for value in values]
    ax.plot(places, costs, ".")
    if study.value_title == "cost":
        _robust(ax, places, costs)
    ax.set(xlabel=parameter, ylabel=f"{study.value_title}, best of the state = 1", title=study.name)
    return ax


def front(found: ParetoFront, metrics: "Optional[tuple[str, str]]" = None, *, ax: Any = None) -> Any:
    """The configurations by two metrics, the first two by default: dominated ones in grey, those on the front joined as a staircase, and
    the default marked. ``found`` is what ``Front.found()`` and ``Study.front()`` return."""
    x, y = metrics or found.metrics[:2]
    sign = {name: -1.0 if name in found.maximised else 1.0 for name in (x, y)}
    at = lambda points: ([point["metrics"][x] for point in points], [point["metrics"][y] for point in points])
    corners, best = [], math.inf
    for point in sorted(found, key=lambda one: (sign[x] * one["metrics"][x], sign[y] * one["metrics"][y])):
        if sign[y] * point["metrics"][y] < best:
            corners.append(point)
            best = sign[y] * point["metrics"][y]
    ax = _axes(ax)
    ax.plot(*at(found.dominated), ".", color="0.6", label="others")
    ax.plot(*at(found), "o", color="C0", label="front")
    ax.step(*at(corners), where="post", color="C0")
    if found.default is not None:
        ax.plot(*at([found.default]), "o", fillstyle="none", markersize=12, color="C1", label="default")
    side = lambda name: f"{name} ({'higher' if sign[name] < 0 else 'lower'} is better)"
    ax.set(xlabel=side(x), ylabel=side(y), title="Pareto front")
    ax.legend()
    return ax


def importances(analysis: Union[str, Mapping[str, Any]], *, ax: Any = None) -> Any:
    """Which share of a measurement's variance each parameter explains by itself, largest above.

    ``analysis`` is what ``treewright --json analyze STUDY`` prints, or the path of the ``analysis.json`` that its ``--out`` writes;
    it wants 30 trials. Parameters with too few configurations to say are left out."""
    if isinstance(analysis, str):
        with open(analysis, encoding="utf-8") as file:
            analysis = json.load(file)
    metric = analysis["conditions"][0]["metrics"][0]
    known = [one for one in metric["parameters"] if one["first_order"] is not None]
    known.sort(key=lambda one: one["first_order"])
    ax = _axes(ax)
    ax.barh([one["parameter"] for one in known], [one["first_order"] for one in known])
    ax.set(xlabel=f"share of the variance of {metric['name']}", xlim=(0, 1), title=analysis["study"])
    return ax


def _unit(study: Study) -> str:
    if study.value_title != "cost":
        return study.value_title
    maximised = study.maximised
    term = lambda name, weight: f"{weight:g} / {name}" if name in maximised else name if weight == 1 else f"{weight:g} {name}"
    return " + ".join(term(name, weight) for name, weight in study.metrics.items())
