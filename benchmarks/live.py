"""A long live session: latency, memory and drops while it records and shows what it does.

    python benchmarks/live.py --rate 30 --seconds 300
    python benchmarks/live.py --rate 60 --seconds 120

A simulated push of that length is replayed in real time by `palpate live --replay --record --view`, in a process of its
own. Where there is no display, the viewer takes everything all the same, without a window. Printed as JSON are

- `latency_ms` from image to estimate;
- `rss_growth_mb`: the most memory of the process in the last tenth of the time, less that after a minute or a fifth of
  the time; `viewer_rss_mb` is the viewer's;
- `images`, and how many were tracked, dropped, without a pose and left out; `counts_agree` says whether the file
  that was recorded has all images, and an estimate for each but those;
- `reached`: which of TARGETS were. They are for a quiet machine.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import tyro

from palpate.geometry.objects import SHAPES
from palpate.io.estimates_mcap import POSES
from palpate.io.recording_mcap import IMAGES, write_recording
from palpate.io.rosbag_reader import bag_messages
from palpate.lab.simulate.recordings import simulate_recording
from palpate.types.sensor import DIGIT

TARGETS = {"p50": 8.0, "p99": 25.0, "rss_growth_mb": 50.0}
"""[ms, ms, MB]"""
LOOK = 1.0
"""[s] between looks at the memory."""
MB = 1e6

SESSION = """
import sys
from palpate.cli import main
from palpate.viewer import live, viewer
if not viewer.has_display():
    opened = viewer.open_viewer
    viewer.has_display = lambda: True
    live.open_viewer = lambda: opened("--serve-grpc")
sys.exit(main.main(sys.argv[1:]))
"""


def main(rate: float = 30.0, seconds: float = 300.0, view: bool = True) -> None:
    """Make the push, replay it and print what was found."""
    with tempfile.TemporaryDirectory() as made:
        path, recorded = Path(made) / "push.mcap", Path(made) / "live.mcap"
        push = simulate_recording(SHAPES["rectangle"], "rectangle-edges", 1, seconds * rate / DIGIT.rate)
        write_recording(replace(push, time=push.time * DIGIT.rate / rate), path)
        words = ["live", "--replay", str(path), "--record", str(recorded), "--json", *(["--view"] if view else [])]
        said, memory, viewer = watched([sys.executable, "-c", SESSION, *words])
        agree = counts_agree(said, recorded)
    first, last = memory[: max(1, min(60, len(memory) // 5))], memory[-max(1, len(memory) // 10) :]
    found = {
        **{name: said[name] for name in ("images", "tracked", "dropped", "without_pose", "left_out", "rate_hz")},
        "counts_agree": agree,
        "latency_ms": said["latency_ms"],
        "statuses": said["statuses"],
        "rss_mb": last[-1],
        "rss_growth_mb": max(last) - first[-1],
        "viewer_rss_mb": viewer,
    }
    values = {**said["latency_ms"], "rss_growth_mb": found["rss_growth_mb"]}
    found["reached"] = {name: values[name] <= most for name, most in TARGETS.items()}
    print(json.dumps(found, indent=1))


def watched(words: Sequence[str]) -> tuple[dict[str, Any], list[float], float]:
    """Run a session; return what it says, its memory over time, and the most of those that it starts [MB]."""
    process = psutil.Popen(words, stdout=subprocess.PIPE, text=True)
    memory, viewer, started = list[float](), 0.0, set[psutil.Process]()
    while process.poll() is None:
        started |= set(process.children(recursive=True))
        memory.append(resident(process))
        viewer = max(viewer, sum(map(resident, started)))
        time.sleep(LOOK)
    for each in started:  # the viewer is there for people to look at afterwards
        if each.is_running():
            each.kill()
    assert process.stdout is not None
    out = process.stdout.read()
    if process.returncode:
        raise SystemExit(f"the session ended with {process.returncode}")
    return json.loads(out), [each for each in memory if each], viewer


def resident(process: psutil.Process) -> float:
    """Memory of a process [MB], 0 where it has ended."""
    try:
        return process.memory_info().rss / MB
    except psutil.Error:
        return 0.0


def counts_agree(said: dict[str, Any], recorded: Path) -> bool:
    """Whether a file holds all images, and an estimate for each but those that were counted as having none."""
    stamps: dict[str, set[int]] = {IMAGES: set(), POSES: set()}
    for raw in bag_messages(recorded):
        if raw.channel.topic in stamps:
            stamps[raw.channel.topic].add(raw.log_time)
    without = said["dropped"] + said["without_pose"] + said["left_out"]
    images, estimates = stamps[IMAGES], stamps[POSES]
    counts = (len(images), len(estimates), len(images - estimates))
    return counts == (said["images"], said["tracked"], without) and estimates <= images


if __name__ == "__main__":
    tyro.cli(main)
