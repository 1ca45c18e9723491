"""Replays: the motion of a real push with rendered touch images, as a DIGIT in the place of the real tip sees it.

Object and contact move as recorded, with the same gap between robot and motion capture. The gel slides over the object
as much as the tip did: as its radius R is larger than the tip's r, the contact turns in it by r / R of the angle in the
tip, and the sensor turns by the rest. So the sensor's pose tells something of the object's yaw, which the real tip's
did not: compare touch models on the same replay, not with the real recording. A hand of several fingers becomes one
gel at their middle that keeps the hand's yaw; such replays test touch alone.
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
from palpate.lab.simulate.gel import draw_side, render
from palpate.lab.simulate.real_motion import Contacts, RealMotion, real_contacts, real_motion, runs, sliding
from palpate.lab.simulate.recordings import Outcome, check_not_negative, episode_numbers, fill_folder
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT, SensorProfile

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
    gel = draw_unit(DIGIT, unit_seed)
    motion = real_motion(recording, DIGIT.rate)
    contacts = real_contacts(recording.shape, recording.sensor, motion.sensor_pose, motion.object_pose)
    pad_angle, depth = _on_the_gel(recording.sensor, motion, contacts, gel, draws)
    # From the gel's centre, which is behind the contact, to the sensor's origin at its apex.
    center = contacts.point + (gel.radius - depth + contacts.gap)[:, None] * contacts.normal
    yaw = np.arctan2(-contacts.normal[:, 1], -contacts.normal[:, 0]) - pad_angle
    apex = se2.compose(np.column_stack((center, yaw)), np.array([gel.radius, 0.0, 0.0]))
    sensor_pose = se2.compose(motion.object_pose, apex)
    edge, worst = np.degrees((np.arcsin(gel.half_width / gel.radius), np.abs(pad_angle[motion.contact]).max()))
    free = recording.shape.signed_distance(center) - (gel.radius - depth + contacts.gap)
    for wrong, why in (
        (
            np.degrees(np.abs(pad_angle)) > edge,
            f"the contact would be {worst:.0f} degrees from the middle of the gel, whose pad ends at {edge:.0f}",
        ),
        (
            free < -1e-4,
            f"the outline is hollow, and a gel of radius {gel.radius * 1e3:.0f} mm does not reach the contact",
        ),
    ):
        if len(frames := np.flatnonzero(motion.contact & wrong)):
            span = f"{motion.time[frames[0]]:.2f} to {motion.time[frames[-1]]:.2f} s"
            name = recording.file or "the recording"
            raise SettingError(f"{name}: frames {frames[0]} to {frames[-1]} of the replay ({span}): {why}")
    slip = sliding(motion, contacts)
    # Friction and stiffness as in simulated worlds; friction is nearly full at 5 mm/s.
    shear = draws.uniform(0.25, 0.6) * draws.uniform(2600.0, 6500.0) * depth * np.tanh(slip / 0.005)
    side = draw_side(camera)
    poses = se2.between(motion.object_pose, sensor_pose)
    with one_thread():
        images = tuple(
            encode_image(render(gel, recording.shape, *values, rng=camera, side=side))
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
        source=_source(recording, seed, unit_seed),
        frames=dict(recording.frames)
        | {
            "sensor_pose": "made: a DIGIT with the contact and gap of the real sensor, sliding no more than that did",
            "image": "rendered; the indentation is drawn, friction follows the sliding",
            "extra": "slip [m/s]: real, towards the sensor's +y; pad_angle [rad]: of the rendered contact, shown_angle "
            "[rad]: as images show it; indentation [m] and tangential_force [N]: drawn",
        },
        extra={
            "slip": slip,
            "pad_angle": np.where(motion.contact, pad_angle, np.nan),
            "shown_angle": np.where(motion.contact, gel.shown_angle(pad_angle), np.nan),
            "indentation": depth,
            "tangential_force": shear,
        },
    )


def replay_folder(
    folder: Path, recordings: Mapping[str, Recording], seed: int = 0, unit: int | None = None, **options: Any
) -> Outcome:
    """Write the replays of recordings to a folder, by file name; options are those of `fill_folder`."""
    check_not_negative(seed=seed, unit=unit)

    def source(recording: Recording) -> str:
        return _source(recording, seed, _seeds(recording, seed, unit)[0])

    return fill_folder(folder, recordings, source, partial(replay_recording, seed=seed, unit=unit), **options)


def _on_the_gel(
    tip: SensorProfile, motion: RealMotion, contacts: Contacts, unit: SensorUnit, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return the contact's angle from the gel's apex (N,) [rad] and its indentation (N,) [m]; 0 without contact.

    A contact begins up to 12 degrees off the apex and stays within 20 if it can. Its depth is that of simulated
    worlds and slowly varies by 10 %; the gel is pressed in over 4 frames, and released.
    """
    time, contact, depth = motion.time, motion.contact, np.zeros(len(motion.time))
    holds: list[tuple[int, int]] = []
    for first, end in runs(contact):
        if holds and time[first] - time[holds[-1][1] - 1] < 1.0:  # too short a pause to turn the sensor in
            first = holds.pop()[0]
        holds.append((first, end))
    rolled = tip.radius / unit.radius * np.unwrap(contacts.angle)
    begin_limit, limit = np.radians(12.0), np.radians(20.0)
    knots: list[tuple[float, float]] = []
    for first, end in holds:
        touching = first + np.flatnonzero(contact[first:end])
        way = rolled[touching] - rolled[first]
        low, high = -limit - way.min(), limit - way.max()
        begin = rng.uniform(-begin_limit, begin_limit)
        begin = 0.5 * (low + high) if low > high else np.clip(begin, low, high)
        knots += [(time[first], begin - rolled[first]), (time[end - 1], begin - rolled[first])]
        level, rate, phase = rng.uniform((4e-4, 0.1, 0.0), (1e-3, 0.5, 2.0 * np.pi))  # [m], [Hz], [rad]
        depth[touching] = level * (1.0 + 0.1 * np.sin(2.0 * np.pi * rate * time[touching] + phase))
    for first, end in runs(contact):
        frames = np.arange(first, end)
        depth[frames] *= np.minimum(np.minimum(frames - first + 1, end - frames) / 4, 1.0)
    if len(tip.tips) > 1:
        return contacts.angle, depth
    at, offset = np.array(knots).T
    return se2.wrap(rolled + np.interp(time, at, offset)), depth


def _source(recording: Recording, seed: int, unit: int) -> str:
    """Return a description of the replay's origin, with all that is needed to make it again."""
    real = recording.source or recording.file or "a recording"
    return f"motion of {real}; touch rendered by palpate: seed {seed}, drawn images of unit {unit}"


def _seeds(
    recording: Recording, seed: int, unit: int | None
) -> tuple[int, np.random.SeedSequence, np.random.SeedSequence]:
    """Return the seeds of the unit, the contacts and the camera, different for each file."""
    name = recording.file.name if recording.file else recording.source
    drawn, draws, camera = np.random.SeedSequence([seed, zlib.crc32(name.encode())]).spawn(3)
    return int(drawn.generate_state(1)[0]) if unit is None else unit, draws, camera
