"""Checks of a recording: its contents, and everything that is wrong with it."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from palpate.checks import check_metres, other_time_unit
from palpate.errors import FileError
from palpate.geometry.shapes import wrong_width
from palpate.io.recording import Recording
from palpate.pipeline.metrics import flag_runs
from palpate.touch.background import SteadyImages, first_frames


def check_recording(recording: Recording) -> dict[str, Any]:
    """Return the contents of a recording and everything that is wrong with it. Decodes every image.

    - frames, duration_s, rate_hz by the median interval.
    - contact_share, truth_share: of the frames; None where contact is unknown.
    - contacts: start_s and end_s of each contact, since the first frame.
    - images: number of frames with an image; image_size: rows and columns [px].
    - first_pose and its sigma; None where the recording has none.
    - findings: kind (rate, unit, time gap, light or image), start_s, end_s and sentence.
    """
    time, contact, sensor = recording.time, recording.contact, recording.sensor
    step, first, sigma = np.diff(time), recording.first_pose, recording.first_pose_sigma

    def between(first: int, last: int) -> dict[str, float]:
        return {"start_s": float(time[first] - time[0]), "end_s": float(time[last] - time[0])}

    return {
        "frames": len(recording),
        "duration_s": float(time[-1] - time[0]),
        "rate_hz": float(1.0 / np.median(step)) if len(step) else None,
        "contact_share": None if contact is None else float(np.mean(contact)),
        "truth_share": float(np.mean(np.isfinite(recording.truth[:, 0]))),
        "images": 0 if recording.image is None else sum(map(bool, recording.image)),
        "image_size": None if recording.image is None else [sensor.image_height, sensor.image_width],
        "first_pose": None if first is None else first.tolist(),
        "first_pose_sigma": None if sigma is None else sigma.tolist(),
        "contacts": [] if contact is None else [between(*ends) for ends in flag_runs(contact)],
        "findings": [
            {"kind": kind, **between(*ends), "sentence": sentence} for kind, *ends, sentence in _faults(recording)
        ],
    }


def _faults(recording: Recording) -> Iterator[tuple[str, int, int, str]]:
    """Find another rate, lengths that are implausible in metres, missing frames, unsteady light and damaged images.

    Yields the kind, the first and the last frame, and a sentence.
    """
    step, wanted = np.diff(recording.time), recording.sensor.rate
    if len(step) > 1:
        rate = 1.0 / float(np.median(step))
        if abs(rate / wanted - 1.0) > 0.05:
            question = other_time_unit(1.0 / rate, wanted)
            words = f"frames come at {rate:.3g} Hz, the sensor profile says {wanted:.1f} Hz"
            yield ("rate", 0, -1, f"{words}{question and ': '}{question}")
    if wrong := wrong_width(recording.shape):
        yield ("unit", 0, -1, wrong)
    for name, poses in (("sensor_pose", recording.sensor_pose), ("object_pose", recording.object_pose)):
        try:
            check_metres(name, np.empty((0, 2)) if poses is None else poses[:, :2])
        except FileError as error:
            yield ("unit", 0, -1, str(error))
    for frame in np.flatnonzero(step > 3.0 * np.median(step)).tolist() if len(step) else ():
        yield ("time gap", frame, frame + 1, f"no frames for {step[frame]:.2f} s")
    steady, is_open = SteadyImages(wanted), True
    for frame in range(len(recording)) if recording.image is not None else ():
        try:
            image = recording[frame].image
        except FileError as error:
            yield ("image", frame, frame, str(error))
            continue
        if is_open and image is not None and steady.add(image) is not None:
            is_open, first = False, frame + 1 - first_frames(wanted)
            if recording.time[first] - recording.time[0] > 0.3:  # [s]
                yield ("light", 0, first, "first images are black or change; the untouched gel is learnt after them")
    if is_open and steady.trouble:
        yield ("light", 0, -1, steady.trouble)
