"""Replays: the motion of a real push with rendered touch images, as a DIGIT in the place of the real tip sees it.

Object and contact move as recorded, with the same gap between robot and motion capture. The gel slides over the object
as much as the tip did: as its radius R is larger than the tip's r, the contact turns in it by r / R of the angle in the
tip, and the sensor turns by the rest. So the sensor's pose tells something of the object's yaw, which the real tip's
did not: compare touch models on the same replay, not with the real recording. A hand of several fingers becomes one
gel at their middle that keeps the hand's yaw; such replays test touch alone. `hand_replay` has a gel for each finger.

An object pose that is unknown for a short time in contact is bridged: seen from the sensor, it moves evenly. In 95 % of
bridges the worst frame is at most 1.1 mm and 1.8 degrees off.
"""

import zlib
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array, Flags
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.io.recording import Recording
from palpate.pipeline.metrics import flag_runs
from palpate.types.images import encode_image
from palpate.types.sensor import DIGIT, SensorProfile
from palpate_lab.simulate.gel import draw_side, render
from palpate_lab.simulate.paths import minimum_jerk
from palpate_lab.simulate.recordings import check_not_negative
from palpate_lab.simulate.unit import SensorUnit, draw_unit


class Touched(NamedTuple):
    """The place of the outline that is nearest to a tip, or to the middle of several, at N poses."""

    point: Array
    """(N, 2) [m] in the object frame."""
    normal: Array
    """Outward normal there, (N, 2); 0 if it is not unique."""
    gap: Array
    """Distance from the surface of the nearest tip to the outline, (N,) [m]; negative is overlap."""
    angle: Array
    """Direction of the contact in the sensor frame, seen from the tip's centre of curvature, (N,) [rad]."""


@dataclass(frozen=True, eq=False)
class Replay:
    """One replay to make. Raises SettingError on a value that is not allowed.

    Sensor unit, indentation and first position on the gel are drawn from seed and file name: the same give the same.
    """

    recording: Recording
    """The real recording."""
    seed: int = 0
    unit: int | None = None
    """Seed of one sensor unit for many replays; None draws one."""

    def __post_init__(self) -> None:
        check_not_negative(seed=self.seed, unit=self.unit)

    @property
    def source(self) -> str:
        """Description of the replay's origin, with all that is needed to make it again."""
        real = self.recording.source or self.recording.file or "a recording"
        unit = self.seeds()[0]
        return f"motion of {real}; touch rendered by palpate: seed {self.seed}, drawn images of unit {unit}"

    def run(self) -> Recording:
        """Return the replay. Poses get no noise, for the recorded ones have it.

        Raises SettingError, which names file and frames, for a motion that cannot be rendered: unknown object poses or
        contact, a gel that does not reach the contact, or a contact off its pad.
        """
        recording = self.recording
        unit_seed, *seeds = self.seeds()
        draws, camera = (np.random.default_rng(each) for each in seeds)
        gel = draw_unit(DIGIT, unit_seed)
        motion, known = real_motion(recording)
        assert motion.object_pose is not None and motion.contact is not None
        touched = touched_places(motion.shape, motion.sensor, se2.between(motion.object_pose, motion.sensor_pose))
        pad_angle, depth = _on_the_gel(motion, touched.angle, gel, draws)
        # From the gel's centre, which is behind the contact, to the sensor's origin at its apex.
        behind = gel.radius - depth + touched.gap
        center = touched.point + behind[:, None] * touched.normal
        yaw = np.arctan2(-touched.normal[:, 1], -touched.normal[:, 0]) - pad_angle
        poses = se2.compose(np.column_stack((center, yaw)), np.array([gel.radius, 0.0, 0.0]))
        clearance = recording.shape.signed_distance(center) - behind
        check_contacts(recording, motion, gel, pad_angle, clearance)
        slip = sliding(motion, touched)
        shear = tangential_force(depth, slip, draws)
        side = draw_side(camera)
        images = tuple(
            encode_image(render(gel, recording.shape, *values, rng=camera, side=side))
            for values in zip(poses, depth, shear, strict=True)
        )
        return replace(
            motion,
            sensor_pose=se2.compose(motion.object_pose, poses),
            sensor=replace(DIGIT, rate=motion.sensor.rate),
            object_pose=np.where(known[:, None], motion.object_pose, np.nan),
            image=images,
            source=self.source,
            extra={
                "slip": slip,
                "pad_angle": np.where(motion.contact, pad_angle, np.nan),
                "shown_angle": np.where(motion.contact, gel.shown_angle(pad_angle), np.nan),
                "indentation": depth,
                "tangential_force": shear,
            },
        )

    def seeds(self) -> tuple[int, np.random.SeedSequence, np.random.SeedSequence]:
        """Return the seeds of the unit, the contacts and the camera, different for each file."""
        name = self.recording.file.name if self.recording.file else self.recording.source
        drawn, draws, camera = np.random.SeedSequence([self.seed, zlib.crc32(name.encode())]).spawn(3)
        return int(drawn.generate_state(1)[0]) if self.unit is None else self.unit, draws, camera


def check_contacts(real: Recording, motion: Recording, gel: SensorUnit, pad_angle: Array, clearance: Array) -> None:
    """Raise SettingError for frames whose contact is off the pad, or out of the gel's reach; it names the real file.

    clearance (N,) [m] is the distance of the gel's surface from the outline, below 0 where another part of the outline
    is in the way.
    """
    assert motion.contact is not None
    edge = np.degrees(np.arcsin(gel.half_width / gel.radius))
    angle = np.degrees(np.abs(pad_angle))
    worst = angle[motion.contact].max()
    off_pad = f"the contact would be {worst:.0f} degrees from the middle of the gel, whose pad ends at {edge:.0f}"
    out_of_reach = f"the outline is hollow, and a gel of radius {gel.radius * 1e3:.0f} mm does not reach the contact"
    refuse_frames(real, motion, angle > edge, off_pad)
    refuse_frames(real, motion, clearance < -1e-4, out_of_reach)


def refuse_frames(real: Recording, motion: Recording, is_wrong: Flags, reason: str) -> None:
    """Raise SettingError for frames (N,) that are wrong in contact, with the reason; it names the real file."""
    assert motion.contact is not None
    frames = np.flatnonzero(motion.contact & is_wrong)
    if len(frames):
        first, last = frames[[0, -1]]
        span = f"{motion.time[first]:.2f} to {motion.time[last]:.2f} s"
        name = real.file or "the recording"
        raise SettingError(f"{name}: frames {first} to {last} of the replay ({span}): {reason}")


def real_motion(recording: Recording) -> tuple[Recording, Flags]:
    """Return the motion of a recording, and the frames (N,) with a recorded object pose.

    Object poses are bridged where they are unknown; frames without one at either end are left out. A motion that begins
    in contact is preceded by an approach. Raises SettingError, which names the file and the frames, if contact or
    object poses are missing, or missing for too long.
    """
    name = recording.file or "the recording"
    if recording.object_pose is None or np.isnan(recording.object_pose).all():
        raise SettingError(f"{name}: has no object poses, from which a replay takes its motion")
    if recording.contact is None or not recording.contact.any():
        raise SettingError(f"{name}: has no contact flags, or none that is set; a replay takes its contacts from them")
    pose = _bridged(recording)
    there = np.flatnonzero(~np.isnan(pose[:, 0]))
    span = slice(there[0], there[-1] + 1)
    time = recording.time[span]
    sensor_pose = recording.sensor_pose[span]
    object_pose = pose[span]
    known = ~np.isnan(recording.object_pose[span, 0])
    contact = recording.contact[span]
    if not contact.any():
        raise SettingError(f"{name}: the object's pose is unknown in all of its contacts")
    rest = 0.6  # [s], a little more than the detector of contact needs to see the gel
    if contact[time - time[0] < rest].any():
        rate = recording.sensor.rate
        count = int(np.ceil(rest * rate - 1e-9))
        approach = _approach(recording.shape, recording.sensor, sensor_pose[0], object_pose[0], count)
        time = np.concatenate((time[0] + np.arange(-count, 0) / rate, time))
        sensor_pose = np.concatenate((approach, sensor_pose))
        object_pose = np.concatenate((np.repeat(object_pose[:1], count, axis=0), object_pose))
        known = np.concatenate((np.repeat(known[:1], count), known))
        contact = np.concatenate((np.zeros(count, np.bool_), contact))
    return Recording(time - time[0], sensor_pose, recording.shape, recording.sensor, object_pose, contact), known


def _approach(shape: Shape, sensor: SensorProfile, sensor_pose: Array, object_pose: Array, frames: int) -> Array:
    """Return a straight path (frames, 3) of the sensor from 1 cm off the object to its pose at the first contact."""
    distance = 0.01 * (1.0 - np.append(0.0, minimum_jerk(frames)[:-1]))
    normal = touched_places(shape, sensor, se2.between(object_pose[None], sensor_pose[None])).normal
    away = se2.transform(np.append([0.0, 0.0], object_pose[2]), normal)
    return sensor_pose + np.column_stack((distance[:, None] * away, np.zeros(frames)))


def touched_places(shape: Shape, sensor: SensorProfile, object_T_sensor: Array) -> Touched:
    """Return the nearest place of an outline for a sensor at poses (N, 3)."""
    centers = se2.transform(object_T_sensor[:, None], sensor.centers)
    middle = centers.mean(axis=1)
    step = 1e-6  # [m]
    steps = step * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    right, left, up, down = shape.signed_distance(middle[:, None] + steps).T
    normal = np.column_stack((right - left, up - down))
    length = np.hypot(normal[:, 0], normal[:, 1])[:, None]
    normal /= np.maximum(length, step * 1e-3)  # 0 in the middle of a slot, where two places are as near
    point = middle - shape.signed_distance(middle)[:, None] * normal
    gap = shape.signed_distance(centers).min(axis=1) - sensor.radius
    angle = se2.wrap(np.arctan2(-normal[:, 1], -normal[:, 0]) - object_T_sensor[:, 2])
    return Touched(point, normal, gap, angle)


def sliding(motion: Recording, touched: Touched) -> Array:
    """Return the sliding speed of the object over the real tip, (N,) [m/s], positive towards the sensor's +y.

    It is the motion over the object of the tip's point that touches now; 0 without contact.
    """
    from scipy.ndimage import uniform_filter1d

    assert motion.object_pose is not None and motion.contact is not None
    object_T_sensor = se2.between(motion.object_pose, motion.sensor_pose)
    step = se2.compose(object_T_sensor[:-1], se2.inverse(object_T_sensor[1:]))
    point = touched.point[1:]
    normal = touched.normal[1:]
    along = np.column_stack((normal[:, 1], -normal[:, 0]))
    speed = np.append(0.0, ((se2.transform(step, point) - point) * along).sum(axis=1) / np.diff(motion.time))
    slip = np.zeros(len(speed))
    for first, last in flag_runs(motion.contact):
        within = speed[first + 1 : last + 1]
        if len(within):
            slip[first + 1 : last + 1] = uniform_filter1d(within, 7, mode="nearest")  # motion capture is noisy
            slip[first] = slip[first + 1]
    return slip


def tangential_force(depth: Array, slip: Array, rng: np.random.Generator) -> Array:
    """Draw friction and stiffness as those of simulated worlds, and return the object's force on the gel (N,) [N].

    Friction is nearly full at a slip of 5 mm/s.
    """
    return rng.uniform(0.25, 0.6) * rng.uniform(2600.0, 6500.0) * depth * np.tanh(slip / 0.005)


def _bridged(recording: Recording) -> Array:
    """Return object poses (N, 3), unknown ones bridged; NaN at either end if they cannot be."""
    assert recording.object_pose is not None and recording.contact is not None
    time = recording.time
    pose = recording.object_pose.copy()
    count = len(recording)
    longest = 1.6 if len(recording.sensor.tips) > 1 else 0.12  # [s] from known pose to known pose
    for first, last in flag_runs(~recording.contact):
        # An untouched object rests, from its pose after the last contact to that before the next.
        stretch = np.arange(max(first - 1, 0), min(last + 2, count))
        known = stretch[~np.isnan(pose[stretch, 0])]
        if len(known):
            pose[stretch] = pose[known[np.abs(stretch[:, None] - known).argmin(axis=1)]]
    for first, last in flag_runs(np.isnan(pose[:, 0])):
        if first == 0 or last == count - 1:
            continue
        end = last + 1
        before = first - 1
        seconds = time[end] - time[before]
        if seconds > longest:
            raise SettingError(
                f"{recording.file or 'the recording'}: frames {first} to {end - 1}, in contact, have no known object "
                f"pose: {seconds:.2f} s from known to known, and up to {longest:g} s can be bridged"
            )
        ends = se2.between(recording.sensor_pose[[before, end]], pose[[before, end]])
        between = se2.interpolated(time[first:end], time[[before, end]], ends)
        pose[first:end] = se2.compose(recording.sensor_pose[first:end], between)
    return pose


def _on_the_gel(motion: Recording, angle: Array, unit: SensorUnit, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the contact's angle from the gel's apex (N,) [rad] and its indentation (N,) [m]; 0 without contact.

    A contact begins up to 12 degrees off the apex and stays within 20 if it can. Its depth is that of simulated
    worlds and slowly varies by 10 %; the gel is pressed in over 4 frames, and released.
    """
    assert motion.contact is not None
    tip = motion.sensor
    time = motion.time
    contact = motion.contact
    depth = np.zeros(len(motion))
    holds: list[tuple[int, int]] = []
    for first, last in flag_runs(contact):
        if holds and time[first] - time[holds[-1][1]] < 1.0:  # too short a pause to turn the sensor in
            first = holds.pop()[0]
        holds.append((first, last))
    rolled = tip.radius / unit.radius * np.unwrap(angle)
    begin_limit = np.radians(12.0)
    limit = np.radians(20.0)
    knots: list[tuple[float, float]] = []
    for first, last in holds:
        touching = first + np.flatnonzero(contact[first : last + 1])
        way = rolled[touching] - rolled[first]
        low = -limit - way.min()
        high = limit - way.max()
        begin = rng.uniform(-begin_limit, begin_limit)
        begin = 0.5 * (low + high) if low > high else np.clip(begin, low, high)
        knots += [(time[first], begin - rolled[first]), (time[last], begin - rolled[first])]
        level, rate, phase = rng.uniform((4e-4, 0.1, 0.0), (1e-3, 0.5, 2.0 * np.pi))  # [m], [Hz], [rad]
        depth[touching] = level * (1.0 + 0.1 * np.sin(2.0 * np.pi * rate * time[touching] + phase))
    for first, last in flag_runs(contact):
        frames = np.arange(first, last + 1)
        depth[frames] *= np.minimum(np.minimum(frames - first + 1, last + 1 - frames) / 4, 1.0)
    if len(tip.tips) > 1:
        return angle, depth
    at, offset = np.array(knots).T
    return se2.wrap(rolled + np.interp(time, at, offset)), depth
