"""Which faults there are, by name: each alone at stated strengths, and a few pairs."""

from collections.abc import Callable
from functools import partial, reduce

import numpy as np

from palpate.lab.study.faults import images, poses, timing, told
from palpate.lab.study.faults.stream import Stream

Fault = Callable[[Stream, np.random.Generator], Stream]
"""What happens to a stream; the same generator makes the same of it. The stream itself stays as it was."""


def _none(stream: Stream, rng: np.random.Generator) -> Stream:
    return stream


def _both(*faults: Fault) -> Fault:
    """One fault after the other; the pair can be seen from where the last one can."""
    return lambda stream, rng: reduce(lambda changed, fault: fault(changed, rng), faults, stream)


CLEAN = "none"
"""What the others are compared with."""
PUSHED_ASIDE = "pushed aside while touched"
"""The one fault that is recorded and not made of a stream: `palpate simulate --knocks` simulates a second pusher."""

FAULTS: dict[str, Fault] = {
    CLEAN: _none,
    **{f"frames dropped, {share} %": partial(timing.dropped, share=share / 100) for share in (5, 20, 50)},
    **{f"frames lost for {seconds} s": partial(timing.burst, seconds=seconds) for seconds in (1, 2)},
    "frames repeated, 10 %": partial(timing.repeated, share=0.1),
    "frames exchanged, 10 %": partial(timing.exchanged, share=0.1),
    **{f"every {word} frame only": partial(timing.slower, every=n) for n, word in ((2, "second"), (3, "third"))},
    "stamps jitter, 5 ms": partial(timing.jittered, deviation=0.005),
    "stamps jitter, 20 ms": partial(timing.jittered, deviation=0.02),
    "one stamp +1000 s": partial(timing.leapt, seconds=1000.0, for_good=False),
    "one stamp -1000 s": partial(timing.leapt, seconds=-1000.0, for_good=False),
    "stamps +1000 s for good": partial(timing.leapt, seconds=1000.0, for_good=True),
    "stamps -1000 s for good": partial(timing.leapt, seconds=-1000.0, for_good=True),
    "stamps in ns": partial(timing.nanoseconds, late=False),
    "stamps in ns from a contact on": partial(timing.nanoseconds, late=True),
    **{f"pose NaN for {seconds} s": partial(poses.not_numbers, seconds=seconds) for seconds in (0.2, 1)},
    "pose frozen for 1 s": partial(poses.frozen, seconds=1.0),
    "pose frozen for good": partial(poses.frozen, seconds=np.inf),
    "pose off by 20 mm once": partial(poses.spike, length=0.02),
    "pose off by 20 mm 10 times": partial(poses.spike, length=0.02, count=10),
    "pose off by 1 m once": partial(poses.spike, length=1.0),
    "pose off by 1e200 m once": partial(poses.spike, length=1e200),
    "pose noise 0.5 mm, 0.3 deg": partial(poses.noisy, length=5e-4, degrees=0.3),
    "pose noise 2 mm, 1 deg": partial(poses.noisy, length=2e-3, degrees=1.0),
    **{f"image late by {n} frames": partial(images.late, frames=n) for n in (1, 2, 3)},
    "image frozen for 1 s": partial(images.frozen, seconds=1.0),
    "image frozen for good": partial(images.frozen, seconds=np.inf),
    "image black for 5 frames": partial(images.flat, level=0, seconds=0.16),
    "image black for 1 s": partial(images.flat, level=0, seconds=1.0),
    "image black for good": partial(images.flat, level=0, seconds=np.inf),
    "image saturated for 1 s": partial(images.flat, level=255, seconds=1.0),
    "image noise for 1 s": partial(images.noise, seconds=1.0),
    "image noise for good": partial(images.noise, seconds=np.inf),
    "red and blue exchanged": images.exchanged_channels,
    "red and blue exchanged, calibrated": _both(images.calibrated, images.exchanged_channels),
    "turned by 90 degrees": partial(images.turned, quarters=1),
    "turned by 180 degrees": partial(images.turned, quarters=2),
    "mirrored": images.mirrored,
    "turned by 180 degrees, calibrated": _both(images.calibrated, partial(images.turned, quarters=2)),
    **{f"light drifts {n:+} %": partial(images.drifting_light, change=n / 100) for n in (-40, -20, -10, 10, 20, 40)},
    **{f"light steps {n:+} %": partial(images.light_step, change=n / 100) for n in (-40, -20, -10, 10, 20, 40)},
    "one light out": images.light_out,
    **{f"wear, up to {n} levels": partial(images.wear, levels=n) for n in (7, 14)},
    "a scratch": images.scratch,
    **{f"outlier images, {n} %": partial(images.outliers, share=n / 100) for n in (10, 30)},
    "false contact of 1 frame": partial(images.false_contact, frames=1),
    "false contact of 10 frames": partial(images.false_contact, frames=10),
    "missed contact of 1 frame": partial(images.missed_contact, frames=1),
    "missed contact of 10 frames": partial(images.missed_contact, frames=10),
    **{f"first pose off {n} mm": partial(told.first_pose_off, length=n / 1e3, degrees=0.0) for n in (5, 10, 20)},
    **{f"first pose off {n} deg": partial(told.first_pose_off, length=0.0, degrees=n) for n in (5, 10, 15)},
    **{f"outline {n:+} %": partial(told.outline_off, share=n / 100) for n in (-2, 2, 5)},
    "extrinsics off 1 mm": partial(poses.misplaced, length=1e-3, degrees=0.0),
    "extrinsics off 2 deg": partial(poses.misplaced, length=0.0, degrees=2.0),
    **{f"moved untouched, {n} mm": partial(poses.moved_untouched, length=n / 1e3, degrees=0.0) for n in (10, 20, 30)},
    "moved untouched, 20 deg": partial(poses.moved_untouched, length=0.0, degrees=20.0),
    PUSHED_ASIDE: poses.pushed_aside,
    "dropped 20 % and image late by 1": _both(partial(timing.dropped, share=0.2), partial(images.late, frames=1)),
    "light drifts -20 % and outliers 10 %": _both(
        partial(images.drifting_light, change=-0.2), partial(images.outliers, share=0.1)
    ),
    "first pose off 10 mm and extrinsics 1 mm": _both(
        partial(told.first_pose_off, length=0.01, degrees=0.0), partial(poses.misplaced, length=1e-3, degrees=0.0)
    ),
    "outline +2 % and moved untouched 10 mm": _both(
        partial(told.outline_off, share=0.02), partial(poses.moved_untouched, length=0.01, degrees=0.0)
    ),
    "false contact of 1 frame and moved 20 mm": _both(
        partial(images.false_contact, frames=1), partial(poses.moved_untouched, length=0.02, degrees=0.0)
    ),
}
"""All of them by the name that tables have."""


def is_of(fault: str, stream: Stream) -> bool:
    """Whether a fault is one of a stream: only PUSHED_ASIDE where something else pushes the object, else all others."""
    if not stream.shoved:
        return fault != PUSHED_ASIDE
    return fault == PUSHED_ASIDE and any(stream.touching[frame] for frame in stream.shoved)
