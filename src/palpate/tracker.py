"""The tracker: one frame in, one estimate out."""

import copy
import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from numpy.typing import ArrayLike

from palpate.arrays import Array
from palpate.compiled import EVERY, Compiled
from palpate.compiled.library import path_of
from palpate.config import TactileChoice, TrackerSettings
from palpate.errors import EstimationError, SettingError
from palpate.estimation.compiled_model import CompiledModel
from palpate.geometry.shapes import Shape
from palpate.models.pushing.compiled import MODELS, PUSHING, pushing_with
from palpate.sensors import OneSensor, Sensors, SeveralFingers
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration
from palpate.touch.reader import Touch
from palpate.touch.touch_model import TouchModel
from palpate.tracker_arguments import Unit, check_shape_and_settings, first_pose_of, hand_of, unit_of, units_of
from palpate.types.estimate import Estimate
from palpate.types.hand import Hand
from palpate.types.measurements import Frame, Measurement
from palpate.types.outline import Sketch, Unknown
from palpate.types.sensor import SensorProfile
from palpate.types.sensor_file import known_sensor

logger = logging.getLogger(__name__)


class Tracker:
    """Tracks one object from the frames of one sensor, or of a hand of several fingers. No input, output or drawing."""

    def __init__(
        self,
        shape: Shape | Unknown | Sketch,
        sensor: SensorProfile | str | Mapping[str, SensorProfile | str] | Hand,
        first_pose: ArrayLike | None,
        settings: TrackerSettings | None = None,
        model: TouchModel | Mapping[str, TouchModel] | None = None,
        calibration: Calibration | Mapping[str, Calibration] | None = None,
        touch: Touch | Mapping[str, Touch] | None = None,
        first_pose_sigma: ArrayLike | None = None,
        set_up_sigma: ArrayLike | None = None,
        is_view_known: bool = False,
        graph: CompiledModel = PUSHING,
        mounts: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        """Take the object's outline, the sensor or its name, and world_T_object (3,) [m, m, rad] at the first frame.

        An outline that is `Unknown`, or a `Sketch`, is learnt by one sensor: `Estimate.outline`. A first pose of None
        is anywhere within a metre of the world's origin, at any yaw. `first_pose_sigma` are standard deviations (3,)
        [m, m, rad] along the object's axes, or a covariance (3, 3) as an `Estimate` has it; by default
        `noise.first_pose`. `set_up_sigma` are those of the constant offset between sensor, world and outline, by
        default `noise.sensor_pose.calibration`. Without a `calibration` of this sensor unit, the first half second of
        images is taken as untouched; one by pushes corrects the sensor's poses, too, and takes the place of
        `set_up_sigma`. `touch` is an object of your own that measures in place of the touch model. Unless the
        calibration or `is_view_known` says that images are upright, the tracker finds out if they are. `graph` are the
        variables and factors: those of pushing, or of a model that extends it.

        A hand of several fingers is a `palpate.Hand`, or sensors by name with their `mounts`, hand_T_finger (3,) [m, m,
        rad]. Then `model`, `calibration` and `touch` are dictionaries by finger, which may leave some out, and
        `set_up_sigma` is of each finger. Images of a hand are taken as upright; unless `is_view_known`, the tracker
        finds out if two fingers are exchanged.

        The first tracker of a process loads compiled code. Where palpate came without it, the very first takes 30 s to
        compile it.
        """
        hand = hand_of(sensor, mounts)
        check_shape_and_settings(shape, settings)
        settings = settings or TrackerSettings()
        self._settings = settings
        self._lock = threading.Lock()
        self._first = first_pose_of(first_pose, first_pose_sigma, settings)
        self._sensors: Sensors
        if hand is None:
            unit = unit_of(known_sensor(sensor), model, calibration, touch)  # pyright: ignore[reportArgumentType]
            self._sensors = _one_sensor(shape, settings, unit, set_up_sigma, is_view_known, graph)
        else:
            if graph is not PUSHING:
                raise SettingError("graph is an extended model, which has one sensor; a hand has the model of pushing")
            if isinstance(shape, Unknown | Sketch):
                raise SettingError("the outline is not known, and the sensor is a hand; one sensor alone learns it")
            units = units_of(hand, model, calibration, touch)
            warm_up(pushing_with(len(hand.fingers)))
            self._sensors = SeveralFingers(shape, hand, settings, units, set_up_sigma, is_view_known)
        self._makes_frame = isinstance(shape, Unknown)
        self._filter = self._sensors.make_estimator(self._first)
        self._sensors.begin(self._first.pose, self._first.covariance)

    def __copy__(self) -> "Tracker":
        """Return a copy that shares nothing with the tracker, so that either can go on alone."""
        return copy.deepcopy(self)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of copies and pickles, which have a lock of their own."""
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take the state of a copy or a pickle."""
        vars(self).update(state)
        self._lock = threading.Lock()

    def reset(self, pose: ArrayLike | None = None, sigma: ArrayLike | None = None) -> None:
        """Begin anew with the same sensor, settings and untouched gel; the next frame may have any time.

        `pose` and `sigma` are a new first pose and its sigma, by default those it last began with.
        """
        if pose is not None or sigma is not None:
            self._first = first_pose_of(self._first.pose if pose is None else pose, sigma, self._settings)
        with self._lock:
            self._sensors.reset()
            self._filter.begin(self._first.pose, self._first.covariance)
            self._sensors.begin(self._first.pose, self._first.covariance)

    def update(self, frame: Frame, measurements: Sequence[Measurement] = ()) -> Estimate:
        """Take the next frame and return the estimate at its time.

        `measurements` of other sources, such as a camera's `ObjectPose`, are added to the frame's own. If a frame has
        an image, the image decides if it is in contact, whatever its flag is.

        Raises FrameError if the frame cannot be used and is left out, and EstimationError if no estimate can be
        computed, not even by beginning anew from the last pose: the next frame then begins another contact.
        """
        sensors = self._sensors
        with self._lock:  # of two threads one waits
            checked = sensors.check(frame, measurements, self._filter)
            if checked.is_first:
                self._first.warn_if_far_from(checked.frame.sensor_pose, self._makes_frame)
            if checked.ends_contact:
                self._filter.end_contact(checked.unobserved_push)
            measured = sensors.measure(checked)
            posterior = sensors.step(self._filter, checked, measured)
            sensors.accept(checked, measured)
            return sensors.estimate(checked, posterior)

    @property
    def tactile(self) -> TactileChoice:
        """Source of the touch measurements; auto until the first frame, and if `touch` was given."""
        return self._sensors.tactile

    @property
    def tactile_reason(self) -> str:
        """Reason for that choice, in words; empty if the settings named it."""
        return self._sensors.tactile_reason

    @property
    def mirrored(self) -> bool:
        """True once touch images are taken as turned by half a turn or mirrored, as only so they fit the push.

        Of a hand, once two fingers are taken as exchanged.
        """
        return self._filter.is_mirrored

    def variable(self, name: str) -> tuple[Array, Array]:
        """Return a variable of the object as learnt so far, by the best answer: mean and standard deviation, (D,) each.

        Names are those of `palpate.models.pushing.variables`, and of an extended model; of a hand, those that belong to
        a finger are that of the first, or have its name, as `depth.left`. Raises SettingError for others.
        """
        return self._filter.variable(self._sensors.name_of_variable(name))

    @property
    def frame(self) -> Frame:
        """The last frame as it was used, its image in the profile's view; EstimationError before the first one."""
        last = self._sensors.last
        if last is None:
            raise EstimationError("no frame has been taken so far; there is one after the first update")
        return last

    @property
    def background(self) -> Background | None:
        """A copy of the untouched gel as it is known now; None before the first images, without images, for a hand."""
        return self._sensors.backgrounds.get("")

    @property
    def backgrounds(self) -> dict[str, Background]:
        """Copies of the untouched gels of a hand's fingers that are known now, by finger; "" is that of one sensor."""
        return self._sensors.backgrounds


def _one_sensor(
    shape: Shape | Unknown | Sketch,
    settings: TrackerSettings,
    unit: Unit,
    set_up_sigma: ArrayLike | None,
    is_view_known: bool,
    graph: CompiledModel,
) -> OneSensor:
    """Return one sensor with all compiled code that it needs, for an outline that is known or one that is learnt."""
    if not isinstance(shape, Unknown | Sketch):
        warm_up(graph)
        return OneSensor(shape, settings, unit, set_up_sigma, is_view_known, graph)
    if graph is not PUSHING:
        raise SettingError("graph is an extended model, which needs an outline that is known")
    from palpate.exploring_sensor import OneSensorExploring  # which few need

    warm_up(graph)
    return OneSensorExploring(shape, settings, unit, set_up_sigma, is_view_known)


def machine_code(graph: CompiledModel | None = None) -> list[Compiled]:
    """Return the compiled functions of a tracker with a model; without one, all that are imported."""
    others = [model for model in MODELS if graph is not None and model is not graph]
    left_out = {function for model in others for function in (model.improve, model.begin_step)}
    return [function for function in EVERY if function not in left_out]


def warm_up(graph: CompiledModel | None = None, progress: Callable[[int], object] | None = None) -> None:
    """Load all machine code, or make it where there is none yet.

    Given a model, that of the others is left out. `progress` is called with the number of functions done.
    """
    improve = (graph or PUSHING).improve
    is_made = improve.is_loaded or path_of(improve) is not None
    if not is_made:
        of_what = "" if improve is PUSHING.improve else " of this number of fingers, or with these factors"
        logger.warning("compiling the estimator%s: once for this version, some 30 s", of_what)
    for count, function in enumerate(machine_code(graph), start=1):
        function.load()
        if progress:
            progress(count)
