"""How often images that lie turned or mirrored are found: python benchmarks/half_turn.py FOLDER_OF_RECORDINGS

Each recording with images and ground truth is tracked as it is, with all images turned by half a turn and mirrored,
from the first pose that it states. Told are the shares that are taken for turned, and how long after the first contact.
The reported one: `palpate simulate` of 12 pushes of each class, seed 66101, 6 s.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path
from statistics import fmean, median

from palpate import Tracker, load_recording
from palpate.config.settings import NoiseSettings
from palpate.pipeline.prepared import first_pose_of
from palpate.touch.view import AS_IT_IS, CameraView
from palpate.types.recording import Recording

VIEWS = {"as it is": AS_IT_IS, "turned by half a turn": CameraView(2), "mirrored": CameraView(0, mirrored=True)}


def found_after(recording: Recording, view: CameraView) -> float | None:
    """Time from the first contact until images are taken for turned [s]; None where they never are."""
    first, sigma = first_pose_of(recording, NoiseSettings())
    tracker = Tracker(recording.shape, recording.sensor, first, first_pose_sigma=sigma)
    touched: float | None = None
    for frame in recording:
        assert frame.image is not None
        estimate = tracker.update(replace(frame, image=view.of(frame.image)))
        if touched is None and estimate.contact:
            touched = frame.time
        if touched is not None and "half a turn" in estimate.reason:
            return frame.time - touched
    return None


def main() -> None:
    """Judge all recordings of a folder in each view, and print the shares as JSON."""
    recordings = [load_recording(file) for file in sorted(Path(sys.argv[1]).glob("*.h5"))]
    told = {}
    for name, view in VIEWS.items():
        times = [found_after(recording, view) for recording in recordings]
        found = [time for time in times if time is not None]
        told[name] = {"share": fmean(time is not None for time in times), "median_s": median(found) if found else None}
    print(json.dumps({"recordings": len(recordings), **told}, indent=1))


if __name__ == "__main__":
    main()
