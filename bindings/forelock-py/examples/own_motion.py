"""A head motion of one's own, frame by frame: a nod that stops, and the hair that goes on.

    python own_motion.py [PLOT.png]
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import forelock

NOD_SECS = 0.6


def pose(seconds):
    """World from head: a nod by 25 degrees about x that ends after NOD_SECS."""
    angle = np.radians(25.0) * np.sin(np.pi * min(seconds / NOD_SECS, 1.0) / 2.0) ** 2
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.eye(4)
    matrix[1:3, 1:3] = [[c, -s], [s, c]]
    return matrix


def main():
    scene = forelock.Scene(set={"groom.strands": 500, "body.motion": "builtin:still"})
    sim = forelock.Simulation(scene)
    times, speeds = [], []
    last = None
    for frame in range(150):
        sim.head_pose = pose((frame + 1) / scene.fps)
        sim.step()
        head = sim.head_pose
        now = (sim.positions - head[:3, 3]) @ head[:3, :3]
        if last is not None:
            times.append(sim.time)
            speeds.append(np.linalg.norm(now - last, axis=1).mean() * scene.fps)
        last = now
    figure, axes = plt.subplots(figsize=(6, 4))
    axes.plot(times, 100 * np.array(speeds))
    axes.axvline(NOD_SECS, linestyle=":", color="grey")
    axes.set(xlabel="time, s", ylabel="mean speed relative to the head, cm/s")
    figure.tight_layout()
    figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "own_motion.png", dpi=120)
    print(f"{100 * max(speeds):.1f} cm/s at most, {100 * speeds[-1]:.2f} cm/s at the end")


if __name__ == "__main__":
    main()
