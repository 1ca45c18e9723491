"""Count what is advised where a sensor's frame is turned: docs/study/turned_frames.json.

    python scripts/measure_turned_frames.py RECORDINGS [DEGREES ...]

A folder of simulated recordings. Each is tracked as it is and with the sensor's frame turned about z. The reasons of
all frames count: *right* names the turn to 10 degrees, *asked* says that the frame is turned and not by how much,
*wrong* names another turn or advises on images, which are upright, *silent* does neither.
"""

import re
import sys
from collections import Counter
from dataclasses import replace
from math import radians, remainder
from pathlib import Path

import numpy as np
from _common import for_each, write

import palpate
from palpate.pipeline.track import first_pose_of_recording
from palpate_lab.study.recordings import find_recordings

TURNS = (0, 20, 45, 180)
"""[deg]"""
NAMED = re.compile(r"turned about z by ([+-]\d+) degrees|; by ([+-]\d+) degrees if images lie")


def main(folder: Path, turns: tuple[int, ...] = TURNS) -> None:
    """Track all recordings at all turns and write the counts."""
    files = [*find_recordings(folder).values()]
    cases = [(file, degrees) for degrees in turns for file in files]
    counts = {degrees: Counter(right=0, asked=0, wrong=0, silent=0) for degrees in turns}
    for (file, degrees), words in zip(cases, for_each(reasons, cases), strict=True):
        kind = kind_of(words, degrees)
        counts[degrees][kind] += 1
        print(f"{degrees:4} {kind:6} {file.stem}: {min(words, default='')[:150]}", flush=True)
    write("turned_frames", {str(degrees): dict(count) for degrees, count in counts.items()})


def reasons(case: tuple[Path, int]) -> set[str]:
    """Return the reasons on turned frames or images that are given for a recording whose frame is turned [deg]."""
    file, degrees = case
    recording = palpate.load_recording(file)
    turned = recording.sensor_pose - np.array([0.0, 0.0, radians(degrees)])
    first, sigma = first_pose_of_recording(recording, palpate.NoiseSettings())
    recording = replace(recording, sensor_pose=turned, is_view_known=False)
    tracker = palpate.Tracker(recording.shape, recording.sensor, first, first_pose_sigma=sigma)
    found = {tracker.update(frame).reason for frame in recording}
    return {words for words in found if "turned about z" in words or "confirm by --orientation" in words}


def kind_of(words: set[str], degrees: int) -> str:
    """Return whether advice on a frame that is turned [deg] is right, asked, wrong or silent."""
    if not words:
        return "silent"
    named = [float(number) for text in words for pair in NAMED.findall(text) for number in pair if number]
    is_right = degrees != 0 and any(abs(remainder(number - degrees, 360.0)) <= 10.0 for number in named)
    if degrees and not named and not any("confirm by --orientation" in text for text in words):
        return "asked"
    return "right" if is_right else "wrong"


if __name__ == "__main__":
    main(Path(sys.argv[1]), tuple(map(int, sys.argv[2:])) or TURNS)
