#!/usr/bin/env python3
"""How soon a change of 10 % can be seen at all, and how soon the tuner's rule sees it, by simulation in two seconds.

    tools/change_bounds.py

The bound is the cumulative sum that knows the size of the change, the noise and all costs before (Page 1954; no method
has a shorter worst delay for its rate of false alarms: Moustakides 1986), with one false alarm in 10,000 frames. "In
turns" it compares two configurations, because nobody knows the speed of the machine. The rule is that of
`server/core/src/statistics/drift.rs` and `server/core/src/tuner/knowledge/rechecks.rs`, with noise estimated to a
tenth. Two frames are added to its delays: the first of another search is the default, and the second tries a
configuration.
"""

import math
import random

CHANGE, ALARM_AFTER, FRAMES, RUNS = math.log(1.1), 10_000, 10, 600
# As in drift.rs and rechecks.rs.
STEP, GATE, JUMP, FORGIVEN, SHIFTED = 0.25, 4.0, 0.5, 1.5, 1.5
SOUGHT, EXPLAINED, UNEXPLAINED, UNCHANGED, APART, RATIOS = 0.095, 3.5, 7.0, -4.0, 4.0, (2, 6)


def frames_to_alarm(forgiven, height, cells=24):
    """Mean frames to a false alarm of a one-sided sum (Brook and Evans 1972)."""
    width = 2 * height / (2 * cells - 1)
    below = lambda x: 0.5 * math.erfc(-(x + forgiven) / math.sqrt(2))
    rows = []
    for start in range(cells):
        steps = [(end - start) * width for end in range(cells)]
        row = [below(step + width / 2) - (below(step - width / 2) if end else 0) for end, step in enumerate(steps)]
        rows.append([(start == end) - share for end, share in enumerate(row)] + [1.0])
    for place, pivot in enumerate(rows):
        for row in rows[place + 1:]:
            factor = row[place] / pivot[place]
            row[place:] = [a - factor * b for a, b in zip(row[place:], pivot[place:])]
    mean = [0.0] * cells
    for place in reversed(range(cells)):
        rest = sum(rows[place][other] * mean[other] for other in range(place + 1, cells))
        mean[place] = (rows[place][cells] - rest) / rows[place][place]
    return mean[0]


def bound(deviations):
    low, high = 0.0, 12.0
    while high - low > 0.02:
        middle = (low + high) / 2
        low, high = (middle, high) if frames_to_alarm(deviations / 2, middle) < ALARM_AFTER else (low, middle)
    delays = []
    for _ in range(RUNS):
        total, frames = 0.0, 0
        while total <= high:
            total, frames = max(0.0, total + random.gauss(deviations / 2, 1)), frames + 1
        delays.append(frames)
    return delays


class Machine:
    """The tuner's view of a finished state's answer."""

    def __init__(self, sigma):
        estimate = lambda: sigma * (1 + 0.12 * random.gauss(0, 1))
        self.own = max(estimate(), estimate())
        self.noise = max(self.own, estimate())
        self.ratio_variance = self.noise**2 * (1 / 16 + 1 / 9)
        self.known = [random.gauss(0, sigma / 4), random.gauss(0, sigma / 3)]
        self.factor = self.variance = self.rise = self.fall = 0.0
        self.suspects = self.check = None

    def hold(self, seen):
        noise = self.own * math.sqrt(1 + 1 / 16)
        self.variance = min(self.variance + (STEP * noise) ** 2, JUMP**2)
        spread, off = math.sqrt(self.variance + noise**2), seen - self.factor
        is_far = abs(off) > GATE * spread
        has_jumped = is_far and self.suspects is not None and abs(seen - self.suspects) <= GATE * noise
        self.suspects = seen if is_far and not has_jumped else None
        if has_jumped:
            self.variance, self.rise, self.fall = JUMP**2, 0.0, 0.0
        if self.suspects is None:
            gain = self.variance / (self.variance + noise**2)
            self.factor, self.variance = self.factor + gain * off, self.variance * (1 - gain)
        if has_jumped:
            return True
        off = max(-GATE, min(GATE, off / spread))
        self.rise, self.fall = max(0.0, self.rise + off - FORGIVEN), max(0.0, self.fall - off - FORGIVEN)
        return max(self.rise, self.fall) > SHIFTED and self.suspects is None

    def finding(self):
        pairs = self.check["pairs"]
        count = len(pairs)
        change, shift = (sum(pair[place] for pair in pairs) / count for place in (0, 1))
        variance = 2 * self.noise**2 / count + self.ratio_variance
        evidence = lambda size, seen: size * (seen - size / 2) / variance
        of_change, shares = evidence(SOUGHT, abs(change)), change * shift < 0 and abs(change) >= abs(shift) / 2
        least = EXPLAINED if shares and abs(shift) >= SOUGHT / 2 else UNEXPLAINED
        if count >= RATIOS[0] and of_change >= least and all(pair[0] * change > 0 for pair in pairs):
            return "state"
        of_shift = evidence(max(SOUGHT, abs(shift)), -math.copysign(change, change * shift))
        is_none = of_change <= UNCHANGED or of_change <= 0 and of_shift <= UNCHANGED
        return "machine" if is_none or count == RATIOS[1] else None

    def wants_other(self):
        return self.check is not None and self.check["other"] is None

    def take(self, seen, is_other):
        """Takes the logarithm of a cost over that before; whether the state has changed."""
        seen -= self.known[is_other]
        check = self.check
        if check is not None and is_other:
            check["other"] = seen
        elif check is not None:
            if abs(seen - check["before"]) <= APART * math.sqrt(2) * self.noise:
                check["pairs"].append((check["other"] - seen, seen - check["level"]))
            check["before"], check["other"] = seen, None
            finding = self.finding() if check["pairs"] else None
            if finding == "state":
                return True
            if finding:
                self.check = None
        level = self.factor if abs(self.factor) > 2 * self.own else 0.0
        if self.hold(seen) and not is_other:
            self.rise = self.fall = 0.0
            if self.check is None:
                self.check = {"before": seen, "other": None, "level": level, "pairs": []}
        return False


def watched(sigma, frames, changes_at=None, is_loaded=False):
    """Frames at which the rule finds a change, and the number of frames that ran the default."""
    machine, load, until, found, others = Machine(sigma), 0.0, 0, [], 0
    for frame in range(frames):
        if is_loaded and frame >= until:
            load, until = math.log(random.choice((1.0, 1.6, 2.2))), frame + random.randrange(5, 25)
        is_other = machine.wants_other()
        others += is_other
        dearer = CHANGE if changes_at is not None and frame >= changes_at and not is_other else 0.0
        if machine.take(random.gauss(load + dearer, sigma), is_other):
            found.append(frame)
            if changes_at is not None:
                break
            machine = Machine(sigma)
    return found, others


def main():
    random.seed(1)
    share = lambda delays: f"{100 * sum(delay <= FRAMES for delay in delays) / len(delays):.0f} %"
    print("noise  | known speed: mean, within 10 | in turns: mean, within 10 | the rule: within 10")
    for sigma in (0.01, 0.02, 0.03, 0.05):
        bounds = [bound(CHANGE / sigma / parts) for parts in (1, 2)]
        cells = [f"{sum(delays) / RUNS:.1f}, {share(delays)}" for delays in bounds]
        found = [watched(sigma, 60, 30)[0] for _ in range(RUNS)]
        cells.append(share([one[0] - 30 + 3 if one and one[0] >= 30 else 99 for one in found]))
        print(f"{100 * sigma:.0f} %    | " + " | ".join(cells))
    for sigma, is_loaded in ((0.02, False), (0.02, True), (0.05, False), (0.05, True)):
        found, others = zip(*(watched(sigma, 1000, None, is_loaded) for _ in range(40)))
        alarms, others = sum(map(len, found)) / 4, sum(others) / 400
        print(f"{100 * sigma:.0f} %, {'0 to 2 other programs' if is_loaded else 'quiet'}: "
              f"{alarms:.1f} alarms in 10,000 frames, {others:.1f} % of frames run the default")


if __name__ == "__main__":
    main()
