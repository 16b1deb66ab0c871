"""The same for asyncio: calls that may wait are awaited, and run in threads beside the event loop.

>>> import asyncio, os, treewright.aio
>>> async def tune():
...     client = await treewright.aio.connect(os.environ["TREEWRIGHT_URL"], client_id="doc-aio", deadline_ms=5000)
...     space = treewright.Space().integer("leaf", 1, 32, default=8, log=True)
...     study = await client.study("doc-aio", space, minimise={"render_ms": 1.0})
...     for _ in range(10):
...         async with study.suggest() as trial:
...             trial.report(render_ms=5 + abs(trial["leaf"] - 3))
...     await client.flush()
...     return await study.best()
>>> configuration, render_ms = asyncio.run(tune())
>>> render_ms <= 10
True
"""

import asyncio
from functools import partial
from typing import Any, Mapping, Optional, Sequence

from . import _native
from ._native import Best, Prediction, Space, Suggestion
from .front import ParetoFront
from .trials import Trials

__all__ = ["Client", "Study", "connect", "local"]


async def _beside(function: Any, *arguments: Any, **named: Any) -> Any:
    """Runs a call that lets go of the interpreter's lock while it waits."""
    return await asyncio.get_running_loop().run_in_executor(None, partial(function, *arguments, **named))


async def local(**options: Any) -> "Client":
    """A client of the user's own daemon; see ``treewright.Client.local``."""
    return Client(await _beside(_native.Client.local, **options))


async def connect(url: str = "http://127.0.0.1:50611", **options: Any) -> "Client":
    """Makes a client; options as those of ``treewright.Client``."""
    return Client(await _beside(_native.Client, url, **options))


class Client:
    """See ``treewright.Client``."""

    def __init__(self, client: _native.Client) -> None:
        self._client = client

    @property
    def url(self) -> str:
        """The address that it was made with."""
        return self._client.url

    async def study(self, id: str, space: Space, **definition: Any) -> "Study":
        """Creates the study, or finds the equal one of that id; arguments as those of ``treewright.Client.study``."""
        return Study(await _beside(self._client.study, id, space, **definition))

    async def existing_study(self, id: str) -> "Study":
        """A study that exists. Raises Refused when there is none."""
        return Study(await _beside(self._client.existing_study, id))

    async def change_space(self, id: str, space: Space, **change: Any) -> "dict[str, int]":
        """Changes the space of a study, which keeps its trials; see ``treewright.Client.change_space``."""
        return await _beside(self._client.change_space, id, space, **change)

    async def delete_study(self, id: str) -> None:
        """Deletes a study with all that was learnt."""
        await _beside(self._client.delete_study, id)

    async def studies(self) -> "list[str]":
        """The ids of all studies."""
        return await _beside(self._client.studies)

    async def flush(self, deadline_ms: float = 5000.0) -> None:
        """Waits until every report is acknowledged. Raises Unreachable when some are not."""
        await _beside(self._client.flush, deadline_ms)

    async def ping_ms(self) -> float:
        """How long the daemon takes to answer, in milliseconds."""
        return await _beside(self._client.ping_ms)

    def stats(self) -> dict:
        """Counts of suggestions and reports since the client was made."""
        return self._client.stats()


class _Asked:
    """A suggestion on its way: awaited, or entered with ``async with``."""

    def __init__(self, study: _native.Study, indicators: Optional[dict]) -> None:
        self._study, self._indicators, self._suggestion = study, indicators, None

    def __await__(self) -> Any:
        return _beside(self._study.suggest, self._indicators).__await__()

    async def __aenter__(self) -> Suggestion:
        self._suggestion = await self
        return self._suggestion

    async def __aexit__(self, *why: Any) -> bool:
        return self._suggestion.__exit__(*why)


class Study:
    """See ``treewright.Study``."""

    def __init__(self, study: _native.Study) -> None:
        self._study = study

    @property
    def name(self) -> str:
        """Its resource name, ``studies/ID``."""
        return self._study.name

    @property
    def metrics(self) -> "dict[str, float]":
        """The measurements that a report has to hold, each with its weight."""
        return self._study.metrics

    @property
    def maximised(self) -> "list[str]":
        """Those of the metrics that are maximised."""
        return self._study.maximised

    @property
    def episode_frames(self) -> int:
        """How many frames make a trial."""
        return self._study.episode_frames

    @property
    def value_title(self) -> str:
        """The name of what a cost stands for; see ``treewright.Study.value_title``."""
        return self._study.value_title

    def cost(self, measured: "Mapping[str, float]") -> float:
        """The study's objective of measurements, which is minimised. Raises Invalid where one is missing."""
        return self._study.cost(measured)

    def beyond(self, measured: "Mapping[str, float]") -> Optional[str]:
        """The first limit that measurements are beyond, in words; None where they are within all of them."""
        return self._study.beyond(measured)

    def value(self, cost: float) -> float:
        """The value behind a cost; see ``treewright.Study.value``."""
        return self._study.value(cost)

    async def flush(self, deadline_ms: float = 5000.0) -> None:
        """Waits until every report of its client is acknowledged. Raises Unreachable when some are not."""
        await _beside(self._study.flush, deadline_ms)

    def suggest(self, indicators: Optional[dict] = None) -> _Asked:
        """The next configuration to run: awaited, or entered with ``async with``. See ``treewright.Study.suggest``."""
        return _Asked(self._study, indicators)

    async def trial_of(self, configuration: dict, indicators: Optional[dict] = None) -> Suggestion:
        """A trial of the caller's own configuration. Raises where no daemon answers."""
        return await _beside(self._study.trial_of, configuration, indicators)

    def set_start(self, configuration: Optional[dict] = None) -> None:
        """Sets what this program runs by default; see ``treewright.Study.set_start``."""
        self._study.set_start(configuration)

    async def extend_lease(self, suggestion: Suggestion) -> None:
        """Renews the lease of an open suggestion, counted from now; see ``treewright.Study.extend_lease``."""
        await _beside(self._study.extend_lease, suggestion)

    async def predict(self, indicators: Optional[dict] = None) -> Prediction:
        """The configuration that would be exploited, and the predicted objective. Writes nothing."""
        return await _beside(self._study.predict, indicators)

    async def trials(self, filter: str = "", order_by: str = "") -> Trials:
        """The stored trials that match; see ``treewright.Study.trials``."""
        return await _beside(self._study.trials, filter, order_by)

    async def front(self, metrics: Optional[Sequence[str]] = None, **options: Any) -> ParetoFront:
        """The Pareto front of the stored trials; see ``treewright.Study.front``."""
        return await _beside(self._study.front, metrics, **options)

    async def best(self, indicators: Optional[dict] = None) -> Best:
        """The best known, with what is proven of it; see ``treewright.Study.best``."""
        return await _beside(self._study.best, indicators)

    async def policy(self) -> "dict[str, str]":
        """How the daemon decides; see ``treewright.Study.policy``."""
        return await _beside(self._study.policy)

    async def set_policy(self, **fields: Any) -> None:
        """Changes fields of the policy for all clients; None gives one its default back."""
        await _beside(self._study.set_policy, **fields)

    async def note(self) -> str:
        """The note for people, as it is stored."""
        return await _beside(self._study.note)

    async def tags(self) -> "list[str]":
        """The words by which people group studies, sorted, as they are stored."""
        return await _beside(self._study.tags)

    async def set_texts(self, **texts: Any) -> None:
        """Changes the texts for people; see ``treewright.Study.set_texts``."""
        await _beside(self._study.set_texts, **texts)

    async def freeze(self) -> None:
        """Neither explores nor learns any more, until ``thaw``."""
        await _beside(self._study.freeze)

    async def thaw(self) -> None:
        """Explores and learns again."""
        await _beside(self._study.thaw)

    async def pin(self, configuration: dict) -> None:
        """Gives every client this configuration, until ``unpin``."""
        await _beside(self._study.pin, configuration)

    async def unpin(self) -> None:
        """Undoes ``pin``."""
        await _beside(self._study.unpin)
