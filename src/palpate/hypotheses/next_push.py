"""Choice of the next push: the place of an outline at which a contact says most of pose and outline."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array
from palpate.errors import EstimationError
from palpate.geometry import se2
from palpate.types.estimate import Estimate


@dataclass(frozen=True)
class _Touch:
    """A contact as it is expected."""

    contact: float = 1e-3
    """[m] Standard deviation of a contact's distance, that of `NoiseSettings.contact`."""
    patch: float = 0.01
    """[m] Length of the outline that a contact touches, with what it tells of its neighbours."""


_TOUCH = _Touch()


@dataclass(frozen=True, eq=False)
class NextPush:
    """A place to push next."""

    point: Array
    """Place on the outline (2,) [m], world frame."""
    direction: Array
    """Direction of the push there, into the object across its outline, a unit vector (2,) in the world frame."""
    information: float
    """Information that a contact there is expected to give [nats]."""


def next_push(estimate: Estimate) -> NextPush:
    """Return the place where a contact is expected to say most: half the log of predicted over measured variance.

    The distance of a tip from the outline is predicted by pose and outline together, a contact measures it to 1 mm.
    What is in the way, and how to get there, is left to the robot. Raises EstimationError for a known outline.
    """
    outline = estimate.outline
    if outline is None:
        raise EstimationError("next_push needs an estimate with an outline: one of palpate.Unknown or palpate.Sketch")
    points = outline.points
    along = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    length = 0.5 * np.hypot(along[:, 0], along[:, 1])
    normal = np.column_stack((along[:, 1], -along[:, 0])) / (2.0 * length[:, None])
    # A motion of the object in its body frame moves a point of its outline, along the normal by these shares.
    by_pose = np.column_stack((normal, points[:, 0] * normal[:, 1] - points[:, 1] * normal[:, 0]))
    variance = np.einsum("ni,ij,nj->n", by_pose, estimate.covariance, by_pose) + np.square(outline.deviation)
    count = max(round(_TOUCH.patch / max(float(length.mean()), 1e-6)), 1) | 1
    around = np.arange(count) - count // 2
    nearby = variance[(np.arange(len(points))[:, None] + around) % len(points)].mean(axis=1)
    best = int(np.argmax(nearby))
    information = 0.5 * float(np.log1p(nearby[best] / _TOUCH.contact**2))
    direction = -se2.rotation(estimate.pose[2]) @ normal[best]
    return NextPush(se2.transform(estimate.pose, points[best]), direction, information)
