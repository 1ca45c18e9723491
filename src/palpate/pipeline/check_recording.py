"""Checks of a recording: its contents, and everything that is wrong with it.

Limits follow from physics and from how well robot and motion capture agree in undisturbed real runs.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.checks import check_metres, other_time_unit
from palpate.errors import FileError
from palpate.geometry import se2
from palpate.geometry.shapes import wrong_width
from palpate.pipeline.truth import flag_runs, knocked_frames
from palpate.stream_monitor import too_often
from palpate.types.recording import Recording, spikes

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with a recording, in frames from `start` to `end`."""

    kind: str
    """time gap, rate, unit, drop-out, jump, knock, untouched motion, off outline or image."""
    start: int
    end: int
    sentence: str


def check_recording(recording: Recording) -> dict[str, Any]:
    """Return the contents of a recording and everything that is wrong with it. Decodes every image.

    - frames, duration [s], rate [Hz] by the median interval, jitter [s]: standard deviation of intervals without gaps.
    - contact: measured, derived (from ground truth and geometry) or absent; contact_share, truth_share: of the frames.
    - contacts: start, end and seconds [s] of each contact.
    - images: number of frames with an image; image_size: rows and columns [px].
    - findings: kind, start and end [s] and sentence, see `Finding`.
    """
    time, contact, truth, sensor = recording.time, recording.contact, recording.object_pose, recording.sensor
    step = np.diff(time)
    regular = np.delete(step, _gaps(time))
    found = list(_faults_of_frames(recording))
    if truth is not None:
        found += _faults_of_truth(time, truth)
        found += _faults_of_motion(recording, truth, contact) if contact is not None else ()
    found.sort(key=lambda finding: (finding.start, finding.end))
    contacts = [] if contact is None else [(float(time[a]), float(time[b])) for a, b in flag_runs(contact)]
    return {
        "frames": len(recording),
        "duration": float(time[-1] - time[0]),
        "rate": float(1.0 / np.median(step)) if len(step) else None,
        "jitter": float(np.std(regular)) if len(regular) else None,
        "contact": "absent" if contact is None else "derived" if recording.contact_derived else "measured",
        "contacts": [{"start": start, "end": end, "seconds": end - start} for start, end in contacts],
        "contact_share": None if contact is None else float(np.mean(contact)),
        "truth_share": 0.0 if truth is None else float(np.mean(~np.isnan(truth).any(axis=1))),
        "images": 0 if recording.image is None else sum(map(bool, recording.image)),
        "image_size": None if recording.image is None else [sensor.image_height, sensor.image_width],
        "findings": [{**asdict(one), "start": float(time[one.start]), "end": float(time[one.end])} for one in found],
    }


def _faults_of_frames(recording: Recording) -> Iterator[Finding]:
    """Find another rate, lengths that are implausible in metres, missing frames and damaged images."""
    step, contact, wanted = np.diff(recording.time), recording.contact, recording.sensor.rate
    if len(step) > 1:
        rate = 1.0 / float(np.median(step))
        if abs(rate / wanted - 1.0) > 0.05:
            question = other_time_unit(1.0 / rate, wanted)
            words = f"frames come at {rate:.3g} Hz, the sensor profile says {wanted:.1f} Hz"
            yield Finding("rate", 0, -1, f"{words}{question and ': '}{question}")
        if sentence := too_often(rate):
            yield Finding("rate", 0, -1, sentence)
    if wrong := wrong_width(recording.shape):
        yield Finding("unit", 0, -1, wrong)
    for name, poses in (("sensor_pose", recording.sensor_pose), ("object_pose", recording.object_pose)):
        try:
            check_metres(name, np.empty((0, 2)) if poses is None else poses[:, :2])
        except FileError as error:
            yield Finding("unit", 0, -1, str(error))
    for frame in _gaps(recording.time).tolist():
        touches = contact is not None and bool(contact[frame] and contact[frame + 1])
        words = f"no frames for {step[frame]:.2f} s{' during contact' if touches else ''}"
        yield Finding("time gap", frame, frame + 1, words)
    for frame in range(len(recording)) if recording.image is not None else ():
        try:
            recording[frame]
        except FileError as error:
            yield Finding("image", frame, frame, str(error))


def _faults_of_truth(time: Array, truth: Array) -> Iterator[Finding]:
    """Find unknown poses, and those that jump away and back; a jump that stays is found with the knocks."""
    unknown = np.isnan(truth[:, 0])
    for first, last in _merged(time, unknown) if not unknown.all() else ():
        count = int(unknown[first : last + 1].sum())
        yield Finding("drop-out", first, last, f"ground truth is unknown in {count} frames")
    for first, last in _merged(time, spikes(truth)):
        yield Finding("jump", first, last, "ground truth jumps away and back; these frames are not scored")


def _faults_of_motion(recording: Recording, truth: Array, contact: Flags) -> Iterator[Finding]:
    """Find motion that pushing does not explain, and a sensor that is not where it touches."""
    time, trusted, outline = recording.time, recording.trusted_truth, recording.shape.outline(40)
    known = np.flatnonzero(trusted)
    for first, last in flag_runs(knocked_frames(recording)):
        around = known[(known >= first - 1) & (known <= last + 1)]
        if contact[first : last + 1].any() and len(around):
            moved, seconds = _moved(*truth[around[[0, -1]]]), time[around[-1]] - time[around[0]]
            yield Finding("knock", first, last, f"something else moves the object: by {moved} in {seconds:.2f} s")
    for first, last in flag_runs(~contact):
        pose = truth[first : last + 1][trusted[first : last + 1]]
        points = se2.transform(pose[:, None], outline)
        away = np.linalg.norm(points - points[:1], axis=-1).max(axis=-1, initial=0.0)
        if away.max(initial=0.0) > 3e-3:  # [m], twice the 1.4 mm by which robot and motion capture disagree
            sentence = f"the object moves by {_moved(pose[0], pose[np.argmax(away)])} while nothing touches it"
            yield Finding("untouched motion", first, last, sentence)
    limit = 2e-3  # [m], for three frames or more: undisturbed runs have 1.4 mm at most
    gap = recording.sensor.gaps(recording.sensor_pose, truth, recording.shape)
    gap[~(trusted & contact)] = 0.0
    for first, last in _merged(time, np.abs(gap) > limit):
        inside = gap[first : last + 1]
        if np.sum(np.abs(inside) > limit) >= 3:
            worst = inside[np.argmax(np.abs(inside))] * 1e3
            how = "overlaps" if worst < 0.0 else "touches but stands off"
            yield Finding("off outline", first, last, f"the sensor {how} the true outline by up to {abs(worst):.1f} mm")


def _gaps(time: Array) -> NDArray[np.intp]:
    """Return the frames after which others are missing, from times (N,) [s]."""
    step = np.diff(time)
    return np.flatnonzero(step > 3.0 * np.median(step)) if len(step) else np.empty(0, np.intp)


def _merged(time: Array, flags: Flags) -> list[tuple[int, int]]:
    """Return the runs of flags (N,); those less than 0.2 s apart, as long as a marker flickers, are one."""
    merged: list[tuple[int, int]] = []
    for first, last in flag_runs(flags):
        if merged and time[first] - time[merged[-1][1]] < 0.2:
            first = merged.pop()[0]
        merged.append((first, last))
    return merged


def _moved(before: Array, after: Array) -> str:
    x, y, theta = se2.between(before, after)
    return f"{np.hypot(x, y) * 1e3:.1f} mm and {abs(np.degrees(theta)):.1f} degrees"
