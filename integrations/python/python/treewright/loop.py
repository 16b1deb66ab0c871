"""The loop of a search that runs by itself: ask, measure, report, until it is enough."""

import time
import warnings
from typing import Any, Callable, Iterable, Mapping, NamedTuple, Optional, Union

from ._native import Best, Study, Suggestion
from .optional import needed

__all__ = ["Ran", "tune"]


class Ran(NamedTuple):
    """A trial of ``tune``, as its callbacks are given it."""

    number: int
    """How many ran before it in this loop."""
    suggestion: Suggestion
    """The configuration of the run; ``suggestion.configuration``."""
    measured: "dict[str, float]"
    """The reported measurements; empty where the objective raised an error that is caught."""
    cost: Optional[float]
    """The study's objective of these measurements; None where they are beyond a limit, and where there are none."""


def tune(
    study: Study,
    objective: Callable[["dict[str, Any]"], Union[float, Mapping[str, float]]],
    *,
    trials: Optional[int] = None,
    seconds: Optional[float] = None,
    indicators: Optional[Mapping[str, float]] = None,
    callbacks: Iterable[Callable[[Ran], Any]] = (),
    catch: "tuple[type[Exception], ...]" = (),
    progress: bool = False,
) -> Best:
    """Runs ``objective`` with one configuration after the other, and returns the best known.

    ``objective`` is called with a dictionary of values and returns the measurements by name, or one number where the study has one
    metric. The loop ends after ``trials``, or with the first trial that ends after ``seconds``; one of them has to be given. Each
    callback is called after each trial with a ``Ran``; one that returns True ends the loop. An error of the objective is reported as the
    trial's failure, and raised unless ``catch`` names its class. ``progress`` shows a bar, which needs the package tqdm. A trial that gets
    no answer within the client's ``deadline_ms`` runs what is known already and teaches nothing; each of them warns.

    >>> import os, treewright
    >>> client = treewright.Client(os.environ["TREEWRIGHT_URL"], client_id="doc-loop", deadline_ms=5000)
    >>> space = treewright.Space().integer("leaf", 1, 32, default=8, log=True)
    >>> study = client.study("doc-loop", space, minimise={"render_ms": 1.0})
    >>> best = treewright.tune(study, lambda values: 5 + abs(values["leaf"] - 3), trials=12)
    >>> best.cost <= 10
    True
    """
    if trials is None and seconds is None:
        raise ValueError("say when to end: trials=NUMBER or seconds=NUMBER")
    callbacks, weights, begin, least = list(callbacks), study.metrics, time.monotonic(), None
    bar = needed("tqdm.auto", "a progress bar", "progress").tqdm(total=trials, unit="trial") if progress else None
    number = 0
    while trials is None or number < trials:
        measured, cost = {}, None
        with study.suggest(indicators) as suggestion:
            if suggestion.source != "daemon":
                words = f"trial {number} is not learnt from, because {suggestion.problem}"
                warnings.warn(words, RuntimeWarning, stacklevel=2)
            try:
                measured = _by_name(objective(suggestion.configuration), weights)
            except catch as problem:
                suggestion.failed(repr(problem))
            else:
                suggestion.report(measured)
                # What is beyond a limit is infeasible, whatever it costs.
                if study.beyond(measured) is None:
                    cost = study.cost({name: measured[name] for name in weights})
        if cost is not None:
            least = cost if least is None else min(cost, least)
        if bar is not None:
            bar.update()
            bar.set_postfix(best=None if least is None else study.value(least))
        enough = [each(Ran(number, suggestion, measured, cost)) is True for each in callbacks]
        number += 1
        if any(enough) or (seconds is not None and time.monotonic() - begin >= seconds):
            break
    if bar is not None:
        bar.close()
    study.flush()
    return study.best(indicators)


def _by_name(result: Union[float, Mapping[str, float]], weights: "dict[str, float]") -> "dict[str, float]":
    if isinstance(result, Mapping):
        return dict(result)
    if len(weights) != 1:
        raise TypeError(f"the objective has to return {', '.join(weights)} by name, not one number")
    return {next(iter(weights)): float(result)}
