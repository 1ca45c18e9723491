"""The touch image of a frame as people see it: of a hand, those of all fingers side by side with their names."""

import numpy as np

from palpate.arrays import Image
from palpate.io.recording import Recording
from palpate.types.measurements import Frame


def picture_size(recording: Recording) -> tuple[int, int]:
    """Return height and width [px] of the pictures of a recording, each at least 1."""
    if recording.hand is None:
        return max(recording.sensor.image_height, 1), max(recording.sensor.image_width, 1)
    fingers = recording.hand.fingers.values()
    return max(*(each.image_height for each in fingers), 1), max(sum(each.image_width for each in fingers), 1)


def touch_picture(recording: Recording, index: int) -> Image | None:
    """Return the touch image of a frame, or None without one; black is a finger of a hand without a new image.

    Raises FileError if an image is damaged.
    """
    frame = recording[index]
    return frame.image if recording.hand is None else _side_by_side(recording, frame)


def _side_by_side(recording: Recording, frame: Frame) -> Image | None:
    """Return the images of all fingers of a hand, in their order, each with its name."""
    import cv2

    if not frame.images:
        return None
    assert recording.hand is not None
    height, width = picture_size(recording)
    picture = np.zeros((height, width, 3), np.uint8)
    left = 0
    for name, finger in recording.hand.fingers.items():
        if name in frame.images:
            picture[: finger.image_height, left : left + finger.image_width] = frame.images[name]
        size = height / 320.0
        place = (left + round(8.0 * size), round(24.0 * size))
        cv2.putText(picture, name, place, cv2.FONT_HERSHEY_SIMPLEX, 0.7 * size, (255, 255, 255), 1, cv2.LINE_AA)
        left += finger.image_width
    return picture
