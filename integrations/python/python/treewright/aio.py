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
from typing import Any, Optional

from . import _native
from ._native import Best, Space, Suggestion
from .trials import Trials

__all__ = ["Client", "Study", "connect"]


async def _beside(function: Any, *arguments: Any, **named: Any) -> Any:
    """Runs a call that lets go of the interpreter's lock while it waits."""
    return await asyncio.get_running_loop().run_in_executor(None, partial(function, *arguments, **named))


async def connect(url: str = "http://127.0.0.1:50611", **options: Any) -> "Client":
    """Makes a client; options as those of ``treewright.Client``."""
    return Client(await _beside(_native.Client, url, **options))


class Client:
    """See ``treewright.Client``."""

    def __init__(self, client: _native.Client) -> None:
        self._client = client

    async def study(self, id: str, space: Space, **definition: Any) -> "Study":
        return Study(await _beside(self._client.study, id, space, **definition))

    async def existing_study(self, id: str) -> "Study":
        return Study(await _beside(self._client.existing_study, id))

    async def delete_study(self, id: str) -> None:
        await _beside(self._client.delete_study, id)

    async def studies(self) -> "list[str]":
        return await _beside(self._client.studies)

    async def flush(self, deadline_ms: float = 5000.0) -> None:
        await _beside(self._client.flush, deadline_ms)

    async def ping_ms(self) -> float:
        return await _beside(self._client.ping_ms)

    def stats(self) -> dict:
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
        return self._study.name

    def suggest(self, indicators: Optional[dict] = None) -> _Asked:
        return _Asked(self._study, indicators)

    async def trial_of(self, configuration: dict, indicators: Optional[dict] = None) -> Suggestion:
        return await _beside(self._study.trial_of, configuration, indicators)

    async def predict(self, indicators: Optional[dict] = None) -> tuple:
        return await _beside(self._study.predict, indicators)

    async def trials(self, filter: str = "", order_by: str = "") -> Trials:
        return await _beside(self._study.trials, filter, order_by)

    async def best(self, indicators: Optional[dict] = None) -> Best:
        return await _beside(self._study.best, indicators)
