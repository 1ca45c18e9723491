"""Contact detection: the share of an image that differs from the untouched gel (paper Sec. V-A)."""

import logging
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.touch.background import (
    SPARSE,
    AnyImage,
    Background,
    Image,
    SteadyImages,
    check_colours,
    check_image,
    first_frames,
    has_markers,
    is_flat,
    without_markers,
)
from palpate.touch.camera_view import check_view
from palpate.touch.cells import Levels, area_means, cells_of, light_of, share_off, share_unlike, wide_cells_of

logger = logging.getLogger(__name__)

START = 0.01
"""Share of significant values from which the gel is touched: the paper's for its smallest contacts.

Noise alone makes 6e-5 of them (normal distribution beyond 4 standard deviations), and 1.3e-3 while the deviation is
known from 15 frames (Student's). One percent is the area of 12 of 1200 cells, 4 mm^2 of a DIGIT's pad.
"""
END = 0.005
"""Share at which a touch ends: half, so that a faint one does not flicker, and still well above noise."""

_SIGNIFICANT = 4.0  # standard deviations of a cell, as in the paper
_LEAST_DEVIATION = 1.0  # [grey levels] of a cell; 4 of it are above the steps, up to 3, of JPEG at quality 75
_NO_GEL, _NO_GEL_IN_DOUBT = 0.8, 0.6  # shares from which no gel is seen; touches make 0.55, other units mostly over 0.6
_THIN = 0.5  # part of the share left without thin lines, below which they are a scratch and no touch
_MOST_REPEATS, _NOISE = 6, 0.25  # identical images in a row from a camera whose noise changes this share of values
_MEMORY, _EVERY = 90, 5  # frames over which the background follows the light, 3 s at 30 Hz; one in five is used

# A touch has ended with an imprint left if little shows, less than this part of the most within half a second, and it
# has not changed for five images. A touch that rolls over a corner shows as little, but for fewer.
_IMPRINT_PART, _MOST_IMPRINT, _IMPRINT_IMAGES = 0.08, 0.02, 5


class ContactDetector:
    """Decides for one image after the other if the gel is touched.

    Cells of an image are compared with those of the untouched gel in the image's light, so a light that fades or
    wanders during a touch leaves none behind. While nothing touches, the background follows the images.

    Without a background the first half second of steady images is taken as untouched, and the answer is no until
    then. A background that is doubted, as it may be of another unit, is trusted once an image looks like it.
    """

    def __init__(
        self,
        background: Background | None = None,
        size: tuple[int, int] | None = None,
        rate: float = 30.0,
        doubted: str = "",
    ) -> None:
        """Take the untouched gel, rows and columns of the images and their rate [Hz].

        Without a size the first image's is taken. `doubted` is the name of a background that is doubted.
        """
        # Compile or load these now, not at a robot's first image.
        area_means(np.zeros((1, 1, 3), np.uint8), 1, 1)
        area_means(np.zeros((1, 1, 3), np.float32), 1, 1)
        share_unlike(np.ones((2, 2, 3), np.float32), np.ones((2, 2, 3), np.float32), np.float32(1.0))
        self.background = background
        """The untouched gel as known now; None while the first images are collected."""
        self.share = 0.0
        """Share of the last image's values that differ significantly from the untouched gel, 0 to 1."""
        self.light: NDArray[np.float64] = np.ones(3)
        """Brightness of each channel in the middle of the last image, relative to the untouched gel."""
        self._first, self._image_size = SteadyImages(rate), size
        self._doubted, self._doubted_images, self._patience = doubted, 0, first_frames(rate)
        self._is_view_checked = self._touched = self._has_markers = False
        self._untouched_images = 0
        self._recent: deque[tuple[float, Levels]] = deque(maxlen=first_frames(rate))  # shares and cells of this touch
        self._sparse: Image | None = None  # of the last image
        self._repeats, self._is_noisy = 0, False
        if background is not None:
            self._has_markers = has_markers(background.mean)
            self._use(replace(background, mean=self.read(background.mean)))

    @property
    def doubt(self) -> str:
        """Reason to doubt the background; empty once an image looked like it."""
        if not self._doubted:
            return ""
        return (
            f"no image so far looks like the untouched gel of {self._doubted}: unless something touches since the "
            "first one, that was another unit or a touched gel, or the gel has changed"
        )

    def read(self, image: AnyImage) -> AnyImage:
        """Return an image (height, width, 3) as `update` takes it: without markers if the untouched gel has some."""
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype not in (np.uint8, np.float32):
            return image  # `update` refuses it
        if self.background is None and self._first.is_empty:
            self._has_markers = has_markers(image)
        return without_markers(image) if self._has_markers else image

    def update(self, image: Image) -> bool:
        """Return true if the gel is touched in an image (height, width, 3) from `read`.

        Raises SettingError, and changes nothing, on an image of another size or type, in another view, grey if the
        untouched gel has colours, without any gel (black, noise, another light), or repeated by a camera that hangs.
        """
        if self.background is None:
            self._collect(image)
            return False
        check_image(image, *self.background.mean.shape[:2])
        cells = cells_of(image)
        if not self._is_view_checked:
            self._check_view(image, cells, self.background)
            self._is_view_checked = True
        light = light_of(cells, self._cells)
        is_blind = is_flat(image) and not is_flat(self.background.mean)
        share = 1.0 if is_blind else self._significant_share(image, cells, light)
        if share > (_NO_GEL_IN_DOUBT if self._doubted else _NO_GEL):
            self._check_view(image, cells, self.background)
            known = "what was seen in the first half second or is in the calibration: is"
            if self._doubted:
                known = f"that of {self._doubted}: was that another unit or a touched gel, or is"
            raise SettingError(
                f"image: {share:.0%} of it is unlike the untouched gel, touched or not; expected is {known} the camera "
                "covered, turned, or its light out?"
            )
        self._check_not_repeated(image)
        self.share, self.light = share, light[:, 0]
        self._touched = share > (END if self._touched else START)
        self._update_doubt()
        if self._touched and self._is_residual_imprint(share, cells):
            self._touched, self.share = False, 0.0
            self._use(replace(self.background, mean=image.astype(np.float32)))
        if not self._touched:
            self._recent.clear()
        if self.share <= END:
            self._untouched_images += 1
            if self._untouched_images % _EVERY == 0:
                self._use(_followed(self.background, image, _EVERY / _MEMORY))
        return self._touched

    def forget(self) -> None:
        """Take the next images as untouched: a supposed touch is a gel or a light that has changed."""
        self.background, self._touched, self._doubted = None, False, ""
        self._first.forget()

    def _is_residual_imprint(self, share: float, cells: Levels) -> bool:
        self._recent.append((share, cells))
        if len(self._recent) <= _IMPRINT_IMAGES or share >= _MOST_IMPRINT:
            return False
        shares = np.array([each for each, _ in self._recent])
        if shares[-_IMPRINT_IMAGES:].max() >= min(_IMPRINT_PART * shares.max(), _MOST_IMPRINT):
            return False
        return share_unlike(cells, self._recent[-_IMPRINT_IMAGES][1], self._tolerance) <= END

    def _update_doubt(self) -> None:
        if not self._touched:
            self._doubted = ""
        if self._doubted:
            self._doubted_images += 1
            if self._doubted_images == self._patience:
                logger.warning("%s", self.doubt)

    def _check_view(self, image: Image, cells: Levels, background: Background) -> None:
        check_colours(image, background)
        check_view(cells, self._cells, "the untouched gel" + (f" of {self._doubted}" if self._doubted else ""))

    def _check_not_repeated(self, image: Image) -> None:
        sparse = image[::SPARSE, ::SPARSE].copy()
        changed = 1.0 if self._sparse is None else float((sparse != self._sparse).mean())
        self._sparse = sparse
        self._is_noisy = self._is_noisy or (self._repeats > 0 and changed > _NOISE)
        self._repeats = 1 if changed else self._repeats + 1
        if self._repeats > _MOST_REPEATS and self._is_noisy:
            raise SettingError(
                f"image: found the same {self._repeats} times, to the last bit; expected is some noise, as there was "
                "before: the camera stands still"
            )

    def _collect(self, image: Image) -> None:
        size = self._image_size or np.atleast_2d(image).shape[:2]
        check_image(image, *size)
        self._image_size = size
        found = self._first.add(image)
        if found is not None:
            self._use(found)
            self._is_view_checked = True

    def _use(self, background: Background) -> None:
        self.background = background
        self._cells, self._wide_cells = cells_of(background.mean), None
        self._tolerance = np.float32(_SIGNIFICANT) * np.maximum(background.noise, np.float32(_LEAST_DEVIATION))

    def _significant_share(self, image: Image, cells: Levels, light: NDArray[np.float64]) -> float:
        share = share_off(cells, self._cells, light, self._tolerance)
        if share <= END:
            return share
        if self._wide_cells is None:  # most frames do without
            assert self.background is not None
            self._wide_cells = wide_cells_of(np.rint(self.background.mean).astype(np.uint8))
        wide = share_unlike(wide_cells_of(image), self._wide_cells, self._tolerance)
        return wide if wide < _THIN * share else share


def _followed(background: Background, image: Image, part: float) -> Background:
    """Return the statistics updated with this image, which has the weight `part`; the past has the rest."""
    change = image.astype(np.float32) - background.mean
    mean = np.asarray(background.mean + part * change, np.float32)
    # Variance of a mixture: that within the past, and that between the past and the image.
    variance = (1.0 - part) * (np.square(background.deviation) + part * np.square(change))
    return Background(mean, np.sqrt(variance, dtype=np.float32), background.noise)
