"""Ratios within rounds, for the scripts beside this one. Python runs a script with its own folder on the path."""

import math
import statistics


def ratio(numerators, denominators):
    """The median of the rounds' ratios and the ends of its 95 % interval, which lies between two of the sorted ratios and
    supposes nothing about how they are distributed (Hahn and Meeker, Statistical Intervals, 1991, section 5.2). Fewer than
    six rounds have no interval: its ends are infinite."""
    ratios = sorted(a / b for a, b in zip(numerators, denominators))
    count = len(ratios)
    outside, below = 0, 0.5**count
    while outside < count // 2 and below <= 0.025:
        outside += 1
        below += math.comb(count, outside) * 0.5**count
    ends = (ratios[outside - 1], ratios[-outside]) if outside else (-math.inf, math.inf)
    return statistics.median(ratios), ends
