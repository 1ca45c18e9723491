"""Touch images for people, and what the touch model saw of them: how they differ from the untouched gel."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration, turned_as, view_of
from palpate.touch.detector import detector_for
from palpate.touch.difference import difference_in_light, reduced
from palpate.types.recording import Recording

Image = NDArray[np.uint8]

_GREY, _CONTRAST = 128.0, 80.0  # grey levels of what is as untouched, and of what differs by 1


def jpeg(image: Image, width: int | None = None) -> bytes:
    """Return an RGB image (height, width, 3) as JPEG, made smaller to a width [px] if one is given."""
    import cv2

    if width is not None and width < image.shape[1]:
        size = (width, round(image.shape[0] * width / image.shape[1]))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    _, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 80])
    return data.tobytes()


def seen(image: Image, background: Background) -> Image:
    """Return what the model sees of an image (height, width, 3), in as many pixels: grey is as the gel is untouched."""
    import cv2

    levels = _GREY + _CONTRAST * difference_in_light(image, reduced(background.mean))
    levels = np.clip(levels, 0.0, 255.0).astype(np.uint8)
    return np.asarray(cv2.resize(levels, image.shape[1::-1], interpolation=cv2.INTER_NEAREST), np.uint8)


def views(recording: Recording, calibration: Calibration | None) -> Iterator[tuple[Image, Image | None]]:
    """Yield each touch image, turned as the profile's are, and what the model sees of it.

    The latter is None while the untouched gel is not known.

    The gel is compared with as tracking does it: with the background as it was when the contact began.
    """
    detector, view = detector_for(turned_as(recording.sensor, calibration), calibration), view_of(calibration)
    compared = detector.background
    for index in range(len(recording)):
        image = recording[index].image
        if image is None:
            raise SettingError("the recording has no images to show")
        image = detector.read(view.of(image))
        if not detector.update(image):
            compared = detector.background
        yield image, None if compared is None else seen(image, compared)
