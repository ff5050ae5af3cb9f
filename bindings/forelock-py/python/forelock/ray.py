"""Many shots on Ray: ``pip install forelock[ray]``, and the command ``forelock`` on every worker.

>>> import ray, forelock.ray
>>> ray.init()                                             # doctest: +SKIP
>>> forelock.ray.shots("shots.toml")["turn"]["frames"]     # doctest: +SKIP
120
"""

import json
import os
import subprocess

import ray


def shots(path, *, program="forelock", num_cpus=1):
    """Run the shots of the list at ``path``, each as a task of Ray with ``num_cpus`` processors.

    Workers must reach the list and its folder of results under the same paths. Returns the report
    of each shot by its name: ``frames`` and ``state_hash``, or ``error``. Shots that are done are
    not run again, and one that was cut short is resumed.
    """
    path = os.path.abspath(path)
    listed = subprocess.run(
        [program, "shots", path, "--list-only"], capture_output=True, text=True
    )
    if listed.returncode != 0:
        raise RuntimeError(listed.stderr.strip())
    names = [line.rsplit(": ", 1)[0] for line in listed.stdout.splitlines()]
    task = ray.remote(num_cpus=num_cpus)(_shot)
    threads = str(max(1, int(num_cpus)))
    return dict(zip(names, ray.get([task.remote(program, path, name, threads) for name in names])))


def _shot(program, path, name, threads):
    run = subprocess.run(
        [program, "shots", path, "--only", name, "--json", "--threads", threads],
        capture_output=True,
        text=True,
    )
    try:
        return json.loads(run.stdout)["shots"][0]
    except (ValueError, LookupError):
        return {"name": name, "error": run.stderr.strip() or f"exit status {run.returncode}"}
