#!/usr/bin/env python3
"""Batches of rays from Python by embreex, tuned per mesh and batch by a Treewright daemon.

    embreex_tuned.py --probe libtreewright_probe.so --trials 30 --rays 3000,300000 [--rounds 9] SCENE.ply ...

A batch rebuilds its scene, as for meshes that move, and asks for the closest hits of all its rays at once. embreex lets nobody choose how Embree
builds: what can be set goes through the probe's preloaded library, with which this program starts itself again. Its scenes are robust, and stay so.
Cost is build plus rays in milliseconds of processor time. With --rounds the tuned configuration is then measured against the default
and every fixed one, in turns within each round. Lines of JSON go to standard output.
"""

import argparse
import ctypes
import os
import sys
import time

import numpy
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene

import measured
import treewright

LAYOUTS = ["auto", "compact", "bvh4.triangle4v"]
# embreex's own way comes first.
FIXED = [{"quality": "medium", "layout": layout} for layout in LAYOUTS] + [{"quality": "low"}]


class Caster:
    """Runs batches with a configuration: devices by their text, a scene for each batch."""

    def __init__(self, probe):
        self.set, self.devices = probe.treewright_probe_set, {}
        self.set.argtypes, self.set.restype = [ctypes.c_char_p], ctypes.c_bool

    def run(self, configuration, mesh, rays):
        layout = configuration.get("layout", "auto")
        named = layout not in ("auto", "compact")
        device = "threads=1" + (f",tri_accel={layout}" if named else "")
        words = [f"device={device}", f"quality={configuration['quality']}", f"compact={'on' if layout == 'compact' else 'off'}"]
        assert self.set(";".join(words).encode()), words
        if device not in self.devices:
            self.devices[device] = EmbreeDevice()
        start = time.process_time()
        scene = EmbreeScene(self.devices[device])
        TriangleMesh(scene, *mesh)
        scene.run(rays[0][:1], rays[1][:1])  # commits
        built = time.process_time()
        hits = scene.run(*rays)
        return {"build_ms": 1e3 * (built - start), "rays_ms": 1e3 * (time.process_time() - built)}, hits


def batch(mesh, count):
    """Rays in all directions from within the box of the mesh."""
    numbers = numpy.random.default_rng(1)
    low, high = mesh[0].min(0), mesh[0].max(0)
    origins = low + (high - low) * numbers.random((count, 3), "f4")
    directions = numbers.standard_normal((count, 3), "f4")
    return origins.astype("f4"), directions / numpy.linalg.norm(directions, axis=1, keepdims=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:50611")
    parser.add_argument("--probe", required=True, help="libtreewright_probe.so")
    parser.add_argument("--trials", type=int, default=30)
    parser.add_argument("--rays", default="3000,300000")
    parser.add_argument("--rounds", type=int, default=0)
    parser.add_argument("scenes", nargs="+")
    options = parser.parse_args()
    library = os.path.abspath(options.probe)
    if library not in os.environ.get("LD_PRELOAD", ""):
        os.environ["LD_PRELOAD"] = library
        os.execv(sys.executable, [sys.executable, *sys.argv])
    caster = Caster(ctypes.CDLL(None))
    client = treewright.Client(options.url, client_id="embreex-example", deadline_ms=60000)
    space = treewright.Space().choice("quality", ["low", "medium"], default="medium")
    space.choice("layout", LAYOUTS, default="auto", active_if=("quality", "medium"))
    indicators = {"triangles": (0.0, 1e8, "log"), "rays": (0.0, 1e9, "log")}
    study = client.study("embreex-example", space, minimise={"build_ms": 1.0, "rays_ms": 1.0}, indicators=indicators)
    for path in options.scenes:
        mesh = measured.read(path)
        for count in map(int, options.rays.split(",")):
            rays = batch(mesh, count)
            known = {"triangles": len(mesh[1]), "rays": count}

            def run(configuration):
                return caster.run(configuration, mesh, rays)

            costs, best = measured.tune(client, study, known, run, FIXED, options.trials)
            compared = measured.compare(run, best, FIXED, options.rounds) if options.rounds else {}
            measured.show(path, len(mesh[1]), f"{count} rays", costs, best, compared)


if __name__ == "__main__":
    main()
