"""Track a recording frame by frame, and say where the object is in the end.

palpate demo                                            # leaves demo-run/recording.mcap
python 01_track_a_recording.py demo-run/recording.mcap
"""

import sys

import numpy as np

import palpate

recording = palpate.load_recording(sys.argv[1])
first, sigma = recording.first_pose, recording.first_pose_sigma
assert first is not None, "the recording states no first pose: say yourself where the object is at the first frame"
tracker = palpate.Tracker(recording.shape, recording.sensor, first, first_pose_sigma=sigma)

estimates = []
for frame in recording:
    estimates.append(tracker.update(frame))
    if len(estimates) == 1 or estimates[-1].status != estimates[-2].status:
        print(f"{frame.time - recording.time[0]:5.2f} s: {estimates[-1].status} {estimates[-1].reason}")

last = estimates[-1]
x, y, theta = last.pose
along_x, along_y, turned = np.sqrt(np.diag(last.covariance))  # along the object's own axes
print(f"x {1e3 * x:.1f} mm, y {1e3 * y:.1f} mm, yaw {np.degrees(theta):.1f} degrees")
print(f"1 sigma: {1e3 * along_x:.1f} mm, {1e3 * along_y:.1f} mm, {np.degrees(turned):.1f} degrees")
if recording.object_pose is not None:
    off = np.hypot(*(last.pose - recording.object_pose[-1])[:2])
    print(f"{1e3 * off:.1f} mm from the ground truth")
