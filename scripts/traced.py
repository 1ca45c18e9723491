"""Recordings whose estimates are kept as traces, and what a tracker is given of each; see `traces`.

All are made again from seeds but those of MIT and CMU, which are read from ../shared/data.
"""

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate import (
    DIGIT,
    GELSIGHT_MINI,
    Calibration,
    ContactDirection,
    Frame,
    Measurement,
    ObjectPose,
    Recording,
    SensorProfile,
    Shape,
    TrackerSettings,
    Turn,
    load_recording,
    load_shape,
    read_bag,
)

ROOT = Path(__file__).parents[1]
SHARED = ROOT.parent / "shared/data"
Array = NDArray[np.float64]


# The simulator, faults, and the bags of the tests: all that is not public, to be changed where these move.

HAND = SensorProfile("CMU two-finger hand", radius=0.0025, tips=((0.0, 0.009), (0.0, -0.009)), rate=1.0 / 0.03)


@cache
def simulated(what: str, seed: int, sensor: SensorProfile = DIGIT, seconds: float = 6.0, **options: Any) -> Recording:
    """Simulate pushes of an object, at a place if it has several: "rectangle corners"."""
    from palpate_lab.simulate.recordings import Simulation

    return Simulation(*_shape_and_kind(what), seed, seconds, sensor=sensor, **options).run()


def pushed_by_two_fingers(what: str, seed: Any, seconds: float = 6.0, **options: Any) -> Recording:
    """Simulate pushes by CMU's hand, which has no images; the seed may be a random generator."""
    from palpate_lab.simulate.pushes import draw_sequence, measured

    shape, kind = _shape_and_kind(what)
    rng = np.random.default_rng(seed)
    motion = draw_sequence(shape, kind, HAND, rng, seconds, **options)
    sensor_pose = measured(motion.sensor_pose, rng)
    object_pose = measured(motion.object_pose, rng)
    time = np.arange(len(sensor_pose)) / HAND.rate
    return Recording(time, sensor_pose, shape, HAND, object_pose, motion.contact)


@dataclass(eq=False)
class _Stream:
    """Data of N frames as a sensor gives them, for a fault to change."""

    time: Array
    contact: NDArray[np.bool_]
    sensor_pose: Array
    truth: Array
    images: list[NDArray[np.uint8]]
    order: NDArray[np.int_]
    """Frames in the order in which they arrive."""
    shape: Shape
    calibration: Calibration | None = None

    @property
    def untouched(self) -> int:
        """Number of frames before the first touch."""
        return int(np.argmax(self.contact))

    @property
    def middle(self) -> int:
        """Frame a third of the way through the longest contact."""
        from palpate.pipeline.metrics import flag_runs

        first, last = max(flag_runs(self.contact), key=lambda run: run[1] - run[0])
        return first + (last - first) // 3

    def during(self, seconds: float) -> NDArray[np.int_]:
        """Return the frames of some seconds from the middle on."""
        begin = self.time[self.middle]
        return np.flatnonzero((self.time >= begin) & (self.time < begin + seconds))


def _drop_frames(stream: _Stream, rng: np.random.Generator) -> None:
    is_kept = rng.random(len(stream.time)) >= 0.2
    is_kept[0] = True
    stream.order = np.flatnonzero(is_kept)


def _exchange_frames(stream: _Stream, rng: np.random.Generator) -> None:
    is_late = rng.random(len(stream.time)) < 0.1
    is_late[0] = False
    stream.order = np.argsort(stream.order + 1.5 * is_late, kind="stable")


def _shift_stamps(stream: _Stream, rng: np.random.Generator) -> None:
    stream.time[stream.middle :] += 1000.0


def _lose_poses(stream: _Stream, rng: np.random.Generator) -> None:
    stream.sensor_pose[stream.during(0.2)] = np.nan


def _displace_poses(stream: _Stream, rng: np.random.Generator) -> None:
    later = np.flatnonzero(stream.contact & (np.arange(len(stream.time)) > stream.middle))
    frames = np.append(stream.middle, rng.choice(later, 9, replace=False))
    angle = rng.uniform(-np.pi, np.pi, 10)
    stream.sensor_pose[frames, :2] += 0.02 * np.column_stack([np.cos(angle), np.sin(angle)])


def _blacken_images(stream: _Stream, rng: np.random.Generator) -> None:
    for k in stream.during(0.16).tolist():
        stream.images[k] = np.zeros_like(stream.images[k])


def _dim_light(stream: _Stream, rng: np.random.Generator) -> None:
    count = len(stream.images)
    dimmed = [np.rint(image * (1.0 - 0.2 * k / (count - 1))) for k, image in enumerate(stream.images)]
    stream.images = [np.clip(image, 0, 255).astype(np.uint8) for image in dimmed]


def _miss_contact(stream: _Stream, rng: np.random.Generator) -> None:
    stream.images[stream.middle : stream.middle + 10] = [stream.images[0]] * 10


def _rotate_images(stream: _Stream, rng: np.random.Generator) -> None:
    from palpate.touch.background import background_of

    stream.calibration = Calibration(background_of(stream.images[: stream.untouched]))
    stream.images = [np.ascontiguousarray(np.rot90(image, 2)) for image in stream.images]


def _change_outline_and_move(stream: _Stream, rng: np.random.Generator) -> None:
    from palpate.geometry import se2
    from palpate.geometry.shapes import scaled

    stream.shape = scaled(stream.shape, 1.02)
    angle = rng.uniform(-np.pi, np.pi)
    aside = np.array([0.01 * np.cos(angle), 0.01 * np.sin(angle), 0.0])
    last = stream.untouched - 1
    before = stream.truth[last]
    motion = se2.compose(se2.compose(before, aside), se2.inverse(before))
    fraction = np.clip(np.arange(len(stream.time)) / last, 0.0, 1.0)  # the sensor follows gradually
    fraction = fraction * fraction * (3.0 - 2.0 * fraction)
    stream.sensor_pose = se2.compose(se2.exp(fraction[:, None] * se2.log(motion)), stream.sensor_pose)
    stream.truth[last // 2 :] = se2.compose(motion, stream.truth[last // 2 :])


FAULTS: dict[str, Callable[[_Stream, np.random.Generator], None]] = {
    "frames dropped, 20 %": _drop_frames,
    "frames exchanged, 10 %": _exchange_frames,
    "stamps +1000 s for good": _shift_stamps,
    "pose NaN for 0.2 s": _lose_poses,
    "pose off by 20 mm 10 times": _displace_poses,
    "image black for 5 frames": _blacken_images,
    "light drifts -20 %": _dim_light,
    "missed contact of 10 frames": _miss_contact,
    "turned by 180 degrees, calibrated": _rotate_images,
    "outline +2 % and moved untouched 10 mm": _change_outline_and_move,
}
"""Faults of sensors, or of what is known of the object, by name."""


def faulty(recording: Recording, fault: str) -> "Given":
    """Put a fault, one of FAULTS, into a recording."""
    stream = _Stream(
        time=recording.time.copy(),
        contact=np.asarray(recording.contact),
        sensor_pose=recording.sensor_pose.copy(),
        truth=np.array(recording.object_pose),
        images=[np.asarray(frame.image) for frame in recording],
        order=np.arange(len(recording)),
        shape=recording.shape,
    )
    first_pose = stream.truth[0].copy()
    FAULTS[fault](stream, np.random.default_rng(0))
    frames = [
        Frame(float(stream.time[k]), stream.sensor_pose[k], stream.images[k], bool(stream.contact[k]), stream.truth[k])
        for k in stream.order.tolist()
    ]
    return Given(replace(recording, shape=stream.shape), tuple(frames), first_pose, calibration=stream.calibration)


def through_a_bag(recording: Recording) -> Recording:
    """Write images, 7 ms late, and poses of a recording into a bag, and read it."""
    sys.path.insert(0, str(ROOT / "tests"))
    from bag_samples import START, compressed_message, pose_message, write_bag

    messages = []
    for frame in recording:
        stamp = START + round(1e9 * frame.time)
        messages += [pose_message(stamp, frame.sensor_pose), compressed_message(stamp + 7_000_000, frame.image)]
    with tempfile.TemporaryDirectory() as folder:
        path = write_bag(Path(folder) / "bag", "mcap", messages)
        read = read_bag(path, recording.shape, sensor=recording.sensor).recording
        return replace(read, first_pose=recording.first_pose, first_pose_sigma=recording.first_pose_sigma)


def _shape_and_kind(what: str) -> tuple[Shape, str]:
    """Return an object, and the simulator's name for how it is touched."""
    name, *place = what.split()
    shape = load_shape(name)
    return shape, "-".join([type(shape).__name__.lower(), *place])


# From here on everything is public.


@dataclass(frozen=True, eq=False)
class Given:
    """Input of a tracker."""

    recording: Recording
    """Recording with the object and the sensor."""
    frames: tuple[Frame, ...]
    """N frames as they arrive."""
    first_pose: Array | None
    """world_T_object (3,) [m, m, rad]; None if it is unknown."""
    first_pose_sigma: Array | None = None
    """Standard deviations of the first pose (3,) [m, m, rad]; None for those of the settings."""
    settings: TrackerSettings | None = None
    """Settings of the tracker; None for the defaults."""
    calibration: Calibration | None = None
    """Calibration of the sensor unit."""
    said: tuple[tuple[Measurement, ...], ...] = ()
    """Measurements given to `update` beside each frame; empty for none at all."""


def told(recording: Recording, begin: int = 0, **changes: Any) -> Given:
    """Return the frames of a recording from `begin` on, with its first pose or, if it has none, the first true one."""
    first = recording.first_pose
    sigma = recording.first_pose_sigma
    if first is None or begin:
        truth = np.asarray(recording.object_pose)[begin:]
        first = truth[np.isfinite(truth[:, 0])][0]
        sigma = SURE
    return replace(Given(recording, tuple(recording)[begin:], first, sigma), **changes)


def mirrored(recording: Recording) -> Given:
    """Exchange left and right in all images."""
    frames = (replace(frame, image=np.asarray(frame.image)[:, ::-1].copy()) for frame in recording)
    return told(recording, frames=tuple(frames))


def begun_in_contact(recording: Recording) -> Given:
    """Leave out all frames up to half a second after a contact has begun."""
    return told(recording, begin=int(np.argmax(np.asarray(recording.contact))) + 15)


def seen_by_a_camera(recording: Recording, delay: int, in_frames: bool) -> Given:
    """Add true poses of the object with noise, of so many frames ago, to every twelfth frame."""
    given = told(recording)
    rng = np.random.default_rng(1)
    sigma = np.array([0.003, 0.003, 0.03])
    said: list[tuple[Measurement, ...]] = [()] * len(given.frames)
    for now in range(12, len(said), 12):
        seen = given.frames[now - delay]
        pose = np.asarray(seen.object_pose) + sigma * rng.normal(size=3)
        said[now] = (ObjectPose(pose, np.diag(sigma**2), seen.time if delay else None),)
    if not in_frames:
        return replace(given, said=tuple(said))
    frames = zip(given.frames, said, strict=True)
    return replace(given, frames=tuple(replace(frame, measurements=seen) for frame, seen in frames))


def felt_by_others(recording: Recording) -> Given:
    """Return a recording with directions and turns, made from the truth with noise, as measurements."""
    rng = np.random.default_rng(2)
    said: list[tuple[Measurement, ...]] = []
    for frame, angle in zip(recording, recording.extra["pad_angle"], strict=True):
        turn = frame.sensor_pose[2] - np.asarray(frame.object_pose)[2]
        off = rng.normal(0.0, 0.02, 2)
        direction = ContactDirection(float(angle + off[0]), 4e-4) if frame.contact else None
        said.append((direction, Turn(float(turn + off[1]), 4e-4)) if direction else ())
    return told(recording, settings=NONE, said=tuple(said))


@dataclass(frozen=True)
class Case:
    """One trace."""

    recording: Callable[[], Recording]
    """Makes or reads the recording."""
    given: Callable[[Recording], Given] = told
    """Says what a tracker is given of it."""
    is_shared: bool = False
    """Whether the recording is read from SHARED."""


SURE = np.array([5e-4, 5e-4, 5e-3])
ROUGH = np.array([0.02, 0.02, 0.4])
ORACLE = TrackerSettings("oracle")
NONE = TrackerSettings("none")
BATCH = TrackerSettings(smoother="batch")
EDGES = "rectangle edges"
CORNERS = "rectangle near-corners"
EIGHT = ("disc", "disc", "ellipse", "ellipse", EDGES, EDGES, CORNERS, "rectangle corners")
UNSEEN = ("triangle corners", "hexagon edges", "t near-corners", "butterfly edges", "rounded-square edges")
MIT = ("Pertubations", "BigPertubations5", "_2016_10_23_NoPerturbations")
CMU = ("20_neg30_90__log2017-05-23_22-05-15", "30_50_60__log2017-05-23_22-20-00", "60_20_150__log2017-05-23_22-25-24")


def _cases() -> dict[str, Case]:
    """All traces by name."""
    cases: dict[str, Case] = {}

    def add(group: str, what: str, *case: Any) -> None:
        cases["-".join([group, *what.replace(",", "").replace("%", "percent").split()])] = Case(*case)

    for n, what in enumerate(EIGHT):
        add("ideal", f"{what} {n}", partial(simulated, what, 100 + n, ideal=True))
        add("set-up", f"{what} {n}", partial(simulated, what, 200 + n))
        add("shoved", f"{what} {n}", partial(simulated, what, 300 + n, knocks=True, ideal=n % 2 == 0))
    for n, what in enumerate(UNSEEN):
        add("unseen", what, partial(simulated, what, 400 + n))
    for n, what in enumerate(("disc", "ellipse", EDGES, "triangle edges")):
        add("mini", what, partial(simulated, what, 500 + n, GELSIGHT_MINI, ideal=n % 2 == 0))
    for n, (what, how) in enumerate(((EDGES, ORACLE), ("ellipse", NONE), ("triangle edges", ORACLE))):
        add("two-fingers", what, partial(pushed_by_two_fingers, what, 600 + n), partial(told, settings=how))
    for n, what in enumerate((EDGES, "ellipse", "triangle corners")):
        add("unknown", what, partial(simulated, what, 700 + n), partial(told, first_pose=None, first_pose_sigma=None))
    for n, what in enumerate((EDGES, "ellipse")):
        again = partial(simulated, what, 204 - 2 * n)
        one = TrackerSettings(hypotheses=1)
        add("rough", what, partial(simulated, what, 800 + n), partial(told, first_pose_sigma=ROUGH))
        add("camera", what, again, partial(seen_by_a_camera, delay=3 * n, in_frames=n == 0))
        add("mirrored", what, partial(simulated, what, 810 + n, ideal=True), mirrored)
        add("batch", what, again, partial(told, settings=BATCH))
        add("one-answer", what, partial(simulated, what, 820 + n, knocks=True), partial(told, settings=one))
    add("bag", EDGES, lambda: through_a_bag(simulated(EDGES, 204)))
    add("begun-in-contact", EDGES, partial(simulated, EDGES, 204), begun_in_contact)
    add("own-touch", EDGES, partial(simulated, EDGES, 830, images=False), felt_by_others)
    for fault in FAULTS:
        add("fault", fault, partial(simulated, EDGES, 840, seconds=8.0, ideal=True), partial(faulty, fault=fault))
    paths = [SHARED / f"mit_point_push/StraightLine{name}.json.gz" for name in MIT]
    paths += [SHARED / f"cmu_two_finger/bigrect_3pts__bigrect_3pts_{name}.txt" for name in CMU]
    for n, path in enumerate(paths):
        add(path.parent.name[:3], str(n % 3), partial(load_recording, path), partial(told, settings=ORACLE), True)
    return cases


CASES = _cases()
