"""Two fingers: a frame holds the images of both, and the tracker knows where each is mounted on the hand.

palpate simulate hands --fingers 2 --shape rectangle --count 1
python examples/10_several_fingers.py hands/rectangle-edges-000000.mcap
"""

import sys

import numpy as np

import palpate

recording = palpate.load_recording(sys.argv[1])
assert recording.hand is not None
sigma = recording.first_pose_sigma
mounts = recording.hand.mounts  # of each finger: x, y [m] and yaw [rad] in the hand's frame
tracker = palpate.Tracker(
    recording.shape, {"left": "digit", "right": "digit"}, recording.first_pose, mounts=mounts, first_pose_sigma=sigma
)
estimate = None
for stored in recording:
    # What a robot of your own would give: the hand's pose, and an image of each finger that has a new one.
    frame = palpate.Frame(stored.time, stored.sensor_pose, images=stored.images)
    estimate = tracker.update(frame)
assert estimate is not None
x, y, yaw = estimate.pose
deviation = np.sqrt(np.diagonal(estimate.covariance))
print(f"{len(recording)} frames, {estimate.status}")
print(f"x {1e3 * x:.1f} mm, y {1e3 * y:.1f} mm, yaw {np.degrees(yaw):.1f} deg")
print(f"1 sigma {1e3 * deviation[0]:.1f} mm, {1e3 * deviation[1]:.1f} mm, {np.degrees(deviation[2]):.1f} deg")
true = recording.truth[-1]
print(f"{1e3 * np.hypot(*(estimate.pose - true)[:2]):.1f} mm from the ground truth")
