"""Treewright tunes a program while it runs, and keeps what was learnt.

The package holds the client SDK, the daemon and the command line. ``Client.local()`` starts a daemon of your own where none is running:

    client = treewright.Client.local()

With the address of one, say what can be tuned and what describes the input, ask for a suggestion, and report what was measured:

>>> import os, treewright
>>> client = treewright.Client(os.environ["TREEWRIGHT_URL"], client_id="doc", deadline_ms=5000)
>>> space = treewright.Space().integer("leaf", 1, 32, default=8, log=True).boolean("compact", default=False)
>>> study = client.study("doc-example", space, minimise={"render_ms": 1.0},
...                      indicators={"triangles": (0.0, 1e8, "log")}, policy={"epsilon": 0.5})
>>> for _ in range(20):
...     with study.suggest({"triangles": 262_267}) as trial:
...         render_ms = 5 + abs(trial["leaf"] - 3)  # build and render with trial.configuration
...         trial.report(render_ms=render_ms)
>>> client.flush()
>>> best = study.best({"triangles": 262_267})
>>> configuration, render_ms = best
>>> sorted(configuration), render_ms <= 10
(['compact', 'leaf'], True)
>>> low, high = best.cost_interval  # of 95 %, for the fastest speed of the machine; best.verdict says what is proven
>>> low <= high
True

Threads, tasks and forked processes may share a study: each suggestion that is neither reported nor given back is a trial of its own.

A suggestion never fails and never waits longer than the deadline (50 ms unless the client says otherwise): without the daemon it
is the last good configuration, or the default.

>>> away = treewright.Client("http://127.0.0.1:1").study("away", space, minimise={"render_ms": 1.0})
>>> away.suggest().source
'default'

Leaving a ``with`` block without a report gives the trial back; an exception is reported as the trial's failure. What is wrong with an
argument is reported at once:

>>> treewright.Client("not an address")
Traceback (most recent call last):
...
treewright.Invalid: `not an address` is not an address of a daemon: ...

``treewright.tune`` is the loop for searches that run by themselves, ``treewright.plot`` draws figures for notebooks.
``treewright.Front`` looks for a Pareto front of two or three metrics; see ``treewright.front``.
``treewright.aio`` has the same for asyncio, ``treewright.optuna`` a sampler for Optuna, ``treewright.autotune`` a cache for autotuners
that finds the nearest known shape.
"""

from ._native import (
    Best,
    Client,
    Front,
    FrontTrial,
    Invalid,
    Prediction,
    Refused,
    Space,
    Study,
    Suggestion,
    TreewrightError,
    Tuner,
    Unreachable,
    __version__,
)
from .loop import Ran, tune

__all__ = [
    "Best",
    "Client",
    "Front",
    "FrontTrial",
    "Invalid",
    "Prediction",
    "Ran",
    "Refused",
    "Space",
    "Study",
    "Suggestion",
    "TreewrightError",
    "Tuner",
    "Unreachable",
    "__version__",
    "tune",
]
