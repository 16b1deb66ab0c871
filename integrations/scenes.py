#!/usr/bin/env python3
"""Meshes for the integrations: `scenes.py FOLDER [FILE.glb | FILE.obj ...]` writes one binary PLY for each.

All examples read this one form: little-endian float positions, then lists of three indices. Of a GLB the triangles of all meshes
are taken as they stand in the world; materials are left out. Needs nothing but Python.
"""

import array
import json
import pathlib
import struct
import sys

COMPONENT = {5121: "B", 5123: "H", 5125: "I", 5126: "f"}
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


def times(a, b):
    return [sum(a[k * 4 + row] * b[column * 4 + k] for k in range(4)) for column in range(4) for row in range(4)]


def matrix(node):
    if "matrix" in node:
        return node["matrix"]
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    s, t = node.get("scale", (1, 1, 1)), node.get("translation", (0, 0, 0))
    columns = [
        (1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)),
        (2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)),
        (2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)),
    ]
    flat = [value * s[index] for index, column in enumerate(columns) for value in (*column, 0)]
    return [*flat, *t, 1]


def read_glb(path):
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, blob = json.loads(data[20 : 20 + length]), data[28 + length :]

    def accessor(number):
        one = document["accessors"][number]
        view = document["bufferViews"][one["bufferView"]]
        code, width = COMPONENT[one["componentType"]], WIDTH[one["type"]]
        start = view.get("byteOffset", 0) + one.get("byteOffset", 0)
        own = array.array(code).itemsize * width
        stride = view.get("byteStride", own)
        if stride == own:
            return array.array(code, blob[start : start + own * one["count"]]), width
        parts = b"".join(blob[start + each * stride : start + each * stride + own] for each in range(one["count"]))
        return array.array(code, parts), width

    vertices, indices = array.array("f"), array.array("I")

    def visit(number, above):
        node = document["nodes"][number]
        m = times(above, matrix(node))
        for part in document["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
            if part.get("mode", 4) != 4:
                continue
            first = len(vertices) // 3
            points, _ = accessor(part["attributes"]["POSITION"])
            if m == IDENTITY:
                vertices.extend(points)
            else:
                for at in range(0, len(points), 3):
                    x, y, z = points[at : at + 3]
                    vertices.extend(m[r] * x + m[4 + r] * y + m[8 + r] * z + m[12 + r] for r in range(3))
            order = accessor(part["indices"])[0] if "indices" in part else range(len(points) // 3)
            indices.extend(first + each for each in order)
        for child in node.get("children", []):
            visit(child, m)

    for root in document["scenes"][document.get("scene", 0)]["nodes"]:
        visit(root, IDENTITY)
    return vertices, indices


def read_obj(path):
    vertices, indices = array.array("f"), array.array("I")
    for line in path.read_text(errors="replace").splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.extend(map(float, words[1:4]))
        elif words[:1] == ["f"]:
            corners = [int(word.split("/")[0]) for word in words[1:]]
            corners = [corner - 1 if corner > 0 else len(vertices) // 3 + corner for corner in corners]
            for each in range(1, len(corners) - 1):
                indices.extend((corners[0], corners[each], corners[each + 1]))
    return vertices, indices


def write(path, vertices, indices):
    if sys.byteorder != "little":
        vertices.byteswap(), indices.byteswap()
    faces = memoryview(indices).cast("B")
    body = b"".join(b"\x03" + faces[at : at + 12].tobytes() for at in range(0, len(faces), 12))
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices) // 3}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(indices) // 3}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + vertices.tobytes() + body)
    print(f"{path}: {len(indices) // 3} triangles")


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name in map(pathlib.Path, sys.argv[2:]):
        reader = {".glb": read_glb, ".obj": read_obj}.get(name.suffix)
        if reader is None:
            sys.exit(f"{name}: only .glb and .obj are read")
        write(folder / f"{name.stem}.ply", *reader(name))


if __name__ == "__main__":
    main()
