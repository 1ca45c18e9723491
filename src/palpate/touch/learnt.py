"""What a trained model says of the frames of a contact, by each image or by pairs of images."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import EstimationError
from palpate.touch.background import Background
from palpate.touch.calibration import UNCORRECTED, DirectionCorrection
from palpate.touch.difference import Difference, difference_in_light, reduced
from palpate.touch.model import TouchModel
from palpate.touch.relative import BACK, Touch, compared_frames
from palpate.types.frame import Frame
from palpate.types.measurements import ContactDirection, ContactPlace, Measurement, RelativePoses, Turn

Array = NDArray[np.float64]
Features = NDArray[Any]

_UNTOLD = 1.0  # [m] standard deviation of x and y of a relative pose, of which images say nothing


class ImageTouch:
    """Says what each image tells by itself: where the tip is touched, how the sensor has turned, or both.

    That is one measurement an image and not one a pair, for pairs of the same images are not independent.
    """

    def __init__(
        self,
        model: TouchModel,
        network_input: "DifferenceInput",
        correction: DirectionCorrection = UNCORRECTED,
        direction: bool = True,
        turn: bool = True,
    ) -> None:
        """Take how what is told of this unit is corrected, and whether to tell directions and turns."""
        self._model, self._input, self._correction = model, network_input, correction
        self._direction, self._turn = direction, turn

    def measure(self, frame: Frame) -> Sequence[Measurement]:
        """See Touch."""
        look, spread = self._model.look(self._input.of(frame)), self._model.settings.spread
        correction = self._correction
        said: list[Measurement] = []
        if self._direction:
            angle, variance = look.direction
            variance = correction.variance(variance * spread["direction"].factor)
            said.append(ContactDirection(correction.true(angle), variance))
            if look.place is not None:
                place, variance = look.place
                said.append(ContactPlace(place, variance * spread["place"].factor))
        if self._turn and look.turn is not None:
            angle, variance = look.turn
            said.append(Turn(correction.turn(angle), correction.variance(variance * spread["turn"].factor)))
        return said

    def end_contact(self) -> None:
        """See Touch."""
        self._input.forget()


class PairTouch:
    """Says how the sensor has turned since earlier frames, from features of each image (paper Eq. 6)."""

    def __init__(
        self,
        network_input: "DifferenceInput",
        see: Callable[[Difference], Features],
        compare: Callable[[Features, Features], tuple[Array, Array]],
        correction: DirectionCorrection = UNCORRECTED,
    ) -> None:
        """Take what makes features (F,) of an image, and turns and variances (P,) of features (P, F) and later (F,).

        correction is of what is told of this unit.
        """
        self._input, self._see, self._compare, self._correction = network_input, see, compare, correction
        self._seen: deque[Features] = deque(maxlen=int(BACK[-1]) + 1)

    def measure(self, frame: Frame) -> Sequence[Measurement]:
        """See Touch."""
        self._seen.append(self._see(self._input.of(frame)))
        back = compared_frames(len(self._seen) - 1)
        if not len(back):
            return ()
        seen = np.array(self._seen)
        turn, variance = self._compare(seen[-1 - back], seen[-1])
        pose = np.zeros((len(back), 3))
        covariance = np.zeros((len(back), 3, 3))
        pose[:, 2], covariance[:, 2, 2] = self._correction.turn(turn), self._correction.variance(variance)
        covariance[:, 0, 0] = covariance[:, 1, 1] = _UNTOLD**2
        return (RelativePoses(back, pose, covariance),)

    def end_contact(self) -> None:
        """See Touch."""
        self._seen.clear()
        self._input.forget()


class DifferenceInput:
    """Frames as the networks see them: their difference from the untouched gel, as it was when the contact began.

    The light may change meanwhile.
    """

    def __init__(self, background: Callable[[], Background]) -> None:
        """Take what tells the background at the moment."""
        self._background = background
        self._mean: NDArray[np.float32] | None = None

    def of(self, frame: Frame) -> Difference:
        """Return the difference (32, 128, 3); EstimationError for a frame without an image."""
        if frame.image is None:
            raise EstimationError(f"frame at {frame.time:.3f} s has no image, and learnt touch needs one")
        if self._mean is None:
            self._mean = reduced(self._background().mean)
        return difference_in_light(frame.image, self._mean)

    def forget(self) -> None:
        """End the contact: the next one is compared with the background as it is then."""
        self._mean = None


def linear_touch(
    model: TouchModel,
    network_input: DifferenceInput,
    correction: DirectionCorrection = UNCORRECTED,
    deviation: float | None = None,
) -> Touch:
    """Return the paper's touch: linear in the key points of two images, conditioned on the kind of contact.

    `deviation` is that of a turn [rad], by default as it was measured with the model.
    """
    points = slice(0, 2)
    variance = model.settings.spread["linear"].factor if deviation is None else deviation**2

    def see(difference: Difference) -> Features:
        return np.concatenate(model.keypoint(difference))

    def compare(earlier: Features, later: Features) -> tuple[Array, Array]:
        kinds = 0.5 * (earlier[:, points.stop :] + later[points.stop :])
        turn = model.linear(earlier[:, points], later[points], kinds)
        return turn, np.full(len(turn), variance)

    return PairTouch(network_input, see, compare, correction)


def pair_touch(
    model: TouchModel, network_input: DifferenceInput, correction: DirectionCorrection = UNCORRECTED
) -> Touch:
    """Return touch with a predicted distribution for each pair."""
    factor = model.settings.spread["pair"].factor

    def see(difference: Difference) -> Features:
        descriptor = model.look(difference).descriptor
        assert descriptor is not None  # `make_touch` takes no other model
        return descriptor

    def compare(earlier: Features, later: Features) -> tuple[Array, Array]:
        turn, variance = model.compare(earlier.astype(np.float32), later.astype(np.float32))
        return turn, variance * factor

    return PairTouch(network_input, see, compare, correction)
