from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from types import TracebackType
from typing import Any, Literal, Optional, TypeVar, Union, overload

from .front import ParetoFront
from .trials import Trials

Value = Union[bool, int, float, str]
Numbers = Mapping[str, float]
# Lowest and highest value, mapped to 0 and 1; with "log" by the logarithm.
Range = Union[tuple[float, float], tuple[float, float, Literal["linear", "log"]]]
# A parameter that stands earlier, and the values with which this one exists.
Condition = tuple[Union[Value, str], ...]
_S = TypeVar("_S", bound="Suggestion")
_F = TypeVar("_F", bound="FrontTrial")

__version__: str

class TreewrightError(Exception):
    """Something went wrong; the message names cause and remedy."""

class Invalid(TreewrightError):
    """An argument is wrong; nothing was sent."""

class Unreachable(TreewrightError):
    """No daemon answered in time; later one may."""

class Refused(TreewrightError):
    """The daemon will not do it."""

class Space:
    """The tuned parameters. Every method returns the space itself; Client.study reports mistakes."""

    def __init__(self) -> None: ...
    def integer(
        self,
        name: str,
        min: int,
        max: int,
        *,
        default: int,
        log: bool = False,
        active_if: Optional[Condition] = None,
        step: Optional[int] = None,
        setup: bool = False,
    ) -> Space:
        """With setup a change of it needs a build, a compilation or the like; that of other parameters only a run."""
    def float(
        self,
        name: str,
        min: float,
        max: float,
        *,
        default: float,
        log: bool = False,
        active_if: Optional[Condition] = None,
        setup: bool = False,
    ) -> Space: ...
    def boolean(self, name: str, *, default: bool, active_if: Optional[Condition] = None, setup: bool = False) -> Space: ...
    def choice(
        self, name: str, values: Sequence[Value], *, default: Value, active_if: Optional[Condition] = None, setup: bool = False
    ) -> Space:
        """One of up to 64 words, which have no order, or numbers, which are searched in their order."""
    def less_or_equal(self, lesser: str, greater: str) -> Space: ...
    def constraint(self, expression: str) -> Space: ...
    def __len__(self) -> int: ...

class Client:
    """A connection to a daemon, with a thread of its own. May be shared between threads, and used in the child of a fork."""

    def __init__(
        self,
        url: str = "http://127.0.0.1:50611",
        *,
        client_id: Optional[str] = None,
        deadline_ms: float = 50.0,
        call_deadline_ms: float = 5000.0,
        queue: int = 1024,
        can_abort: bool = False,
        fidelities: bool = False,
        token: Optional[str] = None,
        token_file: Optional[Union[str, PathLike[str]]] = None,
        authority_file: Optional[Union[str, PathLike[str]]] = None,
        certificate_file: Optional[Union[str, PathLike[str]]] = None,
        key_file: Optional[Union[str, PathLike[str]]] = None,
        software: Mapping[str, str] = ...,
    ) -> None: ...
    @staticmethod
    def local(**options: Any) -> Client:
        """A client of the user's own daemon, which is started where it is not running. Options as above."""
    @property
    def url(self) -> str: ...
    def study(
        self,
        id: str,
        space: Space,
        *,
        minimise: Mapping[str, float] = ...,
        maximise: Mapping[str, float] = ...,
        indicators: Mapping[str, Range] = ...,
        auxiliary: Sequence[str] = ...,
        limits: Mapping[str, tuple[float | None, float | None]] = ...,
        policy: Mapping[str, Value] = ...,
        display_name: str = "",
        state_tolerance: Optional[float] = None,
        seed: int = 0,
        episode_frames: int = 1,
        fidelities: Mapping[str, float] = ...,
    ) -> Study:
        """Creates the study, or finds the equal one of that id. An absent daemon is no error."""
    def existing_study(self, id: str) -> Study: ...
    def change_space(self, id: str, space: Space, *, fixed: Optional[Mapping[str, Value]] = None, only_try: bool = False) -> dict[str, int]:
        """Changes the space of a study, which keeps its trials: revision, kept_trials, outside_trials, given_back_trials."""
    def delete_study(self, id: str) -> None: ...
    def studies(self) -> list[str]: ...
    def flush(self, deadline_ms: float = 5000.0) -> None:
        """Waits until every report is acknowledged. Raises Unreachable when some are not."""
    def ping_ms(self) -> float: ...
    def stats(self) -> dict[str, Union[int, str, None]]: ...

class Study:
    @property
    def name(self) -> str: ...
    @property
    def metrics(self) -> dict[str, float]:
        """The measurements that a report has to hold, each with its weight."""
    @property
    def maximised(self) -> list[str]:
        """Those of the metrics that are maximised."""
    @property
    def episode_frames(self) -> int:
        """Number of frames of a trial. The report of a trial from ``suggest`` holds the means over them."""
    def cost(self, measured: Mapping[str, float]) -> float:
        """The study's objective of measurements, which is minimised. Raises Invalid where one is missing."""
    def beyond(self, measured: Mapping[str, float]) -> Optional[str]:
        """The first limit that measurements are beyond, in words; None where they are within all of them."""
    def value(self, cost: float) -> float:
        """The value behind a cost: the metric where one is maximised and nothing else counts, else the cost."""
    @property
    def value_title(self) -> str:
        """The name of such values: "cost", or the metric and that higher is better."""
    def flush(self, deadline_ms: float = 5000.0) -> None: ...
    def policy(self) -> dict[str, str]:
        """Each field as it is written; those that are left to themselves are not there."""
    def set_policy(self, **fields: Optional[Value]) -> None:
        """Changes fields of the policy for all clients; None gives one its default back."""
    def note(self) -> str: ...
    def tags(self) -> list[str]: ...
    def set_texts(self, *, display_name: Optional[str] = None, note: Optional[str] = None, tags: Optional[Sequence[str]] = None) -> None:
        """Changes the texts for people; what is None stays as it is. ``tags`` are all from now on."""
    def freeze(self) -> None: ...
    def thaw(self) -> None: ...
    def pin(self, configuration: Mapping[str, Value]) -> None: ...
    def unpin(self) -> None: ...
    def suggest(self, indicators: Optional[Numbers] = None) -> Suggestion:
        """The next configuration to run, within the deadline; see Suggestion.problem. Raises Invalid for wrong indicators."""
    def trial_of(self, configuration: Mapping[str, Value], indicators: Optional[Numbers] = None) -> Suggestion:
        """A trial of the caller's own configuration."""
    def set_start(self, configuration: Optional[Mapping[str, Value]] = None) -> None:
        """Sets what this program runs by default, where that is not the study's default; None for that.

        Parameters that are not named have their defaults. Answers are what is better than it. Raises Invalid for
        one that does not fit the space."""
    def extend_lease(self, suggestion: Suggestion) -> None:
        """Renews the lease of an open suggestion, counted from now. Raises Refused where the daemon has ended its trial."""
    def predict(self, indicators: Optional[Numbers] = None) -> Prediction:
        """The configuration that would be exploited, and the predicted objective. Writes nothing."""
    def best(self, indicators: Optional[Numbers] = None) -> Best:
        """The best known, with what is proven of it; of all states without indicators. Raises Refused when nothing was measured."""
    def trials(self, filter: str = "", order_by: str = "") -> Trials:
        """The stored trials that match, by number unless said otherwise."""
    def front(
        self, metrics: Optional[Sequence[str]] = None, *, state: Optional[int] = None, reference: Optional[Sequence[float]] = None
    ) -> ParetoFront:
        """The Pareto front of the stored trials: of two or three measurements, or of those that the study was made for."""
    def tuner(self) -> Tuner: ...

class Best:
    """The best known: ``configuration, cost = study.best()``, or by name."""

    @property
    def configuration(self) -> dict[str, Value]: ...
    @property
    def cost(self) -> float: ...
    @property
    def cost_interval(self) -> Optional[tuple[float, float]]: ...
    @property
    def default_cost(self) -> Optional[float]: ...
    @property
    def value(self) -> float:
        """The value behind the cost: the metric where one is maximised and nothing else counts, else the cost."""
    @property
    def value_interval(self) -> Optional[tuple[float, float]]: ...
    @property
    def default_value(self) -> Optional[float]: ...
    @property
    def value_title(self) -> str: ...
    @property
    def gain(self) -> Optional[float]: ...
    @property
    def gain_interval(self) -> Optional[tuple[Optional[float], Optional[float]]]: ...
    @property
    def probability_better(self) -> Optional[float]: ...
    @property
    def nothing_better(self) -> Optional[bool]: ...
    @property
    def stage(self) -> Optional[str]: ...
    @property
    def status(self) -> Optional[str]:
        """The standing in a word or two, such as "proven better" or "searching"."""
    @property
    def verdict(self) -> Optional[str]: ...
    @property
    def measurements(self) -> int: ...
    @property
    def trial(self) -> str: ...
    def __len__(self) -> int: ...
    @overload
    def __getitem__(self, place: Literal[0, -2]) -> dict[str, Value]: ...
    @overload
    def __getitem__(self, place: Literal[1, -1]) -> float: ...
    def __iter__(self) -> Iterator[Any]: ...

class Prediction:
    """The configuration that would be exploited: ``configuration, cost = study.predict()``, or by name."""

    @property
    def configuration(self) -> dict[str, Value]: ...
    @property
    def predicted_cost(self) -> Optional[float]: ...
    @property
    def mode(self) -> str:
        """exploit where something is known, default where nothing is, pinned where the policy says so."""
    @property
    def reason(self) -> str: ...
    def __len__(self) -> int: ...
    @overload
    def __getitem__(self, place: Literal[0, -2]) -> dict[str, Value]: ...
    @overload
    def __getitem__(self, place: Literal[1, -1]) -> Optional[float]: ...
    def __iter__(self) -> Iterator[Any]: ...

class Suggestion:
    @property
    def configuration(self) -> dict[str, Value]: ...
    @property
    def source(self) -> Literal["daemon", "last_good", "default"]: ...
    @property
    def trial(self) -> Optional[str]: ...
    @property
    def reason(self) -> str: ...
    @property
    def problem(self) -> Optional[str]: ...
    @property
    def predicted_cost(self) -> Optional[float]: ...
    @property
    def abort_above(self) -> Optional[float]: ...
    @property
    def fidelity(self) -> Optional[str]:
        """The cheaper level at which to run; None for a full trial."""
    @property
    def is_prepared(self) -> bool:
        """Whether what was set up for the trial before serves this one."""
    @property
    def is_open(self) -> bool:
        """Whether it is neither reported nor given back."""
    def __getitem__(self, name: str) -> Value: ...
    def report(
        self, measurements: Optional[Numbers] = None, /, *, standard_errors: Optional[Numbers] = None, **named: float
    ) -> None:
        """Ends the trial; returns at once, and the report is sent in the background. ``standard_errors`` are those of measurements that
        are estimates, by name: poor ones count for less."""
    def aborted(self, lower_bound: float) -> None: ...
    def infeasible(self, reason: str) -> None: ...
    def failed(self, reason: str) -> None: ...
    def abandon(self) -> None: ...
    def __enter__(self: _S) -> _S: ...
    def __exit__(
        self,
        kind: Optional[type[BaseException]],
        exception: Optional[BaseException],
        traceback: Optional[TracebackType],
    ) -> bool: ...

class Front:
    """Two or three metrics of which none is given up for another. One program at a time adds to a front, one run at a time."""

    def __init__(
        self,
        client: Client,
        id: str,
        space: Space,
        metrics: Sequence[str],
        *,
        trials: int = 80,
        limits: Mapping[str, tuple[float | None, float | None]] = ...,
        policy: Mapping[str, Value] = ...,
    ) -> None:
        """Creates the study, or goes on with it. ``1/rate`` is a metric that is to be large; ``trials`` are the planned runs."""
    @property
    def metrics(self) -> list[str]: ...
    def suggest(self) -> Optional[FrontTrial]:
        """The next run; None once the planned ones are done, or nothing more is to be tried."""
    def found(self) -> ParetoFront:
        """The front of all runs so far on this machine."""

class FrontTrial:
    @property
    def configuration(self) -> dict[str, Value]: ...
    @property
    def trial(self) -> str: ...
    @property
    def is_open(self) -> bool: ...
    def __getitem__(self, name: str) -> Value: ...
    def report(self, measurements: Optional[Numbers] = None, /, **named: float) -> None:
        """Ends the run, and tells every direction; waits for the daemon. Raises Invalid where a metric is missing or not above 0."""
    def infeasible(self, reason: str) -> None: ...
    def failed(self, reason: str) -> None: ...
    def abandon(self) -> None: ...
    def __enter__(self: _F) -> _F: ...
    def __exit__(
        self,
        kind: Optional[type[BaseException]],
        exception: Optional[BaseException],
        traceback: Optional[TracebackType],
    ) -> bool: ...

class Tuner:
    """A frame loop in which report and question travel together. Where ``episode_frames`` of the study is above 1 it keeps a
    trial for that number of frames without asking, and reports their means. In another state it gives an unfinished trial back."""

    def next(self, indicators: Optional[Numbers] = None) -> Suggestion: ...
    def finish(
        self,
        suggestion: Suggestion,
        measurements: Optional[Numbers] = None,
        /,
        *,
        standard_errors: Optional[Numbers] = None,
        **named: float,
    ) -> None: ...
