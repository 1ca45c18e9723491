"""The sensors of a tracker: one, or the fingers of a hand. Each takes a frame through input, touch and the estimate."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array
from palpate.config import TactileChoice, TrackerSettings
from palpate.estimation.compiled_model import CompiledModel
from palpate.geometry.shapes import Shape
from palpate.hypotheses.filter import MultiHypothesisFilter
from palpate.hypotheses.posterior import Posterior
from palpate.input.checked_frame import CheckedFrame
from palpate.input.frame_values import check_one_sensor, checked_measurements, with_checked_values
from palpate.input.hand_gate import CheckedHand, HandGate
from palpate.input.input_gate import InputGate
from palpate.input.sensor_correction import SensorCorrection, moved_on
from palpate.input.turned_frame import FrameTurnMonitor
from palpate.models.pushing.compiled import PUSHING, pushing_with
from palpate.models.pushing.contact_geometry import contact_model, hand_contact_model
from palpate.models.pushing.hand import variable_of
from palpate.models.pushing.measurements import Fingers, OfFinger
from palpate.status import MIRRORED, Evidence, FrameTurn, InputEvidence, PoseEvidence, Verdict, decide
from palpate.touch.background import Background
from palpate.touch.reader import TouchReader
from palpate.tracker_arguments import FirstPose, Unit, noise_of_hand, noise_of_unit, priors_of_finger
from palpate.types.estimate import Estimate
from palpate.types.hand import Hand, check_names
from palpate.types.measurements import Frame, Measurement

logger = logging.getLogger(__name__)


class Estimator(Protocol):
    """Filter of the object, as a tracker and the input of its sensors use it."""

    is_mirrored: bool
    """True if touch images are taken as turned by half a turn or mirrored."""

    def begin(self, pose: Array, covariance: Array) -> None:
        """Begin with the object's pose (3,) and its covariance (3, 3)."""
        ...

    def end_contact(self, moved: float = 0.0) -> None:
        """Take the object as released."""
        ...

    def variable(self, name: str) -> tuple[Array, Array]:
        """Return mean and standard deviation, (D,) each, of a variable of the object."""
        ...


class AnyPosterior(Protocol):
    """All that is known of the object after a frame: its pose, or pose and outline."""

    @property
    def evidence(self) -> PoseEvidence:
        """Signs of how well the pose is known, for the status."""
        ...

    def estimate(self, time: float, verdict: Verdict) -> Estimate:
        """Return the estimate at a time [s]."""
        ...


class Sensors(Protocol):
    """One sensor, or the fingers of a hand, as a tracker uses them."""

    @property
    def last(self) -> Frame | None:
        """The last frame as it was used."""
        ...

    @property
    def tactile(self) -> TactileChoice:
        """Source of the touch measurements."""
        ...

    @property
    def tactile_reason(self) -> str:
        """Reason for that choice."""
        ...

    @property
    def backgrounds(self) -> dict[str, Background]:
        """Copies of the untouched gels that are known, by finger; "" is one sensor."""
        ...

    def make_estimator(self, first: FirstPose) -> Estimator:
        """Return the filter that the sensors need, with the object's first pose."""
        ...

    def begin(self, pose: Array, covariance: Array) -> None:
        """Take the object's first pose (3,) and its covariance (3, 3)."""
        ...

    def reset(self) -> None:
        """Begin anew with the same untouched gels."""
        ...

    def name_of_variable(self, name: str) -> str:
        """Return the name by which the graph knows a variable."""
        ...

    def check(self, frame: Frame, measurements: Sequence[Measurement], predicted: Any) -> Any:
        """Refuse implausible input, correct the sensor's pose, and decide contact."""
        ...

    def measure(self, checked: Any) -> Any:
        """Return the measurements by touch, of a frame in contact."""
        ...

    def step(self, estimator: Any, checked: Any, measured: Any) -> AnyPosterior:
        """Take the frame and its measurements to all hypotheses."""
        ...

    def accept(self, checked: Any, measured: Any) -> None:
        """Make a frame the last one, now that it was used."""
        ...

    def estimate(self, checked: Any, posterior: Any) -> Estimate:
        """Return the estimate at the time of the frame, with its status and the reason for it."""
        ...


class OneSensor:
    """One sensor: its gate, its correction by a calibration, and its reader of touch."""

    def __init__(
        self,
        shape: Shape,
        settings: TrackerSettings,
        unit: Unit,
        set_up_sigma: ArrayLike | None,
        is_view_known: bool,
        graph: CompiledModel,
    ) -> None:
        calibration = unit.calibration
        self._tips = len(unit.sensor.tips)
        self._correction = SensorCorrection(calibration.set_up if calibration else None)
        self._gate = InputGate(unit.sensor, calibration, settings.markers == "auto")
        self._is_touch_given = unit.touch is not None
        self._settings = replace(settings, noise=noise_of_unit(settings.noise, unit, set_up_sigma))
        is_view_known |= calibration is not None and calibration.is_view_known
        self._may_be_mirrored = not (is_view_known or self._is_touch_given)
        self._graph = graph
        self._touch = _reader_of(unit, settings)
        self._shape = shape
        self._sensor = unit.sensor

    def make_estimator(self, first: FirstPose) -> MultiHypothesisFilter:
        """Return the filter of the object."""
        return MultiHypothesisFilter(
            contact_model(self._shape, self._sensor),
            self._settings,
            first.pose,
            first.covariance,
            may_be_mirrored=self._may_be_mirrored,
            compiled=self._graph,
        )

    def begin(self, pose: Array, covariance: Array) -> None:
        """Take the object's first pose: the first contact tells if the sensor's frame is turned."""
        self._turned_frame = FrameTurnMonitor(self._shape, self._sensor, pose, covariance)
        self._turn: FrameTurn | None = None
        self._is_mirrored_told = False

    @property
    def last(self) -> Frame | None:
        """The last frame as it was used."""
        return self._gate.last

    @property
    def tactile(self) -> TactileChoice:
        """Source of the touch measurements."""
        return self._touch.tactile

    @property
    def tactile_reason(self) -> str:
        """Reason for that choice."""
        return self._touch.reason

    @property
    def backgrounds(self) -> dict[str, Background]:
        """A copy of the untouched gel, if it is known."""
        background = self._gate.background
        return {} if background is None else {"": background.copy()}

    def reset(self) -> None:
        """Begin anew with the same untouched gel."""
        self._touch.end_contact()
        self._gate.reset()
        self._correction.reset()

    def name_of_variable(self, name: str) -> str:
        """Return the name by which the graph knows a variable."""
        return name

    def check(
        self, frame: Frame, measurements: Sequence[Measurement], predicted: MultiHypothesisFilter
    ) -> CheckedFrame:
        """Refuse implausible input, correct the sensor's pose, and decide contact."""
        check_one_sensor(frame)
        given = with_checked_values(frame, measurements, self._tips)
        corrected = self._correction.corrected(given)
        return self._gate.check(corrected, predicted, self._touch.reads_images, self._touch.needs_colours)

    def measure(self, checked: CheckedFrame) -> Sequence[Measurement]:
        """Return the measurements by touch, of a frame in contact."""
        if checked.ends_contact:
            self._touch.end_contact()
        measured = _measured(self._touch, checked)
        return checked_measurements(checked.frame.time, measured, self._tips) if self._is_touch_given else measured

    def step(
        self, estimator: MultiHypothesisFilter, checked: CheckedFrame, measured: Sequence[Measurement]
    ) -> Posterior:
        """Take the frame and its measurements to all hypotheses."""
        if self._turned_frame.is_watching and self._touch.reads_images:
            self._turned_frame.see(checked.frame, measured)
            self._turn = self._turned_frame.found
        posterior = estimator.step(checked.frame, measured, checked.evidence.hidden_motion, self._touch.sunk)
        if estimator.is_mirrored and not self._is_mirrored_told and not self._turned_frame.is_watching:
            self._is_mirrored_told = True
            if self._turn is None:  # a turned frame looks like mirrored images
                logger.warning("frame at %.3f s: %s", checked.frame.time, MIRRORED)
        return posterior

    def accept(self, checked: CheckedFrame, measured: Sequence[Measurement]) -> None:
        """Make a frame the last one, now that it was used."""
        self._gate.accept(checked, measured)
        self._correction.accept(checked.corrected)

    def estimate(self, checked: CheckedFrame, posterior: AnyPosterior) -> Estimate:
        """Return the estimate at the time of the frame, with its status and the reason for it."""
        stream = checked.evidence._replace(sunk=self._touch.sunk, turn=self._turn)
        return moved_on(_decided(posterior, stream, checked.frame.time), checked.corrected.motion_since_image)


class SeveralFingers:
    """The fingers of a hand: a gate and a reader of touch for each."""

    def __init__(
        self,
        shape: Shape,
        hand: Hand,
        settings: TrackerSettings,
        units: Mapping[str, Unit],
        set_up_sigma: ArrayLike | None,
        is_view_known: bool,
    ) -> None:
        self._own = {name for name, unit in units.items() if unit.touch is not None}
        self._readers = {name: _reader_of(unit, settings) for name, unit in units.items()}
        calibrations = {name: unit.calibration for name, unit in units.items() if unit.calibration is not None}
        self._gate = HandGate(hand, calibrations, self._readers, settings.markers == "auto")
        self._hand = hand
        self._model = hand_contact_model(shape, list(hand.fingers.values()))
        noise = noise_of_hand(settings.noise, set_up_sigma, len(hand.fingers))
        self._settings = replace(settings, noise=noise)
        self._may_be_exchanged = not is_view_known and len(hand.fingers) == 2
        self._priors_of_fingers = tuple(
            priors_of_finger(settings.noise, unit, set_up_sigma, len(units)) for unit in units.values()
        )

    def make_estimator(self, first: FirstPose) -> MultiHypothesisFilter:
        """Return the filter of a hand."""
        return MultiHypothesisFilter(
            self._model,
            self._settings,
            first.pose,
            first.covariance,
            may_be_mirrored=self._may_be_exchanged,
            compiled=pushing_with(len(self._hand.fingers)),
            priors_of_fingers=self._priors_of_fingers,
        )

    @property
    def last(self) -> Frame | None:
        """The last frame as it was used."""
        return self._gate.last

    @property
    def tactile(self) -> TactileChoice:
        """Source of the touch measurements: learnt if any finger's images are read."""
        readers = list(self._readers.values())
        return next((reader for reader in readers if reader.tactile == "learnt"), readers[0]).tactile

    @property
    def tactile_reason(self) -> str:
        """Reason for that choice, by finger where they differ."""
        reasons = {name: reader.reason for name, reader in self._readers.items()}
        if len(set(reasons.values())) == 1:
            return next(iter(reasons.values()))
        return "; ".join(f"{name}: {reason}" for name, reason in reasons.items() if reason)

    @property
    def backgrounds(self) -> dict[str, Background]:
        """Copies of the untouched gels that are known, by finger."""
        gels = {finger.name: finger.gate.background for finger in self._gate.fingers}
        return {name: gel.copy() for name, gel in gels.items() if gel is not None}

    def begin(self, pose: Array, covariance: Array) -> None:
        """Take the object's first pose; that a finger's frame is turned is not looked for."""

    def reset(self) -> None:
        """Begin anew with the same untouched gels."""
        self._gate.reset()

    def name_of_variable(self, name: str) -> str:
        """Return the name by which the graph knows a variable, of a finger if it is named: "depth.left"."""
        variable, _, finger = name.partition(".")
        if not finger:
            return name
        check_names(f"variable {variable!r}", {finger: None}, self._hand.fingers)
        number = list(self._hand.fingers).index(finger)
        return next((variable_of(each, number).name for each in PUSHING.model.shared if each.name == variable), name)

    def check(self, frame: Frame, measurements: Sequence[Measurement], predicted: MultiHypothesisFilter) -> CheckedHand:
        """Refuse implausible input, bring the fingers to one time, and decide the contact of each."""
        return self._gate.check(frame, measurements, predicted)

    def measure(self, checked: CheckedHand) -> Mapping[int, Sequence[Measurement]]:
        """Return the measurements by touch of each finger that touches, by its number."""
        measured: dict[int, Sequence[Measurement]] = {}
        for finger in self._gate.fingers:
            seen = checked.seen.get(finger.number)
            if not checked.touches[finger.number] or (seen is not None and seen.ends_contact):
                finger.touch.end_contact()
            if seen is not None:
                given = _measured(finger.touch, seen)
                is_own = finger.name in self._own
                measured[finger.number] = checked_measurements(checked.frame.time, given, 1) if is_own else given
        return measured

    def step(
        self, estimator: MultiHypothesisFilter, checked: CheckedHand, measured: Mapping[int, Sequence[Measurement]]
    ) -> Posterior:
        """Take the frame and its measurements to all hypotheses."""
        fingers = Fingers(checked.mounts, checked.touches, np.where(checked.touches, self._gate.sunk, 0.0))
        of_fingers = [OfFinger(number, one) for number, given in measured.items() for one in given]
        hidden = checked.evidence.hidden_motion
        return estimator.step(checked.frame, hidden_motion=hidden, fingers=fingers, of_fingers=of_fingers)

    def accept(self, checked: CheckedHand, measured: Mapping[int, Sequence[Measurement]]) -> None:
        """Make a frame the last one, now that it was used."""
        self._gate.accept(checked, measured)

    def estimate(self, checked: CheckedHand, posterior: Posterior) -> Estimate:
        """Return the estimate at the time of the frame, with its status and the reason for it."""
        stream = checked.evidence._replace(sunk=float(self._gate.sunk.max()))
        return moved_on(_decided(posterior, stream, checked.frame_time), checked.motion_since)


def _reader_of(unit: Unit, settings: TrackerSettings) -> TouchReader:
    """Return the reader of touch of a sensor unit."""
    return TouchReader(settings.tactile, unit.sensor, unit.model, unit.calibration, own=unit.touch)


def _measured(touch: TouchReader, checked: CheckedFrame) -> Sequence[Measurement]:
    """Return the measurements by touch in a frame of one sensor; none where no touch shows or can be measured."""
    touch.choose(checked.frame.image, checked.background)
    is_blind = checked.evidence.touches_since_start and touch.reads_images
    if not checked.frame.contact or is_blind or not checked.shows_touch:
        return ()
    return touch.read(checked.frame, checked.background, checked.light)


def _decided(posterior: AnyPosterior, stream: InputEvidence, time: float) -> Estimate:
    """Return the estimate of a posterior at a time [s], with the status that all evidence decides."""
    return posterior.estimate(time, decide(Evidence(posterior.evidence, stream)))
