"""Problems on which optimisers are compared: a space, a noisy cost, and the true cost behind it.

A space is a list of `Parameter`, and constraints that optimisers are told: expressions that Python and Treewright read
alike. `Problem.measure(configuration, random)` is what an optimiser sees (None where the configuration cannot be run, told
or not), `Problem.gap(configuration)` is what counts: the noise-free distance to the optimum, or the noise-free cost over
the optimum's where that is the custom of the field.
"""

import dataclasses
import functools
import itertools
import json
import math
import pathlib
import typing

import numpy

from kernels import KERNELS


@dataclasses.dataclass(frozen=True)
class Parameter:
    name: str
    kind: str  # "float", "integer", "choice" or "switch"
    low: float = 0.0
    high: float = 1.0
    log: bool = False
    values: tuple = ()
    default: typing.Any = None
    active_if: tuple | None = None  # (name of an earlier parameter, values)


def active(parameters, configuration):
    """The parameters that mean something beside the others' values."""
    on = set()
    for parameter in parameters:
        condition = parameter.active_if
        if condition is None or (condition[0] in on and configuration[condition[0]] in condition[1]):
            on.add(parameter.name)
    return on


@functools.lru_cache
def _compiled(constraint):
    return compile(constraint, constraint, "eval")


def broken(constraints, configuration):
    """The constraints that a configuration does not fulfil."""
    return [each for each in constraints if not eval(_compiled(each), {"__builtins__": {}}, configuration)]


class Problem:
    name = ""
    parameters: list[Parameter] = []
    constraints: tuple[str, ...] = ()
    # Names of what must not exceed a limit, and is only known after a run.
    limits: tuple[str, ...] = ()
    noise = 0.0

    def gap(self, configuration):
        raise NotImplementedError

    def excess(self, configuration):
        """By how much a run exceeds each of the limits; at most 0 where it keeps it."""
        return {}

    def measure(self, configuration, random):
        cost = self.gap(configuration)
        return None if math.isinf(cost) else cost * math.exp(self.noise * random.standard_normal())


class Bbob(Problem):
    """A function of COCO's bbob suite, shifted so that its optimum is 0, with multiplicative log-normal noise, which vanishes
    where the optimum is."""

    def __init__(self, function, dimension, instance, noise):
        suite = _suite(function, dimension, instance)
        self.inner = suite[0]
        self.suite = suite  # owns the problem
        self.noise = noise
        self.name = f"f{function} d{dimension}"
        self.parameters = [Parameter(f"x{axis}", "float", -5.0, 5.0, default=0.0) for axis in range(dimension)]
        self.optimum = _optimum(function, dimension, instance)

    def gap(self, configuration):
        x = numpy.array([configuration[parameter.name] for parameter in self.parameters])
        return max(float(self.inner(x)) - self.optimum, 1e-12)


class Floor(Bbob):
    """The same as a run time behaves: however good a configuration, a tenth of what a random one costs is always left, and
    its noise with it. `gap` is the cost over the optimum's, as for the other problems with a cost."""

    def __init__(self, function, dimension, instance, noise):
        super().__init__(function, dimension, instance, noise)
        points = numpy.random.default_rng([13, function, dimension, instance]).uniform(-5.0, 5.0, (1000, dimension))
        self.floor = 0.1 * max(float(numpy.median([self.inner(x) for x in points])) - self.optimum, 1e-12)

    def gap(self, configuration):
        return 1.0 + super().gap(configuration) / self.floor


def _suite(function, dimension, instance):
    import cocoex

    return cocoex.Suite("bbob", f"instances: {instance}", f"function_indices:{function} dimensions:{dimension}")


def _optimum(function, dimension, instance):
    """The value of the optimum. COCO does not tell it by a call of its own, but prints the best parameter to a file."""
    import contextlib
    import os
    import tempfile

    problem = (suite := _suite(function, dimension, instance))[0]  # the suite owns the problem
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        problem._best_parameter("print")
        x = numpy.loadtxt(os.path.join(folder, "._bbob_problem_best_parameter.txt"))
    return float(problem(numpy.atleast_1d(x)))


class Grid(Problem):
    """A kernel-tuning landscape: integer grids, most combinations invalid, strong interactions, 5 % noise. Where it is told
    what is valid, values are places, which make that a linear constraint."""

    def __init__(self, seed, is_told=False, valid=0.3, noise=0.05):
        random = numpy.random.default_rng([7, seed])
        self.noise = noise
        self.name = f"grid{seed}"
        self.levels = [int(random.integers(2, 9)) for _ in range(7)]
        self.parameters = [
            Parameter(f"p{index}", "choice", values=values, default=values[0])
            for index, levels in enumerate(self.levels)
            for values in [tuple(step if is_told else 2**step for step in range(levels))]
        ]
        shape = tuple(self.levels)
        cost = numpy.zeros(shape)
        axes = numpy.meshgrid(*[numpy.arange(levels) for levels in shape], indexing="ij")
        for index, axis in enumerate(axes):
            effect = random.normal(0, 0.25, shape[index])
            cost += effect[axis]
        for _ in range(6):  # pairs interact
            a, b = random.choice(len(shape), 2, replace=False)
            table = random.normal(0, 0.2, (shape[a], shape[b]))
            cost += table[axes[a], axes[b]]
        # Resources: a sum over some axes must stay below a bound, as shared memory or registers do.
        need, terms = numpy.zeros(shape), []
        for index in random.choice(len(shape), 4, replace=False):
            weight = random.uniform(0.5, 1.5)
            need += weight * axes[index] / max(shape[index] - 1, 1)
            terms.append(f"{float(weight)!r} * p{index} / {max(shape[index] - 1, 1)}")
        self.cost = numpy.exp(cost)
        self.valid = need <= numpy.quantile(need, valid)
        self.valid[(0,) * len(shape)] = True
        if is_told:
            # Between the needs on both sides, so that rounding decides nothing.
            bound = (need[self.valid].max() + need[~self.valid].min()) / 2
            self.constraints = (f"{' + '.join(terms)} <= {float(bound)!r}",)
        self.best = float(self.cost[self.valid].min())

    def _place(self, configuration):
        return tuple(parameter.values.index(configuration[parameter.name]) for parameter in self.parameters)

    def gap(self, configuration):
        place = self._place(configuration)
        return float(self.cost[place] / self.best) if self.valid[place] else math.inf


def configurations(parameters):
    """Every configuration of a grid, the last parameter fastest, without those that mean nothing beside the others."""
    def extend(configuration, left):
        if not left:
            yield configuration
            return
        first, *rest = left
        is_on = first.active_if is None or configuration.get(first.active_if[0]) in first.active_if[1]
        values = (False, True) if first.kind == "switch" else first.values
        for value in values if is_on else (None,):
            yield from extend({**configuration, first.name: value} if is_on else configuration, rest)

    return extend({}, list(parameters))


class Recorded(Problem):
    """A landscape recorded with the renderer (see `record.py`): every configuration of a grid, with 5 % noise."""

    def __init__(self, path, noise=0.05):
        data = json.loads(pathlib.Path(path).read_text())
        self.name = data["name"]
        self.noise = noise
        self.parameters = []
        for each in data["parameters"]:
            each = dict(each)
            each["values"] = tuple(each.get("values", ()))
            if each.get("active_if"):
                each["active_if"] = (each["active_if"][0], tuple(each["active_if"][1]))
            self.parameters.append(Parameter(**each))
        keys = (self._key(each) for each in configurations(self.parameters))
        self.true = {key: cost for key, cost in zip(keys, data["costs"], strict=True) if cost is not None}
        self.best = min(self.true.values())

    def _key(self, configuration):
        on = active(self.parameters, configuration)
        return json.dumps({name: configuration[name] for name in sorted(on)}, sort_keys=True)

    def gap(self, configuration):
        return self.true.get(self._key(configuration), math.inf) / self.best


class Limited(Problem):
    """The time of zlib with a limit on what comes out (see `record_pairs.py`), with 3 % noise: 63 % of the settings exceed it,
    and cannot be used. The default can."""

    failing, noise, limits = 0.63, 0.03, ("size",)

    def __init__(self, path):
        pair = json.loads(pathlib.Path(path).read_text())
        self.name = pair["name"]
        self.parameters = [self._parameter(name, values, pair["default"][name]) for name, values in pair["parameters"].items()]
        both = zip(pair["first"], pair["second"], strict=True)
        self.known = dict(zip(itertools.product(*pair["parameters"].values()), both, strict=True))
        self.limit = sorted(pair["second"])[int((1 - self.failing) * len(self.known))]
        self.best = min(cost for cost, size in self.known.values() if size <= self.limit)

    @staticmethod
    def _parameter(name, values, default):
        if isinstance(default, str):
            return Parameter(name, "choice", values=tuple(values), default=default)
        return Parameter(name, "integer", values[0], values[-1], default=default)

    def _pair(self, configuration):
        return self.known[tuple(configuration[each.name] for each in self.parameters)]

    def excess(self, configuration):
        return {"size": self._pair(configuration)[1] - self.limit}

    def gap(self, configuration):
        cost, size = self._pair(configuration)
        return cost / self.best if size <= self.limit else math.inf


class Kernel(Problem):
    """A compute kernel's recorded landscape, as Kernel Tuner writes it: every combination that can be run, all else cannot.

    The true cost is the mean time; what an optimiser sees is one of the recorded runs, drawn at random. The default is
    the first combination that was recorded, and no good one. What the constraints allow may still fail.
    """

    def __init__(self, path, constraints=()):
        self.constraints = constraints
        data = json.loads(pathlib.Path(path).read_text())
        self.name = pathlib.Path(path).parent.name + "/" + data["kernel_name"]
        names = [name for name, values in data["tune_params"].items() if len(values) > 1]
        rows = {tuple(row[name] for name in names): row for row in data["cache"].values()}
        self.runs = {key: row["times"] for key, row in rows.items() if isinstance(row.get("time"), float)}
        self.parameters = [
            Parameter(name, "choice", values=tuple(data["tune_params"][name]), default=default)
            for name, default in zip(names, next(iter(self.runs)))
        ]
        self.true = {key: float(numpy.mean(runs)) for key, runs in self.runs.items()}
        self.best = min(self.true.values())

    def _key(self, configuration):
        return tuple(configuration[parameter.name] for parameter in self.parameters)

    def gap(self, configuration):
        return self.true.get(self._key(configuration), math.inf) / self.best

    def measure(self, configuration, random):
        runs = self.runs.get(self._key(configuration))
        return float(random.choice(runs)) if runs else None


class MadeKernel(Problem):
    """A kernel of `kernels.py` on a device that the seed draws, with 5 % noise. Its constraints are told. What runs out of
    registers or memory fails, and nobody is told. The default is the first configuration that can be run, and no good one."""

    noise = 0.05

    def __init__(self, kernel, seed):
        random = numpy.random.default_rng([17, KERNELS.index(kernel), seed])
        self.name, self.constraints = kernel.name, kernel.constraints
        names, device = list(kernel.values), random.uniform(size=4)
        self.true = {}
        for values in itertools.product(*kernel.values.values()):
            configuration = dict(zip(names, values))
            if not broken(self.constraints, configuration):
                cost, rough = kernel.cost(device=device, **configuration), math.exp(0.04 * random.standard_normal())
                self.true |= {values: cost * rough} if cost is not None else {}
        self.parameters = [
            Parameter(name, "choice", values=kernel.values[name], default=default)
            for name, default in zip(names, next(iter(self.true)))
        ]
        self.best = min(self.true.values())

    def gap(self, configuration):
        return self.true.get(tuple(configuration[each.name] for each in self.parameters), math.inf) / self.best


# As `mocktest_kernel_convolution.json` beside the recorded landscape has them.
CONVOLUTION = ("block_size_x * block_size_y >= 64", "block_size_x * block_size_y <= 1024", "tile_size_x * tile_size_y < 30")
# Looked at while the search was made, by this comparison or by an example of the laboratory.
BBOB_FUNCTIONS = (1, 2, 3, 6, 8, 10, 12, 13, 15, 17, 20, 21)
# Looked at by neither: no constant was chosen on them.
BBOB_HELD_OUT = (4, 5, 11, 18, 19, 22, 23, 24)
DIMENSIONS = (2, 5, 10)
# Instances of held-out functions: another one for each seed, so that shifts and rotations differ too.
INSTANCES_FROM = 101
GRIDS_HELD_OUT_FROM = 5000
# Where the landscapes are that are kept.
RECORDED = pathlib.Path(__file__).resolve().parent / "recorded"


def suite(name, folder=None):
    """The problems of a suite by name: functions that make one for a run's seed."""
    held_out = [(function, dimension) for function in BBOB_HELD_OUT for dimension in DIMENSIONS]
    if name == "bbob-held-out":
        return [lambda seed, of=of: Bbob(*of, INSTANCES_FROM + seed, 0.1) for of in held_out]
    if name == "floor-held-out":
        return [lambda seed, of=of: Floor(*of, INSTANCES_FROM + seed, 0.1) for of in held_out]
    if name in ("bbob", "bbob-noiseless"):
        noise = 0.0 if name == "bbob-noiseless" else 0.1
        return [
            lambda _, function=function, dimension=dimension: Bbob(function, dimension, 1, noise)
            for function in BBOB_FUNCTIONS
            for dimension in DIMENSIONS
        ]
    if name in ("grid", "grid-told"):
        return [lambda _, number=number: Grid(number, name == "grid-told") for number in range(8)]
    if name in ("grid-held-out", "grid-told-held-out"):
        is_told = name == "grid-told-held-out"
        return [lambda seed, number=number: Grid(GRIDS_HELD_OUT_FROM + 8 * seed + number, is_told) for number in range(8)]
    if name in ("kernel", "kernel-told"):
        constraints = CONVOLUTION if name == "kernel-told" else ()
        return [lambda _, path=path: Kernel(path, constraints) for path in sorted(pathlib.Path(folder).glob("mock_gpu.json"))]
    if name == "made-kernels":
        return [lambda seed, kernel=kernel: MadeKernel(kernel, seed) for kernel in KERNELS]
    if name == "zlib":
        return [lambda _, of=of: Limited(RECORDED / f"zlib-{of}-size.json") for of in ("words", "mesh")]
    if name == "recorded":
        return [lambda _, path=path: Recorded(path) for path in sorted(pathlib.Path(folder).glob("*.json"))]
    raise SystemExit(f"there is no suite {name}; there are {', '.join(SUITES)}")


SUITES = ("bbob", "bbob-noiseless", "bbob-held-out", "floor-held-out", "grid", "grid-held-out", "grid-told", "grid-told-held-out",
          "kernel", "kernel-told", "made-kernels", "recorded", "zlib")
