"""How far hair sags and swings, by the stiffness of AMS's integrity springs.

    python sweep_parameter.py [PLOT.png]
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import forelock


def strands(count=100, particles=25, length=0.25):
    """Straight strands that stand out to the side."""
    at = np.zeros((count, particles, 3), np.float32)
    at[..., 0] = np.linspace(0.0, length, particles)
    at[..., 2] = np.linspace(-0.05, 0.05, count)[:, None]
    return forelock.Groom(at)


def main():
    factors = np.geomspace(1.0, 1000.0, 13)
    drops, swings = [], []
    groom = strands()
    tips = groom.strand_offsets[1:] - 1
    scene = forelock.Scene.from_toml('groom.source = "hair"\nbody.mesh = "none"\nbody.motion = "builtin:still"')
    keys = {"solver.ams.sag_free": False}
    scene = forelock.Scene.from_toml(scene.to_toml(), set=keys)
    for factor in factors:
        sim = forelock.Simulation(scene, groom)
        sim.set("solver.ams.k_integrity", float(factor))
        heights = []
        for _ in range(180):
            sim.step()
            heights.append(sim.positions[tips, 1].mean())
        drops.append(-np.mean(heights[-30:]))
        swings.append(np.ptp(heights[-90:]))
        print(f"k_integrity {factor:.3g}: tips {100 * drops[-1]:.1f} cm below rest")
    figure, axes = plt.subplots(figsize=(6, 4))
    axes.semilogx(factors, 100 * np.array(drops), "o-", label="below rest, last half second")
    axes.semilogx(factors, 100 * np.array(swings), "s--", label="swing, last 1.5 s")
    axes.set(xlabel="k_integrity", ylabel="tips, cm")
    axes.legend()
    figure.tight_layout()
    figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "sweep_parameter.png", dpi=120)


if __name__ == "__main__":
    main()
