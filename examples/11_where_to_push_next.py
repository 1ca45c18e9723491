"""Touch an object that nobody drew, and ask after each contact at which place the next one says most.

python 11_where_to_push_next.py
"""

import numpy as np

import palpate

RADIUS = 0.06  # [m] of the true object, a disc about the origin of the world, which the tracker is not told
tracker = palpate.Tracker(palpate.Unknown((0.05, 0.2)), "digit", None, palpate.TrackerSettings("none"))


def touch(side: float, start: float) -> palpate.Estimate:
    """Return the estimate after a third of a second of contact at the side at this angle [rad], head on."""
    outward = np.array((np.cos(side), np.sin(side)))
    measured = (palpate.ContactDirection(0.0, 0.02**2),)
    for step in range(10):
        pose = np.array((*(RADIUS - 3e-4) * outward, side + np.pi))
        tracker.update(palpate.Frame(start + step / 30.0, pose, contact=True, measurements=measured))
    away = np.array((*(RADIUS + 0.05) * outward, side + np.pi))
    return tracker.update(palpate.Frame(start + 0.4, away, contact=False))


side = 0.0
for contact in range(6):
    estimate = touch(side, 0.5 * contact)
    assert estimate.outline is not None
    push = palpate.next_push(estimate)
    touched = estimate.outline.touched.mean()
    sigma = 1e3 * estimate.outline.sigma
    print(
        f"at {np.degrees(side):.0f}°: {touched:.0%} touched, known to {sigma:.1f} mm, next {push.information:.1f} nats"
    )
    side = np.arctan2(push.point[1], push.point[0]) % (2.0 * np.pi)  # the true disc is about the origin
