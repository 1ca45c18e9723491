"""Contacts of a step of pushing with several fingers, besides its factors: of each finger, and of the hand.

The hand's contact is what balance and friction cone read: the middle of the touched points, with the mean normal.
"""

import math
from typing import Any

from palpate.arrays import Records
from palpate.compiled import kernel
from palpate.estimation.model import Model
from palpate.manifolds.se2_kernels import position, rotation
from palpate.models.generated import put_rotations
from palpate.models.pushing.contact_geometry import put_touch_of_finger
from palpate.models.pushing.force import angle_from_normal, make_motion, put_sliding
from palpate.models.pushing.step import SHARE_OF_SINKING, predict_step
from palpate.models.pushing.variables import GRIP

FACING = 0.5
"""Length of the mean normal of the fingers that touch below which they press the object between them: those of two are
then more than 120 degrees apart."""

LASTING = 0.03
"""Way [m] over which a slide at fingers that pinch goes on, if it does; farther back it says nothing of now."""


@kernel
def prepare_hand_step(now: Records, surfaces: Any) -> None:
    """Write rotations, the contact geometry of each finger, and that of the hand."""
    put_rotations(now)
    for k in range(len(now.touches)):
        put_touch_of_finger(
            position(now.g),
            now.turn_g,
            position(now.finger[k]),
            now.turn_finger[k],
            surfaces[k],
            now.touch_of[k],
        )
    _put_touch_of_hand(now)


@kernel
def _put_touch_of_hand(now: Records) -> None:
    """Write the mean of the contacts of the fingers that touch, how far these are apart, and if they pinch."""
    hand = now.touch
    hand.gap = 0.0
    hand.point = 0.0
    hand.material = 0.0
    hand.normal = 0.0
    hand.gap_by_g[:] = 0.0
    hand.point_by_g[:] = 0.0
    hand.material_by_g[:] = 0.0
    hand.normal_by_g[:] = 0.0
    count = 0.0
    for k in range(len(now.touches)):
        count += now.touches[k]
    now.touching = count
    now.apart = 0.0
    now.pinched = 0.0
    if count == 0.0:
        hand.normal = 1.0
        return
    for k in range(len(now.touches)):
        if now.touches[k] > 0.5:
            touch = now.touch_of[k]
            hand.gap += touch.gap / count
            hand.point += touch.point / count
            hand.normal += touch.normal / count
            for c in range(3):
                hand.gap_by_g[c] += touch.gap_by_g[c] / count
                hand.point_by_g[c] += touch.point_by_g[c] / count
                hand.normal_by_g[c] += touch.normal_by_g[c] / count
    square = 0.0
    for k in range(len(now.touches)):
        if now.touches[k] > 0.5:
            square += abs(now.touch_of[k].point - hand.point) ** 2 / count
    now.apart = 2.0 * math.sqrt(square)
    now.pinched = 1.0 if abs(hand.normal) < FACING else 0.0


def make_put_hand_force(model: Model) -> Any:
    """Return the compiled function of a model that writes the angle of the force at a step, and how much it slides."""
    motion = make_motion(model)
    grip_at = model.in_shared[GRIP].start

    @kernel
    def put_hand_force(steps: Records, k: int, row: Records, settings: Records) -> None:
        """Write the angle of the pushing force at step k, and how much the contact slides.

        Of several fingers that touch, each has a force of its own, which their motion does not tell. Nearly always
        one of them is inside its friction cone and holds the object; then the angle is 0.
        """
        now = steps[k]
        angle = 0.0
        if now.touching < 1.5:
            angle = angle_from_normal(motion(steps, k, row, settings), now)
        put_sliding(k, angle, row.shared[grip_at], settings, now)

    return put_hand_force


def begin_hand_step(steps: Records) -> None:
    """Begin the last of the steps (N, B), as `step.begin_step` does; its motion is that of the fingers that touch.

    Its way [m] is their motion since several touch, at most LASTING.
    """
    last = len(steps) - 1
    for b in range(steps.shape[1]):
        now = steps[last, b]
        before = steps[last - 1, b]
        now.turn_measured = rotation(now.measured[2])
        now.moved = 0.0
        for k in range(len(now.touches)):
            if now.touches[k] > 0.5:
                here = position(now.measured) + now.turn_measured * position(now.finger[k])
                there = position(before.measured) + before.turn_measured * position(before.finger[k])
                sinking = abs(now.sunk[k] - before.sunk[k]) if before.touches[k] > 0.5 else 0.0
                now.moved = max(now.moved, abs(here - there) + SHARE_OF_SINKING * sinking)
        held = before.way if before.touching > 1.5 else 0.0
        now.way = max(min(held + now.moved, LASTING), now.moved)
        predict_step(steps[:, b])
