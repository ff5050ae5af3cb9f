#!/usr/bin/env python3
"""How much processor time the window needs for a picture of hair that moves.

    tools/window-work.py FORELOCK [SECONDS]

Opens `FORELOCK view --draw gpu` (built with `--features view`) on the demo, on a display without a
screen (Xvfb), and samples its threads with perf for SECONDS (30). The window's own work is what the
program does in its main thread, which draws the widgets, and all that the thread `artist` does, which
prepares pictures of the hair, except for the graphics driver: on a software Vulkan that does the work
of a graphics card. Simulation is in other threads.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

RATE = 999
# Time for loading the demo and compiling kernels.
BEGIN_SECS = 30


def pictures(log):
    return log.read_text(encoding="utf-8").count(" picture ")


def samples(recording):
    """Samples by thread and program or library."""
    script = ["perf", "script", "-i", recording, "-F", "comm,ip,dso", "--no-inline"]
    counts = Counter()
    for line in subprocess.run(script, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout.splitlines():
        comm, _, rest = line.strip().partition("  ")
        library = rest[rest.rfind("(") + 1 : rest.rfind(")")]
        counts[comm.strip(), Path(library).name] += 1
    return counts


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    forelock = sys.argv[1]
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 30.0
    reading, writing = os.pipe()
    arguments = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "1920x1080x24"]
    display = subprocess.Popen(arguments, pass_fds=[writing], stderr=subprocess.DEVNULL)
    os.close(writing)
    window = None
    try:
        number = os.read(reading, 16).decode().strip()
        if not number:
            sys.exit("Xvfb does not start")
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "log"
            # Plays until after the measurement.
            shot = ["--screenshot", f"{folder}/window.png", "--after", str(BEGIN_SECS + 2 * seconds)]
            environment = dict(os.environ, DISPLAY=f":{number}", RUST_LOG="forelock_view=debug")
            with open(log, "w", encoding="utf-8") as out:
                window = subprocess.Popen([forelock, "view", "--draw", "gpu", *shot], env=environment, stderr=out)
            time.sleep(BEGIN_SECS)
            before = pictures(log)
            recording = f"{folder}/perf.data"
            perf = ["perf", "record", "-q", "-e", "cpu-clock", "-F", str(RATE), "-p", str(window.pid)]
            subprocess.run([*perf, "-o", recording, "--", "sleep", str(seconds)], check=True)
            drawn = pictures(log) - before
            counts = samples(recording)
    finally:
        if window:
            window.terminate()
            window.wait()
        display.terminate()
    if drawn < 3:
        sys.exit(f"only {drawn} pictures were drawn")
    name = Path(forelock).name
    print(f"{drawn} pictures in {seconds:.0f} s\n")
    print("| thread | in | ms a picture |\n| --- | --- | ---: |")
    for (comm, library), count in counts.most_common(16):
        print(f"| {comm} | {library} | {1e3 * count / RATE / drawn:.2f} |")
    def is_own(comm, library):
        by_driver = library.startswith(("libvulkan", "libLLVM", "perf-", "nvidia"))
        return (comm, library) == (name, name) or (comm == "artist" and not by_driver)

    own = sum(count for key, count in counts.items() if is_own(*key))
    ms = 1e3 * own / RATE / drawn
    print(f"\nown work: {ms:.2f} ms a picture, {3 * ms:.1f} % of a core at 30 pictures a second")


if __name__ == "__main__":
    main()
