"""Replays: the motion of a real push with rendered touch images, as a DIGIT in the place of the real tip sees it.

The object moves as recorded, and the contact moves along its outline as recorded. The DIGIT touches the outline at the
same point as the real tip of radius r, from the same side and with the same gap between robot and motion capture: its
centre of curvature lies on the line through that point and the tip's centre. Its gel has a larger radius R, and its yaw
is chosen so that the gel slides over the object as much as the tip did, with the same length of contact path on both:
if the contact's direction in the tip turns by an angle, it turns by r / R of it in the gel, and the sensor makes up for
the rest. A tip that sticks and rolls as the object turns becomes a gel that sticks and rolls; at constant yaw the gel
would slide by (R - r) times the angle instead, and a turn of 26 degrees would carry the contact off its pad. The price
is that the sensor follows the object: it turns by 1 - r / R of the angle, three quarters for the MIT's tip, and its
centre moves by (R - r) times the angle, also if a hand knocks the object. So the sensor's pose tells something of the
object's yaw, which the real tip's did not: comparisons between touch models on the same replay are fair, those with
the real recording are not.

A hand of several fingers becomes one gel at their middle that keeps the hand's yaw, with the contact of hand and edge.
A single round gel could not have held the object as two fingers did, so these replays test touch, not pushing.
"""

import zlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.lab.parallel import one_thread
from palpate.lab.simulate.episodes import episode_numbers
from palpate.lab.simulate.folder import Outcome, fill_folder
from palpate.lab.simulate.gel import draw_side, render
from palpate.lab.simulate.real_motion import SMOOTH, Contacts, RealMotion, real_contacts, real_motion, runs, sliding
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT

Array = NDArray[np.float64]


def replay_recording(recording: Recording, seed: int = 0, unit: int | None = None) -> Recording:
    """Return the replay of a real recording; the same seed, file name and unit give the same.

    Sensor unit, indentation and first position on the gel are drawn; `unit` is the seed of one unit for many replays.
    Poses get no noise, for the recorded ones have it. Raises SettingError, which names file and frames, for a motion
    that cannot be rendered: unknown object poses or contact, a gel that does not reach the contact, or a contact off
    its pad.
    """
    unit_seed, *seeds = _seeds(recording, seed, unit)
    draws, camera = (np.random.default_rng(each) for each in seeds)
    sensor_unit = draw_unit(DIGIT, unit_seed)
    motion = real_motion(recording, DIGIT.rate)
    contacts = real_contacts(recording.shape, recording.sensor, motion.sensor_pose, motion.object_pose)
    pad_angle, depth = _on_the_gel(recording, motion, contacts, sensor_unit, draws)
    sensor_pose = _sensor_pose(motion, contacts, pad_angle, depth, sensor_unit.radius)
    edge, worst = np.degrees(
        (np.arcsin(sensor_unit.half_width / sensor_unit.radius), np.abs(pad_angle[motion.contact]).max())
    )
    _refuse(
        recording,
        motion,
        np.degrees(np.abs(pad_angle)) > edge,
        f"the contact would be {worst:.0f} degrees from the middle of the gel, whose pad ends at {edge:.0f}",
    )
    center = se2.compose(se2.between(motion.object_pose, sensor_pose), np.array([-sensor_unit.radius, 0.0, 0.0]))
    free = recording.shape.signed_distance(center[:, :2]) - (sensor_unit.radius - depth + contacts.gap)
    _refuse(
        recording,
        motion,
        free < -1e-4,
        f"the outline is hollow, and a gel of radius {sensor_unit.radius * 1e3:.0f} mm does not reach the contact",
    )
    slip = sliding(motion, contacts)
    # Friction and stiffness as in simulated worlds; friction is nearly full at 5 mm/s.
    shear = draws.uniform(0.25, 0.6) * draws.uniform(2600.0, 6500.0) * depth * np.tanh(slip / 0.005)
    side = draw_side(camera)
    poses = se2.between(motion.object_pose, sensor_pose)
    with one_thread():
        images = tuple(
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
        image=images,
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
    folder: Path, recordings: Mapping[str, Recording], seed: int = 0, unit: int | None = None, **options: Any
) -> Outcome:
    """Write the replays of recordings to a folder, by file name; options are those of `folder.fill_folder`."""
    for option, value in (("seed", seed), ("unit", unit or 0)):
        if value < 0:
            raise SettingError(f"{option} is {value}; allowed is 0 or more")

    def source(recording: Recording) -> str:
        return _source(recording, real_motion(recording, DIGIT.rate), seed, _seeds(recording, seed, unit)[0])

    return fill_folder(folder, recordings, source, partial(replay_recording, seed=seed, unit=unit), **options)


def _on_the_gel(
    recording: Recording, motion: RealMotion, contacts: Contacts, unit: SensorUnit, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return the contact's angle from the gel's apex (N,) [rad] and its indentation (N,) [m]; 0 without contact.

    A contact begins up to 12 degrees off the apex and stays within 20 if it can. Its depth is that of simulated
    worlds and slowly varies by 10 %; the gel is pressed in over 4 frames, and released.
    """
    time, depth = motion.time, np.zeros(len(motion.time))
    rolled = recording.sensor.radius / unit.radius * np.unwrap(contacts.angle)
    begin_limit, limit = np.radians(12.0), np.radians(20.0)
    knots: list[tuple[float, float]] = []
    for first, end in _holds(motion):
        touching = first + np.flatnonzero(motion.contact[first:end])
        way = rolled[touching] - rolled[first]
        low, high = -limit - way.min(), limit - way.max()
        begin = rng.uniform(-begin_limit, begin_limit)
        begin = 0.5 * (low + high) if low > high else np.clip(begin, low, high)
        knots += [(time[first], begin - rolled[first]), (time[end - 1], begin - rolled[first])]
        level, rate, phase = rng.uniform((4e-4, 0.1, 0.0), (1e-3, 0.5, 2.0 * np.pi))  # [m], [Hz], [rad]
        depth[touching] = level * (1.0 + 0.1 * np.sin(2.0 * np.pi * rate * time[touching] + phase))
    for first, end in runs(motion.contact):
        frames = np.arange(first, end)
        depth[frames] *= np.minimum(np.minimum(frames - first + 1, end - frames) / 4, 1.0)
    if len(recording.sensor.tips) > 1:
        return contacts.angle, depth
    at, offset = np.array(knots).T
    return se2.wrap(rolled + np.interp(time, at, offset)), depth


def _holds(motion: RealMotion) -> list[tuple[int, int]]:
    """Return first frame and end of contacts; those less than 1 s apart, too short to turn the sensor, are joined."""
    holds: list[tuple[int, int]] = []
    for first, end in runs(motion.contact):
        if holds and motion.time[first] - motion.time[holds[-1][1] - 1] < 1.0:
            first = holds.pop()[0]
        holds.append((first, end))
    return holds


def _sensor_pose(motion: RealMotion, contacts: Contacts, pad_angle: Array, depth: Array, radius: float) -> Array:
    """Return world_T_sensor (N, 3) of the gel, with the contact of the tip."""
    away = radius - depth + contacts.gap
    center = contacts.point + away[:, None] * contacts.normal
    yaw = np.arctan2(-contacts.normal[:, 1], -contacts.normal[:, 0]) - pad_angle
    apex = se2.compose(np.column_stack((center, yaw)), np.array([radius, 0.0, 0.0]))
    return se2.compose(motion.object_pose, apex)


def _refuse(recording: Recording, motion: RealMotion, wrong: NDArray[np.bool_], why: str) -> None:
    """Raise SettingError if any frames in contact are wrong, and name them."""
    if len(frames := np.flatnonzero(motion.contact & wrong)):
        first, last = frames[0], frames[-1]
        span = f"{first} to {last} of the replay ({motion.time[first]:.2f} to {motion.time[last]:.2f} s)"
        raise SettingError(f"{recording.file or 'the recording'}: frames {span}: {why}")


def _source(recording: Recording, motion: RealMotion, seed: int, unit: int) -> str:
    """Return a description of the replay's origin, with all that is needed to make it again."""
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
    """Return descriptions of the replay's fields."""
    sensor, truth, contact = (recording.frames.get(n, "as recorded") for n in ("sensor_pose", "object_pose", "contact"))
    return {
        "sensor_pose": "made: a DIGIT with the contact and gap of the real sensor, turned so that it slides no more "
        f"than that did; the real one is in extra/real_sensor_pose: {sensor}",
        "object_pose": f"real: {truth}; NaN where bridged for rendering",
        "contact": f"real: {contact}",
        "image": "rendered; the indentation is drawn, friction follows the sliding",
        "extra": f"slip [m/s]: real, towards the sensor's +y, averaged over {SMOOTH} frames; pad_angle [rad]: of the "
        "rendered contact, shown_angle [rad]: as images show it; indentation [m] and tangential_force [N]: drawn",
    }


def _seeds(
    recording: Recording, seed: int, unit: int | None
) -> tuple[int, np.random.SeedSequence, np.random.SeedSequence]:
    """Return the seeds of the unit, the contacts and the camera, different for each file."""
    name = recording.file.name if recording.file else recording.source
    drawn, draws, camera = np.random.SeedSequence([seed, zlib.crc32(name.encode())]).spawn(3)
    return int(drawn.generate_state(1)[0]) if unit is None else unit, draws, camera
