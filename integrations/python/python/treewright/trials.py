"""The stored trials of a study: a list of dictionaries, and a table for pandas."""

from typing import Any

from .optional import needed

__all__ = ["Trials"]


class Trials(list):  # type: ignore[type-arg]
    """Trials by number. Each is a dictionary: number, client_id, state_id, mode, state, outcome, cost, late, exclusion (the reason, for one from
    which nothing is learnt), create_time and complete_time (seconds since 1970), configuration, indicators, measurements, and their
    standard_errors where the reports gave some."""

    def rows(self) -> "list[dict[str, Any]]":
        """One flat dictionary a trial: parameters are called config.NAME, the others indicator.NAME, measurement.NAME and
        standard_error.NAME."""
        groups = {"configuration": "config", "indicators": "indicator", "measurements": "measurement", "standard_errors": "standard_error"}
        flat = []
        for trial in self:
            row = {name: value for name, value in trial.items() if name not in groups}
            for group, prefix in groups.items():
                row.update({f"{prefix}.{name}": value for name, value in trial[group].items()})
            flat.append(row)
        return flat

    def to_pandas(self) -> Any:
        """A DataFrame of rows(), by number; times are timestamps in UTC. Needs pandas."""
        pandas = needed("pandas", "to_pandas", "pandas")
        table = pandas.DataFrame(self.rows())
        for name in ("create_time", "complete_time"):
            if name in table:
                table[name] = pandas.to_datetime(table[name], unit="s", utc=True)
        return table.set_index("number") if "number" in table else table

    def to_arrow(self) -> Any:
        """A pyarrow.Table of rows(), with the trials in the order they have here; what a trial has not is null. Needs pyarrow."""
        pyarrow = needed("pyarrow", "to_arrow", "arrow")
        rows = self.rows()
        names = list(dict.fromkeys(name for row in rows for name in row))
        columns = {name: [row.get(name) for row in rows] for name in names}
        for name in ("create_time", "complete_time"):
            if name in columns:
                microseconds = [None if each is None else round(each * 1e6) for each in columns[name]]
                columns[name] = pyarrow.array(microseconds, pyarrow.timestamp("us", tz="UTC"))
        return pyarrow.table(columns)
