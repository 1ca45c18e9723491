"""A sensor of your own: its gel and its images in a profile, and contact told by the images.

No touch model knows this sensor, so that its images tell contact alone; `palpate train` makes a model of recordings.
Here images and poses are made up: the sensor comes, pushes a box for 40 mm and draws back.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import palpate
from palpate.geometry import se2
from palpate.types.images import encode_image

SENSOR = palpate.SensorProfile(
    name="my gel",
    radius=0.03,  # [m] of its surface across the pad
    half_width=0.01,  # [m] of the pad
    image_height=60,
    image_width=80,
    rate=30.0,  # [Hz]
)
BOX = palpate.Rectangle(0.12, 0.08)  # [m]

# What the sensor does: along x to the box, whose left side is at x = -60 mm, and 40 mm on.
apex = np.concatenate((np.linspace(-0.08, -0.06, 40), np.linspace(-0.06, -0.02, 60), np.linspace(-0.02, -0.05, 20)))
touching = np.repeat([False, True, False], (40, 60, 20))
sensor_pose = np.column_stack((apex, 0.01 * np.ones(120), np.zeros(120)))
box_pose = np.column_stack((np.maximum.accumulate(apex + 0.06).clip(0.0), np.zeros(120), np.zeros(120)))


def camera(pressed: bool, random: np.random.Generator) -> np.ndarray:
    """Return an image (60, 80, 3): a grey gel, and a bright imprint in its middle where it is pressed."""
    rows, columns = np.mgrid[:60, :80]
    imprint = 90.0 * np.exp(-((rows - 30) ** 2 + (columns - 40) ** 2) / 150.0) * pressed
    return (80.0 + imprint[..., None] + random.normal(0.0, 1.0, (60, 80, 3))).astype(np.uint8)


random = np.random.default_rng(0)
images = tuple(encode_image(camera(pressed, random), "png") for pressed in touching)
recording = palpate.Recording(np.arange(120) / 30, sensor_pose, BOX, SENSOR, box_pose, image=images)
with TemporaryDirectory() as folder:  # files keep the profile
    palpate.write_recording(recording, Path(folder) / "push.mcap")
    sensor = palpate.load_recording(Path(folder) / "push.mcap").sensor

tracker = palpate.Tracker(recording.shape, sensor, first_pose=box_pose[0])
estimates = [tracker.update(frame) for frame in recording]
found = np.array([estimate.contact for estimate in estimates])
print(f"{sensor.name}: contact in {found.sum()} frames, {(found == touching).mean():.0%} of all told right")
moved = se2.between(box_pose[0], estimates[-1].pose)
print(f"the box moved by {1e3 * moved[0]:.1f} mm, in truth by {1e3 * box_pose[-1, 0]:.1f} mm")
