"""What optimisers have in common: the interface, and the places of values in the unit interval."""

import math


class Method:
    """`propose()` is the method's own idea; `ask()` begins with the default configuration."""

    # What `recommend` goes by.
    recommends = "best measured"
    # Whether it is told what a problem's constraints allow.
    takes_constraints = False

    def __init__(self, parameters, constraints, budget, seed):
        self.parameters, self.constraints, self.budget, self.seed = parameters, constraints, budget, seed
        self.told = []
        self.worst = 1.0

    @classmethod
    def takes(cls, problem):
        """Whether everything that a problem tells can be told to it."""
        return cls.takes_constraints or not problem.constraints

    def default(self):
        return {parameter.name: parameter.default for parameter in self.parameters}

    def ask(self):
        return self.propose() if self.told else self.default()

    def penalty(self, cost):
        """A number for optimisers that only know numbers."""
        if cost is None:
            return 2.0 * self.worst
        self.worst = max(self.worst, cost)
        return cost

    def exceeds(self, excess):
        """Hears by how much the configuration that it asked for exceeds each limit, before `tell`. Most have no word for it."""

    def tell(self, configuration, cost):
        self.told.append((configuration, cost))

    def recommend(self):
        known = [(cost, index) for index, (_, cost) in enumerate(self.told) if cost is not None]
        return self.told[min(known)[1]][0] if known else self.default()

    def close(self):
        pass


def is_ordered(parameter):
    """Whether it is a choice of numbers, whose order counts."""
    return parameter.kind == "choice" and all(isinstance(value, (int, float)) for value in parameter.values)


def from_unit(parameter, u):
    """The value at a place of the unit interval."""
    u = min(max(float(u), 0.0), 1.0)
    if parameter.kind == "switch":
        return u >= 0.5
    if parameter.kind == "choice":
        return parameter.values[min(int(u * len(parameter.values)), len(parameter.values) - 1)]
    low, high = parameter.low, parameter.high
    if parameter.kind == "integer":
        if parameter.log:
            return int(min(max(round(math.exp(math.log(low) + u * (math.log(high) - math.log(low)))), low), high))
        return int(min(low + int(u * (high - low + 1)), high))
    if parameter.log:
        return math.exp(math.log(low) + u * (math.log(high) - math.log(low)))
    return low + u * (high - low)


def to_unit(parameter, value):
    """The middle of the places of the unit interval that `from_unit` takes for this value."""
    if parameter.kind == "switch":
        return 0.75 if value else 0.25
    if parameter.kind == "choice":
        return (parameter.values.index(value) + 0.5) / len(parameter.values)
    low, high = parameter.low, parameter.high
    if parameter.log:
        return math.log(value / low) / math.log(high / low)
    return (value - low + 0.5) / (high - low + 1) if parameter.kind == "integer" else (value - low) / (high - low)


class Driver(Method):
    """One that calls a cost function itself: `search()` runs in a thread and has a configuration measured by `measured`."""

    def __init__(self, parameters, constraints, budget, seed):
        import queue
        import threading

        super().__init__(parameters, constraints, budget, seed)
        self.asked, self.answers = queue.Queue(), queue.Queue()
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self):
        try:
            self.search()
        except SystemExit:
            pass
        except BaseException as error:  # a question that is never answered would wait for ever
            self.asked.put(error)

    def measured(self, configuration):
        """The cost, or None where it cannot be run."""
        self.asked.put(configuration)
        answer = self.answers.get()
        if answer is StopIteration:
            raise SystemExit
        return answer

    def ask(self):
        asked = self.asked.get()
        if isinstance(asked, BaseException):
            raise asked
        return asked

    def tell(self, configuration, cost):
        super().tell(configuration, cost)
        self.answers.put(cost)

    def close(self):
        self.answers.put(StopIteration)
        self.thread.join()
