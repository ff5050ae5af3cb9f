#!/usr/bin/env python3
"""Opens a glTF file of hair in Blender and compares its lines with the arrays of an .npz.

    check_gltf.py hair.glb expected.npz [--fps 60] [--tolerance 1e-6]

The .npz is a groom or a cache of Forelock: `positions` [P, 3] or [F, P, 3] and `strand_offsets`,
metres, y up, and optionally `times` [F]. Edges and the points of every frame, which are shape keys,
are compared; the tolerance is relative to the size of the groom. A negative control moves one point
and must fail. Attributes are listed, not compared.

Blender is z up and turns what it reads: (x, y, z) becomes (x, -z, y). The first frame of the file is
frame 0 or 1 of Blender, as its importer has it. Needs Python 3.11 and the packages `bpy` and
`numpy`.
"""

import sys

import bpy
import numpy as np

import blender_check


def edges_of(offsets):
    """Both ends of each edge of strands at `offsets`, [E, 2]."""
    ends = [np.stack([np.arange(a, b - 1), np.arange(a + 1, b)], axis=1) for a, b in zip(offsets, offsets[1:])]
    return np.concatenate(ends)


def read_points(hair):
    """The points of the mesh `hair` at the current frame, in the axes of the file, [P, 3]."""
    own = hair.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = own.to_mesh()
    local = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
    mesh.vertices.foreach_get("co", local)
    own.to_mesh_clear()
    matrix = np.array(own.matrix_world, dtype=np.float64)
    world = local.reshape(-1, 3).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    return blender_check.file_axes(world)


def first_frame(hair):
    """The frame of Blender where the shape keys begin."""
    keys = hair.data.shape_keys
    action = keys.animation_data.action if keys and keys.animation_data else None
    return action.frame_range[0] if action else 0.0


def set_frame(frame):
    """Shows `frame`, which may lie between two."""
    whole = int(np.floor(frame + 1e-6))
    bpy.context.scene.frame_set(whole, subframe=max(0.0, float(frame - whole)))


def main():
    args = blender_check.arguments(__doc__, 60)
    expected, frames, size = blender_check.load(args.expected)
    times = expected["times"] if "times" in expected else np.arange(len(frames)) / args.fps

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = args.fps
    # Points stay in their order, and points without an edge too.
    bpy.ops.import_scene.gltf(filepath=args.file, merge_vertices=False)
    found = [o for o in bpy.data.objects if o.type == "MESH"]
    if len(found) != 1:
        sys.exit(f"Blender finds {len(found)} meshes in the file, not one")
    hair = found[0]
    print("attributes in Blender:", [a.name for a in hair.data.attributes])

    if len(hair.data.vertices) != frames.shape[1]:
        sys.exit(f"{len(hair.data.vertices)} points, not {frames.shape[1]}")
    edges = np.empty(len(hair.data.edges) * 2, dtype=np.int32)
    hair.data.edges.foreach_get("vertices", edges)
    wanted = edges_of(expected["strand_offsets"].astype(np.int64))
    edges = np.sort(edges.reshape(-1, 2), axis=1)
    if {tuple(edge) for edge in edges} != {tuple(edge) for edge in wanted}:
        sys.exit(f"{len(edges)} edges, not the {len(wanted)} of the strands")

    worst, start = 0.0, first_frame(hair)
    for time, wanted in zip(times, frames):
        set_frame(start + (time - times[0]) * args.fps)
        points = read_points(hair)
        worst = max(worst, blender_check.difference(points, wanted, size))
    print(f"{len(frames)} frames of {len(edges)} edges with {len(points)} points")
    blender_check.judge(worst, points, frames[-1], size, args.tolerance)


if __name__ == "__main__":
    main()
