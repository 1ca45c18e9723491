"""A loop of your own: an image and a sensor pose come in, an estimate goes out, at every frame.

`next_touch` stands for your camera and your robot; here it replays a recording at the pace it was made.

    palpate demo                                            # leaves demo-run/recording.mcap
    python 03_live_loop.py demo-run/recording.mcap

`palpate live` has such a loop for a camera with sensor poses by UDP.
"""

import sys
import time
from collections.abc import Iterator

import numpy as np

import palpate

recording = palpate.load_recording(sys.argv[1])
pace = float(sys.argv[2]) if len(sys.argv) > 2 else 1.0  # times as fast
assert recording.object_pose is not None


def next_touch() -> Iterator[palpate.Frame]:
    """Yield frames as they come: when [s], where the sensor was (world_T_sensor), and what it saw (RGB)."""
    begin = time.monotonic()
    for frame in recording:
        due = begin + (frame.time - recording.time[0]) / pace
        time.sleep(max(0.0, due - time.monotonic()))
        yield palpate.Frame(frame.time, frame.sensor_pose, image=frame.image, contact=frame.contact)


# The first pose is known to 10 mm and 3 degrees; touch tells the rest.
# The status is `ambiguous` at first: 10 mm leaves several places on the outline.
sigma = [0.01, 0.01, np.radians(3.0)]
tracker = palpate.Tracker(recording.shape, recording.sensor, recording.object_pose[0], first_pose_sigma=sigma)

took, left_out, said = [], 0, -1.0
for frame in next_touch():
    begin = time.perf_counter()
    try:
        estimate = tracker.update(frame)
    except palpate.FrameError as error:  # a frame that cannot be used; the next one may be
        left_out += 1
        print(f"left out: {error}")
        continue
    took.append(1e3 * (time.perf_counter() - begin))
    if frame.time - said >= 1.0:
        said = frame.time
        x, y, theta = estimate.pose
        where = f"x {1e3 * x:.1f} mm, y {1e3 * y:.1f} mm, yaw {np.degrees(theta):.1f} degrees"
        print(f"{'touching' if estimate.contact else 'free':8} {estimate.status:13} {where}")
print(f"{len(took)} frames, {left_out} left out; a step took {np.median(took):.1f} ms in the median")
