"""Values of a frame of a hand: each is checked by itself, and the error names the finger of one that cannot be used."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.arrays import Array
from palpate.checks import FARTHEST
from palpate.errors import FrameError
from palpate.input.frame_values import BY_FINGER, check_image, planar, with_checked_values
from palpate.types.hand import Hand
from palpate.types.measurements import Frame, finite_number


def with_checked_hand_values(frame: Any, measurements: Any, hand: Hand) -> Frame:
    """Return a copy of a frame of a hand, so that a driver may reuse its arrays, with further measurements added.

    A contact of no finger says less than those of the fingers, and is left out.
    Raises FrameError on a value that is not allowed, or of a finger that is not there.
    """
    if isinstance(frame, Frame) and frame.image is not None:
        names = ", ".join(hand.fingers)
        raise FrameError(f"frame at {frame.time} s has image of no finger; allowed are images={{NAME: ...}} of {names}")
    # Contact is decided finger by finger.
    checked = with_checked_values(_flagged(frame), measurements, len(hand.fingers))
    when = f"frame at {checked.time:.3f} s"
    given = {field: _by_finger(when, field, getattr(frame, field), hand) for field in BY_FINGER}
    for name, image in given["images"].items():
        check_image(f"{when}, finger {name}", image)
    for name, flag in given["contacts"].items():
        if not isinstance(flag, bool | np.bool_ | None):
            raise FrameError(f"{when} has contact {flag!r} of finger {name}; it must be True, False or None")
    return replace(
        checked,
        contact=None,
        images=given["images"],
        contacts={name: bool(flag) for name, flag in given["contacts"].items() if flag is not None},
        finger_poses={name: _pose(when, name, pose) for name, pose in given["finger_poses"].items()},
        image_times={name: _time(when, name, time) for name, time in given["image_times"].items()},
    )


def _flagged(frame: Any) -> Any:
    """Return a frame that states a contact, as one of a single sensor has to."""
    return replace(frame, contact=False) if isinstance(frame, Frame) else frame


def _by_finger(when: str, field: str, given: Any, hand: Hand) -> dict[str, Any]:
    """Return values by finger; raises FrameError unless they are a dictionary by the names of fingers."""
    names = ", ".join(hand.fingers)
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise FrameError(f"{when} has {field} of type {type(given).__name__}; allowed is a dictionary by {names}")
    for name in given:
        if name not in hand.fingers:
            raise FrameError(f"{when} has {field} of finger {name!r}, which is not there; allowed are {names}")
    return {name: value for name, value in given.items() if value is not None}


def _pose(when: str, name: str, given: Any) -> Array:
    pose = planar(when, given)
    if pose is None or (np.abs(pose) > FARTHEST).any():
        allowed = f"three finite numbers x [m], y [m], theta [rad], up to {FARTHEST:g}"
        raise FrameError(f"{when} has pose {given} of finger {name}; it must be {allowed}")
    return pose


def _time(when: str, name: str, given: Any) -> float:
    time = None if isinstance(given, bool) else finite_number(given)
    if time is None:
        raise FrameError(f"{when} has image time {given!r} of finger {name}; it must be a finite number [s]")
    return time
