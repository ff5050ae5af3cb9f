#!/usr/bin/env python3
"""Compares a USD file with an `.npz` of the same groom or cache, by the library of USD itself.

    check_usd.py hair.usdc hair.npz     compares; the exit status is 1 if they differ
    check_usd.py --make FOLDER          writes the files of crates/forelock-io/tests/data/usd

Needs the packages usd-core and numpy. In the `.npz` are `positions` [P, 3] or [F, P, 3],
`strand_offsets` and, where there are any, `times` (seconds), `velocities`, `widths`, `colours`,
`transparencies`, `root_uv`, `pinned`, `stiffness`, `binding_...` and `groom_...`, as Forelock
writes them.
"""

import os
import subprocess
import sys

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt


def compare(usd_path, npz_path):
    wanted = dict(np.load(npz_path))
    stage = Usd.Stage.Open(usd_path)
    failures = []

    def check(name, found, expected, tolerance=0.0):
        found, expected = np.asarray(found, dtype=np.float64), np.asarray(expected, dtype=np.float64)
        if found.shape != expected.shape:
            failures.append(f"{name}: shape {found.shape}, not {expected.shape}")
            return
        error = float(np.max(np.abs(found - expected), initial=0.0))
        print(f"{name}: {found.shape}, largest difference {error:g}")
        if not error <= tolerance:
            failures.append(f"{name}: differs by {error:g}")

    check("metres per unit", UsdGeom.GetStageMetersPerUnit(stage), 1.0)
    if UsdGeom.GetStageUpAxis(stage) != "Y":
        failures.append("the up axis is not Y")
    if not stage.GetDefaultPrim():
        failures.append("there is no default prim")
    prims = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.BasisCurves)]
    if len(prims) != 1:
        return failures + [f"{len(prims)} prims with curves"]
    curves = UsdGeom.BasisCurves(prims[0])
    if curves.GetTypeAttr().Get() != "linear":
        failures.append("the curves are not linear")
    check("counts", curves.GetCurveVertexCountsAttr().Get(), np.diff(wanted["strand_offsets"]))

    points = curves.GetPointsAttr()
    frames = wanted["positions"]
    if frames.ndim == 2:
        check("points", points.Get(), frames)
    else:
        times = points.GetTimeSamples()
        if not times:
            return failures + ["the points have no samples"]
        check("times", np.array(times) / stage.GetTimeCodesPerSecond(), wanted["times"], 1e-9)
        ends = [stage.GetStartTimeCode(), stage.GetEndTimeCode()]
        check("first and last time code", ends, [times[0], times[-1]])
        found = np.array([points.Get(time) for time in times])
        check("points", found, frames)
        # The cache of a run has no widths; those of the file are then not compared.
        widths = wanted["widths"] if "widths" in wanted else curves.GetWidthsAttr().Get()
        radius = np.max(widths) / 2
        boxes = [[frame.min(axis=0) - radius, frame.max(axis=0) + radius] for frame in frames]
        check("extent", [curves.GetExtentAttr().Get(time) for time in times], boxes, 1e-5)
        if "velocities" in wanted:
            velocities = curves.GetVelocitiesAttr()
            check("velocities", [velocities.Get(time) for time in times], wanted["velocities"])
    if "widths" in wanted:
        check("widths", curves.GetWidthsAttr().Get(), wanted["widths"])
    api = UsdGeom.PrimvarsAPI(prims[0])
    for name, key, interpolation in [
        ("displayColor", "colours", "vertex"),
        ("displayOpacity", "transparencies", "vertex"),
        ("st", "root_uv", "uniform"),
        ("groom_id", "groom_id", "uniform"),
        ("groom_group_id", "groom_group_id", "uniform"),
        ("groom_guide", "groom_guide", "uniform"),
        ("groom_closest_guides", "groom_closest_guides", "uniform"),
        ("groom_guide_weights", "groom_guide_weights", "uniform"),
        ("forelock_pinned", "pinned", "uniform"),
        ("forelock_stiffness", "stiffness", "uniform"),
        ("forelock_root_triangle", "binding_triangles", "uniform"),
        ("forelock_root_barycentric", "binding_barycentric", "uniform"),
        ("forelock_root_distance", "binding_distances", "uniform"),
    ]:
        primvar = api.GetPrimvar(name)
        if key in wanted and not primvar.HasValue():
            failures.append(f"{name}: missing")
        elif key not in wanted and primvar.HasValue() and frames.ndim == 2:
            # The cache of a run holds positions alone; its exports have the groom's attributes too.
            failures.append(f"{name}: not expected")
        elif key in wanted:
            if primvar.GetInterpolation() != interpolation:
                failures.append(f"{name}: interpolation {primvar.GetInterpolation()}")
            value = np.array(primvar.Get())
            check(name, 1 - value if name == "displayOpacity" else value, wanted[key], 1e-6)
    return failures


def strands(count, each):
    """Points with all kinds of numbers: whole ones, few different ones, and others."""
    s, i = np.mgrid[0:count, 0:each].astype(np.float32)
    return np.stack([s * np.float32(0.37), -i, np.sin(s + i)], axis=-1).reshape(-1, 3)


def make(folder):
    """One stage in every form: z up, centimetres, transforms, samples, compressed arrays."""
    os.makedirs(folder, exist_ok=True)
    count, each = 40, 5
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetTimeCodesPerSecond(30)
    top = UsdGeom.Xform.Define(stage, "/top")
    top.AddTranslateOp().Set(Gf.Vec3d(1, 2, 3.25))
    top.AddRotateXYZOp().Set(Gf.Vec3f(10, 20, 30))
    top.AddTranslateOp(opSuffix="pivot").Set(Gf.Vec3d(0.5, 0, 0))
    top.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    top.AddTranslateOp(opSuffix="pivot", isInverseOp=True)
    middle = UsdGeom.Xform.Define(stage, "/top/middle")
    middle.AddOrientOp().Set(Gf.Quatf(0.5, 0.5, -0.5, 0.5))
    turn = middle.AddRotateZXYOp()
    turn.Set(Gf.Vec3f(0, 0, 0), 0)
    turn.Set(Gf.Vec3f(40, 20, 60), 20)
    matrix = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 1, 0), 33))
    middle.AddTransformOp().Set(matrix.SetTranslateOnly(Gf.Vec3d(7, 8, 9)))
    curves = UsdGeom.BasisCurves.Define(stage, "/top/middle/hair")
    curves.CreateTypeAttr("linear")
    curves.CreateCurveVertexCountsAttr([each] * count)
    for frame in range(4):
        moved = strands(count, each) * np.float32(1 + frame / 4)
        curves.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(moved), 5 * frame)
    curves.CreateWidthsAttr([0.25, 0.125] * (count * each // 2))
    curves.SetWidthsInterpolation("vertex")
    api = UsdGeom.PrimvarsAPI(curves)
    colours = api.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "uniform")
    colours.Set([(0, 0.5, 1), (0.25, 0.75, 0.1)])
    colours.SetIndices(Vt.IntArray([0, 1] * (count // 2)))
    uvs = api.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "uniform")
    uvs.Set([(s / count, 0.5) for s in range(count)])
    api.CreatePrimvar("displayOpacity", Sdf.ValueTypeNames.FloatArray, "constant").Set([0.75])
    short = UsdGeom.BasisCurves.Define(stage, "/short")
    short.CreateTypeAttr("cubic")
    short.CreateBasisAttr("bspline")
    short.CreateWrapAttr("pinned")
    short.CreateCurveVertexCountsAttr([4, 3])
    short.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(strands(1, 7)))
    short.CreateWidthsAttr([1, 0.5])
    short.SetWidthsInterpolation("uniform")
    stage.DefinePrim("/class").SetActive(False)
    mesh = UsdGeom.Mesh.Define(stage, "/top/mesh")
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    mesh.GetPrim().SetMetadata("comment", 'it says "no"; \\ and # too')
    stage.GetRootLayer().customLayerData = {"a": 1.5, "b": {"c": "}"}}

    layer = stage.GetRootLayer()
    layer.Export(f"{folder}/pxr.usda")
    # The library reads the version once, so each needs a process.
    export = "import sys; from pxr import Sdf; Sdf.Layer.FindOrOpen(sys.argv[1]).Export(sys.argv[2])"
    for version in ["0.4", "0.5", "0.6", "0.8"]:
        environment = {**os.environ, "USD_WRITE_NEW_USDC_FILES_AS_VERSION": f"{version}.0"}
        names = [f"{folder}/pxr.usda", f"{folder}/pxr_{version}.usdc"]
        subprocess.run([sys.executable, "-c", export, *names], env=environment, check=True)
    cache = UsdGeom.XformCache()
    arrays = {"times": np.array([0, 5, 10, 15]) / 30}
    frames = []
    for code in [0, 5, 10, 15]:
        cache.SetTime(code)
        parts = []
        for prim in [curves, short]:
            world = np.array(cache.GetLocalToWorldTransform(prim.GetPrim()))
            points = np.array(prim.GetPointsAttr().Get(code)).astype(np.float64)
            parts.append(points @ world[:3, :3] + world[3, :3])
        frames.append(np.concatenate(parts))
    arrays["positions"] = np.array(frames)
    arrays["colours"] = np.array(UsdGeom.PrimvarsAPI(curves).GetPrimvar("displayColor").ComputeFlattened())
    np.savez_compressed(f"{folder}/pxr.npz", **arrays)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    if sys.argv[1] == "--make":
        make(sys.argv[2])
    else:
        problems = compare(sys.argv[1], sys.argv[2])
        print("\n".join(problems) or "the same")
        sys.exit(1 if problems else 0)
