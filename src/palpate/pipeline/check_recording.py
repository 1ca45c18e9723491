"""Checks of a recording: its contents, and everything that is wrong with it."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from palpate.checks import check_metres, other_time_unit
from palpate.errors import FileError
from palpate.geometry.shapes import wrong_width
from palpate.io.recording import Recording
from palpate.pipeline.check_motion import mismatches
from palpate.pipeline.metrics import flag_runs
from palpate.touch.background import SteadyImages, first_frames
from palpate.touch.contact_detector import touched


def check_recording(recording: Recording) -> dict[str, Any]:
    """Return the contents of a recording and everything that is wrong with it. Decodes every image.

    - frames, duration_s, rate_hz by the median interval.
    - contact_share, truth_share: of the frames; None if contact is unknown.
    - contacts: start_s and end_s of each contact, since the first frame; None if contact is unknown.
    - images: number of frames with an image; image_size: rows and columns [px]. Of a hand both are by finger.
    - first_pose and its sigma; None if the recording has none.
    - findings: kind (import, rate, unit, time gap, light, image or mismatch), start_s, end_s and sentence; those of
      kind import are the warnings that the recording keeps.
    """
    time = recording.time
    contact = recording.contact
    interval = np.diff(time)
    first_pose = recording.first_pose
    sigma = recording.first_pose_sigma

    def between(first: int, last: int) -> dict[str, float]:
        """Return the times of two frames since the first of the recording [s]."""
        return {"start_s": float(time[first] - time[0]), "end_s": float(time[last] - time[0])}

    return {
        "frames": len(recording),
        "duration_s": float(time[-1] - time[0]),
        "rate_hz": float(1.0 / np.median(interval)) if len(interval) else None,
        "contact_share": None if contact is None else float(np.mean(contact)),
        "truth_share": float(np.mean(np.isfinite(recording.truth[:, 0]))),
        **_about_images(recording),
        "first_pose": None if first_pose is None else first_pose.tolist(),
        "first_pose_sigma": None if sigma is None else sigma.tolist(),
        "contacts": None if contact is None else [between(*ends) for ends in flag_runs(contact)],
        "findings": [
            {"kind": kind, **between(first, last), "sentence": sentence}
            for find in (_warnings, _other_rate, _other_unit, _time_gaps, _damaged_images_and_light, _mismatches)
            for kind, first, last, sentence in find(recording)
        ],
    }


def _about_images(recording: Recording) -> dict[str, Any]:
    """Return the number of images and their size, of a hand by finger."""
    if recording.hand is not None and recording.images is not None:
        fingers = {name: recording.hand.fingers[name] for name in recording.images}
        return {
            "images": {name: sum(map(bool, images)) for name, images in recording.images.items()},
            "image_size": {name: [each.image_height, each.image_width] for name, each in fingers.items()},
        }
    sensor = recording.sensor
    return {
        "images": 0 if recording.image is None else sum(map(bool, recording.image)),
        "image_size": None if recording.image is None else [sensor.image_height, sensor.image_width],
    }


_Finding = tuple[str, int, int, str]
"""Kind of a fault, the first and the last frame, and a sentence."""


def _warnings(recording: Recording) -> Iterator[_Finding]:
    """Find the warnings of the import."""
    for warning in recording.warnings:
        yield ("import", 0, -1, warning)


def _other_rate(recording: Recording) -> Iterator[_Finding]:
    """Find a rate of frames that is off the sensor's by more than 5 %."""
    wanted = recording.sensor.rate
    interval = np.diff(recording.time)
    if len(interval) < 2:
        return
    rate = 1.0 / float(np.median(interval))
    if abs(rate / wanted - 1.0) > 0.05:
        sentence = f"frames come at {rate:.3g} Hz, the sensor profile says {wanted:.1f} Hz"
        question = other_time_unit(1.0 / rate, wanted)
        yield ("rate", 0, -1, f"{sentence}: {question}" if question else sentence)


def _other_unit(recording: Recording) -> Iterator[_Finding]:
    """Find lengths that are implausible in metres."""
    wrong = wrong_width(recording.shape)
    if wrong:
        yield ("unit", 0, -1, wrong)
    for name, poses in (("sensor_pose", recording.sensor_pose), ("object_pose", recording.object_pose)):
        try:
            if poses is not None:
                check_metres(name, poses[:, :2])
        except FileError as error:
            yield ("unit", 0, -1, str(error))


def _time_gaps(recording: Recording) -> Iterator[_Finding]:
    """Find missing frames."""
    interval = np.diff(recording.time)
    if not len(interval):
        return
    for frame in np.flatnonzero(interval > 3.0 * np.median(interval)).tolist():
        yield ("time gap", frame, frame + 1, f"no frames for {interval[frame]:.2f} s")


def _damaged_images_and_light(recording: Recording) -> Iterator[_Finding]:
    """Find damaged images, and first images that do not show the gel steadily lit."""
    if recording.images is not None:
        yield from _damaged_images_of_fingers(recording)
    if recording.image is None:
        return
    rate = recording.sensor.rate
    steady = SteadyImages(rate)
    is_open = True  # no steady half second so far
    for frame in range(len(recording)):
        try:
            image = recording[frame].image
        except FileError as error:
            yield ("image", frame, frame, str(error))
            continue
        if is_open and image is not None and steady.add(image) is not None:
            is_open = False
            first = frame + 1 - first_frames(rate)
            if recording.time[first] - recording.time[0] > 0.3:  # [s]
                yield ("light", 0, first, "first images are black or change; the untouched gel is learnt after them")
    if is_open and steady.trouble:
        yield ("light", 0, -1, steady.trouble)


def _damaged_images_of_fingers(recording: Recording) -> Iterator[_Finding]:
    """Find damaged images of the fingers of a hand."""
    for frame in range(len(recording)):
        try:
            _ = recording[frame]
        except FileError as error:
            yield ("image", frame, frame, str(error))


def _mismatches(recording: Recording) -> Iterator[_Finding]:
    """Find poses and images that do not belong together."""
    contact = recording.contact
    if recording.hand is not None and contact is None:
        return
    if contact is None:
        contact = touched(recording.image or (), recording.sensor)
    if len(contact) == len(recording):
        for sentence in mismatches(recording, contact):
            yield ("mismatch", 0, -1, sentence)
