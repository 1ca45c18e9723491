"""Time of touch: a new image against 30 earlier ones, from pixels to measurements, beside decoding that image.

    python benchmarks/touch.py

Everything on one thread. Decoding a JPEG of the same image is the yardstick, for these machines are noisy.
"""

import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from palpate.geometry.shapes import Rectangle
from palpate.lab.simulate.gel import render
from palpate.lab.simulate.unit import draw_unit
from palpate.touch.background import first_frames
from palpate.touch.contact_detector import ContactDetector
from palpate.touch.modes import Tactile, make_touch
from palpate.types.frame import Frame
from palpate.types.images import decode_image, encode_image
from palpate.types.sensor import DIGIT

FRAMES, WARM = 400, 50
SIGMAS = (1.0, 1.0, 0.02)


def main() -> None:
    """Print a line for each mode."""
    cv2.setNumThreads(1)
    images = _images()
    data = [encode_image(image) for image in images]
    size = (DIGIT.image_height, DIGIT.image_width)
    reference = _median([lambda each=each: decode_image(each, "jpeg", size) for each in data])
    print(f"{'decoding a JPEG':28s} {reference:6.2f} ms")
    detector = ContactDetector()
    for _ in range(first_frames(DIGIT.rate)):
        detector.update(images[0])
    found = _median([lambda each=each: detector.update(each) for each in images])
    print(f"{'contact':28s} {found:6.2f} ms  {found / reference:5.2f} of decoding")
    modes: tuple[Tactile, ...] = ("learnt", "learnt-pairs", "learnt-linear")
    for mode in modes:
        background = detector.background
        assert background is not None
        touch = make_touch(mode, DIGIT, SIGMAS, SIGMAS, None, lambda known=background: known)
        frames = [Frame(k / 30, np.zeros(3), image=image) for k, image in enumerate(images)]
        found = _median([lambda each=each, touch=touch: touch.measure(each) for each in frames])
        print(f"{mode:28s} {found:6.2f} ms  {found / reference:5.2f} of decoding")


def _images() -> list[np.ndarray]:
    """Images of an edge that rolls over the gel; the first is untouched."""
    unit, shape = draw_unit(DIGIT, 1), Rectangle(0.2, 0.1)
    yaw = np.linspace(-0.2, 0.2, FRAMES)
    poses = np.column_stack([np.full(FRAMES, -0.1), np.zeros(FRAMES), yaw])
    depth = np.append(0.0, np.full(FRAMES - 1, 5e-4))
    return list(render(unit, shape, poses, depth, rng=np.random.default_rng(0)))


def _median(calls: list[Callable[[], Any]]) -> float:
    """Median time of calls [ms], the first ones left out."""
    took = []
    for call in calls:
        begin = time.perf_counter()
        call()
        took.append((time.perf_counter() - begin) * 1e3)
    return float(np.median(took[WARM:]))


if __name__ == "__main__":
    main()
