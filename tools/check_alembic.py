#!/usr/bin/env python3
"""Opens an Alembic file in Blender and compares its hair with the arrays of an .npz.

    check_alembic.py hair.abc expected.npz [--fps 24] [--tolerance 1e-6]

The .npz is a groom or a cache of Forelock: `positions` [P, 3] or [F, P, 3] and `strand_offsets`,
metres, y up, and optionally `widths` [P]. Strands, points of every frame, and radii (half the
widths) are compared; the tolerance is relative to the size of the groom. A negative control moves
one point and must fail. Other attributes are listed, not compared: Blender's importer of strands
drops them.

Blender is z up and turns what it reads: (x, y, z) becomes (x, -z, y). Frame f of Blender is the time
f / fps. Needs Python 3.11 and the packages `bpy` and `numpy`.
"""

import sys

import bpy
import numpy as np

import blender_check


def attribute(data, name, width):
    """The values of the attribute `name` of the strands `data`, [n, width]."""
    found = data.attributes[name]
    values = np.empty(len(found.data) * width, dtype=np.float32)
    found.data.foreach_get("vector" if width == 3 else "value", values)
    return values.reshape(-1, width)


def strands():
    """The strands of the scene at its current frame, in the order of their names."""
    graph = bpy.context.evaluated_depsgraph_get()
    found = [o.evaluated_get(graph) for o in bpy.data.objects if o.type == "CURVES"]
    return sorted(found, key=lambda o: o.name)


def read_frame(frame):
    """Positions in the axes of the file, points of each strand, radii."""
    bpy.context.scene.frame_set(frame)
    positions, counts, radii = [], [], []
    for o in strands():
        matrix = np.array(o.matrix_world, dtype=np.float64)
        local = attribute(o.data, "position", 3).astype(np.float64)
        world = local @ matrix[:3, :3].T + matrix[:3, 3]
        positions.append(blender_check.file_axes(world))
        counts += [curve.points_length for curve in o.data.curves]
        if "radius" in o.data.attributes:
            radii.append(attribute(o.data, "radius", 1)[:, 0])
    return np.concatenate(positions), np.array(counts), np.concatenate(radii) if radii else None


def main():
    args = blender_check.arguments(__doc__, 24)
    expected, frames, size = blender_check.load(args.expected)

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = args.fps
    bpy.ops.wm.alembic_import(filepath=args.file)
    if not strands():
        sys.exit("Blender finds no strands in the file")
    print("attributes in Blender:", [a.name for o in strands() for a in o.data.attributes])

    worst = 0.0
    for frame, wanted in enumerate(frames):
        found, counts, radii = read_frame(frame)
        if not np.array_equal(counts, np.diff(expected["strand_offsets"].astype(np.int64))):
            sys.exit(f"frame {frame}: {len(counts)} strands with {counts.sum()} points, not as expected")
        worst = max(worst, blender_check.difference(found, wanted, size))
        if "widths" in expected:
            if radii is None or not np.allclose(2 * radii, expected["widths"], rtol=1e-6, atol=1e-12):
                sys.exit(f"frame {frame}: the radii are not half the widths")
    print(f"{len(frames)} frames of {len(counts)} strands with {counts.sum()} points")
    blender_check.judge(worst, found, frames[-1], size, args.tolerance)
    print("radii:", "as expected" if "widths" in expected else "not compared")


if __name__ == "__main__":
    main()
