"""Presses at known angles from a recording: the outline and both poses say where the sensor was touched."""

import numpy as np

from palpate.errors import FileError
from palpate.geometry import se2
from palpate.recording.recording import Recording
from palpate.touch.presses import Presses
from palpate.training.samples import contact_frames, geometry_of, lacking


def presses_of(recording: Recording) -> Presses:
    """Return one press of each contact of a recording: its middle frame, at the angle that the outline says.

    That is a robot which presses its sensor on a fixed object, or any pushes with ground truth. Raises FileError where
    the recording has no images, poses of the object or contact flags, or the sensor several tips.
    """
    name = recording.file or "the recording"
    if lacks := lacking(recording):
        raise FileError(f"{name}: has no {' and no '.join(lacks)}; presses need them")
    if len(recording.sensor.tips) > 1:
        raise FileError(f"{name}: sensor {recording.sensor.name!r} has several tips; presses are of one")
    assert recording.object_pose is not None and recording.contact is not None
    g = se2.between(recording.object_pose, recording.sensor_pose)
    contact, frame = contact_frames(recording.contact & np.isfinite(g).all(axis=1))
    middle = [int(frame[contact == each][np.sum(contact == each) // 2]) for each in np.unique(contact)]
    images = [recording[index].image for index in middle]
    direction, _, _ = geometry_of(recording, g[middle])
    return Presses(
        tuple(image for image in images if image is not None),
        direction,
        tuple(f"{name}: frame {index}" for index in middle),
    )
