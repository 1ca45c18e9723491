"""Pictures of a video file, with their times."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from palpate.errors import FileError
from palpate.files import existing_file
from palpate.lab.truth.tags import Gray


def pictures(path: Path) -> Iterator[tuple[float, Gray]]:
    """Yield the time [s] after the first and each picture, in grey. Raises FileError where the file is no video."""
    import cv2

    capture = cv2.VideoCapture(str(existing_file(path)))
    try:
        rate, count = capture.get(cv2.CAP_PROP_FPS), 0
        while capture.isOpened():
            done, picture = capture.read()
            if not done:
                break
            time = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
            # Some containers do not say when a picture was taken.
            yield (
                time if time > 0.0 or not count else count / rate,
                np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8),
            )
            count += 1
    finally:
        capture.release()
    if not count:
        raise FileError(f"{path}: is no video that OpenCV can read")
