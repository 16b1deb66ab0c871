"""A cache for autotuners of kernels (Helion, Triton and their like) that answers with the nearest known shape.

Such autotuners look configurations up by the exact key of a shape, and a shape that was never tuned is tuned from nothing. Here a
shape is a point: its sizes are the study's indicators, and a shape that was not met before gets what the daemon predicts from those
near it. What is measured comes back and is shared between machines.

>>> import os, treewright, treewright.autotune
>>> client = treewright.Client(os.environ["TREEWRIGHT_URL"], client_id="doc-cache", deadline_ms=5000)
>>> space = treewright.Space().choice("block", [16, 32, 64, 128], default=16).integer("warps", 1, 8, default=4, log=True)
>>> cache = treewright.autotune.NearestCache(client, "matmul", space, sizes=("m", "n", "k"))
>>> cache.get({"m": 512, "n": 512, "k": 256}) is None  # nothing is known
True
>>> for block in (16, 64, 128):
...     assert cache.put({"m": 512, "n": 512, "k": 256}, {"block": block, "warps": 4}, ms=1 + abs(block - 64) / 64)
>>> cache.get({"m": 512, "n": 512, "k": 256})["block"]
64
>>> cache.get({"m": 640, "n": 512, "k": 256}) is None  # what was measured once, in one shape, is no answer elsewhere
True
>>> for _ in range(2):
...     for m in (512, 1024, 4096):
...         for block in (16, 64, 128):
...             assert cache.put({"m": m, "n": 512, "k": 256}, {"block": block, "warps": 4}, ms=m / 512 + abs(block - 64) / 64)
>>> cache.get({"m": 2048, "n": 512, "k": 256})["block"]
64
"""

from typing import Mapping, Optional, Sequence, Union

from ._native import Client, Refused, Space, Unreachable

__all__ = ["NearestCache"]

Value = Union[bool, int, float, str]


class NearestCache:
    """``get`` a configuration for a shape, ``put`` what was measured.

    A study holds one kernel on one kind of device: name both in ``study``. ``largest`` is the size that maps to 1; larger
    ones are taken all the same. A daemon that is away is a miss, as an autotuner's cache must never stop a compilation.
    """

    def __init__(
        self, client: Client, study: str, space: Space, *, sizes: Sequence[str], largest: float = 2.0**20, metric: str = "ms"
    ) -> None:
        self._client, self._sizes, self._metric = client, tuple(sizes), metric
        indicators = {size: (0.0, largest, "log") for size in self._sizes}
        self._study = client.study(study, space, minimise={metric: 1.0}, indicators=indicators)

    def _shape(self, key: Mapping[str, float]) -> "dict[str, float]":
        missing = [size for size in self._sizes if size not in key]
        if missing or len(key) != len(self._sizes):
            raise KeyError(f"a shape of this cache has {', '.join(self._sizes)}, not {', '.join(key)}")
        return {size: float(key[size]) for size in self._sizes}

    def get(self, key: Mapping[str, float]) -> "Optional[dict[str, Value]]":
        """The configuration for this shape, or None where nothing near is known."""
        try:
            known = self._study.predict(self._shape(key))
        except (Refused, Unreachable):
            return None
        return None if known.mode == "default" else known.configuration

    def put(self, key: Mapping[str, float], configuration: Mapping[str, Value], **measured: float) -> bool:
        """Tells what a configuration took; False where the daemon is away."""
        if self._metric not in measured:
            raise KeyError(f"say {self._metric}=...")
        try:
            trial = self._study.trial_of(dict(configuration), self._shape(key))
            trial.report(measured)
            self._client.flush()
        except Unreachable:
            return False
        return True
