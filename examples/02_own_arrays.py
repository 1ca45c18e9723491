"""Your own arrays: images with their times, poses of the robot's hand with theirs, and where the gel sits on the hand.

Here all of them are made up: a DIGIT pushes a box straight on for 33 mm. The camera runs at 30 Hz and stamps images
40 ms late; the robot tells its hand's pose 100 times a second, in nanoseconds.
"""

import sys
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import palpate
from palpate.geometry import se2
from palpate_lab.simulate.gel import render
from palpate_lab.simulate.unit import draw_unit

BOX = palpate.Rectangle(0.12, 0.08)  # [m]
LATE = 0.04  # [s]


def gel_at(seconds: np.ndarray) -> np.ndarray:
    """Where the gel's apex is at times (N,) [s]: it waits 1 s, then goes 20 mm/s along x; the box begins at x = 0."""
    x = -0.01 + 0.02 * np.clip(seconds - 1.0, 0.0, 2.5)
    return np.column_stack((x, np.full_like(x, 0.005), np.zeros_like(x)))


# What a robot would have logged. The hand is 150 mm above the gel's apex and turned by a quarter.
hand_T_gel = np.array([[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, -0.15], [0.0, 0.0, 0.0, 1.0]])
hand_time = np.arange(350) * 10_000_000  # [ns], integers
world_T_gel = np.tile(np.eye(4), (350, 1, 1))
world_T_gel[:, :2, 3] = gel_at(hand_time * 1e-9)[:, :2]
world_T_hand = world_T_gel @ np.linalg.inv(hand_T_gel)

seen_at = np.arange(95) / 30  # [s]
gel = gel_at(seen_at)
box = np.column_stack((0.06 + np.maximum(gel[:, 0], 0.0), np.zeros((95, 2))))
depth = np.where(gel[:, 0] > 0.0, 8e-4, 0.0)  # [m] that the gel gives way
images = render(draw_unit(palpate.DIGIT, 1), BOX, se2.between(box, gel), depth, rng=np.random.default_rng(0))

# What you would write.
recording = palpate.Recording.from_arrays(
    seen_at + LATE, images, hand_time, world_T_hand, BOX, "digit", sensor_T_gel=hand_T_gel, time_offset=-LATE
)
file = Path(sys.argv[1] if len(sys.argv) > 1 else mkdtemp()) / "push.mcap"
palpate.write_recording(recording, file)
tracker = palpate.Tracker(BOX, recording.sensor, first_pose=box[0], settings=palpate.TrackerSettings(tactile="learnt"))
estimates = [tracker.update(frame) for frame in palpate.load_recording(file)]
print(f"{len(recording)} frames, {sum(each.contact for each in estimates)} in contact")
moved, true = 1e3 * (estimates[-1].pose - box[0])[0], 1e3 * (box[-1] - box[0])[0]
print(f"the box moved by {moved:.1f} mm, in truth by {true:.1f} mm")
