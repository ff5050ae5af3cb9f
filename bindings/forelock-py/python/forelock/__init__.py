"""Real-time simulation of dense hair, strand by strand.

>>> import forelock
>>> sim = forelock.Simulation(forelock.Scene(set={"groom.strands": 100}))
>>> sim.step(10)["frame"]
10
>>> sim.positions.shape[1]
3
"""

import json as _json

from ._forelock import Cache, ForelockError, Groom, Scene, Simulation, __version__
from . import _forelock

__all__ = ["Cache", "ForelockError", "Groom", "Scene", "Simulation", "simulate", "train", "__version__"]


def simulate(scene, out, *, resume=False, progress=None):
    """Run a scene into the folder ``out``: cache, pictures, report.

    Returns the summary of the run as a dict. Ctrl-C ends the run, and ``resume=True`` goes on with
    it. ``progress(what, done, total)`` is called after each step.
    """
    return _json.loads(_forelock.simulate(scene, out, resume=resume, progress=progress))


def train(config=None, out="training", *, set=None, resume=False, progress=None):
    """Train a model of the learned solver into the folder ``out``.

    ``config`` is a dict or the path of a TOML file (`docs/training-reference.md` has the keys), by
    default the training of the built-in head's hair; ``set`` is a dict of dotted keys laid over it.
    Returns the summary as a dict: the model is among its ``outputs``, and a scene uses it by
    ``solver.kind = "neural"`` and ``solver.neural.model``. Ctrl-C ends the training, and
    ``resume=True`` goes on with it. ``progress(what, done, total)`` is called after each step.
    """
    return _json.loads(_forelock.train(config, out, set=set, resume=resume, progress=progress))
