"""Measure the processor time of a frame of a hand with the images of two fingers: docs/study/hand_times.json.

    python scripts/measure_hand_times.py RECORDING ...

Times are of one thread from images in memory to the estimate, percentiles over all frames but the first five of each
recording, which compile or load. Processor time does not count what others on the machine take; wall time is beside it.
"""

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from _common import write

import palpate
from palpate_lab.parallel import quiet

PERCENTILES = (50, 90, 99)


def main(files: Sequence[Path]) -> None:
    """Track all recordings and write the percentiles."""
    times = np.concatenate([times_of(file) for file in files])
    processor, wall, answers = times.T
    one = answers == 1.0
    write(
        "hand_times",
        {
            "recordings": len(files),
            "frames": len(times),
            "load": os.getloadavg()[0],
            "processor_ms": percentiles(processor),
            "processor_ms_one_hypothesis": percentiles(processor[one]),
            "wall_ms": percentiles(wall),
            "answers_mean": float(answers.mean()),
        },
    )


def times_of(file: Path) -> np.ndarray:
    """Return processor time [ms], wall time [ms] and the number of answers of each frame, (N, 3)."""
    recording = palpate.load_recording(file)
    assert recording.hand is not None
    tracker = palpate.Tracker(
        recording.shape,
        recording.hand,
        recording.first_pose,
        first_pose_sigma=recording.first_pose_sigma,
        set_up_sigma=recording.set_up_sigma,
    )
    rows = []
    with quiet():
        for frame in list(recording):
            processor = time.process_time()
            wall = time.perf_counter()
            estimate = tracker.update(frame)
            took = (time.process_time() - processor, time.perf_counter() - wall)
            rows.append((1e3 * took[0], 1e3 * took[1], len(estimate.answers)))
    return np.array(rows[5:])


def percentiles(values: np.ndarray) -> dict[str, float]:
    """Return percentiles by their number."""
    return {f"p{share}": float(np.percentile(values, share)) for share in PERCENTILES}


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
