"""What check_alembic.py and check_gltf.py share: arguments, expected frames, the verdict."""

import argparse
import sys

import numpy as np


def arguments(description, fps):
    """The command line of a check, whose frames are `fps` a second by default."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("expected")
    parser.add_argument("--fps", type=int, default=fps)
    parser.add_argument("--tolerance", type=float, default=1e-6)
    return parser.parse_args()


def load(path):
    """The arrays of a groom or cache, its frames [F, P, 3] and its size in metres."""
    expected = np.load(path)
    frames = expected["positions"].astype(np.float64)
    frames = frames.reshape((-1,) + frames.shape[-2:])
    return expected, frames, np.linalg.norm(np.ptp(frames[0], axis=0))


def file_axes(points):
    """Blender's points, z up, in the axes of the file, y up."""
    return points[:, [0, 2, 1]] * [1, 1, -1]


def difference(found, wanted, size):
    """The largest distance of two points, relative to the size of the groom."""
    return np.linalg.norm(found - wanted, axis=1).max() / size


def judge(worst, found, wanted, size, tolerance):
    """Ends with an error if `worst` is too large, or if the comparison misses a point that is moved
    in the last frame, `found` and `wanted`."""
    print(f"the largest difference of a point is {worst:.3g} of the groom's size, {size:.4g} m")
    if worst > tolerance:
        sys.exit("that is more than the tolerance")
    moved = wanted.copy()
    moved[len(moved) // 2, 1] += 10 * tolerance * size
    if difference(found, moved, size) <= tolerance:
        sys.exit("the negative control passed: the comparison is blind")
