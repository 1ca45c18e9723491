"""How recordings are tracked that begin in contact, against the same with the untouched gel given.

    python benchmarks/begun_in_contact.py FOLDER [--live] [--json]

FOLDER holds recordings with images, contact flags and truth that begin without contact, as `palpate simulate` makes.
Each is cut off before a frame of its first contact, the first to the twenty-first; its untouched gel is that of the
frames that were cut off. With --live the tracker is given the frames as they come, without a look ahead.
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.errors import FrameError
from palpate.geometry import se2
from palpate.io import load_recording
from palpate.pipeline.run import track
from palpate.touch.background import background_of
from palpate.touch.calibration import Calibration
from palpate.tracker import Tracker
from palpate.types.recording import Recording

LATEST = 20  # frames of the first contact that are cut off at most


def main() -> None:
    """Track each recording in both ways and print final errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--live", action="store_true")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    files = sorted(arguments.folder.glob("*.h5"))
    errors: dict[str, list[tuple[float, float]]] = {"given": [], "found": []}
    for number, file in enumerate(files):
        recording, unit = begun(load_recording(file), number * LATEST // max(len(files) - 1, 1))
        errors["given"].append(final_error(recording, unit, live=False))
        errors["found"].append(final_error(recording, None, arguments.live))
        print(
            file.name,
            *(f"{name} {mm:.2f} mm {deg:.2f} deg" for name, [*_, (mm, deg)] in errors.items()),
            file=sys.stderr,
        )
    medians = {name: np.median(each, axis=0).tolist() for name, each in errors.items()}
    found = {
        "recordings": len(files),
        **{
            f"{name}_{unit}": value
            for name, pair in medians.items()
            for unit, value in zip(("mm", "deg"), pair, strict=True)
        },
    }
    print(
        json.dumps(found, indent=2)
        if arguments.json
        else "\n".join(f"{name:12} {value:8.3f}" for name, value in found.items())
    )


def begun(recording: Recording, late: int) -> tuple[Recording, Calibration]:
    """Return a recording from so many frames after its first contact began, and its unit as it was before."""
    assert recording.image is not None and recording.contact is not None and recording.object_pose is not None
    contact = int(np.argmax(recording.contact))
    still = [frame.image for frame, _ in zip(recording, range(contact - 1), strict=False) if frame.image is not None]
    first = contact + late
    cut = replace(
        recording,
        time=recording.time[first:],
        sensor_pose=recording.sensor_pose[first:],
        object_pose=recording.object_pose[first:],
        contact=recording.contact[first:],
        image=tuple(recording.image[index] for index in range(first, len(recording))),
        episode=None,
        extra={},
    )
    return cut, Calibration(background_of(still))


def final_error(recording: Recording, unit: Calibration | None, live: bool) -> tuple[float, float]:
    """Return how far the last estimate is off [mm], [deg]."""
    assert recording.object_pose is not None
    if live:
        tracker, pose = Tracker(recording.shape, recording.sensor, recording.object_pose[0]), recording.object_pose[0]
        for frame in recording:
            try:
                pose = tracker.update(frame).pose
            except FrameError:
                continue
    else:
        pose = track(recording, calibration=unit).online.pose[-1]
    off = se2.between(recording.object_pose[-1], pose)
    return 1e3 * float(np.hypot(*off[:2])), float(np.degrees(abs(off[2])))


if __name__ == "__main__":
    main()
