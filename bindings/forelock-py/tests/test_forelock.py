import gc
import json
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest

import forelock

SMALL = {"groom.strands": 60, "body.sdf_cells": 32, "body.motion": "builtin:turn"}


def strands(count=20, particles=12):
    """Straight strands that hang from a line."""
    at = np.zeros((count, particles, 3), np.float32)
    at[..., 0] = np.linspace(-0.05, 0.05, count)[:, None]
    at[..., 1] = -0.01 * np.arange(particles)
    return at


def test_grooms_of_arrays():
    at = strands()
    groom = forelock.Groom(at)
    assert (len(groom), groom.strands, groom.particles) == (20, 20, 240)
    assert np.array_equal(groom.positions, at.reshape(-1, 3))
    assert np.array_equal(groom.strand_offsets, np.arange(21) * 12)
    again = forelock.Groom(groom.positions, groom.strand_offsets)
    assert np.array_equal(again.positions, groom.positions)
    # Other types and orders are converted.
    assert len(forelock.Groom(at.astype(np.float64)[::2])) == 10
    assert groom.resample(5).particles == 100
    bad = at.copy()
    bad[3, 4] = np.nan
    repaired = forelock.Groom(bad)
    assert len(repaired) == 19 and repaired.repairs


@pytest.mark.parametrize(
    "positions, offsets, words",
    [
        (np.zeros((4, 2)), None, "shape"),
        (np.zeros((4, 3)), None, "strand_offsets"),
        (strands(), [0, 240], "no strand_offsets"),
        (np.zeros((4, 3)), [0, 9], "last offset is 9"),
        (np.zeros((4, 3)), [0, -4], "-4"),
        (np.full((1, 4, 3), np.nan), None, "no strand"),
    ],
)
def test_grooms_that_cannot_be(positions, offsets, words):
    with pytest.raises(forelock.ForelockError, match=words):
        forelock.Groom(positions, offsets)


def test_groom_files(tmp_path):
    groom = forelock.Groom(strands())
    for name in ["a.npz", "a.data", "a.tfx", "a.obj"]:
        groom.save(tmp_path / name)
        again = forelock.Groom.load(tmp_path / name)
        assert np.allclose(again.positions, groom.positions, atol=1e-6)
    centimetres = forelock.Groom.load(str(tmp_path / "a.data"), unit="cm")
    assert np.allclose(centimetres.positions, 0.01 * groom.positions, atol=1e-6)
    with pytest.raises(forelock.ForelockError, match="missing.tfx"):
        forelock.Groom.load(tmp_path / "missing.tfx")
    with pytest.raises(forelock.ForelockError, match="unit"):
        forelock.Groom.load(tmp_path / "a.data", unit="ell")


def test_scenes():
    scene = forelock.Scene(set={"solver.kind": "dftl", "time.frames": 7, "solver.dftl.damping": 0.8})
    assert scene.frames == 7 and scene.fps == 60
    text = scene.to_toml()
    assert forelock.Scene.from_toml(text).to_toml() == text
    of_dict = forelock.Scene({"groom": {"source": "hair"}, "time": {"frames": np.int64(3)}})
    assert of_dict.frames == 3
    with pytest.raises(forelock.ForelockError, match="frams"):
        forelock.Scene({"groom": {"source": "hair"}, "time": {"frams": 3}})
    with pytest.raises(forelock.ForelockError):
        forelock.Scene({"groom": {"source": object()}})


def test_views_stay_as_they_are():
    sim = forelock.Simulation(groom=forelock.Groom(strands()))
    first = sim.positions
    assert first.dtype == np.float32 and first.shape == (240, 3) and not first.flags.writeable
    assert first.base is not None and sim.positions.base is first.base, "a view, not a copy"
    before = first.copy()
    sim.set("gravity", [3.0, -9.81, 0.0])
    assert sim.step(10)["frame"] == 10
    second = sim.positions
    assert np.array_equal(first, before)
    assert not np.array_equal(second, first)
    moved = second.copy()
    del sim
    gc.collect()
    assert np.array_equal(second, moved) and np.array_equal(first, before)


def test_memory_is_used_again():
    sim = forelock.Simulation(groom=forelock.Groom(strands()))
    where = set()
    for _ in range(12):
        sim.step()
        where.add(sim.positions.__array_interface__["data"][0])
    assert len(where) <= 2


def test_runs_are_equal_and_changes_undone():
    sims = [forelock.Simulation(forelock.Scene(set=SMALL), history=True) for _ in range(2)]
    for sim in sims:
        sim.step(6)
    assert sims[0].state_hash() == sims[1].state_hash()
    hash_at_6 = sims[0].state_hash()
    sims[0].set("solver.ams.k_integrity", 1.0)
    sims[0].step(4)
    sims[1].step(4)
    assert sims[0].state_hash() != sims[1].state_hash()
    sims[1].seek(6)
    assert sims[1].frame == 6 and sims[1].state_hash() == hash_at_6
    with pytest.raises(forelock.ForelockError, match="groom.strands"):
        sims[0].set("groom.strands", 10)
    with pytest.raises(forelock.ForelockError):
        sims[0].set("solver.ams.k_integrity", -5)


def test_head_colliders_and_edits():
    sim = forelock.Simulation(groom=forelock.Groom(strands()), history=True)
    pose = np.eye(4)
    assert np.allclose(sim.head_pose, pose)
    pose[0, 3] = 0.01
    sim.head_pose = pose
    sim.step()
    assert np.allclose(sim.head_pose, pose)
    roots = sim.positions[sim.strand_offsets[:-1]]
    assert np.allclose(roots[:, 0], np.linspace(-0.05, 0.05, 20) + 0.01, atol=1e-6)
    ball = sim.add_collider({"shape": "sphere", "radius": 0.02, "position": [0.0, -0.06, 0.1]})
    pose[:3, 3] = [0.0, -0.06, 0.0]
    sim.move_collider(ball, pose)
    sim.step(30)
    distance = np.linalg.norm(sim.positions - [0.0, -0.06, 0.0], axis=1)
    assert distance.min() > 0.019
    sim.remove_collider(ball)
    again = forelock.Simulation(sim.performed_scene, groom=forelock.Groom(strands()))
    again.step(sim.frame)
    assert np.allclose(again.positions, sim.positions, atol=1e-4)
    before = sim.state_hash()
    sim.edit({"op": "trim", "to": 0.05})
    assert sim.groom.positions[:, 1].min() > -0.06
    assert sim.undo() and sim.state_hash() == before
    with pytest.raises(forelock.ForelockError):
        sim.head_pose = np.diag([2.0, 1.0, 1.0, 1.0])
    with pytest.raises(forelock.ForelockError):
        sim.move_collider(77, np.eye(4))


def test_the_gil_is_released():
    sim = forelock.Simulation(forelock.Scene(set=SMALL | {"groom.strands": 2000}))
    done = threading.Event()
    thread = threading.Thread(target=lambda: (sim.step(20), done.set()))
    thread.start()
    count = 0
    while not done.is_set():
        count += 1
        time.sleep(1e-3)
    thread.join()
    assert count > 10


def test_labels(tmp_path):
    labels = {
        "ids": np.array([7, 8, 9], np.int32),
        "group_ids": np.array([0, 1, 1], np.int32),
        "guides": np.array([True, False, False]),
        "closest_guides": np.array([[-1, -1, -1], [7, -1, -1], [7, 7, -1]], np.int32),
        "guide_weights": np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.5, 0]], np.float32),
    }
    plain = forelock.Groom(strands(3))
    assert plain.labels == {}
    groom = plain.with_labels(labels)
    path = tmp_path / "hair.abc"
    groom.save(path)
    for own in [groom, groom.resample(5), forelock.Groom.load(path)]:
        assert own.labels.keys() == labels.keys()
        for name, values in labels.items():
            assert own.labels[name].dtype == values.dtype
            assert np.array_equal(own.labels[name], values), name
    assert groom.with_labels({"ids": [1, 2, 3]}).labels.keys() == {"ids"}
    for wrong, words in [
        ({"ids": [1, 2]}, "ids"),
        ({"guide_weights": [0, 1, 0]}, "must have .S, 3."),
        ({"names": [1, 2, 3]}, "no label"),
    ]:
        with pytest.raises(forelock.ForelockError, match=words):
            plain.with_labels(wrong)


def test_training(tmp_path):
    seen = []
    config = {
        "hair": {"grooms": ["straight"], "lengths": [0.7], "grown": 96, "held_out": 2},
        "motions": {"count": 4, "secs": 1, "held_out": 1},
    }
    keys = {"steps.codes": 20, "steps.simulator": 8, "steps.measure_every": 4}
    summary = forelock.train(config, tmp_path, set=keys, progress=lambda *own: seen.append(own))
    assert summary["steps"] == 8 and seen
    model = [path for path in summary["outputs"] if path.endswith(".safetensors")][0]
    scene = SMALL | {"solver.kind": "neural", "solver.neural.model": model}
    sim = forelock.Simulation(forelock.Scene(set=scene))
    sim.step(3)
    assert np.isfinite(sim.positions).all()
    with pytest.raises(forelock.ForelockError, match="steps.codes"):
        forelock.train({"steps": {"codes": 0}}, tmp_path / "other")


def test_runs_into_a_folder(tmp_path):
    seen = []
    keys = {"time.frames": 4, "output.film": False, "output.picture": False, "output.cache_every": 1}
    scene = forelock.Scene(set=SMALL | keys)
    summary = forelock.simulate(scene, tmp_path, progress=lambda *own: seen.append(own))
    assert summary["frames"] == 4 and seen
    cache = forelock.Cache(tmp_path / "hair.npz")
    assert len(cache) == 5 and np.allclose(cache.times, np.arange(5) / 60)
    sim = forelock.Simulation(scene)
    sim.step(4)
    assert np.array_equal(cache[-1], sim.positions)
    with pytest.raises(IndexError):
        cache[5]
    json.dumps(summary)


def test_a_progress_that_raises_ends_the_run(tmp_path):
    def fail(*_):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        forelock.simulate(forelock.Scene(set=SMALL), tmp_path, progress=fail)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_ends_a_step():
    script = textwrap.dedent(
        """
        import forelock
        sim = forelock.Simulation(forelock.Scene(set={"groom.strands": 200}))
        print("ready", flush=True)
        sim.step(1_000_000)
        """
    )
    child = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert child.stdout.readline().strip() == b"ready"
    time.sleep(0.3)
    os.kill(child.pid, signal.SIGINT)
    _, errors = child.communicate(timeout=10)
    assert b"KeyboardInterrupt" in errors
