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

    (shape, kind), rng = _shape_and_kind(what), np.random.default_rng(seed)
    motion = draw_sequence(shape, kind, HAND, rng, seconds, **options)
    sensor_pose, object_pose = measured(motion.sensor_pose, rng), measured(motion.object_pose, rng)
    time = np.arange(len(sensor_pose)) / HAND.rate
    return Recording(time, sensor_pose, shape, HAND, object_pose, motion.contact)


def faulty(recording: Recording, fault: str) -> "Given":
    """Put a fault of sensors, or of what is known of the object, into a recording; FAULTY names them."""
    from palpate.geometry import se2
    from palpate.geometry.shapes import scaled
    from palpate.pipeline.metrics import flag_runs
    from palpate.touch.background import background_of

    rng, count, shape, calibration = np.random.default_rng(0), len(recording), recording.shape, None
    contact, time, pose = np.asarray(recording.contact), recording.time.copy(), recording.sensor_pose.copy()
    truth, images = np.array(recording.object_pose), [np.asarray(frame.image) for frame in recording]
    first_pose, order = truth[0].copy(), np.arange(count)
    first, last = max(flag_runs(contact), key=lambda run: run[1] - run[0])
    middle = first + (last - first) // 3  # of the longest contact
    untouched = int(np.argmax(contact))  # frames before the first touch

    def during(seconds: float) -> NDArray[np.int_]:
        return np.flatnonzero((time >= time[middle]) & (time < time[middle] + seconds))

    match fault:
        case "frames dropped, 20 %":
            order = np.flatnonzero(np.append(True, (rng.random(count) >= 0.2)[1:]))
        case "frames exchanged, 10 %":
            later = np.append(False, (rng.random(count) < 0.1)[1:])
            order = np.argsort(order + 1.5 * later, kind="stable")
        case "stamps +1000 s for good":
            time[middle:] += 1000.0
        case "pose NaN for 0.2 s":
            pose[during(0.2)] = np.nan
        case "pose off by 20 mm 10 times":
            later = np.flatnonzero(contact & (np.arange(count) > middle))
            frames, angle = np.append(middle, rng.choice(later, 9, replace=False)), rng.uniform(-np.pi, np.pi, 10)
            pose[frames, :2] += 0.02 * np.column_stack([np.cos(angle), np.sin(angle)])
        case "image black for 5 frames":
            for k in during(0.16).tolist():
                images[k] = np.zeros_like(images[k])
        case "light drifts -20 %":
            dimmed = [np.rint(image * (1.0 - 0.2 * k / (count - 1))) for k, image in enumerate(images)]
            images = [np.clip(image, 0, 255).astype(np.uint8) for image in dimmed]
        case "missed contact of 10 frames":
            images[middle : middle + 10] = [images[0]] * 10
        case "turned by 180 degrees, calibrated":
            calibration = Calibration(background_of(images[:untouched]))
            images = [np.ascontiguousarray(np.rot90(image, 2)) for image in images]
        case "outline +2 % and moved untouched 10 mm":
            shape, angle = scaled(shape, 1.02), rng.uniform(-np.pi, np.pi)
            aside = np.array([0.01 * np.cos(angle), 0.01 * np.sin(angle), 0.0])
            before = truth[untouched - 1]
            motion = se2.compose(se2.compose(before, aside), se2.inverse(before))
            part = np.clip(np.arange(count) / (untouched - 1), 0.0, 1.0)  # the sensor follows gradually
            part = part * part * (3.0 - 2.0 * part)
            pose = se2.compose(se2.exp(part[:, None] * se2.log(motion)), pose)
            truth[(untouched - 1) // 2 :] = se2.compose(motion, truth[(untouched - 1) // 2 :])
        case _:
            raise ValueError(f"no fault is called {fault!r}")
    frames = [Frame(float(time[k]), pose[k], images[k], bool(contact[k]), truth[k]) for k in order.tolist()]
    return Given(replace(recording, shape=shape), tuple(frames), first_pose, calibration=calibration)


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
    """What a tracker is given."""

    recording: Recording
    """Whose object and sensor it is."""
    frames: tuple[Frame, ...]
    """N frames as they arrive."""
    first_pose: Array | None
    """world_T_object (3,) [m, m, rad]; None is not known at all."""
    first_pose_sigma: Array | None = None
    """How well it is known (3,) [m, m, rad]; None is what the settings say."""
    settings: TrackerSettings | None = None
    """How to track."""
    calibration: Calibration | None = None
    """What is known of the sensor unit."""
    said: tuple[tuple[Measurement, ...], ...] = ()
    """What is said of each frame beside what is in it; nothing of any where this is empty."""


def told(recording: Recording, begin: int = 0, **changes: Any) -> Given:
    """Return what a tracker is told of a recording from a frame on: its first pose or, where it has none, the truth."""
    first, sigma = recording.first_pose, recording.first_pose_sigma
    if first is None or begin:
        truth = np.asarray(recording.object_pose)[begin:]
        first, sigma = truth[np.isfinite(truth[:, 0])][0], SURE
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
    given, rng, sigma = told(recording), np.random.default_rng(1), np.array([0.003, 0.003, 0.03])
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
    """Let directions and turns with noise, made from the truth, be what touch says."""
    rng = np.random.default_rng(2)
    said: list[tuple[Measurement, ...]] = []
    for frame, angle in zip(recording, recording.extra["pad_angle"], strict=True):
        turn, off = frame.sensor_pose[2] - np.asarray(frame.object_pose)[2], rng.normal(0.0, 0.02, 2)
        felt = (ContactDirection, angle + off[0]), (Turn, turn + off[1])
        said.append(tuple(what(float(value), 4e-4) for what, value in felt) if frame.contact else ())
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


SURE, ROUGH = np.array([5e-4, 5e-4, 5e-3]), np.array([0.02, 0.02, 0.4])
ORACLE, NONE, BATCH = TrackerSettings("oracle"), TrackerSettings("none"), TrackerSettings(smoother="batch")
EDGES, CORNERS = "rectangle edges", "rectangle near-corners"
EIGHT = ("disc", "disc", "ellipse", "ellipse", EDGES, EDGES, CORNERS, "rectangle corners")
UNSEEN = ("triangle corners", "hexagon edges", "t near-corners", "butterfly edges", "rounded-square edges")
FAULTY = (
    *("frames dropped, 20 %", "frames exchanged, 10 %", "stamps +1000 s for good", "pose NaN for 0.2 s"),
    *("pose off by 20 mm 10 times", "image black for 5 frames", "light drifts -20 %", "missed contact of 10 frames"),
    *("turned by 180 degrees, calibrated", "outline +2 % and moved untouched 10 mm"),
)
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
        again, one = partial(simulated, what, 204 - 2 * n), TrackerSettings(hypotheses=1)
        add("rough", what, partial(simulated, what, 800 + n), partial(told, first_pose_sigma=ROUGH))
        add("camera", what, again, partial(seen_by_a_camera, delay=3 * n, in_frames=n == 0))
        add("mirrored", what, partial(simulated, what, 810 + n, ideal=True), mirrored)
        add("batch", what, again, partial(told, settings=BATCH))
        add("one-answer", what, partial(simulated, what, 820 + n, knocks=True), partial(told, settings=one))
    add("bag", EDGES, lambda: through_a_bag(simulated(EDGES, 204)))
    add("begun-in-contact", EDGES, partial(simulated, EDGES, 204), begun_in_contact)
    add("own-touch", EDGES, partial(simulated, EDGES, 830, images=False), felt_by_others)
    for fault in FAULTY:
        add("fault", fault, partial(simulated, EDGES, 840, seconds=8.0, ideal=True), partial(faulty, fault=fault))
    paths = [SHARED / f"mit_point_push/StraightLine{name}.json.gz" for name in MIT]
    paths += [SHARED / f"cmu_two_finger/bigrect_3pts__bigrect_3pts_{name}.txt" for name in CMU]
    for n, path in enumerate(paths):
        add(path.parent.name[:3], str(n % 3), partial(load_recording, path), partial(told, settings=ORACLE), True)
    return cases


CASES = _cases()
