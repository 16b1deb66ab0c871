#!/usr/bin/env python3
"""Batches of rays from Python straight through Embree's own entry points by ctypes, tuned per mesh and batch by a Treewright daemon.

    embree_caster.py --trials 30 --rays 65536,1048576 [--rounds 9] [--embree libembree4.so.4] SCENE.ply ...

Sixteen rays a call, from arrays of numpy: so tracing, not Python, is what a batch takes. A batch rebuilds its scene, as for meshes that move. What
is tuned is how the scene is built, and whether Embree keeps the rays of a call together (coherent) or follows each by itself, which is
its default. Two kinds of batches: a camera's picture in tiles of 4 by 4, and rays that are scattered all over the mesh. Cost is build
plus rays in milliseconds of processor time. With --rounds the tuned configuration is then measured against the default and every fixed one, in
turns within each round. Lines of JSON go to standard output. Without --embree the library that PyPI's embreex brings is taken.
"""

import argparse
import ctypes
import glob
import importlib.util
import math
import os
import time

import numpy

import measured
import treewright

LAYOUTS = ["auto", "compact", "bvh4.triangle4"]
FIXED = [{"quality": quality, "rays": rays} | ({"layout": "auto"} if quality == "medium" else {})
         for quality in ["medium", "low", "high"] for rays in ["incoherent", "coherent"]]  # Embree's own way comes first.
FIXED += [{"quality": "medium", "rays": rays, "layout": layout} for layout in LAYOUTS[1:] for rays in ["incoherent", "coherent"]]
QUALITY = {"low": 0, "medium": 1, "high": 2}
COMPACT, COHERENT = 1 << 1, 1 << 16
TRIANGLE, INDEX, VERTEX, UINT3, FLOAT3 = 0, 0, 1, 0x5003, 0x9003
# Rows of an RTCRayHit16: org x y z, tnear, dir x y z, time, tfar, mask, id, flags; Ng x y z, u, v, primID, geomID, instID; and some to spare.
ORIGIN, DIRECTION, TFAR, MASK, PRIMITIVE, GEOMETRY, ROWS = slice(0, 3), slice(4, 7), 8, 9, 17, 18, 24
NOTHING = 0xFFFFFFFF


class Arguments(ctypes.Structure):
    """RTCIntersectArguments."""

    _fields_ = [("flags", ctypes.c_int), ("features", ctypes.c_uint), ("context", ctypes.c_void_p), ("filter", ctypes.c_void_p),
                ("intersect", ctypes.c_void_p), ("min_width_distance_factor", ctypes.c_float)]


class Caster:
    """Embree's entry points, and devices by their text: a layout by name needs one of its own."""

    def __init__(self, path):
        self.embree, self.devices = ctypes.CDLL(path), {}
        pointer, number, size = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t
        for name, result, arguments in [
            ("rtcNewDevice", pointer, [ctypes.c_char_p]), ("rtcNewScene", pointer, [pointer]), ("rtcReleaseScene", None, [pointer]),
            ("rtcSetSceneFlags", None, [pointer, number]), ("rtcSetSceneBuildQuality", None, [pointer, number]),
            ("rtcNewGeometry", pointer, [pointer, number]), ("rtcReleaseGeometry", None, [pointer]),
            ("rtcSetGeometryBuildQuality", None, [pointer, number]), ("rtcCommitGeometry", None, [pointer]),
            ("rtcSetNewGeometryBuffer", pointer, [pointer, number, number, number, size, size]),
            ("rtcAttachGeometry", number, [pointer, pointer]), ("rtcCommitScene", None, [pointer]),
            ("rtcIntersect16", None, [pointer, pointer, pointer, pointer]),
        ]:
            entry = getattr(self.embree, name)
            entry.restype, entry.argtypes = result, arguments
        self.valid = numpy.full(32, -1, "i4")

    def run(self, configuration, mesh, batch):
        embree, layout, quality = self.embree, configuration.get("layout", "auto"), QUALITY[configuration["quality"]]
        text = "threads=1" + (f",tri_accel={layout}" if layout not in ("auto", "compact") else "")
        if text not in self.devices:
            self.devices[text] = embree.rtcNewDevice(text.encode())
        device = self.devices[text]
        rays = aligned(batch.shape)
        rays[:] = batch
        start = time.process_time()
        scene = embree.rtcNewScene(device)
        embree.rtcSetSceneFlags(scene, COMPACT if layout == "compact" else 0)
        embree.rtcSetSceneBuildQuality(scene, quality)
        geometry = embree.rtcNewGeometry(device, TRIANGLE)
        embree.rtcSetGeometryBuildQuality(geometry, quality)
        for kind, form, source in [(VERTEX, FLOAT3, mesh[0]), (INDEX, UINT3, mesh[1])]:
            buffer = embree.rtcSetNewGeometryBuffer(geometry, kind, 0, form, 12, len(source))
            ctypes.memmove(buffer, source.ctypes.data, source.nbytes)
        embree.rtcCommitGeometry(geometry)
        embree.rtcAttachGeometry(scene, geometry)
        embree.rtcReleaseGeometry(geometry)
        embree.rtcCommitScene(scene)
        built = time.process_time()
        asked = Arguments(flags=COHERENT if configuration["rays"] == "coherent" else 0, features=NOTHING)
        valid, asked_at, intersect = self.valid.ctypes.data + -self.valid.ctypes.data % 64, ctypes.addressof(asked), embree.rtcIntersect16
        for packet in range(rays.ctypes.data, rays.ctypes.data + rays.nbytes, rays.strides[0]):
            intersect(valid, scene, packet, asked_at)
        done = time.process_time()
        embree.rtcReleaseScene(scene)
        return {"build_ms": 1e3 * (built - start), "rays_ms": 1e3 * (done - built)}, rays[:, PRIMITIVE].view("u4").copy()


def aligned(shape):
    """Floats that begin at a multiple of 64 bytes, as Embree wants its packets."""
    room = numpy.empty(math.prod(shape) + 16, "f4")
    first = -room.ctypes.data % 64 // 4
    return room[first : first + math.prod(shape)].reshape(shape)


def packets(origins, directions):
    """Rays as packets of sixteen that have met nothing yet."""
    rays = numpy.zeros((len(origins) // 16, ROWS, 16), "f4")
    for rows, values in [(ORIGIN, origins), (DIRECTION, directions)]:
        rays[:, rows] = values.reshape(-1, 16, 3).transpose(0, 2, 1)
    rays[:, TFAR] = numpy.inf
    numbers = rays.view("u4")
    numbers[:, MASK] = numbers[:, PRIMITIVE] = numbers[:, GEOMETRY] = NOTHING
    return rays


def scattered(mesh, count):
    """Rays in all directions from within the box of the mesh."""
    numbers = numpy.random.default_rng(1)
    low, high = mesh[0].min(0), mesh[0].max(0)
    return packets(low + (high - low) * numbers.random((count, 3), "f4"), numbers.standard_normal((count, 3), "f4"))


def camera(mesh, count):
    """A square picture from a corner of the box towards its middle, in tiles of 4 by 4 pixels."""
    low, high = mesh[0].min(0), mesh[0].max(0)
    middle, side = (low + high) / 2, math.isqrt(count)
    eye = middle + (high - low) * 0.35
    forward = (middle - eye) / numpy.linalg.norm(middle - eye)
    right = numpy.cross(forward, [0.01, 1, 0])
    right /= numpy.linalg.norm(right)
    up = numpy.cross(right, forward)
    pixels = numpy.arange(side * side)
    tile, within = pixels // 16, pixels % 16
    u = ((tile % (side // 4) * 4 + within % 4 + 0.5) / side * 2 - 1)[:, None]
    v = ((tile // (side // 4) * 4 + within // 4 + 0.5) / side * 2 - 1)[:, None]
    directions = forward + 0.7 * (u * right + v * up)
    return packets(numpy.broadcast_to(eye, directions.shape).astype("f4"), directions.astype("f4"))


def embree_of_embreex():
    """The library in embreex's wheel."""
    found = importlib.util.find_spec("embreex")
    pattern = os.path.join(os.path.dirname(os.path.dirname(found.origin)) if found else "", "embreex.libs", "libembree4*")
    return next(iter(glob.glob(pattern)), "libembree4.so.4")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:50611")
    parser.add_argument("--embree", default=embree_of_embreex())
    parser.add_argument("--trials", type=int, default=30)
    parser.add_argument("--rays", default="65536,1048576", help="squares of multiples of 4")
    parser.add_argument("--rounds", type=int, default=0)
    parser.add_argument("scenes", nargs="+")
    options = parser.parse_args()
    caster = Caster(options.embree)
    client = treewright.Client(options.url, client_id="embree-caster", deadline_ms=60000)
    space = treewright.Space().choice("quality", list(QUALITY), default="medium")
    space.choice("rays", ["incoherent", "coherent"], default="incoherent")
    space.choice("layout", LAYOUTS, default="auto", active_if=("quality", "medium"))
    indicators = {"triangles": (0.0, 1e8, "log"), "rays": (0.0, 1e9, "log"), "camera": (0.0, 1.0)}
    study = client.study("embree-caster", space, minimise={"build_ms": 1.0, "rays_ms": 1.0}, indicators=indicators)
    for path in options.scenes:
        mesh = measured.read(path)
        for count in map(int, options.rays.split(",")):
            for kind in (camera, scattered):
                batch = kind(mesh, count)
                known = {"triangles": len(mesh[1]), "rays": count, "camera": float(kind is camera)}

                def run(configuration):
                    return caster.run(configuration, mesh, batch)

                costs, best = measured.tune(client, study, known, run, FIXED, options.trials)
                compared = measured.compare(run, best, FIXED, options.rounds) if options.rounds else {}
                measured.show(path, len(mesh[1]), f"{count} {kind.__name__}", costs, best, compared)


if __name__ == "__main__":
    main()
