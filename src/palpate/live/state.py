"""How a live session goes: what is shown meanwhile and told at its end."""

import threading
from array import array
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.live.poses import SensorPlace, along
from palpate.live.truth import TruePose
from palpate.pipeline.metrics import rotation_errors, translation_errors
from palpate.types.estimate import Estimate
from palpate.types.seen_poses import LONGEST_GAP

_RATED = 60  # images that the rate is measured by
_NOTES = 3  # that are shown
_COMPARED = 120  # estimates that wait for the truth
_AGAIN = 1.0  # [s] after which more of what is refused is said


class LiveEstimate(NamedTuple):
    """An estimate and how it came about."""

    estimate: Estimate
    """What the tracker says."""
    place: SensorPlace
    """Where the sensor was, and how that was known."""
    latency: float
    """From the image to the estimate [s]."""


@dataclass
class LiveState:
    """Counts of a live session; threads write what is theirs, and the table reads.

    In the end, each image was tracked, dropped, without a pose or left out.
    """

    say: Callable[[str], None]
    """Takes what is to be told at once, in words."""
    images: int = 0
    """How many came."""
    tracked: int = 0
    """How many became an estimate."""
    dropped: int = 0
    """How many a newer one replaced while a step was running."""
    unplaced: int = 0
    """How many had no sensor pose at their time."""
    left_out: int = 0
    """How many the tracker refused."""
    poses: int = 0
    """How many sensor poses came and were taken."""
    refused: int = 0
    """How many things came in their place."""
    pose_age: float | None = None
    """How old the last sensor pose is [s]; None before the first."""
    last: LiveEstimate | None = None
    """The last estimate."""
    contact_frames: int = 0
    """How many estimates were in contact."""
    statuses: Counter[str] = field(default_factory=Counter)
    """How many estimates had which status."""
    true_poses: int | None = None
    """How many true poses of the object came; None where nobody looks for them."""
    true: TruePose | None = None
    """The last one."""
    truth_age: float | None = None
    """How old it is [s]."""
    error: tuple[float, float] | None = None
    """How far the last estimate that was compared with it was off [mm, degrees]."""
    notes: deque[str] = field(default_factory=lambda: deque(maxlen=_NOTES))
    """What was said last."""
    _latencies: "array[float]" = field(default_factory=lambda: array("d"))
    _errors: "array[float]" = field(default_factory=lambda: array("d"))
    _recent: deque[Estimate] = field(default_factory=lambda: deque(maxlen=_COMPARED))
    _arrivals: deque[float] = field(default_factory=lambda: deque(maxlen=_RATED))
    _refusal_said: float = -np.inf
    _left_out_said: float = -np.inf
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def note(self, text: str) -> None:
        """Keep and say something."""
        self.notes.append(text)
        self.say(text)

    def arrived(self, time: float) -> None:
        """Count an image of a time [s]."""
        with self._lock:
            self.images += 1
            self._arrivals.append(time)

    def estimated(self, last: LiveEstimate) -> None:
        """Count an estimate."""
        self.tracked += 1
        self.contact_frames += last.estimate.contact
        self.statuses[last.estimate.status] += 1
        self._latencies.append(1e3 * last.latency)
        with self._lock:
            self._recent.append(last.estimate)
        self.last = last  # at the end, for whoever sees it asks for the rest

    def compare(self, true: TruePose) -> NDArray[np.float64] | None:
        """Take a true pose and return what was estimated for its time, (3,); None where nothing was."""
        self.true = true
        self.true_poses = 1 + (self.true_poses or 0)
        with self._lock:
            pairs = list(pairwise(self._recent))
        around = next(((a, b) for a, b in reversed(pairs) if a.time <= true.time <= b.time), None)
        if around is None or around[1].time - around[0].time > LONGEST_GAP:
            return None
        before, after = around
        pose = along(before.pose, after.pose, (true.time - before.time) / (after.time - before.time))
        mm = 1e3 * float(translation_errors(pose, true.pose))
        self.error = mm, float(np.degrees(abs(rotation_errors(pose, true.pose))))
        self._errors.extend(self.error)
        return pose

    def leave_out(self, reason: str, now: float) -> None:
        """Count a frame that the tracker refused at a time [s], and say so, once a second at most."""
        self.left_out += 1
        if now - self._left_out_said >= _AGAIN:
            self._left_out_said = now
            self.note(f"a frame is left out, {self.left_out} so far: {reason}")

    def refuse(self, reason: str, now: float) -> None:
        """Count what is refused at a time [s], and say so, once a second at most."""
        self.refused += 1
        if now - self._refusal_said >= _AGAIN:
            self._refusal_said = now
            self.note(f"a sensor pose is refused, {self.refused} so far: {reason}")

    @property
    def rate(self) -> float | None:
        """Images per second as measured over the last ones [Hz]."""
        with self._lock:
            times = (self._arrivals[0], self._arrivals[-1]) if len(self._arrivals) > 1 else None
            return None if times is None else (len(self._arrivals) - 1) / (times[1] - times[0])

    def latency_ms(self, last: int | None = None) -> dict[str, float | None]:
        """Median, 95 % and 99 % and largest time from image to estimate [ms], of all or of the last ones."""
        return _spread(np.array(self._latencies[-last:] if last else self._latencies))

    def errors(self) -> dict[str, dict[str, float | None]]:
        """Median, 95 % and 99 % and largest error of what was compared with the truth [mm and degrees]."""
        mm, deg = np.array(self._errors).reshape(-1, 2).T
        return {"translation_mm": _spread(mm), "rotation_deg": _spread(deg)}

    def summary(self) -> dict[str, Any]:
        """Return it all as plain data for JSON."""
        return {
            "images": self.images,
            "tracked": self.tracked,
            "dropped": self.dropped,
            "without_pose": self.unplaced,
            "left_out": self.left_out,
            "sensor_poses": self.poses,
            "refused_poses": self.refused,
            "rate_hz": self.rate,
            "latency_ms": self.latency_ms(),
            "contact_frames": self.contact_frames,
            "statuses": dict(self.statuses),
            "truth": None
            if self.true_poses is None
            else {"poses": self.true_poses, "compared": len(self._errors) // 2, "error": self.errors()},
        }


def _spread(values: NDArray[np.float64]) -> dict[str, float | None]:
    if not len(values):
        return dict.fromkeys(("p50", "p95", "p99", "max"))
    p50, p95, p99 = np.percentile(values, (50, 95, 99)).tolist()
    return {"p50": p50, "p95": p95, "p99": p99, "max": float(values.max())}
