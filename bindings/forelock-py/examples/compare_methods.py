"""The tips of the demo's hair in a turn of the head, under each solver.

    python compare_methods.py [PLOT.png]
"""

import sys
import time

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import forelock

FRAMES = 120


def main():
    figure, (paths, costs) = plt.subplots(1, 2, figsize=(10, 4))
    for solver in ["ams", "mass-spring", "dftl", "xpbd"]:
        scene = forelock.Scene(set={"groom.strands": 300, "solver.kind": solver})
        sim = forelock.Simulation(scene)
        tips = sim.strand_offsets[1:] - 1
        rest = sim.groom.positions[sim.groom.strand_offsets[1:] - 1]
        moved, began = [], time.perf_counter()
        for _ in range(FRAMES):
            sim.step()
            pose = sim.head_pose
            in_head = (sim.positions[tips] - pose[:3, 3]) @ pose[:3, :3]
            moved.append(np.linalg.norm(in_head - rest, axis=1).mean())
        took = (time.perf_counter() - began) / FRAMES
        paths.plot(np.arange(FRAMES) / scene.fps, 1e3 * np.array(moved), label=solver)
        costs.bar(solver, 1e3 * took)
        print(f"{solver}: {1e3 * took:.2f} ms a frame, tips move by up to {1e3 * max(moved):.0f} mm")
    paths.set(xlabel="time, s", ylabel="mean distance of the tips from rest, mm")
    paths.legend()
    costs.set(ylabel="ms a frame")
    figure.tight_layout()
    figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "compare_methods.png", dpi=120)


if __name__ == "__main__":
    main()
