"""Pareto fronts: the configurations of which no other is better in all of two or three metrics.

>>> import os, treewright
>>> client = treewright.Client(os.environ["TREEWRIGHT_URL"], client_id="doc-front", call_deadline_ms=20000)
>>> space = treewright.Space().integer("level", 1, 50, default=25)
>>> front = treewright.Front(client, "doc-front", space, ["time_ms", "memory_mb"], trials=12)
>>> while (trial := front.suggest()) is not None:
...     with trial:
...         trial.report(time_ms=100 / trial["level"], memory_mb=float(trial["level"]))
>>> found = front.found()
>>> found.runs, found.metrics, found[0]["metrics"]["time_ms"] <= found[-1]["metrics"]["time_ms"]
(12, ['time_ms', 'memory_mb'], True)

``client.existing_study("doc-front").front()`` has it again, as of any study whose trials measured the metrics.
``found.to_pandas()`` is a table, and ``treewright.plot.front(found)`` a figure.
"""

from typing import Any, Optional

from .optional import needed

__all__ = ["ParetoFront"]


class ParetoFront(list):  # type: ignore[type-arg]
    """The configurations of a front, the best of the first metric first. Each is a dictionary: configuration, runs (how many measured
    it), metrics (the medians), ratios (to the default; None where that was not measured). Beside them: metrics and maximised (names),
    runs (of all configurations), default and dominated (in the same form), hypervolume (0 to 1; the share of the box between zero and
    the default that the front leaves behind)."""

    def __init__(
        self,
        points: "list[dict[str, Any]]",
        *,
        metrics: "list[str]",
        maximised: "list[str]",
        runs: int,
        default: "Optional[dict[str, Any]]",
        dominated: "list[dict[str, Any]]",
        hypervolume: Optional[float],
    ) -> None:
        super().__init__(points)
        self.metrics, self.maximised, self.runs = metrics, maximised, runs
        self.default, self.dominated, self.hypervolume = default, dominated, hypervolume

    def rows(self, dominated: bool = False) -> "list[dict[str, Any]]":
        """One flat dictionary a configuration: parameters are called config.NAME, ratios ratio.NAME, metrics as they are. ``is_front``
        tells those on the front from the others, which come behind them with ``dominated``."""
        flat = []
        for is_front, points in ((True, self), (False, self.dominated if dominated else [])):
            for point in points:
                row = {"is_front": is_front, "runs": point["runs"], **point["metrics"]}
                row.update({f"ratio.{name}": value for name, value in (point["ratios"] or {}).items()})
                row.update({f"config.{name}": value for name, value in point["configuration"].items()})
                flat.append(row)
        return flat

    def to_pandas(self, dominated: bool = False) -> Any:
        """A DataFrame of rows(). Needs pandas."""
        return needed("pandas", "to_pandas", "pandas").DataFrame(self.rows(dominated))
