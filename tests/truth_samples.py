"""A camera over a table, and the video that it gives of a push, rendered."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from palpate.geometry import se2
from palpate.geometry.objects import SHAPES
from palpate.lab.truth.camera import Camera
from palpate.lab.truth.tags import OBJECT, SENSOR, TABLE, Gray, Tag, tag_image
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT

COUNT = 45
PRECISE = (3e-4, 3e-4, np.radians(0.1))
"""What truth has to be within at 1 px per 0.5 mm [m, m, rad]."""
ROWS, COLUMNS, FOCAL = 720, 960, 1200.0
CAMERA = Camera((ROWS, COLUMNS), ((FOCAL, 0.0, 480.0), (0.0, FOCAL, 360.0), (0.0, 0.0, 1.0)), (0.0,) * 5, 0.1)
"""1 px for 0.5 mm at 0.6 m."""
FINE = 2
Patches = list[tuple[Tag, Any, float]]
OBJECT_HEIGHT, SENSOR_HEIGHT = 0.04, 0.07
WORLD_T_TABLE, SENSOR_T_TAG, DELAY = np.array([0.5, -0.2, 0.6]), np.array([-0.02, 0.004, 0.1]), 3.237
TABLE_PLACE = np.array([0.0, 0.07, 0.0])  # of the sheet in the view; the push happens beside it


def eye(tilt: float = 0.12) -> tuple[Any, Any]:
    """camera_R_table and camera_t_table: from 0.6 m above, not quite straight down."""
    down = np.diag([1.0, -1.0, -1.0])
    c, s = np.cos(tilt), np.sin(tilt)
    rotation = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) @ down
    return rotation, -rotation @ (np.array([0.0, -0.01, 0.0]) - 0.6 * (rotation.T @ np.array([0.0, 0.0, 1.0])))


def drawn(canvas: Gray, patches: Patches) -> Gray:
    """A canvas of finer pixels with tags at poses (x, y, angle) and heights, as the camera sees them."""
    import cv2

    canvas = canvas.copy()
    matrix = np.diag([FINE, FINE, 1.0]) @ np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]]) @ np.array(CAMERA.matrix)
    rotation, way = eye()
    half = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])  # pixels have their coordinates in the middle
    for tag, pose, height in patches:
        side, border = 200, 30
        image = np.pad(tag_image(tag.number, side), border, constant_values=255)
        scale, middle = tag.size / side, side / 2 + border
        flat = np.array([[scale, 0.0, -scale * middle], [0.0, -scale, scale * middle], [0.0, 0.0, 1.0]])
        c, s = np.cos(pose[2]), np.sin(pose[2])
        lay = np.array([[c, -s, pose[0]], [s, c, pose[1]], [0.0, 0.0, 1.0]])
        see = matrix @ np.column_stack([rotation[:, 0], rotation[:, 1], rotation[:, 2] * height + way])
        whole = half @ see @ lay @ flat @ np.linalg.inv(half)
        cv2.warpPerspective(image, whole, canvas.shape[::-1], canvas, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)
    return canvas


def photographed(canvas: Gray, rng: np.random.Generator) -> Gray:
    """A canvas at the camera's resolution, blurred, with noise and little contrast."""
    import cv2

    small = cv2.resize(canvas, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA)
    blurred = cv2.GaussianBlur(small, (0, 0), 0.8)
    return (20.0 + 0.8 * blurred + rng.normal(0.0, 3.0, small.shape)).clip(0, 255).astype(np.uint8)


def motion(time: Any) -> tuple[Any, Any]:
    """Where object and sensor are on the table at times (N,) [s] of the video, (N, 3) each."""
    object_pose = np.column_stack([-0.05 + 0.03 * np.sin(time), -0.13 + 0.015 * time, 0.5 * np.sin(0.7 * time)])
    sensor_pose = np.column_stack(
        [0.13 + 0.06 * np.cos(3.0 * time), -0.1 + 0.04 * np.sin(4.0 * time), np.sin(5.0 * time)]
    )
    return object_pose, sensor_pose


@cache
def video() -> list[tuple[float, Gray]]:
    """COUNT pictures at 30 Hz; in some of them a hand is over the object's tag."""
    rng = np.random.default_rng(3)
    time = np.arange(COUNT) / 30.0
    objects, tags = motion(time)
    lying: Patches = [(each, TABLE_PLACE + np.array([*each.place, 0.0]), 0.0) for each in TABLE]
    table, pictures = drawn(np.full((ROWS * FINE, COLUMNS * FINE), 150, np.uint8), lying), []
    for when, pose, tag in zip(time, objects, tags, strict=True):
        patches: Patches = [(OBJECT, pose, OBJECT_HEIGHT), (SENSOR, tag, SENSOR_HEIGHT)]
        seen = photographed(drawn(table, patches), rng)
        if 20 <= len(pictures) < 26:
            seen[300:560, 300:480] = 90
        pictures.append((float(when), seen))
    return pictures


def write_video(path: Path) -> None:
    """Write the pictures as a video."""
    import cv2

    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (COLUMNS, ROWS))
    for _, picture in video():
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    writer.release()


def recording() -> tuple[Recording, Any]:
    """What the robot recorded meanwhile, at 60 Hz by its own clock, and where the object really was in its world."""
    time = DELAY + np.arange(2 * COUNT) / 60.0
    objects, tags = (se2.compose(se2.inverse(TABLE_PLACE), pose) for pose in motion(time - DELAY))
    sensor = se2.compose(se2.compose(WORLD_T_TABLE, tags), se2.inverse(SENSOR_T_TAG))
    made = Recording(time, sensor, SHAPES["disc"], DIGIT, contact=np.zeros(len(time), np.bool_))
    return made, se2.compose(WORLD_T_TABLE, objects)
