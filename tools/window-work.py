#!/usr/bin/env python3
"""How much processor time the window needs for a picture of hair that moves.

    tools/window-work.py FORELOCK [SECONDS]

Opens `FORELOCK view --draw gpu` (built with `--features view`) on the demo, on a display without a
screen (Xvfb), and samples its threads with perf for SECONDS (30). The window's own work is that of its
main thread, which draws the widgets, and of the thread `artist`, which prepares pictures of the hair,
without the graphics driver: on a software Vulkan that does the work of a graphics card. Simulation is
in other threads.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

RATE = 999
# Time for loading the demo and compiling kernels.
BEGIN_SECS = 30


def counts_in(log):
    """Pictures of hair so far, and repaints of the window."""
    text = log.read_text(encoding="utf-8")
    return text.count(" picture "), text.count(" repaint")


def samples(recording, pid):
    """Samples by thread and program or library; the main thread is "main"."""
    script = ["perf", "script", "-i", recording, "-F", "comm,tid,ip,dso", "--no-inline"]
    text = subprocess.run(script, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout
    counts = Counter()
    for line in text.splitlines():
        comm, tid, rest = re.match(r"\s*(.*?)\s+(\d+)\s+(.*)", line).groups()
        library = rest[rest.rfind("(") + 1 : rest.rfind(")")]
        counts["main" if tid == str(pid) else comm, Path(library).name] += 1
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
            environment = dict(os.environ, DISPLAY=f":{number}", RUST_LOG="forelock_view=trace")
            with open(log, "w", encoding="utf-8") as out:
                window = subprocess.Popen([forelock, "view", "--draw", "gpu", *shot], env=environment, stderr=out)
            time.sleep(BEGIN_SECS)
            before = counts_in(log)
            recording = f"{folder}/perf.data"
            perf = ["perf", "record", "-q", "-e", "cpu-clock", "-F", str(RATE), "-p", str(window.pid)]
            subprocess.run([*perf, "-o", recording, "--", "sleep", str(seconds)], check=True)
            drawn, repainted = (now - then for now, then in zip(counts_in(log), before))
            counts = samples(recording, window.pid)
    finally:
        if window:
            window.terminate()
            window.wait()
        display.terminate()
    if drawn < 3 or not repainted:
        sys.exit(f"only {drawn} pictures were drawn, in {repainted} repaints")
    print(f"{drawn} pictures and {repainted} repaints in {seconds:.0f} s\n")
    print("| thread | in | ms in all |\n| --- | --- | ---: |")
    for (comm, library), count in counts.most_common(16):
        print(f"| {comm} | {library} | {1e3 * count / RATE:.0f} |")

    def own_ms(thread, times):
        """Milliseconds of the thread without the driver, each time."""

        def by_driver(library):
            return library.startswith(("libvulkan", "libLLVM", "perf-")) or "nvidia" in library

        own = sum(count for (comm, library), count in counts.items() if comm == thread and not by_driver(library))
        return 1e3 * own / RATE / times

    picture, repaint = own_ms("artist", drawn), own_ms("main", repainted)
    print(f"\nown work: {picture:.2f} ms a picture and {repaint:.2f} ms a repaint,")
    print(f"{3 * (picture + repaint):.1f} % of a core for 30 of both a second")


if __name__ == "__main__":
    main()
