"""Whether the gel is touched: how much of an image is off the untouched one (paper Sec. V-A)."""

from dataclasses import replace

import numpy as np

from palpate.compiled import Records, compiled
from palpate.errors import SettingError
from palpate.recording.sensor import SensorProfile
from palpate.touch.area import area_means
from palpate.touch.background import Background, Image, Levels, background_of, check_channel_order, check_image
from palpate.touch.calibration import Calibration
from palpate.touch.markers import AnyImage, has_markers, without_markers

FIRST_SECONDS, FEWEST = 0.5, 8
"""Time of frames that are taken as untouched where no background is given [s], and the fewest frames that will do."""

START = 0.01
"""Share of significant values above which the gel is touched: the paper's for its smallest contacts.

Noise alone makes 6e-5 of them (normal law beyond 4 standard deviations), and 1.3e-3 while the deviation is known from
15 frames only (Student's law). One percent is the area of 12 of 1200 cells, 4 mm^2 of a DIGIT's pad.
"""

END = 0.005
"""Share at which a touch ends: half, so that one that hardly shows does not flicker. Still well above noise."""

_SIGNIFICANT = 4.0  # standard deviations, as in the paper
_CELLS = 30  # over the shorter side: the gel spreads every touch over more than such a cell of 0.6 mm
_ALIKE = 2  # pixels across that share their noise: cameras and JPEG keep one colour for 2 x 2
_LEAST_DEVIATION = 1.0  # [grey levels] of a cell; 4 of it are more than the steps, up to 3, of JPEG at quality 75
_UNLIKE = 8.0  # [grey levels] between cells of the first frames, that are not of one gel at rest
DARK = 5.0  # [grey levels] in the mean of an image before the light or the camera is on
_LIGHT = 2.0  # [grey levels] of a cell off the light's plane, above which it hardly tells of the light
_FITS, _SETTLED = 8, 1e-3  # most reweighted fits of the light's plane, and the change of light that is none
_DIMMEST, _BRIGHTEST = 0.3, 3.0  # times the untouched gel's light
_OTHER = 0.8  # share of significant values from which on no gel is seen: touches make 0.45 at most
_SAME, _CHANGES = 6, 0.25  # images in a row that are the same to the last bit; share of values that noise changes
_FLAT = 4.0  # [grey levels] between the darkest and the brightest value of an image that shows nothing
_SPARSE = 8  # pixels, of which one is looked at for that
_MEMORY = 90  # frames over which the background follows the light, 3 s at 30 Hz
_EVERY = 5  # frames, of which one is taken for that: more tell little and cost time


class ContactDetector:
    """Says of one image after the other whether the gel is touched.

    An image is averaged over cells, 30 across, and these are compared with those of the untouched gel: averages have
    less noise, so that a touch of 0.1 mm shows. The 4 standard deviations are those of a cell. The background is first
    scaled to the image's light: each channel by a plane over the image, fitted robustly, which a touch of less than
    half of the pad does not sway. A light that fades or wanders during a touch leaves none behind. While nothing
    touches, the background follows what is seen; during a touch it stays as it is.

    Without a background, the images of the first FIRST_SECONDS are taken as untouched and their statistics are used, as
    long as they are alike and not black; until then the answer is False. A sensor that touches something from the start
    needs a background from a file.
    """

    def __init__(
        self, background: Background | None = None, size: tuple[int, int] | None = None, rate: float = 30.0
    ) -> None:
        """Take the untouched gel, rows and columns of the sensor's images, and how many come in a second [Hz].

        Without a size, the first image's is taken.
        """
        # Compiled or loaded now, not at a robot's first image.
        area_means(np.zeros((1, 1, 3), np.uint8), 1, 1)
        area_means(np.zeros((1, 1, 3), np.float32), 1, 1)
        _light(np.ones((2, 2, 3), np.float32), np.ones((2, 2, 3), np.float32))
        self._first: list[Image] = []
        self._enough = max(round(FIRST_SECONDS * rate), FEWEST)
        self._image_size = size
        self._background = background
        self._checked = False
        self._touched = False
        self._share = 0.0
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

    def read(self, image: AnyImage) -> AnyImage:
        """Return an image (height, width, 3) as it is compared: without markers where the untouched gel has some."""
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype not in (np.uint8, np.float32):
            return image  # which is none, as `update` says
        if self._background is None and not self._first:
            self._is_marked = has_markers(image)
        return without_markers(image) if self._is_marked else image

    def update(self, image: Image) -> bool:
        """Return whether the gel is touched in this image (height, width, 3) RGB, as `read` gives it.

        Raises SettingError on an image of another size or type than the background's or the first one, where the
        first one has red and blue swapped against a given background, on one that shows no touch and no untouched gel
        either (black, noise, turned, another light), and where the camera stands still. It changes nothing then.
        """
        background = self._background
        if background is None:
            self._gather(image)
            return False
        check_image(image, *background.mean.shape[:2])
        if not self._checked:
            check_channel_order(image, background)
            self._checked = True
        self._check_alive(image)
        share = 1.0 if _is_flat(image) and not _is_flat(background.mean) else self._significant(image)
        if share > _OTHER:
            check_channel_order(image, background)
            raise SettingError(
                f"image: {share:.0%} of it is unlike the untouched gel, touched or not; expected is what was seen in "
                "the first half second or is in the calibration: is the camera covered, turned, or its light out?"
            )
        self._share = share
        self._touched = self._share > (END if self._touched else START)
        if self._share <= END:
            self._untouched += 1
            if self._untouched % _EVERY == 0:
                self._compare_with(_followed(background, image, _EVERY / _MEMORY))
        return self._touched

    def forget(self) -> None:
        """Take the next images as untouched: what is thought to be a touch is a gel or a light that has changed."""
        self._background, self._first, self._touched = None, [], False

    def _check_alive(self, image: Image) -> None:
        """SettingError where a camera with noise gives the same image again and again."""
        sparse = image[::_SPARSE, ::_SPARSE].copy()
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
        if self._image_size is None:
            self._image_size = np.atleast_2d(image).shape[:2]
        check_image(image, *self._image_size)
        if image.mean() < DARK:
            return
        if self._first and self._significant(image) > START:
            self._first = []  # something moves on the gel, or its light is not yet what it will be
        if not self._first:
            self._set_cells(image.astype(np.float32))
            self._tolerance = np.float32(_UNLIKE)
        self._first.append(image.copy())
        if len(self._first) == self._enough:
            self._compare_with(background_of(self._first))
            self._first, self._checked = [], True

    def _compare_with(self, background: Background) -> None:
        self._background = background
        pixels = self._set_cells(background.mean)
        noise = area_means(background.deviation, *self._size) * np.float32(min(_ALIKE / pixels, 1.0))
        self._tolerance = np.float32(_SIGNIFICANT) * np.maximum(noise, np.float32(_LEAST_DEVIATION))

    def _set_cells(self, untouched: Levels) -> float:
        """Set what cells are compared with, and return how many pixels a cell is across."""
        height, width = untouched.shape[:2]
        pixels = max(min(height, width) / _CELLS, 1.0)
        self._size = (round(height / pixels), round(width / pixels))
        self._mean = area_means(untouched, *self._size)
        return pixels

    def _significant(self, image: Image) -> float:
        cells = area_means(image, *self._size)
        light = np.clip(_light(cells, self._mean), _DIMMEST, _BRIGHTEST)
        return float((np.abs(cells - light * self._mean) > self._tolerance).mean())


def _is_flat(image: Image | Levels) -> bool:
    """Whether an image is all of one level, as black and saturated ones are."""
    return float(np.ptp(image[::_SPARSE, ::_SPARSE])) < _FLAT


def detector_for(sensor: SensorProfile, calibration: Calibration | None = None) -> ContactDetector:
    """Return what detects contact in a sensor's images, once they lie as the calibration says."""
    size = (sensor.image_height, sensor.image_width) if sensor.image_height else None
    return ContactDetector(calibration and calibration.background, size, sensor.rate)


@compiled
def _light(cells: Records, mean: Records) -> Records:
    """Return how bright the light is in cells (R, C, 3), relative to their mean: for each channel a plane over them.

    Fitted by reweighted least squares: what is off the plane by more than _LIGHT is a touch, and counts for little.
    """
    rows, columns, channels = cells.shape
    light = np.empty_like(cells)
    ratio = np.empty(rows * columns)
    for channel in range(channels):
        for row in range(rows):
            for column in range(columns):
                ratio[row * columns + column] = cells[row, column, channel] / max(mean[row, column, channel], 1.0)
        middle, right, down = np.median(ratio), 0.0, 0.0
        for _ in range(_FITS):
            one, x1, y1, xx, xy, yy, m1, mx, my = (
                1.0,
                0.0,
                0.0,
                1.0,
                0.0,
                1.0,
                0.0,
                0.0,
                0.0,
            )  # a black channel has a fit
            for row in range(rows):
                y = 2.0 * (row + 0.5) / rows - 1.0
                for column in range(columns):
                    x = 2.0 * (column + 0.5) / columns - 1.0
                    level = np.float64(mean[row, column, channel])
                    off = cells[row, column, channel] - (middle + right * x + down * y) * level
                    pull = level / (1.0 + (off / _LIGHT) ** 2)
                    weight, pull = pull * level, pull * off
                    one, x1, y1 = one + weight, x1 + weight * x, y1 + weight * y
                    xx, xy, yy = xx + weight * x * x, xy + weight * x * y, yy + weight * y * y
                    m1, mx, my = m1 + pull, mx + pull * x, my + pull * y
            square = np.array([[one, x1, y1], [x1, xx, xy], [y1, xy, yy]])
            step = np.linalg.solve(square, np.array([m1, mx, my]))
            middle, right, down = middle + step[0], right + step[1], down + step[2]
            if np.abs(step).max() < _SETTLED:
                break
        for row in range(rows):
            y = 2.0 * (row + 0.5) / rows - 1.0
            for column in range(columns):
                x = 2.0 * (column + 0.5) / columns - 1.0
                light[row, column, channel] = middle + right * x + down * y
    return light


def _followed(background: Background, image: Image, part: float) -> Background:
    """Return the statistics where this image makes up a part of what is known, and the past the rest."""
    change = image.astype(np.float32) - background.mean
    mean = np.asarray(background.mean + part * change, np.float32)
    # Of a mixture of two: the variance within the past, and that between the past and the image.
    variance = (1.0 - part) * (np.square(background.deviation) + part * np.square(change))
    return Background(mean, np.sqrt(variance, dtype=np.float32))
