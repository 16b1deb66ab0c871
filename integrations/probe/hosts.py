#!/usr/bin/env python3
"""Programs to probe: the same picture (or batch of rays) by Blender Cycles, Mitsuba or embreex, as often as asked.

    treewright-probe -- python3 hosts.py cycles SCENE.glb [--eye=X,Y,Z --target=X,Y,Z --fov DEGREES] [--size 320x240] [--samples 16]
    treewright-probe -- python3 hosts.py mitsuba|embreex SCENE.ply ...

With --rounds N and --set WORDS (several) each round has one picture as the host asks for it and one with each set, in changing order, and
the line of JSON at the end has processor time of each and how many pixels (hits) differ from the first. Without --set the probe need not be there.
Needs bpy 5.0, mitsuba 3.9 or embreex 4.4 from PyPI.
"""

import argparse
import ctypes
import json
import math
import os
import random
import tempfile
import time

import numpy


def cycles(options):
    import bpy
    from mathutils import Vector

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=os.path.abspath(options.scene))
    scene = bpy.context.scene
    upright = lambda point: Vector((point[0], -point[2], point[1]))
    eye, target = upright(options.eye), upright(options.target)
    data = bpy.data.cameras.new("camera")
    data.angle = math.radians(options.fov)
    scene.camera = bpy.data.objects.new("camera", data)
    scene.camera.location, scene.camera.rotation_euler = eye, (target - eye).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(scene.camera)
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs[0].default_value = (1, 1, 1, 1)
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.samples, scene.cycles.seed = options.samples, 0
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.debug_use_spatial_splits = options.spatial_splits
    scene.render.threads_mode, scene.render.threads = "FIXED", options.threads
    scene.render.resolution_x, scene.render.resolution_y = options.size
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    folder = tempfile.mkdtemp()
    scene.render.filepath = os.path.join(folder, "picture.exr")

    def render():
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        pixels = numpy.array(image.pixels[:], "f4").reshape(-1, 4)[:, :3]
        bpy.data.images.remove(image)
        return pixels

    return render


def mitsuba(options):
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    width, height = options.size
    to_world = mi.ScalarTransform4f().look_at(origin=options.eye, target=options.target, up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}
    sensor = {"type": "perspective", "fov": options.fov, "to_world": to_world, "film": film, "sampler": {"type": "independent"}}
    whole = {"type": "scene", "integrator": {"type": "path", "max_depth": 6}, "sensor": sensor, "sky": {"type": "constant"}}
    whole["mesh"] = {"type": "ply", "filename": options.scene, "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse"}}}

    def render():
        return numpy.array(mi.render(mi.load_dict(whole), spp=options.samples, seed=1)).reshape(-1, 3)

    return render


def embreex(options):
    import trimesh
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore import EmbreeDevice
    from embreex.rtcore_scene import EmbreeScene

    mesh = trimesh.load(options.scene, process=False)
    numbers, count = numpy.random.default_rng(1), options.size[0] * options.size[1] * options.samples
    low, high = mesh.bounds
    origins = (low + (high - low) * numbers.random((count, 3))).astype("f4")
    directions = numbers.standard_normal((count, 3)).astype("f4")

    def batch():
        scene = EmbreeScene(EmbreeDevice())
        TriangleMesh(scene, mesh.vertices.astype("f4"), mesh.faces.astype("i4"))
        return scene.run(origins, directions)

    return batch


def main():
    numbers = lambda separator, kind: lambda text: [kind(each) for each in text.split(separator)]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("host", choices=["cycles", "mitsuba", "embreex"])
    parser.add_argument("scene")
    parser.add_argument("--eye", type=numbers(",", float), default=[3, 2, 3])
    parser.add_argument("--target", type=numbers(",", float), default=[0, 0.5, 0])
    parser.add_argument("--fov", type=float, default=50)
    parser.add_argument("--size", type=numbers("x", int), default=[320, 240])
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--spatial-splits", action="store_true", help="Cycles' own switch")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], metavar="WORDS")
    options = parser.parse_args()
    run = globals()[options.host](options)
    all_words = ["", *options.set]
    if options.set:
        tell = ctypes.CDLL(None).treewright_probe_set
        tell.argtypes, tell.restype = [ctypes.c_char_p], ctypes.c_bool
        run()  # warms what is made once
    cpu_ms, pictures, order = {words: [] for words in all_words}, {}, random.Random(1)
    for _ in range(options.rounds):
        for words in order.sample(all_words, len(all_words)):
            assert not options.set or tell(words.encode()), words
            start = time.process_time()
            picture = run()
            cpu_ms[words].append(round(1e3 * (time.process_time() - start), 1))
            pictures.setdefault(words, picture)
    rows = []
    for words in all_words:
        apart = numpy.abs(pictures[words].astype("f8") - pictures[""])
        differs = (apart.max(axis=1) if apart.ndim > 1 else apart) > 0
        rows.append({"set": words, "cpu_ms": cpu_ms[words], "differs": int(differs.sum()), "of": len(differs), "mean_apart": float(apart.mean())})
    name = os.path.basename(options.scene)
    print(json.dumps({"host": options.host, "scene": name, "samples": options.samples, "rows": rows}), flush=True)


if __name__ == "__main__":
    main()
