"""Renders with Mitsuba 3 for mitsuba_curves.py, scenes that our renderer shows alike: every surface matt and flat."""

import json
import struct
import sys
import time

import mitsuba
import numpy

SAMPLES, SAMPLERS = (1, 4, 16, 64), ("independent", "multijitter")
# glTF's numbers of component types.
KINDS = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


def matt_copy(path, copy):
    """Writes the scene with matt, flat surfaces; its meshes as (positions, triangles, albedo, emission)."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    scene, rest = json.loads(data[20:20 + length]), data[20 + length:]
    if scene.get("textures") or scene.get("animations") or any(set(node) - {"mesh", "name"} for node in scene["nodes"]):
        sys.exit(f"{path} has textures, animations or nodes that are moved; bake them first")

    def array(number, columns):
        accessor = scene["accessors"][number]
        view = scene["bufferViews"][accessor["bufferView"]]
        start = 8 + view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        count = accessor["count"] * (1 if accessor["type"] == "SCALAR" else 3)
        return numpy.frombuffer(rest, KINDS[accessor["componentType"]], count, start).reshape(-1, columns)

    meshes, strength = [], "KHR_materials_emissive_strength"
    for part in (part for mesh in scene["meshes"] for part in mesh["primitives"]):
        points, normals = (array(part["attributes"][name], 3) if name in part["attributes"] else None
                           for name in ("POSITION", "NORMAL"))
        corners, material = array(part["indices"], 3), scene["materials"][part["material"]]
        # Mitsuba's lights shine to the side that their winding says, which shall be that of the normals.
        a, b, c = (points[corners[:, each]] for each in range(3))
        if normals is not None and (numpy.cross(b - a, c - a) * normals[corners[:, 0]]).sum() < 0:
            corners = corners[:, ::-1]
        factor = material.get("extensions", {}).get(strength, {}).get("emissiveStrength", 1.0)
        emission = [factor * each for each in material.get("emissiveFactor", (0, 0, 0))]
        meshes.append((points, corners, material["pbrMetallicRoughness"]["baseColorFactor"][:3], emission))
        part["attributes"] = {"POSITION": part["attributes"]["POSITION"]}
    for material in scene["materials"]:
        kept = {name: value for name, value in material.pop("extensions", {}).items() if name == strength}
        # With an index of refraction of 1, no layer reflects.
        material["extensions"] = {"KHR_materials_ior": {"ior": 1.0}, **kept}
        material["pbrMetallicRoughness"].update(metallicFactor=0.0, roughnessFactor=1.0)
        material.pop("extras", None)
    scene["extensionsUsed"] = ["KHR_materials_ior", strength]
    scene["scenes"][0].pop("extras", None)
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    copy.write_bytes(head + text + rest)
    return meshes


def shape(points, corners, albedo, emission):
    """A mesh of Mitsuba."""
    rgb = lambda values: {"type": "rgb", "value": [float(value) for value in values]}
    matt = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(albedo)}}
    properties = mitsuba.Properties()
    properties["bsdf"], properties["face_normals"] = mitsuba.load_dict(matt), True
    if any(emission):
        properties["emitter"] = mitsuba.load_dict({"type": "area", "radiance": rgb(emission)})
    mesh = mitsuba.Mesh("mesh", len(points), len(corners), props=properties)
    fields = mitsuba.traverse(mesh)
    fields["vertex_positions"], fields["faces"] = points.ravel(), corners.astype("u4").ravel()
    fields.update()
    return mesh


def measure(variant, meshes, options, wants_reference, file):
    """Pictures and times of a variant, into a file. In a process of its own, since an old LLVM ends it."""
    mitsuba.set_variant(variant)
    import drjit
    drjit.set_thread_count(options.threads)
    scene = mitsuba.load_dict({"type": "scene", **{f"mesh{i}": shape(*mesh) for i, mesh in enumerate(meshes)}})
    # Mitsuba also counts the camera's ray and the one that meets the light.
    path = mitsuba.load_dict({"type": "path", "max_depth": options.bounces + 2, "rr_depth": 1 << 20})
    eye, target = ([float(value) for value in text.split(",")] for text in (options.eye, options.target))
    film = dict(zip(("width", "height"), map(int, options.size.split("x"))), pixel_format="rgb", rfilter={"type": "box"})
    sensors = {sampler: mitsuba.load_dict({
        "type": "perspective", "fov": options.fov, "fov_axis": "y", "near_clip": 1e-3, "far_clip": 1e4,
        "to_world": mitsuba.ScalarTransform4f().look_at(origin=eye, target=target, up=[0, 1, 0]),
        "film": {"type": "hdrfilm", "component_format": "float32", **film}, "sampler": {"type": sampler},
    }) for sampler in SAMPLERS}

    def render(sampler, samples, seed):
        start = time.perf_counter()
        picture = mitsuba.render(scene, sensor=sensors[sampler], integrator=path, spp=samples, seed=seed)
        return numpy.array(picture), time.perf_counter() - start  # the copy waits for LLVM

    found = {}
    for sampler, samples in ((sampler, samples) for sampler in SAMPLERS for samples in SAMPLES):
        render(sampler, samples, 1)  # compiles
        runs = [render(sampler, samples, 100 * samples + run) for run in range(options.repeats)]
        found[f"{sampler} {samples}"], found[f"{sampler} {samples} s"] = map(numpy.array, zip(*runs))
    if wants_reference:
        frames = range(options.reference_spp // SAMPLES[-1] // 2)
        half = lambda seed: numpy.mean([render(SAMPLERS[0], SAMPLES[-1], seed + i)[0] for i in frames], 0, "f8")
        found["reference"] = numpy.array([half(1_000_000), half(2_000_000)])
    numpy.savez(file, **found)
