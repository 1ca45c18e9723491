"""The points that a view draws, in world coordinates [m]."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.geometry import se2
from palpate.geometry.distance_field import DistanceField
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]


def contact_points(
    sensor_pose: ArrayLike, object_pose: ArrayLike, sensor: SensorProfile, field: DistanceField
) -> Array:
    """Return the points of the outline (N, 2) that are nearest to the sensor, to its nearest part if there are several.

    From world_T_sensor and world_T_object (N, 3) and the distance to the outline.
    """
    object_pose = np.asarray(object_pose, dtype=np.float64)
    centers = se2.transform(se2.between(object_pose, sensor_pose)[:, None], sensor.round_centers)
    distance, gradient, _ = field.value_gradient_hessian(centers)
    steepness = np.maximum((gradient**2).sum(axis=-1), 1e-6)
    nearest = centers - (distance / steepness)[..., None] * gradient
    tip = distance.argmin(axis=1)
    return se2.transform(object_pose, nearest[np.arange(len(tip)), tip])
