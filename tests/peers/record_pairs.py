#!/usr/bin/env python3
"""Records pairs of objectives that conflict: how long zlib takes with every configuration, and what it needs for that.

    tests/peers/record_pairs.py --out tests/peers/recorded

writes `zlib-words-size.json`, `zlib-mesh-size.json` (processor time beside compressed bytes) and `zlib-words-memory.json`
(processor time beside the bytes that zlib allocates, by the formula of its `zconf.h`). The inputs are made here, so that
anybody can repeat it. A time is the least of its rounds, because other work makes a run slower, never faster.

A pair holds `parameters`, and for each configuration, the last parameter fastest, `first` and `second`, both as multiples of
what zlib's own default needs.
"""

import argparse
import itertools
import json
import math
import pathlib
import random
import struct
import time
import zlib

PARAMETERS = {"level": list(range(1, 10)), "memory_level": list(range(1, 10)), "window_bits": list(range(9, 16)),
              "strategy": ["default", "filtered", "huffman", "runs", "fixed"]}
DEFAULT = {"level": 6, "memory_level": 8, "window_bits": 15, "strategy": "default"}
STRATEGIES = {"default": zlib.Z_DEFAULT_STRATEGY, "filtered": zlib.Z_FILTERED, "huffman": zlib.Z_HUFFMAN_ONLY, "runs": zlib.Z_RLE,
              "fixed": zlib.Z_FIXED}


def words(size):
    """Sentences of words that are as frequent as in a language: the n-th in proportion to 1/n."""
    of = random.Random(1)
    letters = "etaoinshrdlucmfwypvbgkjqxz"
    known = ["".join(of.choices(letters, weights=range(26, 0, -1), k=of.randint(2, 9))) for _ in range(3000)]
    text = " ".join(of.choices(known, weights=[1 / (1 + place) for place in range(len(known))], k=size // 4))
    return text.encode()[:size]


def mesh(size):
    """Vertices of a rippled sphere as 32-bit floats, then triangles as 32-bit indices."""
    side = int(math.sqrt(size / 36))
    data = bytearray()
    for i, j in itertools.product(range(side), repeat=2):
        around, up = 2 * math.pi * i / side, math.pi * j / side
        radius = 1 + 0.1 * math.sin(9 * around) * math.sin(7 * up)
        data += struct.pack("<3f", radius * math.sin(up) * math.cos(around), radius * math.cos(up), radius * math.sin(up) * math.sin(around))
    for i, j in itertools.product(range(side - 1), repeat=2):
        at = i * side + j
        data += struct.pack("<6I", at, at + 1, at + side, at + side, at + 1, at + side + 1)
    return bytes(data)


def compress(data, of):
    packer = zlib.compressobj(of["level"], zlib.DEFLATED, of["window_bits"], of["memory_level"], STRATEGIES[of["strategy"]])
    return len(packer.compress(data)) + len(packer.flush())


def memory(of):
    return (1 << (of["window_bits"] + 2)) + (1 << (of["memory_level"] + 9))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bytes", type=int, default=200_000, help="size of the inputs")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--out", type=pathlib.Path, required=True, help="a folder")
    options = parser.parse_args()
    every = [dict(zip(PARAMETERS, values)) for values in itertools.product(*PARAMETERS.values())]
    for name, data in (("words", words(options.bytes)), ("mesh", mesh(options.bytes))):
        times, sizes = [math.inf] * len(every), [0] * len(every)
        for turn in range(options.rounds):
            for place, of in enumerate(every):
                begin = time.process_time_ns()
                sizes[place] = compress(data, of)
                times[place] = min(times[place], time.process_time_ns() - begin)
            print(f"\r{name}: round {turn + 1} of {options.rounds}", end="", flush=True)
        print()
        default = every.index(DEFAULT)
        seconds = {"size": sizes} | ({"memory": [memory(of) for of in every]} if name == "words" else {})
        for what, of in seconds.items():
            pair = {"name": f"zlib-{name}-{what}", "about": f"zlib {zlib.ZLIB_RUNTIME_VERSION}, {len(data)} bytes, least of {options.rounds} rounds",
                    "parameters": PARAMETERS, "default": DEFAULT,
                    "first": [round(value / times[default], 3) for value in times], "second": [round(value / of[default], 3) for value in of]}
            (options.out / f"zlib-{name}-{what}.json").write_text(json.dumps(pair) + "\n")


if __name__ == "__main__":
    main()
