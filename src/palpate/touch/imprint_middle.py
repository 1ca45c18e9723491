"""Middle of an imprint on a flat pad, by its shading, whatever its lights, colours, dots or objects.

Flanks that face each other have opposite slopes, so that the change of light on one is the opposite of that on the
other: an imprint is antisymmetric about its middle. No network has to know the unit for that. Imprints that are cut off
by the border or wider than the image, as of long edges, are not, and of these one side alone, such as where the pad
ends, may look like a whole imprint; there the network's place is better.
"""

import math
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array
from palpate.touch.touch_model import COLUMNS, ROWS, Difference, TouchModel
from palpate.types.sensor import SENSORS, SensorProfile


@dataclass(frozen=True)
class ImprintSettings:
    """Limits and errors of middles of imprints."""

    least_symmetry: float = 0.4
    """Symmetry from which the middle is better than the network: 0.3 mm off in the median of pushes by drawn units and
    not 0.5, of balls 0.1 and not 0.3."""
    longest_ball: float = 0.2
    """Height of the longest imprint of a ball, as a share of the image's: balls have up to 0.16, sides and corners,
    which run through all of the image, 0.22 and more."""
    widest_side: float = 2.5e-3
    """Width [m] of the widest long imprint that is whole: corners have up to 1.5e-3, sides that cover the pad 3e-3 and
    more."""
    least_reach: float = 1.0
    """Least distance of the middle of a long imprint from the image's border, in widths of it: ends of the pad, which
    look like an imprint, have up to 0.9."""
    border: int = 2
    """Columns at the border that do not count for that."""
    sigma: float = 4e-5
    """Standard deviation [m] of the middle of a fully antisymmetric imprint."""
    share_of_asymmetry: float = 0.25
    """More of it for one without any symmetry, as a share of its width: what is on one side alone may lie anywhere in
    it. Fitted to balls and sides on drawn units."""
    pushed: float = 3e-4
    """More of it [m] in a push, where shear draws the gel to one side and corners lean: about their mean over a
    contact, middles scatter by 0.31 mm in 13 contacts of 8 tuning pushes, whatever their symmetry."""
    side: float = 1.2e-4
    """Standard deviation [m] of the middle of a long side's imprint about that of a ball on the same unit, whose light
    draws both to one side, but not equally; the rounder an imprint, the less. Fitted to corners on drawn units."""
    share_of_network: float = 0.75
    """Standard deviation of the error that all places by the network share on one unit, as a share of an imprint's
    width: the light of a unit decides which part of a wide imprint shows most. Fitted to sides on drawn units; balls
    on a unit say nothing of it."""


_MIDDLE = ImprintSettings()


def place_of_push(
    by_network: tuple[float, ...], model: TouchModel, difference: Difference, sensor: SensorProfile, spread: float
) -> tuple[float, ...]:
    """Return the place along y of a push on a flat pad, by the imprint's middle if it shows, else that by a network.

    Both are a mean [m] and a variance [m^2], before the model's own correction of variances. The difference is (ROWS,
    COLUMNS, 3). `spread` is a factor on the variance of a middle, as presses of this unit show it.
    """
    imprint = read_imprint(difference, sensor)
    if imprint is None:
        return _place_by_network(by_network, model, sensor)
    scale = model.settings.spread["place"].scale  # which is of the network's variance
    return imprint[0], (spread * imprint[1] + _MIDDLE.pushed**2) / scale


def _place_by_network(read: tuple[float, ...], model: TouchModel, sensor: SensorProfile) -> tuple[float, ...]:
    """Return the place by a network, which takes images to show as much of a pad as those that it was trained on."""
    if sensor.pixel_pitch is None:
        return read
    shown = sensor.pixel_pitch * sensor.image_width
    learnt_on = next((each for each in SENSORS.values() if each.name == model.settings.sensor), sensor)
    ratio = shown / ((learnt_on.pixel_pitch or sensor.pixel_pitch) * (learnt_on.image_width or sensor.image_width))
    place, variance = read
    return ratio * place, ratio**2 * variance


def place_on_unit(
    model: TouchModel | None, difference: Difference, sensor: SensorProfile, spread: float = 1.0
) -> tuple[float, float] | None:
    """Return the place of a press along y of a flat pad and its variance, with errors that all images share.

    They are in [m] and [m^2]. A tracker learns these errors from many images; a reading of one has to state them.
    None if no middle shows, and there is no model or it reads no places. `spread` is that of `place_of_push`.
    """
    imprint = read_imprint(difference, sensor)
    extent = extent_of(difference, sensor)
    if imprint is not None:
        side = _MIDDLE.side * max(1.0 - extent.width / extent.height, 0.0)
        return imprint[0], spread * imprint[1] + side**2
    reading = {} if model is None else model.read(difference)
    if model is None or "place" not in reading:
        return None
    place, variance = _place_by_network(reading["place"], model, sensor)
    # An even imprint is sqrt(3) of its deviations long to either side. Of one that the border cuts off, an image shows
    # hardly more than in which half of it the middle is.
    is_cut_off = extent.reach(extent.centre) < math.sqrt(3.0)
    half = 0.5 * extent.shown / math.sqrt(12.0) if is_cut_off else 0.0
    shared = _MIDDLE.share_of_network * math.hypot(extent.width, half)
    return place, variance * model.settings.spread["place"].scale + shared**2


def read_imprint(difference: Difference, sensor: SensorProfile) -> tuple[float, float] | None:
    """Return the middle along y of the imprint in a difference (ROWS, COLUMNS, 3), and its variance [m], [m^2].

    None if it is not antisymmetric or not whole, so that a network is needed.
    """
    share, symmetry = middle_of(difference)
    if symmetry <= _MIDDLE.least_symmetry or sensor.pixel_pitch is None:
        return None
    extent = extent_of(difference, sensor)
    middle = share * extent.shown
    is_whole = extent.width <= _MIDDLE.widest_side and extent.reach(middle) >= _MIDDLE.least_reach
    if extent.is_long and not is_whole:
        return None
    outside = (1.0 - share_of_sides(difference, share)) * extent.width
    of_asymmetry = _MIDDLE.share_of_asymmetry * (1.0 - symmetry) * extent.width
    return middle, _MIDDLE.sigma**2 + of_asymmetry**2 + outside**2


def middle_of(difference: Difference) -> tuple[float, float]:
    """Return where across an image the imprint in a difference (ROWS, COLUMNS, 3) has its middle, and its symmetry.

    The middle is a share of the image's width, from -0.5 on the left to 0.5; the symmetry is 1 if every change of light
    is the opposite of that on the other side, and 0 without a change. The difference convolved with itself is least at
    twice the middle.
    """
    from scipy.fft import irfft2, rfft2  # in float32 and several lines at once, a fourth of the time of numpy.fft

    size = (2 * ROWS, 2 * COLUMNS)
    spectrum = np.asarray(rfft2(difference.transpose(2, 0, 1), size))
    antisymmetry = -np.asarray(irfft2((spectrum * spectrum).sum(axis=0), size))
    row, column = np.unravel_index(int(antisymmetry.argmax()), size)
    total = float(np.square(difference).sum())
    if not total > 0.0:
        return 0.0, 0.0
    most = float(antisymmetry[row, column])
    peak = float(column)
    if 0 < column < 2 * COLUMNS - 1:  # between columns, by a parabola
        before = float(antisymmetry[row, column - 1])
        after = float(antisymmetry[row, column + 1])
        peak += 0.5 * (before - after) / min(before - 2.0 * most + after, -1e-9 * total)
    return (0.5 * peak + 0.5) / COLUMNS - 0.5, most / total


@dataclass(frozen=True)
class Extent:
    """Place and size of an imprint in an image, by its squared change of light."""

    centre: float
    """Along y from the middle of the image [m]."""
    width: float
    """Standard deviation along y [m]."""
    height: float
    """Standard deviation along the image's columns [m]."""
    is_long: bool
    """True of a side or corner, which runs through the whole height of the image."""
    shown: float
    """Width of gel that the image shows [m]."""

    def reach(self, middle: float) -> float:
        """Return the distance of a middle [m] from the image's border, in widths of the imprint."""
        return (0.5 * self.shown - abs(middle)) / max(self.width, 1e-9)


def extent_of(difference: Difference, sensor: SensorProfile) -> Extent:
    """Return place and size of the imprint in a difference (ROWS, COLUMNS, 3); all 0 where the image did not change."""
    pitch = sensor.pixel_pitch or 0.0
    shown = pitch * sensor.image_width
    change = np.square(difference).sum(axis=2)
    total = float(change.sum())
    if not total > 0.0:
        return Extent(0.0, 0.0, 0.0, False, shown)
    centre, width = _mean_and_deviation(change.sum(axis=0) / total)
    _, height = _mean_and_deviation(change.sum(axis=1) / total)
    is_long = height > _MIDDLE.longest_ball
    return Extent(shown * (centre - 0.5), shown * width, pitch * sensor.image_height * height, is_long, shown)


def _mean_and_deviation(weight: Array) -> tuple[float, float]:
    """Return mean and standard deviation of cells (N,) with these weights, of sum 1, that divide 0 to 1 evenly."""
    cell = (np.arange(len(weight)) + 0.5) / len(weight)
    mean = float(weight @ cell)
    return mean, math.sqrt(float(weight @ np.square(cell - mean)))


def share_of_sides(difference: Difference, middle: float) -> float:
    """Return the share of all change of light in a difference (ROWS, COLUMNS, 3) that lies on two sides of a middle.

    The sides are equally wide and end before the image's border; the middle is that of `middle_of`.
    """
    change = np.square(difference).sum(axis=(0, 2))
    total = float(change.sum())
    column = (middle + 0.5) * COLUMNS - 0.5
    reach = min(column, COLUMNS - 1 - column) - _MIDDLE.border
    if not total > 0.0 or reach < 0.0:
        return 0.0
    first = math.ceil(column - reach)
    last = math.floor(column + reach)
    return float(change[first : last + 1].sum()) / total
