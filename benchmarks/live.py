"""A long live session: latency, memory and drops while it records.

    python benchmarks/live.py --rate 30 --seconds 300

A simulated push of that length is replayed in real time by `palpate live --replay --record`, in a process of its own.
Printed as JSON are

- `latency_ms` from image to estimate;
- `rss_growth_mb`: the most memory of the process in the last tenth of the time, less that after a minute or a fifth of
  the time;
- `images`, and how many were tracked, dropped, without a pose and left out; `counts_agree` says whether the recorded
  file has all images, and an estimate for each but those.
"""

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import tyro

from palpate import DIGIT, Rectangle, write_recording
from palpate.io.estimates import POSES
from palpate.io.recording_mcap import IMAGES
from palpate.io.rosbag_reader import bag_messages
from palpate.lab.simulate.recordings import Simulation


def main(rate: float = 30.0, seconds: float = 300.0) -> None:
    """Make the push, replay it and print the results."""
    with tempfile.TemporaryDirectory() as folder:
        path, recorded = Path(folder) / "push.mcap", Path(folder) / "live.mcap"
        push = Simulation(Rectangle(0.2363, 0.1579), "rectangle-edges", 1, seconds * rate / DIGIT.rate).run()
        write_recording(replace(push, time=push.time * DIGIT.rate / rate), path)
        words = ["live", "--replay", str(path), "--record", str(recorded), "--json"]
        summary, memory = watched([sys.executable, "-m", "palpate", *words])
        agree = counts_agree(summary, recorded)
    first, last = memory[: max(1, min(60, len(memory) // 5))], memory[-max(1, len(memory) // 10) :]
    growth = max(last) - first[-1]
    counts = ("images", "tracked", "dropped", "without_pose", "left_out", "rate_hz", "latency_ms", "statuses")
    memory_mb = {"rss_mb": last[-1], "rss_growth_mb": growth}
    found = {name: summary[name] for name in counts} | memory_mb | {"counts_agree": agree}
    print(json.dumps(found, indent=1))


def watched(words: list[str]) -> tuple[dict[str, Any], list[float]]:
    """Run a session; return its summary and its memory at every second [MB]."""
    process, memory = psutil.Popen(words, stdout=subprocess.PIPE, text=True), list[float]()
    while process.poll() is None:
        memory.append(process.memory_info().rss / 1e6)
        time.sleep(1.0)
    assert process.stdout is not None
    if process.returncode:
        raise SystemExit(f"the session ended with {process.returncode}")
    return json.loads(process.stdout.read()), memory


def counts_agree(summary: dict[str, Any], recorded: Path) -> bool:
    """Check that a file has all images, and an estimate for each but those that were counted as having none."""
    times: dict[str, set[int]] = {IMAGES: set(), POSES: set()}
    for message in bag_messages(recorded):
        if message.channel.topic in times:
            times[message.channel.topic].add(message.log_time)
    without = summary["dropped"] + summary["without_pose"] + summary["left_out"]
    images, estimates = times[IMAGES], times[POSES]
    counts = (len(images), len(estimates), len(images - estimates))
    return counts == (summary["images"], summary["tracked"], without) and estimates <= images


if __name__ == "__main__":
    tyro.cli(main)
