"""A measurement of your own: a camera sees where a tag on the object is, but not how it is turned.

The first pose is 20 mm and 5 degrees off. The camera alone puts the tag right; where the tag is and which side is
pushed tell the yaw together.
"""

import numpy as np

from palpate import DIGIT, Frame, OwnMeasurement, Rectangle, Tracker
from palpate.geometry import se2

TAG = np.array([0.02, 0.05])  # [m], in the object frame
CAMERA = 5e-4  # [m], standard deviation of what the camera sees
LENGTH, WIDTH = 0.24, 0.16  # [m]


class TagPosition(OwnMeasurement):
    """Where the camera sees the tag."""

    on = ("object_pose",)

    def __init__(self, seen: np.ndarray) -> None:
        self.seen = seen  # (2,) [m], in the world

    def residual(self, pose: np.ndarray) -> np.ndarray:
        """Return where the tag should be less where it is seen [standard deviations]."""
        return (se2.transform(pose, TAG) - self.seen) / CAMERA


# The truth: the object rests, then it is pushed 40 mm along its length, straight through its centre.
start = np.array([0.40, 0.10, 0.30])  # x [m], y [m], theta [rad]
pushed = np.array([[max(0.0, 1e-3 * (k - 30)), 0.0, 0.0] for k in range(71)])
objects = se2.compose(start, pushed)
behind = np.array([[-0.5 * LENGTH - (0.1 if k < 30 else 0.0), 0.0, 0.0] for k in range(71)])
sensors = se2.compose(objects, behind)

wrong = start + np.array([0.012, -0.016, np.radians(5.0)])
tracker = Tracker(Rectangle(LENGTH, WIDTH), DIGIT, wrong, first_pose_sigma=(0.02, 0.02, 0.1))
random = np.random.default_rng(0)


def show(what: str, pose: np.ndarray, truth: np.ndarray) -> None:
    """Print how far a pose is off."""
    millimetres, degrees = 1e3 * np.hypot(*(pose - truth)[:2]), np.degrees(abs(se2.wrap(pose[2] - truth[2])))
    print(f"{what}: {millimetres:.2f} mm and {degrees:.2f} degrees off")


show("first pose", wrong, start)
for k in range(71):
    tag = TagPosition(se2.transform(objects[k], TAG) + random.normal(scale=CAMERA, size=2))
    found = tracker.update(Frame(k / 30, sensors[k], contact=k >= 30), measurements=[tag])
    if k in (29, 70):
        show("tag seen" if k == 29 else "and pushed", found.pose, objects[k])
