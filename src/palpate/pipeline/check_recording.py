"""Checks of a recording: its contents, and everything that is wrong with it.

Limits follow from physics and from how well robot and motion capture agree in undisturbed real runs.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.checks import check_metres, other_time_unit
from palpate.errors import FileError
from palpate.geometry import se2
from palpate.geometry.shapes import wrong_width
from palpate.pipeline.knocks import LIMITS as KNOCK_LIMITS
from palpate.pipeline.knocks import knocked_frames
from palpate.pipeline.truth import flag_runs, time_gaps, trusted_truth
from palpate.stream_monitor import too_often
from palpate.touch.background import is_grey
from palpate.types.recording import Recording, spikes

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Limits:
    """Limits beyond which something is a finding."""

    rate: float = 0.05
    """Relative difference of the median rate from the sensor profile's."""
    edge: float = 0.2
    """Time at either end where truth may be unknown [s]: systems do not start and stop together."""
    merge: float = 0.2
    """Time between two findings of a kind that are one [s]: as long as a hand acts or a marker flickers."""
    noise: float = 1e-3
    """Motion in one interval that is part of a knock [m]; a camera makes 0.9 mm of an object at rest."""
    moved: float = 3e-3
    """Motion of an untouched object [m]: twice the 1.4 mm by which robot and motion capture disagree."""
    lost: float = 1.0
    """Longest stretch without contact within a push [s], in which the sensor does not retreat."""
    retreat: float = 1e-3
    """Motion against the sensor's x axis that releases the contact [m]."""
    misfit: float = 2e-3
    """Gap or overlap in contact [m], for three frames or more: undisturbed runs have 1.4 mm at most."""
    listed: int = 5
    """Findings of a kind that are listed one by one; more are counted."""


LIMITS = Limits()


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with a recording."""

    kind: str
    """time gap, rate, unit, drop-out, jump, knock, untouched motion, contact lost, overlap, stand-off or image."""
    start: float
    """Time of the first frame that shows it [s]."""
    end: float
    """Time of the last one [s]."""
    sentence: str
    """Description for people."""
    breaks: bool = False
    """True if motion capture or contact is broken by it."""


def check_recording(recording: Recording) -> dict[str, Any]:
    """Return the contents of a recording and everything that is wrong with it. Decodes every image.

    - frames, duration [s], rate [Hz] by the median interval, jitter [s]: standard deviation of intervals without gaps.
    - contact: measured, derived (from ground truth and geometry) or absent; contact_share, truth_share: of the frames.
    - contacts: start, end and seconds [s] of each unbroken contact.
    - images: number of frames with an image; image_size: rows and columns [px]; is_grey: the first one is grey, which
      the shipped touch models do not read.
    - findings: see `Finding`; unbroken: none of them breaks motion capture or contact; knocked: something other than
      the sensor moved the object in contact; verdict: both in a sentence.
    """
    time, contact, truth, sensor = recording.time, recording.contact, recording.object_pose, recording.sensor
    step = np.diff(time)
    regular = np.delete(step, time_gaps(time))
    searches = [_rate, _units, _time_gaps, _images, _contact_lost]
    if truth is not None:
        searches += [_drop_outs, _jumps]
    if truth is not None and contact is not None:
        searches += [_knocks, _untouched, _misfits]
    found = (finding for search in searches for finding in search(recording))
    findings = sorted(found, key=lambda finding: (finding.start, finding.end))
    runs = [(float(time[first]), float(time[last])) for first, last in contact_runs(recording)]
    return {
        "frames": len(recording),
        "duration": float(time[-1] - time[0]),
        "rate": float(1.0 / np.median(step)) if len(step) else None,
        "jitter": float(np.std(regular)) if len(regular) else None,
        "contact": "absent" if contact is None else "derived" if recording.contact_derived else "measured",
        "contacts": [{"start": start, "end": end, "seconds": end - start} for start, end in runs],
        "contact_share": None if contact is None else float(np.mean(contact)),
        "truth_share": 0.0 if truth is None else float(np.mean(~np.isnan(truth).any(axis=1))),
        "images": 0 if recording.image is None else sum(map(bool, recording.image)),
        "image_size": None if recording.image is None else [sensor.image_height, sensor.image_width],
        "is_grey": _begins_grey(recording),
        "findings": [asdict(finding) for finding in findings],
        "unbroken": not any(finding.breaks for finding in findings),
        "knocked": any(finding.kind == "knock" for finding in findings),
        "verdict": _verdict(recording, findings),
    }


def counted(findings: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return findings for people: where there are more of a kind than `listed`, one that counts them."""
    shown: list[dict[str, Any]] = []
    for kind, number in Counter(finding["kind"] for finding in findings).items():
        several = [finding for finding in findings if finding["kind"] == kind]
        if number > LIMITS.listed:
            end = max(finding["end"] for finding in several)
            several = [{**several[0], "end": end, "sentence": f"{number} times; first: {several[0]['sentence']}"}]
        shown += several
    return sorted(shown, key=lambda finding: (finding["start"], finding["end"]))


def contact_runs(recording: Recording) -> list[tuple[int, int]]:
    """Return the first and last frame of each unbroken contact, which ends where the episode number changes too."""
    if recording.contact is None:
        return []
    number = np.zeros(len(recording), np.int64) if recording.episode is None else recording.episode
    change = np.append(True, (np.diff(recording.contact) != 0) | (np.diff(number) != 0))
    first = np.flatnonzero(change)
    last = np.append(first[1:], len(recording)) - 1
    return [(int(a), int(b)) for a, b in zip(first, last, strict=True) if recording.contact[a]]


def _begins_grey(recording: Recording) -> bool:
    try:
        image = recording[0].image
    except FileError:  # a damaged image is a finding
        return False
    return image is not None and is_grey(image)


def _verdict(recording: Recording, findings: Sequence[Finding]) -> str:
    broken = Counter(finding.kind for finding in findings if finding.breaks)
    knocks = sum(finding.kind == "knock" for finding in findings)
    held = {"motion capture": recording.object_pose is not None, "contact": recording.contact is not None}
    known = [name for name, there in held.items() if there]
    if broken:
        verdict = "broken: " + ", ".join(_count(number, kind) for kind, number in broken.items())
    elif known:
        verdict = f"unbroken: {' and '.join(known)} hold{'' if len(known) > 1 else 's'} throughout"
    else:
        verdict = "nothing to judge: no ground truth and no contact flags"
    return verdict + (f"; {_count(knocks, 'knock')}" if knocks else "")


def _count(number: int, kind: str) -> str:
    return kind if number == 1 else f"{number} x {kind}"


def _rate(recording: Recording) -> Iterator[Finding]:
    if len(recording) < 3:
        return
    rate, wanted = 1.0 / float(np.median(np.diff(recording.time))), recording.sensor.rate
    if abs(rate / wanted - 1.0) > LIMITS.rate:
        question = other_time_unit(1.0 / rate, wanted)
        sentence = f"frames come at {rate:.3g} Hz, the sensor profile says {wanted:.1f} Hz{question and ': '}{question}"
        yield _finding(recording, "rate", 0, -1, sentence)
    if sentence := too_often(rate):
        yield _finding(recording, "rate", 0, -1, sentence)


def _units(recording: Recording) -> Iterator[Finding]:
    """Find lengths that are implausible in metres."""
    if wrong := wrong_width(recording.shape):
        yield _finding(recording, "unit", 0, -1, wrong)
    for name, poses in (("sensor_pose", recording.sensor_pose), ("object_pose", recording.object_pose)):
        try:
            check_metres(name, np.empty((0, 2)) if poses is None else poses[:, :2])
        except FileError as error:
            yield _finding(recording, "unit", 0, -1, str(error))


def _time_gaps(recording: Recording) -> Iterator[Finding]:
    step = np.diff(recording.time)
    touching = {frame for first, last in contact_runs(recording) for frame in range(first, last)}
    for frame in time_gaps(recording.time).tolist():
        sentence = f"no frames for {step[frame]:.2f} s" + (" during contact" if frame in touching else "")
        yield _finding(recording, "time gap", frame, frame + 1, sentence, breaks=frame in touching)


def _images(recording: Recording) -> Iterator[Finding]:
    for frame in range(len(recording)) if recording.image is not None else ():
        try:
            recording[frame]
        except FileError as error:
            yield _finding(recording, "image", frame, frame, str(error))


def _drop_outs(recording: Recording) -> Iterator[Finding]:
    time, truth = recording.time, recording.object_pose
    assert truth is not None
    if np.isnan(truth).all():
        return
    unknown = np.isnan(truth[:, 0])
    for first, last in _merged(time, flag_runs(unknown)):
        count = int(unknown[first : last + 1].sum())
        frames = "1 frame" if count == 1 else f"{count} frames within {_seconds(recording, first, last)}"
        inner = time[last] > time[0] + LIMITS.edge and time[first] < time[-1] - LIMITS.edge
        yield _finding(recording, "drop-out", first, last, f"ground truth is unknown in {frames}", breaks=bool(inner))


def _jumps(recording: Recording) -> Iterator[Finding]:
    """Find poses that jump away and back; a jump that stays is found with the knocks."""
    assert recording.object_pose is not None
    for first, last in _merged(recording.time, flag_runs(spikes(recording.object_pose))):
        sentence = "ground truth jumps away and back; these frames are not scored"
        yield _finding(recording, "jump", first, last, sentence, breaks=True)


def _knocks(recording: Recording) -> Iterator[Finding]:
    """Find motion in contact that pushing does not explain, by `knocked_frames`.

    A hand takes several frames to move an object; a motion between two neighbouring frames is a jump of the capture.
    """
    assert recording.contact is not None and recording.object_pose is not None
    known = np.flatnonzero(trusted_truth(recording))
    if len(known) < 2:
        return
    touched = recording.contact[known][:-1] | recording.contact[known][1:]
    motion = _step_lengths(recording.object_pose[known], recording.shape.outline(40))
    path = np.append(0.0, np.cumsum(_step_lengths(recording.sensor_pose, np.array(recording.sensor.tips))))
    excess = motion - KNOCK_LIMITS.faster * np.diff(path[known])
    for start, end in flag_runs(knocked_frames(recording)):
        steps = np.flatnonzero(touched & (known[1:] >= start) & (known[:-1] <= end))
        if not len(steps):
            continue
        fast = steps[excess[steps] > LIMITS.noise]
        first, last = (fast if len(fast) else steps)[[0, -1]]
        before, after = int(known[first]), int(known[last + 1])
        moved = _motion(recording.object_pose[before], recording.object_pose[after])
        pushed = f"while the sensor moves {(path[after] - path[before]) * 1e3:.1f} mm"
        if after == before + 1:
            sentence = f"ground truth jumps by {moved} between two frames {pushed}"
            yield _finding(recording, "jump", before, after, sentence, breaks=True)
        else:
            seconds = _seconds(recording, before, after)
            sentence = f"something else moves the object: by {moved} in {seconds} {pushed}"
            yield _finding(recording, "knock", before, after, sentence)


def _untouched(recording: Recording) -> Iterator[Finding]:
    assert recording.contact is not None and recording.object_pose is not None
    trusted, outline = trusted_truth(recording), recording.shape.outline(40)
    for first, last in flag_runs(~recording.contact):
        known = first + np.flatnonzero(trusted[first : last + 1])
        if not len(known):
            continue
        points = se2.transform(recording.object_pose[known][:, None], outline)
        away = np.linalg.norm(points - points[0], axis=-1).max(axis=-1)
        if away.max() > LIMITS.moved:
            moved = _motion(recording.object_pose[known[0]], recording.object_pose[known[np.argmax(away)]])
            sentence = f"the object moves by {moved} while nothing touches it"
            yield _finding(recording, "untouched motion", first, last, sentence, breaks=True)


def _contact_lost(recording: Recording) -> Iterator[Finding]:
    number = recording.episode
    for (_, lost), (found, _) in pairwise(contact_runs(recording)):
        if found == lost + 1 or (number is not None and number[lost] != number[found]):
            continue
        seconds = recording.time[found] - recording.time[lost]
        ahead = se2.between(recording.sensor_pose[lost], recording.sensor_pose[lost : found + 1])[:, 0]
        if seconds < LIMITS.lost and ahead.min() > -LIMITS.retreat:
            sentence = f"contact is lost for {seconds:.2f} s in a push, the sensor does not retreat"
            yield _finding(recording, "contact lost", lost, found, sentence, breaks=True)


def _misfits(recording: Recording) -> Iterator[Finding]:
    assert recording.contact is not None and recording.object_pose is not None
    gap = recording.sensor.gaps(recording.sensor_pose, recording.object_pose, recording.shape)
    gap[~(trusted_truth(recording) & recording.contact)] = np.nan
    overlap = "overlap", "the sensor overlaps the true outline by up to"
    stand_off = "stand-off", "the sensor touches but stands off the true outline by up to"
    for (kind, words), wrong in ((overlap, gap < -LIMITS.misfit), (stand_off, gap > LIMITS.misfit)):
        for first, last in _merged(recording.time, flag_runs(wrong)):
            inside = wrong[first : last + 1]
            if inside.sum() >= 3:
                worst = np.abs(gap[first : last + 1][inside]).max() * 1e3
                yield _finding(recording, kind, first, last, f"{words} {worst:.1f} mm")


def _finding(recording: Recording, kind: str, first: int, last: int, sentence: str, breaks: bool = False) -> Finding:
    return Finding(kind, float(recording.time[first]), float(recording.time[last]), sentence, breaks)


def _merged(time: Array, runs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the runs, with those that are close in time as one."""
    merged: list[tuple[int, int]] = []
    for first, last in runs:
        if merged and time[first] - time[merged[-1][1]] < LIMITS.merge:
            first = merged.pop()[0]
        merged.append((first, last))
    return merged


def _step_lengths(pose: Array, points: Array) -> Array:
    """Return the largest motion (N-1,) [m] of points (P, 2) [m] on a body of poses (N, 3) in each step."""
    steps = np.diff(se2.transform(pose[:, None], points), axis=0)
    return np.linalg.norm(steps, axis=-1).max(axis=-1)


def _motion(before: Array, after: Array) -> str:
    x, y, theta = se2.between(before, after)
    return f"{np.hypot(x, y) * 1e3:.1f} mm and {abs(np.degrees(theta)):.1f} degrees"


def _seconds(recording: Recording, first: int, last: int) -> str:
    return f"{recording.time[last] - recording.time[first]:.2f} s"
