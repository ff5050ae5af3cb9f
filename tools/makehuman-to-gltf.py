#!/usr/bin/env python3
"""Writes MakeHuman's base mesh with a rig and its weights as a glTF 2.0 file.

    makehuman-to-gltf.py base.obj rig.json weights.json out.glb

The mesh is in decimetres; the file is in metres, y up. Only the body is written, without the helper
geometry that clothes are fitted to. Needs Python 3 and nothing else.
"""

import json
import struct
import sys

SCALE = 0.1


def read_obj(path):
    """Vertices, and the triangles of the group `body`."""
    vertices, triangles, inside = [], [], False
    for line in open(path, encoding="utf-8"):
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append([SCALE * float(x) for x in words[1:4]])
        elif words[0] == "g":
            inside = words[1:] == ["body"]
        elif words[0] == "f" and inside:
            corners = [int(word.split("/")[0]) - 1 for word in words[1:]]
            triangles += [[corners[0], b, c] for b, c in zip(corners[1:], corners[2:])]
    return vertices, triangles


def groups(path):
    """The vertices of each group of faces."""
    found, group = {}, None
    for line in open(path, encoding="utf-8"):
        words = line.split()
        if words and words[0] == "g":
            group = found.setdefault(words[1], set())
        elif words and words[0] == "f" and group is not None:
            group.update(int(word.split("/")[0]) - 1 for word in words[1:])
    return found


def middle(points):
    return [sum(p[c] for p in points) / len(points) for c in range(3)]


def main():
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    obj, rig_path, weights_path, out = sys.argv[1:]
    vertices, triangles = read_obj(obj)
    cubes = groups(obj)
    rig = json.load(open(rig_path, encoding="utf-8"))
    rig = rig.get("bones", rig)
    weights = json.load(open(weights_path, encoding="utf-8"))["weights"]

    def place(bone):
        cube = bone["head"].get("cube_name")
        if cube in cubes:
            return middle([vertices[v] for v in sorted(cubes[cube])])
        x, y, z = bone["head"]["default_position"]
        # The rig's default positions are in metres with z up.
        return [x, z, -y]

    order, names = [], {}
    while len(order) < len(rig):
        before = len(order)
        for name, bone in rig.items():
            parent = bone.get("parent") or ""
            if name not in names and (parent == "" or parent in names):
                names[name] = len(order)
                order.append(name)
        if len(order) == before:
            sys.exit("the rig has a bone without its parent")
    places = [place(rig[name]) for name in order]
    used = sorted({v for triangle in triangles for v in triangle})
    number = {v: i for i, v in enumerate(used)}
    influences = [[] for _ in used]
    for name, pairs in weights.items():
        for vertex, weight in pairs if name in names else []:
            if vertex in number and weight > 0:
                influences[number[vertex]].append((names[name], weight))
    joints, shares = [], []
    for own in influences:
        own = sorted(own, key=lambda pair: -pair[1])[:4] or [(0, 1.0)]
        total = sum(weight for _, weight in own)
        own += [(0, 0.0)] * (4 - len(own))
        joints.append([joint for joint, _ in own])
        shares.append([weight / total for _, weight in own])
    positions = [vertices[v] for v in used]

    data, views, accessors = bytearray(), [], []

    def add(kind, component, code, rows, **more):
        flat = [x for row in rows for x in (row if isinstance(row, list) else [row])]
        packed = struct.pack(f"<{len(flat)}{code}", *flat)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(packed)})
        data.extend(packed + b"\0" * (-len(packed) % 4))
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": component, "type": kind, "count": len(rows), **more}
        )
        return len(accessors) - 1

    low = [min(p[c] for p in positions) for c in range(3)]
    high = [max(p[c] for p in positions) for c in range(3)]
    attributes = {
        "POSITION": add("VEC3", 5126, "f", positions, min=low, max=high),
        "JOINTS_0": add("VEC4", 5123, "H", joints),
        "WEIGHTS_0": add("VEC4", 5126, "f", shares),
    }
    indices = add("SCALAR", 5125, "I", [number[v] for triangle in triangles for v in triangle])
    binds = add("MAT4", 5126, "f", [[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -p[0], -p[1], -p[2], 1] for p in places])
    nodes = []
    for i, name in enumerate(order):
        parent = rig[name].get("parent") or ""
        base = places[names[parent]] if parent else [0, 0, 0]
        node = {"name": name, "translation": [places[i][c] - base[c] for c in range(3)]}
        children = [names[own] for own in order if (rig[own].get("parent") or "") == name]
        nodes.append({**node, "children": children} if children else node)
    nodes.append({"name": "Body", "mesh": 0, "skin": 0})
    roots = [names[own] for own in order if not rig[own].get("parent")]
    text = json.dumps(
        {
            "asset": {"version": "2.0", "generator": "makehuman-to-gltf"},
            "scene": 0,
            "scenes": [{"nodes": roots + [len(nodes) - 1]}],
            "nodes": nodes,
            "meshes": [{"name": "Body", "primitives": [{"attributes": attributes, "indices": indices}]}],
            "skins": [{"joints": list(range(len(order))), "inverseBindMatrices": binds}],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{"byteLength": len(data)}],
        }
    ).encode()
    text += b" " * (-len(text) % 4)
    with open(out, "wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(data), b"BIN\0") + data)


if __name__ == "__main__":
    main()
