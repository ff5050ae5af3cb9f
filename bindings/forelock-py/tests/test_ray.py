"""Runs with ``ray`` and with the command in the variable FORELOCK, or ``forelock`` on the path."""

import os
import shutil

import pytest

ray = pytest.importorskip("ray")
program = os.environ.get("FORELOCK") or shutil.which("forelock")
pytestmark = pytest.mark.skipif(program is None, reason="the command forelock is not on the path")

LIST = """
out = "all"
[set]
"time.frames" = 3
"groom.strands" = 30
"body.sdf_cells" = 24
"output.film" = false
"output.picture" = false
[[shot]]
name = "turn"
vary."solver.kind" = ["ams", "dftl", "xpbd"]
[[shot]]
name = "bad"
set."groom.source" = "missing.tfx"
"""


def test_shots_on_two_workers(tmp_path):
    import forelock.ray

    path = tmp_path / "list.toml"
    path.write_text(LIST)
    ray.init(num_cpus=2, include_dashboard=False)
    try:
        found = forelock.ray.shots(path, program=program)
        again = forelock.ray.shots(path, program=program)
    finally:
        ray.shutdown()
    assert list(found) == ["turn-kindams", "turn-kinddftl", "turn-kindxpbd", "bad"]
    assert all(found[name]["frames"] == 3 for name in list(found)[:3])
    assert len({own["state_hash"] for own in found.values()}) == 4
    assert "missing.tfx" in found["bad"]["error"]
    assert again == found
    assert (tmp_path / "all/turn-kindams/hair.npz").is_file()
