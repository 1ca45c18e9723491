"""Whether the gel is touched: how much of an image is off the untouched one (paper Sec. V-A)."""

import logging
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.touch.area import area_means
from palpate.touch.background import SPARSE, Background, Image, check_colours, check_image, is_flat
from palpate.touch.calibration import Calibration, misfit
from palpate.touch.fitting_view import check_view
from palpate.touch.left_behind import LeftBehind
from palpate.touch.light import Levels, Light, cells_of, light_of, share_off, share_unlike, wide_cells_of
from palpate.touch.markers import AnyImage, has_markers, without_markers
from palpate.touch.steady import SteadyImages, first_frames
from palpate.types.sensor import SensorProfile

logger = logging.getLogger(__name__)

START = 0.01
"""Share of significant values above which the gel is touched: the paper's for its smallest contacts.

Noise alone makes 6e-5 of them (normal law beyond 4 standard deviations), and 1.3e-3 while the deviation is known from
15 frames only (Student's law). One percent is the area of 12 of 1200 cells, 4 mm^2 of a DIGIT's pad.
"""

END = 0.005
"""Share at which a touch ends: half, so that one that hardly shows does not flicker. Still well above noise."""

_SIGNIFICANT = 4.0  # standard deviations, as in the paper
_LEAST_DEVIATION = 1.0  # [grey levels] of a cell; 4 of it are more than the steps, up to 3, of JPEG at quality 75
_OTHER = 0.8  # share of significant values from which on no gel is seen: touches make 0.55 at most
_OTHER_UNIT = 0.6  # the same until the gel of a calibration was seen: nearly all other units are farther off
_THIN = 0.5  # share of that which is left without thin lines where a scratch is seen and no touch
_SAME, _CHANGES = 6, 0.25  # images in a row that are the same to the last bit; share of values that noise changes
_MEMORY = 90  # frames over which the background follows the light, 3 s at 30 Hz
_EVERY = 5  # frames, of which one is taken for that: more tell little and cost time


class ContactDetector:
    """Says of one image after the other whether the gel is touched.

    An image's cells are compared with those of the untouched gel in the image's light; see `touch.light`. So a light
    that fades or wanders during a touch leaves none behind, and what one leaves behind nevertheless is taken for the
    untouched gel. What is thinner than half a cell, as a scratch, is no touch. The 4 standard deviations are those of a
    cell. While nothing touches, the background follows what is seen; during a touch it stays as it is.

    Without a background, the images of the first half second are taken as untouched and their statistics are used, as
    long as they are alike and not black; until then the answer is False. One of a calibration is doubted until an image
    looks like it: it may be of another unit, or of a touched gel.
    """

    def __init__(
        self,
        background: Background | None = None,
        size: tuple[int, int] | None = None,
        rate: float = 30.0,
        doubted: str = "",
    ) -> None:
        """Take the untouched gel, rows and columns of the sensor's images, and how many come in a second [Hz].

        Without a size, the first image's is taken. `doubted` names what the untouched gel is known from, if it is to be
        doubted.
        """
        # Compiled or loaded now, not at a robot's first image.
        area_means(np.zeros((1, 1, 3), np.uint8), 1, 1)
        area_means(np.zeros((1, 1, 3), np.float32), 1, 1)
        share_unlike(np.ones((2, 2, 3), np.float32), np.ones((2, 2, 3), np.float32), np.float32(1.0))
        self._first = SteadyImages(rate)
        self._left_behind = LeftBehind(rate)
        self._image_size = size
        self._background = background
        self._doubted = doubted
        self._doubted_for, self._patience = 0, first_frames(rate)  # images
        self._checked = False
        self._touched = False
        self._share = 0.0
        self._light = np.ones(3)
        self._untouched = 0
        self._sparse: Image | None = None
        self._same = 0
        self._is_noisy = False
        self._is_marked = False
        if background is not None:
            self._is_marked = has_markers(background.mean)
            self._compare_with(replace(background, mean=self.read(background.mean)))

    @property
    def background(self) -> Background | None:
        """The untouched gel as known now; None while the first frames are being gathered."""
        return self._background

    @property
    def share(self) -> float:
        """Share of the last image's values that are significantly off the untouched gel, 0 to 1."""
        return self._share

    @property
    def light(self) -> NDArray[np.float64]:
        """How bright the light of each channel was in the middle of the last image, 1 as the untouched gel is known."""
        return self._light

    @property
    def doubt(self) -> str:
        """What speaks against the untouched gel of a calibration, in words; nothing once an image looked like it."""
        if not self._doubted:
            return ""
        return (
            f"no image so far looks like the untouched gel of {self._doubted}: unless something touches since the "
            "first one, that was another unit or a touched gel, or the gel has changed"
        )

    def read(self, image: AnyImage) -> AnyImage:
        """Return an image (height, width, 3) as it is compared: without markers where the untouched gel has some."""
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype not in (np.uint8, np.float32):
            return image  # which is none, as `update` says
        if self._background is None and self._first.is_empty:
            self._is_marked = has_markers(image)
        return without_markers(image) if self._is_marked else image

    def update(self, image: Image) -> bool:
        """Return whether the gel is touched in this image (height, width, 3) RGB, as `read` gives it.

        Raises SettingError on an image of another size or type than the background's or the first one, where the
        first one is turned, mirrored or of exchanged channels against a given background, or is grey and that is not,
        on one that shows no touch and no untouched gel either (black, noise, turned, another light), and where the
        camera stands still. It changes nothing then.
        """
        background = self._background
        if background is None:
            self._gather(image)
            return False
        check_image(image, *background.mean.shape[:2])
        cells = cells_of(image)
        if not self._checked:
            self._check_view(image, cells, background)
            self._checked = True
        light = light_of(cells, self._cells)
        is_blind = is_flat(image) and not is_flat(background.mean)
        share = 1.0 if is_blind else self._significant(image, cells, light, background)
        if share > (_OTHER_UNIT if self._doubted else _OTHER):
            self._check_view(image, cells, background)
            known = "what was seen in the first half second or is in the calibration: is"
            if self._doubted:
                known = f"that of {self._doubted}: was that another unit or a touched gel, or is"
            raise SettingError(
                f"image: {share:.0%} of it is unlike the untouched gel, touched or not; expected is {known} the camera "
                "covered, turned, or its light out?"
            )
        self._check_alive(image)
        self._share, self._light = share, light[:, 0]
        self._touched = self._share > (END if self._touched else START)
        self._weigh_doubt()
        if not self._touched:
            self._left_behind.forget()
        elif self._left_behind.add(share, cells, self._tolerance, END):
            self._touched, self._share = False, 0.0
            self._left_behind.forget()
            background = replace(background, mean=image.astype(np.float32))
            self._compare_with(background)
        if self._share <= END:
            self._untouched += 1
            if self._untouched % _EVERY == 0:
                self._compare_with(_followed(background, image, _EVERY / _MEMORY))
        return self._touched

    def forget(self) -> None:
        """Take the next images as untouched: what is thought to be a touch is a gel or a light that has changed."""
        self._background, self._touched, self._doubted = None, False, ""
        self._first.forget()

    def _weigh_doubt(self) -> None:
        """Believe a calibration whose untouched gel the last image looks like; warn where none does for a while."""
        if not self._touched:
            self._doubted = ""
        if self._doubted:
            self._doubted_for += 1
            if self._doubted_for == self._patience:
                logger.warning("%s", self.doubt)

    def _check_view(self, image: Image, cells: Levels, background: Background) -> None:
        """SettingError where an image is grey and the untouched gel is not, or lies otherwise than that."""
        check_colours(image, background)
        check_view(cells, self._cells, "the untouched gel" + (f" of {self._doubted}" if self._doubted else ""))

    def _check_alive(self, image: Image) -> None:
        """SettingError where a camera with noise gives the same image again and again."""
        sparse = image[::SPARSE, ::SPARSE].copy()
        changed = 1.0 if self._sparse is None else float((sparse != self._sparse).mean())
        self._sparse = sparse
        self._is_noisy = self._is_noisy or (self._same > 0 and changed > _CHANGES)
        self._same = 1 if changed else self._same + 1
        if self._same > _SAME and self._is_noisy:
            raise SettingError(
                f"image: found the same {self._same} times, to the last bit; expected is some noise, as there was "
                "before: the camera stands still"
            )

    def _gather(self, image: Image) -> None:
        size = self._image_size or np.atleast_2d(image).shape[:2]
        check_image(image, *size)
        self._image_size = size
        found = self._first.add(image)
        if found is not None:
            self._compare_with(found)
            self._checked = True

    def _compare_with(self, background: Background) -> None:
        self._background = background
        self._cells, self._wide_cells = cells_of(background.mean), None
        self._tolerance = np.float32(_SIGNIFICANT) * np.maximum(background.noise, np.float32(_LEAST_DEVIATION))

    def _significant(self, image: Image, cells: Levels, light: Light, background: Background) -> float:
        share = share_off(cells, self._cells, light, self._tolerance)
        if share <= END:
            return share
        if self._wide_cells is None:  # most frames do without
            self._wide_cells = wide_cells_of(np.rint(background.mean).astype(np.uint8))
        wide = share_unlike(wide_cells_of(image), self._wide_cells, self._tolerance)
        return wide if wide < _THIN * share else share


def detector_for(sensor: SensorProfile, calibration: Calibration | None = None) -> ContactDetector:
    """Return what detects contact in a sensor's images, once they lie as the calibration says.

    Raises SettingError on a calibration of images of another size than the sensor's.
    """
    size = (sensor.image_height, sensor.image_width) if sensor.image_height else None
    if calibration is None:
        return ContactDetector(None, size, sensor.rate)
    if wrong := misfit(calibration, sensor):
        raise SettingError(wrong)
    doubted = "" if calibration.is_sure else str(calibration.file or "the calibration")
    return ContactDetector(calibration.background, size, sensor.rate, doubted)


def _followed(background: Background, image: Image, part: float) -> Background:
    """Return the statistics where this image makes up a part of what is known, and the past the rest.

    The noise of cells stays as it was measured, maybe over longer than the past that counts.
    """
    change = image.astype(np.float32) - background.mean
    mean = np.asarray(background.mean + part * change, np.float32)
    # Of a mixture of two: the variance within the past, and that between the past and the image.
    variance = (1.0 - part) * (np.square(background.deviation) + part * np.square(change))
    return Background(mean, np.sqrt(variance, dtype=np.float32), background.noise)
