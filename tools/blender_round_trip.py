#!/usr/bin/env python3
"""A groom and a moving head out of Blender, simulated, and back into Blender.

    blender_round_trip.py [--forelock PROGRAM] [--out FOLDER] [--frame 30]

Builds a head that turns and hair on it, as an artist would have them, and
1. exports both as Alembic, the head with its motion, and writes a scene;
2. runs `forelock simulate`, which exports the moving hair as Alembic;
3. imports that file, compares the roots with the head at each frame, and renders a frame.

Needs Python 3.11 and the packages `bpy` and `numpy`; the same lines run inside Blender.
"""

import argparse
import math
import pathlib
import subprocess

import bpy
import numpy as np

FPS = 24
FIRST = 1
FRAMES = 48
STRANDS = 1500
POINTS = 20
RADIUS = 0.09
MIDDLE = np.array([0.0, 0.0, 0.1])


def build():
    """The head, which turns, and the hair at rest. The first frame is the rest pose."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = FPS, FIRST, FIRST + FRAMES
    bpy.ops.mesh.primitive_uv_sphere_add(radius=RADIUS, location=MIDDLE, segments=48, ring_count=32)
    head = bpy.context.active_object
    # The head turns about the world's origin, its neck.
    bpy.ops.object.transform_apply(location=True)
    for frame, degrees in [(0, 0), (12, 50), (24, -50), (36, 0)]:
        head.rotation_euler = (0.0, 0.0, math.radians(degrees))
        head.keyframe_insert("rotation_euler", frame=FIRST + frame)

    random = np.random.default_rng(1)
    height = random.uniform(0.1, 1.0, STRANDS)
    angle = random.uniform(0.0, 2.0 * math.pi, STRANDS)
    flat = np.sqrt(1.0 - height**2)
    out = np.stack([flat * np.cos(angle), flat * np.sin(angle), height], axis=1)
    # Each strand leaves the head and bends down.
    along = np.linspace(0.0, 0.2, POINTS)[:, None]
    down = np.array([0.0, 0.0, -1.0])
    side = out * [1.0, 1.0, 0.0] / np.maximum(flat, 1e-3)[:, None]
    lift = 0.03 * (1.0 - np.exp(-along / 0.03))
    rise = along - lift
    points = MIDDLE + out[:, None] * (RADIUS + 0.0005 + lift) + side[:, None] * 0.15 * rise + down * rise
    hair = bpy.data.hair_curves.new("hair")
    hair.add_curves([POINTS] * STRANDS)
    hair.attributes["position"].data.foreach_set("vector", points.astype(np.float32).ravel())
    radius = hair.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.full(STRANDS * POINTS, 2e-4, np.float32))
    hair_object = bpy.data.objects.new("hair", hair)
    scene.collection.objects.link(hair_object)
    return head, hair_object, points


def only(wanted):
    """Selects one object."""
    for o in bpy.data.objects:
        o.select_set(o == wanted)
    bpy.context.view_layer.objects.active = wanted


def export(head, hair, folder):
    """Writes the groom, the moving head and the scene. Returns the scene's file."""
    bpy.context.scene.frame_set(FIRST)
    only(hair)
    bpy.ops.wm.alembic_export(filepath=str(folder / "groom.abc"), selected=True, start=FIRST, end=FIRST)
    only(head)
    bpy.ops.wm.alembic_export(filepath=str(folder / "head.abc"), selected=True, start=FIRST, end=FIRST + FRAMES)
    scene = folder / "scene.toml"
    scene.write_text(
        'groom.source = "groom.abc"\n'
        f"[time]\nfps = {FPS}\nframes = {FRAMES}\n"
        f'[output]\nexports = ["hair.abc"]\nfirst_frame = {FIRST}\n'
        '[body]\nmesh = "head.abc"\nmotion = "animation"\n'
    )
    return scene


def points_of(found):
    """The points of an imported object in the world."""
    strands = found.evaluated_get(bpy.context.evaluated_depsgraph_get())
    data = strands.data.attributes["position"].data
    local = np.empty(3 * len(data), np.float32)
    data.foreach_get("vector", local)
    matrix = np.array(strands.matrix_world)
    return local.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--forelock", default="forelock")
    parser.add_argument("--out", default="blender-round-trip", type=pathlib.Path)
    parser.add_argument("--frame", default=30, type=int)
    args = parser.parse_args()
    folder = args.out.absolute()
    folder.mkdir(parents=True, exist_ok=True)
    head, hair, rest = build()
    scene_file = export(head, hair, folder)
    subprocess.run([args.forelock, "simulate", scene_file, "--out", folder / "run"], check=True)

    bpy.data.objects.remove(hair)
    bpy.ops.wm.alembic_import(filepath=str(folder / "run" / "hair.abc"), set_frame_range=False)
    found = next(o for o in bpy.data.objects if o.type == "CURVES")
    worst, moved = 0.0, 0.0
    for frame in range(FIRST, FIRST + FRAMES + 1):
        bpy.context.scene.frame_set(frame)
        points = points_of(found).reshape(STRANDS, POINTS, 3)
        matrix = np.array(head.matrix_world)
        follow = rest @ matrix[:3, :3].T + matrix[:3, 3]
        worst = max(worst, np.abs(points[:, 0] - follow[:, 0]).max())
        moved = max(moved, np.linalg.norm(points[:, -1] - follow[:, -1], axis=1).max())
    print(f"roots follow the head within {1e6 * worst:.1f} um; tips lag by up to {100 * moved:.1f} cm")

    scene = bpy.context.scene
    scene.frame_set(args.frame)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.rotation_euler = (0.0, -0.75, 0.08), (math.radians(90.0), 0.0, 0.0)
    light = bpy.data.objects.new("light", bpy.data.lights.new("light", "SUN"))
    light.rotation_euler, light.data.energy = (math.radians(50.0), 0.0, math.radians(30.0)), 3.0
    colour = bpy.data.materials.new("hair")
    colour.diffuse_color = (0.2, 0.09, 0.04, 1.0)
    colour.use_nodes = True
    colour.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.2, 0.09, 0.04, 1.0)
    found.data.materials.append(colour)
    scene.world = bpy.data.worlds.new("world")
    scene.collection.objects.link(camera)
    scene.collection.objects.link(light)
    scene.camera, scene.render.engine = camera, "CYCLES"
    scene.cycles.samples = 16
    scene.render.resolution_x = scene.render.resolution_y = 480
    scene.render.filepath = str(folder / "frame.png")
    bpy.ops.render.render(write_still=True)
    if worst > 1e-5 or moved < 0.01:
        raise SystemExit("the hair does not follow the head")


if __name__ == "__main__":
    main()
