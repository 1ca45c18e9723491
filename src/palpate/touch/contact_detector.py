"""Contact detection: the share of an image that differs from the untouched gel (paper Sec. V-A)."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from palpate.arrays import Flags, Image, Levels
from palpate.config import CONTACT_DETECTION
from palpate.errors import FileError, SettingError
from palpate.touch.background import Background, SteadyImages
from palpate.touch.calibration import Calibration, check_view, mismatch
from palpate.touch.cells import (
    Light,
    cells_of,
    channels_apart,
    compare,
    is_grey,
    sparse_pixels,
    unlike_sparsely,
    wide_cells_of,
)
from palpate.touch.markers import Markers, find_markers, without_markers
from palpate.touch.marks import new_marks, put_marks
from palpate.types.images import AS_IT_IS, decode_image, scaled
from palpate.types.sensor import SensorProfile

NO_GEL_SHARE = 0.8
"""Share of significant values from which an image shows no gel: touches make up to 0.7."""
NO_GEL_SHARE_IN_DOUBT = 0.6
"""The same while a calibration may be of another unit, which mostly makes more."""
SCRATCH_SHARE = 0.5
"""Share of the significant values that is left in wide cells, below which they are thin lines, a scratch."""
NOISY_SHARE = 0.5
"""Share of pixels that differ from one image to the next from which a camera has noise in every image."""
MOST_REPEATS = 10
"""Images of such a camera that may be the same to the last bit; with more it stands still."""
BACKGROUND_MEMORY = 90
"""Images over which the background follows the light: 3 s at 30 Hz."""
BACKGROUND_EVERY = 5
"""One untouched image in so many is used for that, which is enough for the light."""


class ContactDetector:
    """Decision for one image after the other if the gel is touched.

    Cells of an image are compared with those of the untouched gel in the light of the image, so a light that fades or
    moves during a touch does not look like one afterwards. While nothing touches, the background follows the images.

    Without a calibration the first half second of steady images is taken as untouched, and `update` returns false until
    then. A calibration that is not sure may be of another unit; it is trusted once an image looks like it.
    """

    def __init__(
        self, sensor: SensorProfile, calibration: Calibration | None = None, seek_markers: bool = True
    ) -> None:
        """Take the sensor's profile; raises SettingError if the calibration has images of another size."""
        if calibration is not None:
            wrong = mismatch(calibration, sensor)
            if wrong:
                raise SettingError(wrong)
        self.background: Background | None = None
        """The untouched gel at present; None while the first images are collected."""
        self.share = 0.0
        """Share of the last image's values that differ significantly from the untouched gel, 0 to 1."""
        self.cells: Levels | None = None
        """Cells (rows, columns, 3) of the last image that was compared with the untouched gel; None before one was."""
        self.light: Light | None = None
        """Light in that image, relative to the untouched gel's; None before one was compared."""
        self.new_view: Background | None = None
        """The steady view that the images refused last showed for half a second, as of a camera that was set up late;
        otherwise None."""
        self._size = (sensor.image_height, sensor.image_width) if sensor.image_height else None
        self._steady = SteadyImages(sensor.rate)
        self._view = calibration.view if calibration else AS_IT_IS
        self._doubted = ""  # name of the calibration, while it may be of another unit
        self._touched = False
        self.markers: Markers | None = None
        """Markers of the untouched gel; None without."""
        self._seek_markers = seek_markers
        self._untouched_images = 0
        self._last: Image | None = None  # the last image that showed a gel
        self._sparse: Image | None = None  # sparse pixels of the last image that showed a gel
        self._repeats = 0  # times that the last image came in a row
        self._is_noisy = False  # an image that came after a repeated one differed in most pixels
        if calibration is not None:
            self._size = calibration.background.mean.shape[:2]
            self.take(calibration.background)
            self._doubted = "" if calibration.is_sure else str(calibration.file or "the calibration")

    @property
    def doubt(self) -> str:
        """Reason to doubt the background; empty once an image has looked like it."""
        if not self._doubted:
            return self._steady.trouble if self.background is None else ""
        return (
            f"no image so far looks like the untouched gel of {self._doubted}: unless something touches since the "
            "first one, that was another unit or a touched gel, or the gel has changed"
        )

    def read(self, image: Image) -> Image:
        """Return a camera's image as `update` takes it: in the profile's view and size, without markers."""
        if image.ndim != 3 or image.shape[2] != 3:
            return image  # `update` refuses it
        image = image if self._view == AS_IT_IS else self._view.of(image)
        if self._size and image.shape[:2] != self._size:
            image = scaled(image, self._size)
        if self.background is None and not self._steady.seen and self._seek_markers:
            self.markers = find_markers(image)
        return image if self.markers is None else without_markers(image, self.markers)

    def update(self, image: Image) -> bool:
        """Return true if the gel is touched in an image (height, width, 3) from `read`.

        Raises SettingError, and changes nothing but `new_view`, on an image of another size or type, in another
        view, grey if the untouched gel has colours, without any gel (black, noise, another light), or repeated by a
        camera that hangs.
        """
        height, width = self._size or np.atleast_2d(image).shape[:2]
        if image.dtype != np.uint8 or image.shape != (height, width, 3):
            turned = ", turned by a quarter" if image.shape == (width, height, 3) else ""
            expected = f"uint8 ({height}, {width}, 3): rows, columns, red green blue"
            raise SettingError(f"image: found {image.dtype} {image.shape}{turned}; expected {expected}")
        self._size = (height, width)
        if self.background is None:
            first_background = self._steady.add(image)
            if first_background is not None:
                self._use(first_background)
            return False
        cells = cells_of(image)
        share, light = self._significant_share(image, cells, self.light)
        self._check_gel(image, cells, share)
        self._check_not_repeated(image)
        if self._takes_marks(image):
            share, light = self._significant_share(image, cells, light)
        self.share = share
        self.cells = cells
        self.light = light
        self._touched = share > (CONTACT_DETECTION.end if self._touched else CONTACT_DETECTION.start)
        if not self._touched:
            self._doubted = ""
        if self.share <= CONTACT_DETECTION.end:
            self._untouched_images += 1
            if self._untouched_images % BACKGROUND_EVERY == 0:
                self._follow(image, cells)
            if self._wide_cells is None or self._untouched_images % BACKGROUND_MEMORY == 0:
                self._make_wide_cells()
        return self._touched

    def forget(self) -> None:
        """Forget the untouched gel and take the next images as untouched: what looked like a touch was a change."""
        self.background = None
        self.cells = None
        self.light = None
        self._last = None
        self._touched = False
        self._doubted = ""
        self.new_view = None
        self._steady.seen.clear()

    def take(self, gel: Background) -> None:
        """Take a background as the untouched gel."""
        self.forget()
        if self._seek_markers:
            self.markers = self.markers or find_markers(gel.mean)
        self._use(replace(gel, mean=without_markers(gel.mean, self.markers)))

    def _use(self, background: Background) -> None:
        """Set the background, as a copy that is changed in place, and what images are compared with."""
        self._compare_with(background.copy())

    def _compare_with(self, background: Background) -> None:
        """Compare images with a background from now on, which is another object than the last one."""
        self.background = background
        self._untouched_cells = cells_of(background.mean)
        self._wide_cells: Levels | None = None  # made when they are first needed
        self._shares_last_filtered: tuple[float, float] | None = None
        self._is_grey = is_grey(background.mean)
        deviation = np.maximum(background.noise, np.float32(CONTACT_DETECTION.least_deviation))
        self._tolerance = channels_apart(np.float32(CONTACT_DETECTION.significant) * deviation)

    def _follow(self, image: Image, cells: Levels) -> None:
        """Move the background towards an untouched image, of these cells."""
        assert self.background is not None
        part = BACKGROUND_EVERY / BACKGROUND_MEMORY
        self.background = self.background.follow(image, part)
        self._untouched_cells += np.float32(part) * (cells - self._untouched_cells)
        self._shares_last_filtered = None

    def _takes_marks(self, image: Image) -> bool:
        """Take marks that are not in the last image into the untouched gel; return true if there are any."""
        assert self.background is not None
        last = self._last
        if last is None:
            self._last = None if self.markers else image.copy()  # a driver may reuse its array; markers move
            return False
        marks = new_marks(image, last)
        if marks is not None:
            put_marks(self.background.mean, marks, image, last)
            self._compare_with(replace(self.background))
        np.copyto(last, image)
        return marks is not None

    def _significant_share(self, image: Image, cells: Levels, start: Light | None) -> tuple[float, Light]:
        """Return the share of values that differ significantly from the untouched gel, without that of scratches.

        Return the light as well, the fit of which begins at `start`.
        """
        share, light = compare(cells, self._untouched_cells, self._tolerance, start)
        if is_grey(image) != self._is_grey:  # the camera has changed its mode, or sees nothing
            return 1.0, light
        if share <= CONTACT_DETECTION.end:
            return share, light
        wide_share = self._share_of_wide_details(image, share, light)
        return (wide_share if wide_share < SCRATCH_SHARE * share else share), light

    def _share_of_wide_details(self, image: Image, share: float, light: Light) -> float:
        """Return the share without details as thin as scratches, computed anew only if the whole share has changed."""
        last = self._shares_last_filtered
        if last is None or abs(share - last[0]) > 0.1 * share:  # a touch adds more
            untouched = self._make_wide_cells() if self._wide_cells is None else self._wide_cells
            last = (share, compare(wide_cells_of(image), untouched, self._tolerance, light)[0])
            self._shares_last_filtered = last
        return last[1]

    def _make_wide_cells(self) -> Levels:
        """Make the cells of the untouched gel without thin details, in a frame with little else to do if possible."""
        assert self.background is not None
        self._wide_cells = wide_cells_of(self.background.mean)
        return self._wide_cells

    def _check_gel(self, image: Image, cells: Levels, share: float) -> None:
        """Raise SettingError if an image shows no gel or, if it is the first, lies in another view."""
        shows_gel = share <= (NO_GEL_SHARE_IN_DOUBT if self._doubted else NO_GEL_SHARE)
        if shows_gel:
            self._steady.seen.clear()
            self.new_view = None
        elif not self._doubted:
            self.new_view = self._steady.add(image) or self.new_view
        if share <= CONTACT_DETECTION.start or (shows_gel and self._sparse is not None):
            return
        check_view(
            cells,
            self._untouched_cells,
            f"the untouched gel of {self._doubted}" if self._doubted else "the untouched gel",
        )
        if not shows_gel:
            expected = "what was seen in the first half second or is in the calibration: is"
            if self._doubted:
                expected = f"that of {self._doubted}: was that another unit or a touched gel, or is"
            raise SettingError(
                f"image: {share:.0%} of it is unlike the untouched gel, touched or not; expected is {expected} the "
                "camera covered or turned, or are its light or colours off?"
            )

    def _check_not_repeated(self, image: Image) -> None:
        """Raise SettingError if a camera whose images have noise has given the same image too often."""
        changed = 1.0
        if self._sparse is None:
            self._sparse = sparse_pixels(image).copy()
        else:
            changed = unlike_sparsely(image, self._sparse)
        self._is_noisy = self._is_noisy or (self._repeats > 0 and changed > NOISY_SHARE)
        self._repeats = 1 if changed else self._repeats + 1
        if self._repeats > MOST_REPEATS and self._is_noisy:
            raise SettingError(
                f"image: found the same {self._repeats} times, to the last bit; expected is some noise, as there was "
                "before: the camera stands still"
            )


def touched(images: Sequence[bytes], sensor: SensorProfile, calibration: Calibration | None = None) -> Flags:
    """Return flags (N,) of encoded images that show a touch; those that are damaged or show no gel count as none."""
    detector = ContactDetector(sensor, calibration)
    size = (sensor.image_height, sensor.image_width)
    flags = np.zeros(len(images), np.bool_)
    for index, image in enumerate(images):
        with suppress(FileError, SettingError):
            flags[index] = detector.update(detector.read(decode_image(image, size)))
    return flags
