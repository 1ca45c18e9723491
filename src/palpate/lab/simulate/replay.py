"""Replays: the motion of a real push, with touch images as a DIGIT in the place of the real tip would have seen it.

The object moves as it did, and the contact moves along its outline as it did. The DIGIT is put where it touches the
outline at the same point as the real tip, of radius r, from the same side and with the same gap that robot and motion
capture leave there: its centre of curvature lies on the line through that point and the tip's centre. What its gel of
radius R does not share with a small tip is how it has to turn, and that is chosen so that the gel slides over the
object no more and no less than the tip did: of both, the contact moves along the surface by the same length. When the
contact's direction in the tip turns by an angle, it turns by r / R times that angle in the gel, and the sensor makes up
for the rest. A tip that sticks, and rolls as the object turns, becomes a gel that sticks and rolls; kept at a constant
yaw, the gel would slide by (R - r) times the angle instead, and a turn of 26 degrees would carry the contact off its
pad. The price is that the sensor follows the object: it turns by 1 - r / R of the angle, three quarters for the MIT's
tip, and its centre goes along by (R - r) times the angle, also where a hand knocks the object. The sensor's pose says
something of the object's yaw, then, which the real tip's did not; comparisons between ways to touch on the same replay
are fair, those with the real recording are not.

A hand of several fingers becomes one gel at their middle that keeps the hand's yaw. The contact it shows is that of
hand and edge. A single round gel could not have held the object as two fingers did, so these replays say something of
touch and nothing of how single contacts push.
"""

import zlib
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.lab.simulate.folder import Outcome, fill_folder
from palpate.lab.simulate.gel import draw_side, render
from palpate.lab.simulate.real_motion import SMOOTH, Contacts, RealMotion, real_contacts, real_motion, runs, sliding
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.parallel import one_thread
from palpate.shards import Shard
from palpate.types.images import encode_image
from palpate.types.recording import Recording, episode_numbers
from palpate.types.sensor import DIGIT

Array = NDArray[np.float64]

_BEGIN, _FAR = np.radians(12.0), np.radians(20.0)  # from the gel's apex: where contacts begin, where they better stay
_AGAIN = 1.0  # [s] without contact that the sensor needs to turn to another place on its gel
_DEPTH, _SWAY = (4e-4, 1e-3), 0.1  # [m] as in simulated worlds, and by which share it comes and goes
_SLOW = (0.1, 0.5)  # [Hz] at which it does
_ONSET = 4  # frames in which the gel is pressed in, and let go
_FRICTION, _STIFFNESS = (0.25, 0.6), (2600.0, 6500.0)  # of simulated worlds; [N/m]
_CREEP = 0.005  # [m/s] of sliding from which friction is nearly full
_HOLLOW = 1e-4  # [m] by which a gel may overlap the outline elsewhere than at the contact


def replay_recording(recording: Recording, seed: int = 0, unit: int | None = None) -> Recording:
    """Return the replay of a real recording; the same seed, file name and unit give the same.

    Sensor unit, depth of contact and where on the gel it begins are drawn; `unit` is the seed of one unit for many
    replays. Poses get no noise: that of the motion capture is in them. Raises SettingError, which names file and
    frames, for a motion that cannot be rendered: object poses or contact are unknown for too long, the gel does not
    reach the contact, or the contact is off its pad.
    """
    unit_seed, *seeds = _seeds(recording, seed, unit)
    draws, camera = (np.random.default_rng(each) for each in seeds)
    sensor_unit = draw_unit(DIGIT, unit_seed)
    motion = real_motion(recording, DIGIT.rate)
    contacts = real_contacts(recording.shape, recording.sensor, motion.sensor_pose, motion.object_pose)
    pad_angle, depth = _on_the_gel(recording, motion, contacts, sensor_unit, draws)
    sensor_pose = _sensor_pose(motion, contacts, pad_angle, depth, sensor_unit.radius)
    _check_reach(recording, motion, contacts, pad_angle, depth, sensor_pose, sensor_unit)
    slip = sliding(motion, contacts)
    shear = draws.uniform(*_FRICTION) * draws.uniform(*_STIFFNESS) * depth * np.tanh(slip / _CREEP)
    side = draw_side(camera)
    poses = se2.between(motion.object_pose, sensor_pose)
    with one_thread():
        pictures = tuple(
            encode_image(render(sensor_unit, recording.shape, *values, rng=camera, side=side))
            for values in zip(poses, depth, shear, strict=True)
        )
    return Recording(
        time=motion.time,
        sensor_pose=sensor_pose,
        shape=recording.shape,
        sensor=DIGIT,
        object_pose=np.where(motion.known[:, None], motion.object_pose, np.nan),
        contact=motion.contact,
        episode=episode_numbers(motion.contact),
        image=pictures,
        contact_derived=recording.contact_derived,
        source=_source(recording, motion, seed, unit_seed),
        frames=_frames(recording),
        extra={
            "real_sensor_pose": np.where(motion.added[:, None], np.nan, motion.sensor_pose),
            "slip": slip,
            "pad_angle": np.where(motion.contact, pad_angle, np.nan),
            "shown_angle": np.where(motion.contact, sensor_unit.shown_angle(pad_angle), np.nan),
            "indentation": depth,
            "tangential_force": shear,
        },
    )


def replay_folder(
    folder: Path,
    recordings: Mapping[str, Recording],
    seed: int = 0,
    unit: int | None = None,
    workers: int = 1,
    resume: bool = False,
    dask: str | None = None,
    progress: Callable[[int], None] | None = None,
    shard: Shard | None = None,
) -> Outcome:
    """Write the replays of recordings to a folder, by the names that files are to get, each whole or not at all.

    Options and errors are those of `folder.simulate_folder`; what cannot be replayed does not stop the rest.
    """
    for option, value in (("seed", seed), ("unit", unit or 0)):
        if value < 0:
            raise SettingError(f"{option} is {value}; allowed is 0 or more")

    def source(recording: Recording) -> str:
        drawn, *_ = _seeds(recording, seed, unit)
        return _source(recording, real_motion(recording, DIGIT.rate), seed, drawn)

    make = partial(replay_recording, seed=seed, unit=unit)
    return fill_folder(folder, recordings, source, make, workers, resume, dask, progress, shard)


def _on_the_gel(
    recording: Recording, motion: RealMotion, contacts: Contacts, unit: SensorUnit, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return where on the gel the contact is, from its apex (N,) [rad], and how deep (N,) [m]; 0 out of contact."""
    held = len(recording.sensor.tips) > 1
    time, depth = motion.time, np.zeros(len(motion.time))
    rolled = recording.sensor.radius / unit.radius * np.unwrap(contacts.angle)
    knots: list[tuple[float, float]] = []
    for first, end in _holds(motion):
        touching = first + np.flatnonzero(motion.contact[first:end])
        way = rolled[touching] - rolled[first]
        low, high = -_FAR - way.min(), _FAR - way.max()
        begin = rng.uniform(-_BEGIN, _BEGIN)
        begin = 0.5 * (low + high) if low > high else np.clip(begin, low, high)
        knots += [(time[first], begin - rolled[first]), (time[end - 1], begin - rolled[first])]
        level, rate, phase = rng.uniform((_DEPTH[0], _SLOW[0], 0.0), (_DEPTH[1], _SLOW[1], 2.0 * np.pi))
        depth[touching] = level * (1.0 + _SWAY * np.sin(2.0 * np.pi * rate * time[touching] + phase))
    for first, end in runs(motion.contact):
        frames = np.arange(first, end)
        depth[frames] *= np.minimum(np.minimum(frames - first + 1, end - frames) / _ONSET, 1.0)
    at, offset = np.array(knots).T
    return (contacts.angle if held else se2.wrap(rolled + np.interp(time, at, offset))), depth


def _holds(motion: RealMotion) -> list[tuple[int, int]]:
    """Contacts, first frame and the one after the last, those as one between which there is little time."""
    holds: list[tuple[int, int]] = []
    for first, end in runs(motion.contact):
        if holds and motion.time[first] - motion.time[holds[-1][1] - 1] < _AGAIN:
            first = holds.pop()[0]
        holds.append((first, end))
    return holds


def _sensor_pose(motion: RealMotion, contacts: Contacts, pad_angle: Array, depth: Array, radius: float) -> Array:
    """Return world_T_sensor (N, 3) of the gel that touches where the tip did."""
    away = radius - depth + contacts.gap
    center = contacts.point + away[:, None] * contacts.normal
    yaw = np.arctan2(-contacts.normal[:, 1], -contacts.normal[:, 0]) - pad_angle
    apex = se2.compose(np.column_stack((center, yaw)), np.array([radius, 0.0, 0.0]))
    return se2.compose(motion.object_pose, apex)


def _check_reach(
    recording: Recording,
    motion: RealMotion,
    contacts: Contacts,
    pad_angle: Array,
    depth: Array,
    sensor_pose: Array,
    unit: SensorUnit,
) -> None:
    """Raise SettingError where the contact is off the pad, or the gel touches the outline somewhere else."""
    name = recording.file or "the recording"
    edge = np.arcsin(unit.half_width / unit.radius)
    if len(off := np.flatnonzero(motion.contact & (np.abs(pad_angle) > edge))):
        worst = np.degrees(np.abs(pad_angle[off]).max())
        raise SettingError(
            f"{name}: frames {_span(off, motion)}: the contact would be {worst:.0f} degrees from the middle of the "
            f"gel, whose pad ends at {np.degrees(edge):.0f}"
        )
    center = np.array([-unit.radius, 0.0, 0.0])
    in_object = se2.between(motion.object_pose, se2.compose(sensor_pose, center))
    free = recording.shape.signed_distance(in_object[:, :2]) - (unit.radius - depth + contacts.gap)
    if len(off := np.flatnonzero(motion.contact & (free < -_HOLLOW))):
        raise SettingError(
            f"{name}: frames {_span(off, motion)}: the outline is hollow, and a gel of radius "
            f"{unit.radius * 1e3:.0f} mm does not reach where the tip touched"
        )


def _span(frames: NDArray[np.intp], motion: RealMotion) -> str:
    first, last = frames[0], frames[-1]
    return f"{first} to {last} of the replay ({motion.time[first]:.2f} to {motion.time[last]:.2f} s)"


def _source(recording: Recording, motion: RealMotion, seed: int, unit: int) -> str:
    """Return the words that say where a replay comes from, and from what it can be made again."""
    rest, bridged = int(motion.added.sum()), int((~motion.known).sum())
    notes = [
        f"motion of {recording.source or recording.file or 'a recording'}",
        f"touch rendered by palpate: seed {seed}, drawn images of unit {unit}",
    ]
    if rest:
        notes.append(f"{rest / DIGIT.rate:.1f} s of rest added before")
    if bridged:
        count = "1 frame" if bridged == 1 else f"{bridged} frames"
        notes.append(f"{count} bridged in which the object's pose is unknown")
    return "; ".join(notes)


def _frames(recording: Recording) -> dict[str, str]:
    return {
        "sensor_pose": "made: a DIGIT that touches the outline where the real sensor did, with its gap, and turns so "
        "that it slides no more than that did; the real one is in extra/real_sensor_pose: "
        + recording.frames.get("sensor_pose", "as recorded"),
        "object_pose": f"real: {recording.frames.get('object_pose', 'as recorded')}; NaN where bridged for rendering",
        "contact": f"real: {recording.frames.get('contact', 'as recorded')}",
        "image": "rendered; the depth of contact is drawn, friction follows the sliding",
        "extra": f"slip [m/s]: real, towards the sensor's +y, averaged over {SMOOTH} frames; pad_angle [rad]: of the "
        "rendered contact, shown_angle [rad]: as images show it; indentation [m] and tangential_force [N]: drawn",
    }


def _seeds(
    recording: Recording, seed: int, unit: int | None
) -> tuple[int, np.random.SeedSequence, np.random.SeedSequence]:
    """Seeds of the unit, the contacts and the camera: other ones for each file."""
    name = recording.file.name if recording.file else recording.source
    drawn, draws, camera = np.random.SeedSequence([seed, zlib.crc32(name.encode())]).spawn(3)
    return int(drawn.generate_state(1)[0]) if unit is None else unit, draws, camera
