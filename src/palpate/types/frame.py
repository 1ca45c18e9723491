"""Frame: image and pose of a sensor at one instant."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.types.measurements import Measurement


@dataclass(frozen=True, eq=False)
class Frame:
    """One instant of a recording, the input of `Tracker.update`."""

    time: float
    """[s]"""
    sensor_pose: NDArray[np.float64]
    """world_T_sensor, (3,) [m, m, rad]"""
    image: NDArray[np.uint8] | None = None
    """touch image, (height, width, 3), RGB"""
    contact: bool | None = None
    """true while the sensor touches the object; None if unknown"""
    object_pose: NDArray[np.float64] | None = None
    """world_T_object, (3,) [m, m, rad]: ground truth, used for scoring and by oracle touch only"""
    measurements: tuple[Measurement, ...] = ()
    """measurements of this instant by other sources than touch, such as a camera's ObjectPose"""
