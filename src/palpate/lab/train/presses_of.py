"""Presses at known angles from a recording: the outline and both poses say where the sensor was touched."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.geometry import se2
from palpate.geometry.shapes import Disc
from palpate.lab.train.samples import contact_frames, geometry_of, lacking
from palpate.touch.press_calibration import Presses
from palpate.types.recording import Recording

Array = NDArray[np.float64]
Indices = NDArray[np.int_]

_DEPTH = (0.7e-3, 0.5e-3)  # [m] to which a robot presses usually, mean and standard deviation
_UNEVEN = 4e-4  # [m] by which one press is deeper than another, standard deviation
_ELSEWHERE = 3.0  # times that, root of the mean square, from which a disc does not stay in one place
_VAGUE = math.radians(1.0)  # standard deviation of the angles from which a disc's place is not known


def presses_of(recording: Recording) -> Presses:
    """Return one press of each contact of a recording: its middle frame, at the angle that the outline says.

    That is a robot which presses its sensor on a fixed object, or any pushes with ground truth. Of a disc that stays
    where it is, a ball or a rod, no pose has to be known. Raises FileError where the recording has no images, contact
    flags or poses of an object that is no disc, where a disc was not in one place, and of a sensor with several tips.
    """
    name = recording.file or "the recording"
    is_placed = recording.object_pose is None and isinstance(recording.shape, Disc)
    if lacks := [each for each in lacking(recording) if not (is_placed and each == "object_pose")]:
        raise FileError(f"{name}: has no {' and no '.join(lacks)}; presses need them")
    if len(recording.sensor.tips) > 1:
        raise FileError(f"{name}: sensor {recording.sensor.name!r} has several tips; presses are of one")
    if is_placed:
        recording = _with_disc_placed(recording)
    assert recording.object_pose is not None and recording.contact is not None
    g = se2.between(recording.object_pose, recording.sensor_pose)
    middle = _middles(recording.contact & np.isfinite(g).all(axis=1))
    images = [recording[index].image for index in middle]
    direction, _, _ = geometry_of(recording, g[middle])
    return Presses(
        tuple(image for image in images if image is not None),
        direction,
        tuple(f"{name}: frame {index}" for index in middle),
    )


def _middles(touched: NDArray[np.bool_]) -> list[int]:
    """The middle frame of each contact, from flags (N,)."""
    contact, frame = contact_frames(touched)
    return [int(frame[contact == each][np.sum(contact == each) // 2]) for each in np.unique(contact)]


def _with_disc_placed(recording: Recording) -> Recording:
    """A recording of presses with the pose of its disc, which stays where it is.

    Where the sensor touches, the centre of its tip is away from the disc's by both radii less how deep it is pressed
    in. The depth is an unknown besides the place.
    """
    from scipy.optimize import least_squares

    sensor, disc, name = recording.sensor, recording.shape, recording.file or "the recording"
    assert isinstance(disc, Disc) and recording.contact is not None
    middle = _middles(recording.contact)
    if len(middle) < 3:
        raise FileError(f"{name}: has {len(middle)} contacts; three or more tell where a disc is")
    pressing = recording.sensor_pose[middle]
    tip = se2.transform(pressing, [-sensor.radius, 0.0])
    apart = sensor.radius + disc.radius

    def misfit(unknown: Array) -> Array:
        place, depth = unknown[:2], unknown[2]
        off = np.hypot(*(tip - place).T) + depth - apart
        return np.append(off / _UNEVEN, (depth - _DEPTH[0]) / _DEPTH[1])

    ahead = se2.transform(pressing, [disc.radius, 0.0]).mean(axis=0)
    found = least_squares(misfit, [*ahead, _DEPTH[0]])
    off = float(np.sqrt(np.mean(np.square(found.fun[:-1]))))
    if not off < _ELSEWHERE:
        raise FileError(
            f"{name}: the sensor was not in touch with a disc of {1e3 * disc.radius:.1f} mm radius in one place "
            f"({1e3 * off * _UNEVEN:.1f} mm off, allowed are {1e3 * _ELSEWHERE * _UNEVEN:.1f}); did it move?"
        )
    place, of_place = found.x[:2], np.linalg.inv(found.jac.T @ found.jac)[:2, :2]
    # An angle at the tip changes as the place moves across the line from tip to disc.
    across = (place - tip)[:, ::-1] * [-1.0, 1.0] / np.sum(np.square(place - tip), axis=1, keepdims=True)
    vague = math.sqrt(float(np.mean(np.sum(across @ of_place * across, axis=1))))
    if not vague < _VAGUE:
        raise FileError(
            f"{name}: angles of presses on a disc whose place is not known are good to {math.degrees(vague):.1f} "
            f"degrees, needed is {math.degrees(_VAGUE):.0f}; touch it from more sides, or state its pose"
        )
    pose = np.array([*place, 0.0])
    return replace(recording, object_pose=np.tile(pose, (len(recording.time), 1)))
