#!/usr/bin/env python3
"""A cache for Helion's autotuner that answers shapes which were never tuned by what is known of those near them.

    helion_cache.py [--local | --url URL]

Helion's own caches answer the exact key of a shape. This one is a class like them, for kernels with a list of configurations: what Helion measures goes
into a study whose indicators are the sizes of the tensors, and a shape that was not met before gets the configuration that the daemon predicts; where it
knows nothing, Helion tunes. As in `@helion.kernel(autotuner_fn=tuned_by(client, [helion.Config(...), ...]))`.

Wants helion and what it needs. Without a graphics processor the example runs by its Pallas backend, interpreted, which wants jax; what it
measures there is the interpreter. Tried with Helion 1.5.1, whose classes for this are not promised to stay.
"""

import argparse
import hashlib
import math
import os

import torch

if __name__ == "__main__" and not torch.cuda.is_available():
    os.environ.update(HELION_BACKEND="pallas", HELION_PALLAS_INTERPRET="1")

import helion
import helion.language as hl
from helion.autotuner import FiniteSearch
from helion.autotuner.base_cache import AutotuneCacheBase, BoundKernelInMemoryCacheKey

import treewright
from treewright.autotune import NearestCache


class TreewrightCache(AutotuneCacheBase):
    """Helion's autotuner makes one for each kernel and shape."""

    client = None

    def __init__(self, autotuner, **more):
        super().__init__(autotuner, **more)
        self.measured = []
        benchmark = autotuner.benchmark_batch

        def noted(configs, **named):
            results = benchmark(configs, **named)
            self.measured += [(result.config, result.perf) for result in results]
            return results

        # The loop of a search keeps only its winner.
        autotuner.benchmark_batch = noted
        self.numbers = {str(number): config for number, config in enumerate(autotuner.configs)}
        tensors = [each for each in self.args if isinstance(each, torch.Tensor)]
        self.shape = {f"size_{at}_{axis}": size for at, each in enumerate(tensors) for axis, size in enumerate(each.shape)}
        # What configurations mean, and how long they take, holds for one kernel, list and device.
        device = torch.cuda.get_device_name() if tensors[0].is_cuda else "cpu"
        said = repr([self.kernel.kernel.name, device, [each.dtype for each in tensors], *self.numbers.values()])
        study = f"helion-{hashlib.sha256(said.encode()).hexdigest()[:12]}"
        space = treewright.Space().choice("config", list(self.numbers), default="0")
        self.known = NearestCache(self.client, study, space, sizes=tuple(self.shape))

    def get(self):
        known = self.known.get(self.shape)
        return None if known is None else self.numbers[known["config"]]

    def put(self, config):
        names = {config: name for name, config in self.numbers.items()}
        for config, ms in self.measured:
            if math.isfinite(ms):
                self.known.put(self.shape, {"config": names[config]}, ms=ms)

    def _get_cache_key(self):
        return BoundKernelInMemoryCacheKey(specialization_key=tuple(self.shape.items()), extra_results=())

    def _list_cache_entries(self):
        return []


def tuned_by(client, configs):
    """What a kernel takes as its autotuner_fn; it has no configs of its own, which Helion would tune without asking."""
    cache = type("TreewrightCache", (TreewrightCache,), {"client": client})
    return lambda kernel, args, **_more: cache(FiniteSearch(kernel, args, configs))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:50611")
    parser.add_argument("--local", action="store_true", help="a daemon of your own, started when it is needed")
    options = parser.parse_args()
    patient = {"client_id": "helion-cache", "deadline_ms": 60000}
    client = treewright.Client.local(**patient) if options.local else treewright.Client(options.url, **patient)

    blocks = [helion.Config(block_sizes=[size]) for size in (128, 256, 1024)]

    @helion.kernel(autotuner_fn=tuned_by(client, blocks), static_shapes=True)
    def add(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        out = torch.empty_like(x)
        for tile in hl.tile(out.size(0)):
            out[tile] = x[tile] + y[tile]
        return out

    for size in (2048, 4096, 3072, 6144):
        x, before = torch.ones(size, device="cuda" if torch.cuda.is_available() else "cpu"), len(trials(client))
        assert torch.equal(add(x, x), x + x)
        ran = len(trials(client)) - before
        print(f"{size} numbers:", f"Helion measured {ran} configurations" if ran else "answered by the shapes near it", flush=True)


def trials(client):
    return [trial for study in client.studies() if study.startswith("helion-") for trial in client.existing_study(study).trials()]


if __name__ == "__main__":
    main()
