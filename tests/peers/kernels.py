"""Compute kernels that are made up: their parameters, the constraints that a user would write, and what they cost.

Costs are rooflines of arithmetic and traffic, times what a device's occupancy, vectors and conflicts add. `device` holds
four numbers from 0 to 1. A cost of None is a kernel that fails although its constraints hold. No constant of the search
was chosen on them.
"""

import dataclasses
import math
import typing


@dataclasses.dataclass(frozen=True)
class Kernel:
    name: str
    values: dict
    constraints: tuple
    cost: typing.Callable


def off(value, best):
    """Distance of a value from the best one, in powers of two."""
    return abs(math.log2(value / best))


def hidden(threads, registers, memory, needed):
    """A factor for the latency that too few resident threads leave; None where not one block is resident."""
    blocks = min(2048 // threads, int(65536 // (registers * threads)), int(98304 // max(memory, 1)))
    return 1 + 0.6 * max(0.0, 1 - blocks * threads / needed) if blocks else None


def matrix_product(mwg, nwg, kwg, mdim, ndim, vector, share_a, share_b, device):
    tile = (mwg // mdim) * (nwg // ndim)
    latency = hidden(mdim * ndim, 24 + 1.5 * tile + 2 * vector, 4 * kwg * (share_a * mwg + share_b * nwg), 512 + 1024 * device[0])
    if latency is None:
        return None
    arithmetic = 1 + 1.2 / tile ** (0.4 + 0.4 * device[1]) + 2.0 / kwg
    traffic = (0.4 + device[2]) * (48 / nwg * (1.5 - 0.5 * share_a) + 48 / mwg * (1.4 - 0.4 * share_b))
    return max(arithmetic, traffic) * latency * (1 + 0.09 * off(vector, 4 if device[3] > 0.5 else 2))


def stencil(block_x, block_y, tile_x, tile_y, time, unroll, read_only, device):
    width, height, cells = block_x * tile_x + 2 * time, block_y * tile_y + 2 * time, tile_x * tile_y
    latency = hidden(block_x * block_y, 18 + 3 * cells + cells * unroll, 4 * width * height, 768 + 768 * device[0])
    if latency is None:
        return None
    redundant = width * height / (block_x * tile_x * block_y * tile_y)
    arithmetic = redundant * (1 + 0.25 / cells + 0.06 * off(unroll, 2))
    traffic = redundant * (1 + 3 * device[1]) / time * (1.0 - 0.15 * device[2] * read_only)
    return max(arithmetic, traffic) * latency * (1 + 0.3 * max(0.0, math.log2(32 / block_x))) * (1 + 0.05 * read_only * device[3])


def histogram(block, items, vector, bins, copies, passes, staged, device):
    latency = hidden(block, 16 + 2 * items * vector, 4 * (bins * copies + staged * block * items), 1024 + 768 * device[0])
    if latency is None:
        return None
    conflicts = 1 + (1 + 2 * device[1]) * block / (bins * copies)
    merge = 1 + 0.004 * bins * copies / items * (0.3 + device[2]) / 16
    traffic = passes ** (0.5 + 0.3 * device[3]) * (1.25 - 0.25 * staged) * (1 + 0.12 * off(vector, 4))
    return max(conflicts, traffic) * merge * latency * (1 + 0.2 / items + 0.03 * staged * off(items, 8))


KERNELS = (
    Kernel(
        "matrix product",
        {"mwg": (16, 32, 64, 128), "nwg": (16, 32, 64, 128), "kwg": (8, 16, 32), "mdim": (8, 16, 32), "ndim": (8, 16, 32),
         "vector": (1, 2, 4, 8), "share_a": (0, 1), "share_b": (0, 1)},
        ("mwg % (mdim * vector) == 0", "nwg % ndim == 0", "mdim * ndim <= 512", "kwg * (share_a * mwg + share_b * nwg) <= 6144"),
        matrix_product),
    Kernel(
        "stencil",
        {"block_x": (8, 16, 32, 64, 128), "block_y": (1, 2, 4, 8, 16, 32), "tile_x": (1, 2, 4, 8), "tile_y": (1, 2, 4, 8),
         "time": (1, 2, 3, 4, 6, 8), "unroll": (1, 2, 3, 4), "read_only": (0, 1)},
        ("block_x * block_y >= 32", "block_x * block_y <= 1024", "time % unroll == 0",
         "(block_x * tile_x + 2 * time) * (block_y * tile_y + 2 * time) <= 12288"),
        stencil),
    Kernel(
        "histogram",
        {"block": (32, 64, 128, 256, 512, 1024), "items": (1, 2, 4, 8, 16, 32), "vector": (1, 2, 4, 8),
         "bins": (64, 128, 256, 512, 1024), "copies": (1, 2, 4, 8, 16, 32), "passes": (1, 2, 4, 8, 16), "staged": (0, 1)},
        ("items % vector == 0", "bins * passes >= 1024", "bins * passes <= 2048", "bins * copies <= 12288"),
        histogram),
)
