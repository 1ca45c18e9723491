"""What a recording holds, and whether it can be relied on."""

from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from palpate.errors import FileError
from palpate.pipeline.findings import Finding, contact_runs, find_all
from palpate.pipeline.time_gaps import time_gaps
from palpate.touch.background import is_grey
from palpate.types.recording import Recording


@dataclass(frozen=True)
class Contact:
    """One unbroken stretch of contact."""

    start: float
    """Time of its first frame [s]."""
    end: float
    """Time of its last frame [s]."""
    seconds: float
    """[s]"""


@dataclass(frozen=True)
class Inspection:
    """What a recording holds and what is wrong with it."""

    frames: int
    duration: float
    """From the first to the last frame [s]."""
    rate: float | None
    """Frames per second by the median interval [Hz]; None for a single frame."""
    jitter: float | None
    """Standard deviation of the intervals, time gaps left out [s]."""
    contact: Literal["measured", "derived", "absent"]
    """Whether contact was sensed, computed from ground truth and geometry, or is not in the recording."""
    contacts: tuple[Contact, ...]
    contact_share: float | None
    """Share of the frames in contact."""
    truth_share: float
    """Share of the frames with ground truth."""
    images: int
    """How many frames have an image."""
    image_size: tuple[int, int] | None
    """Rows and columns [px]."""
    is_grey: bool
    """Whether the first image is grey, which the touch models that come along do not read."""
    findings: tuple[Finding, ...]
    unbroken: bool
    """Whether motion capture and contact hold throughout: no drop-out but at the very ends, no jump, no
    contact lost and found, no motion while untouched, no frames missing in contact. A knock by hand breaks
    neither."""
    knocked: bool
    """Whether something else than the sensor moved the object in contact."""
    verdict: str
    """The two in a sentence."""

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data for JSON; times in seconds."""
        return asdict(self)


def inspect_recording(recording: Recording) -> Inspection:
    """Look a recording over. Decodes every image."""
    time = recording.time
    step = np.diff(time)
    regular = np.delete(step, time_gaps(time))
    runs = contact_runs(recording)
    findings = tuple(find_all(recording))
    truth = recording.object_pose
    flagged = recording.contact is not None
    knocked = any(finding.kind == "knock" for finding in findings)
    return Inspection(
        frames=len(recording),
        duration=float(time[-1] - time[0]),
        rate=float(1.0 / np.median(step)) if len(step) else None,
        jitter=float(np.std(regular)) if len(regular) else None,
        contact=("derived" if recording.contact_derived else "measured") if flagged else "absent",
        contacts=tuple(
            Contact(float(time[first]), float(time[last]), float(time[last] - time[first])) for first, last in runs
        ),
        contact_share=float(np.mean(recording.contact)) if recording.contact is not None else None,
        truth_share=0.0 if truth is None else float(np.mean(~np.isnan(truth).any(axis=1))),
        images=0 if recording.image is None else sum(map(bool, recording.image)),
        image_size=None if recording.image is None else (recording.sensor.image_height, recording.sensor.image_width),
        is_grey=_begins_grey(recording),
        findings=findings,
        unbroken=not any(finding.breaks for finding in findings),
        knocked=knocked,
        verdict=_verdict(recording, findings),
    )


def _begins_grey(recording: Recording) -> bool:
    """Whether the first image is grey; one that does not decode is a finding of its own."""
    try:
        image = recording[0].image
    except FileError:
        return False
    return image is not None and is_grey(image)


def _verdict(recording: Recording, findings: tuple[Finding, ...]) -> str:
    counts = Counter(finding.kind for finding in findings if finding.breaks)
    knocks = sum(finding.kind == "knock" for finding in findings)
    known = [
        *(["motion capture"] if recording.object_pose is not None else []),
        *(["contact"] if recording.contact is not None else []),
    ]
    if counts:
        verdict = "broken: " + ", ".join(_count(number, kind) for kind, number in counts.items())
    elif known:
        verdict = f"unbroken: {' and '.join(known)} hold{'' if len(known) > 1 else 's'} throughout"
    else:
        verdict = "nothing to judge: no ground truth and no contact flags"
    return verdict + (f"; {_count(knocks, 'knock')}" if knocks else "")


def _count(number: int, kind: str) -> str:
    return kind if number == 1 else f"{number} x {kind}"
