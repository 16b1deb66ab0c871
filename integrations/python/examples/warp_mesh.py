#!/usr/bin/env python3
"""Queries of NVIDIA Warp against a mesh, on the processor: which constructor its tree gets and how large its leaves are, tuned per mesh and query.

    warp_mesh.py [--local | --url URL] [--trials 24] [--queries 1000,30000] [--rounds 7] SCENE.ply ...

Wants warp-lang and numpy. Each run rebuilds the mesh, as for one that moves, and asks for the closest hits of rays or for the nearest points of the
surface. Cost is build plus queries in milliseconds of processor time. With --rounds the tuned configuration is then measured against Warp's
default and every fixed one, in turns within each round. Lines of JSON go to standard output.
"""

import argparse
import time

import numpy
import warp

import measured
import treewright

# Warp's own way comes first.
DEFAULT = {"constructor": "sah", "leaf": 4}
FIXED = [DEFAULT, *({"constructor": constructor, "leaf": leaf} for constructor in ("sah", "median", "cubql") for leaf in (2, 12))]


@warp.kernel
def rays(mesh: warp.uint64, origins: warp.array(dtype=warp.vec3), directions: warp.array(dtype=warp.vec3), out: warp.array(dtype=float)):
    each = warp.tid()
    found = warp.mesh_query_ray(mesh, origins[each], warp.normalize(directions[each]), 1.0e6)
    out[each] = warp.where(found.result, found.t, -1.0)


@warp.kernel
def nearest(mesh: warp.uint64, origins: warp.array(dtype=warp.vec3), directions: warp.array(dtype=warp.vec3), out: warp.array(dtype=float)):
    each = warp.tid()
    found = warp.mesh_query_point_no_sign(mesh, origins[each], 1.0e6)
    out[each] = warp.length(warp.mesh_eval_position(mesh, found.face, found.u, found.v) - origins[each])


def points(vertices, count):
    """Points within the box of the mesh, and directions."""
    numbers = numpy.random.default_rng(1)
    low, high = vertices.min(0), vertices.max(0)
    both = low + (high - low) * numbers.random((count, 3), "f4"), numbers.standard_normal((count, 3), "f4")
    return [warp.array(each.astype("f4"), dtype=warp.vec3, device="cpu") for each in both]


def run(kernel, mesh, asked, configuration):
    """Builds and asks with a configuration: milliseconds of both, and what was found."""
    vertices, corners = mesh
    out = warp.empty(len(asked[0]), dtype=float, device="cpu")
    start = time.process_time()
    tree = warp.Mesh(vertices, corners, bvh_constructor=configuration["constructor"], bvh_leaf_size=configuration["leaf"])
    built = time.process_time()
    warp.launch(kernel, len(asked[0]), [tree.id, *asked, out], device="cpu")
    done = time.process_time()
    # Ties between triangles are decided by the order of the tree, so distances are what can be compared.
    return {"build_ms": 1e3 * (built - start), "query_ms": 1e3 * (done - built)}, out.numpy().round(3)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default="http://127.0.0.1:50611")
    parser.add_argument("--local", action="store_true", help="a daemon of your own, started when it is needed")
    parser.add_argument("--trials", type=int, default=24)
    parser.add_argument("--queries", default="1000,30000")
    parser.add_argument("--rounds", type=int, default=0)
    parser.add_argument("scenes", nargs="+")
    options = parser.parse_args()
    warp.config.log_level = warp.LOG_WARNING
    patient = {"client_id": "warp-mesh", "deadline_ms": 60000}
    client = treewright.Client.local(**patient) if options.local else treewright.Client(options.url, **patient)
    space = treewright.Space().choice("constructor", ["sah", "median", "cubql"], default="sah").integer("leaf", 1, 32, default=4, log=True)
    indicators = {"triangles": (0.0, 1e8, "log"), "queries": (0.0, 1e9, "log"), "nearest": (0.0, 1.0)}
    study = client.study("warp-mesh", space, minimise={"build_ms": 1.0, "query_ms": 1.0}, indicators=indicators)
    for path in options.scenes:
        vertices, corners = measured.read(path)
        mesh = warp.array(vertices, dtype=warp.vec3, device="cpu"), warp.array(corners.ravel(), dtype=warp.int32, device="cpu")
        for count in map(int, options.queries.split(",")):
            for kernel in (rays, nearest):
                asked = points(vertices, count)
                known = {"triangles": len(corners), "queries": count, "nearest": float(kernel is nearest)}
                once = lambda configuration: run(kernel, mesh, asked, configuration)
                once(DEFAULT)  # compiles
                costs, best = measured.tune(client, study, known, once, FIXED, options.trials)
                compared = measured.compare(once, best, FIXED, options.rounds) if options.rounds else {}
                measured.show(path, len(corners), f"{count} {kernel.key}", costs, best, compared)


if __name__ == "__main__":
    main()
