"""The frames of a recording tracked one after the other, saved now and again, so that a killed process goes on.

What is saved is a tracker (`Tracker.save`) and, beside it, what a run keeps of the frames so far.
"""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.by_value import same
from palpate.errors import FileError, FrameError, SettingError
from palpate.tracker import Tracker
from palpate.tracker_state import load_tracker_and, save_tracker
from palpate.types.answer import Answer
from palpate.types.estimate import Estimate
from palpate.types.frame import Frame

logger = logging.getLogger(__name__)

_TOLD = 5  # frames that are left out, each of which is said
_EVERY = 10.0  # [s] between states that are saved
_SHARE = 20  # as many times as long as saving took is not saved again


@dataclass
class Steps:
    """How far a recording is tracked."""

    tracker: Tracker
    """As the last frame left it."""
    estimates: list[Estimate] = field(default_factory=list)
    """One for each frame so far; those that were loaded hold no more than what a Run keeps of them."""
    taken: list[bool] = field(default_factory=list)
    """Whether each was taken and not left out."""
    step_ms: list[float] = field(default_factory=list)
    """Time of each `Tracker.update` [ms]."""
    wall_s: float = 0.0
    """Time of the processes that went before [s]."""

    def take(self, frame: Frame) -> None:
        """Take the next frame.

        One that cannot be used is left out: the estimate before stands for it, with status "faulty". Raises what
        `Tracker.update` does, FrameError only at the first frame.
        """
        start = time.perf_counter()
        try:
            estimate, taken = self.tracker.update(frame), True
        except FrameError as error:
            if not self.estimates:
                raise
            if (left_out := self.taken.count(False)) < _TOLD:
                more = "; further ones are counted only" if left_out + 1 == _TOLD else ""
                logger.warning("%s; it is left out%s", error, more)
            estimate, taken = replace(self.estimates[-1], time=frame.time, status="faulty", reason=str(error)), False
        self.step_ms.append((time.perf_counter() - start) * 1e3)
        self.estimates.append(estimate)
        self.taken.append(taken)

    def save(self, path: Path, made_of: dict[str, Any]) -> None:
        """Write it all, and what it was `made_of`. Raises SettingError where the tracker cannot be saved."""
        rows = [
            (one.time, one.pose, one.covariance, one.contact, one.status, _packed(one.answers), one.friction)
            for one in self.estimates
        ]
        save_tracker(self.tracker, path, (made_of, rows, self.taken, self.step_ms, self.wall_s))


def load_steps(path: Path, made_of: dict[str, Any]) -> Steps:
    """Return what `Steps.save` wrote. Raises FileError on anything else, and where it was made of something else."""
    tracker, beside = load_tracker_and(path)
    try:
        before, rows, taken, step_ms, wall_s = beside
        estimates = [Estimate(*row[:5], answers=_unpacked(row[5]), friction=row[6]) for row in rows]
        steps = Steps(tracker, estimates, taken, step_ms, wall_s)
        other = [name for name, value in made_of.items() if not same(before[name], value)]
    except (TypeError, ValueError, KeyError, IndexError) as error:
        raise FileError(f"{path}: holds no steps of a recording ({error!r})") from error
    if other:
        raise FileError(f"{path}: what was interrupted had another {other[0]}; say the same again, or begin anew")
    return steps


def _packed(answers: Sequence[Answer]) -> NDArray[np.float64]:
    """Several answers as rows (N, 13) of pose, covariance and weight; no rows where there is one, the estimate."""
    several = answers if len(answers) > 1 else ()
    return np.array([(*one.pose, *one.covariance.flat, one.weight) for one in several]).reshape(-1, 13)


def _unpacked(rows: NDArray[np.float64]) -> tuple[Answer, ...]:
    return tuple(Answer(row[:3], row[3:12].reshape(3, 3), float(row[12])) for row in rows)


class Saving:
    """Saves steps now and again: not more often than every few seconds, and in a small share of the time."""

    def __init__(self, path: Path, made_of: dict[str, Any]) -> None:
        self._path, self._made_of = path, made_of
        self._begun = time.perf_counter()
        self._due = self._begun + _EVERY

    def see(self, steps: Steps) -> None:
        """Save them where it is time to. What cannot be saved is not: the run goes on all the same."""
        start = time.perf_counter()
        if start < self._due:
            return
        so_far = replace(steps, wall_s=steps.wall_s + start - self._begun)
        try:
            so_far.save(self._path, self._made_of)
        except SettingError as error:  # by iSAM2 it can be between contacts, by a particle filter never
            logger.debug("%s", error)
        except FileError as error:
            logger.warning("%s; a run that is interrupted now would have to begin anew", error)
        end = time.perf_counter()
        self._due = end + max(_EVERY, _SHARE * (end - start))
