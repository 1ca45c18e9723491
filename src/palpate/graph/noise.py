"""How much each factor is believed: standard deviations, the published ones and ours."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.graph.factors import ContactModel

Array = NDArray[np.float64]


_WITH_MEAN = ("friction_ratio", "depth")
_OFF = ("sticking_kernel", "turning_kernel", "contact_kernel", "feeling_kernel", "cone_share")  # None is allowed


@dataclass(frozen=True)
class GraphNoise:
    """Standard deviations of the factors. The defaults are palpate's: those of what touches and slides are learnt by
    `palpate tune` from simulated recordings, the others have their reasons.
    """

    tactile: tuple[float, float, float] = (1.0, 1.0, 8e-2)
    """Relative pose from touch where touch does not say itself [m, m, rad], for one pair of images. Only yaw counts. An
    image takes part in 30 pairs a step and some hundred in all, which are no independent measurements."""
    constant: tuple[float, float, float] = (1.0, 1.0, 5.0)
    """The same for the constant model: the sensor turns by about 0.1 rad in 10 to 40 frames, and the thirty pairs of a
    step are wrong all the same way."""
    sticking: float = 2e-5
    """Sliding in one step when nothing moves [m]."""
    sticking_share: float = 0.06
    """Sliding in one step as a share of the sensor's motion in it, where the pushing force is inside the friction cone.
    In simulation it is 0.3 % in the median there, and a contact in hundreds creeps by more."""
    sliding_share: float = 2.0
    """The same where the force is at the cone's edge: slides go on for long and one way, so that nothing much smaller
    than the motion itself leaves them free."""
    cone_margin: float = 0.04
    """How far inside the cone's edge the force must be to hold the contact [rad]."""
    cone_width: float = 0.03
    """Angle over which holding goes over into sliding [rad]."""
    cone_share: float | None = 0.13
    """How far the object's motion is outside the friction cone in one step, as a share of the sensor's; None leaves
    the cone out."""
    sticking_kernel: float | None = 2.0
    """Scale of the Cauchy kernel on the two sticking rows together [standard deviations]; None is a plain square."""
    turning: float = 2e-7
    """Imbalance of force and torque in one step when nothing moves [m^2]."""
    turning_share: float = 0.013
    """The same as a share of the sensor's motion times c. With the right c and centre of friction, the ellipsoid fits
    simulated feet to 1 %."""
    turning_kernel: float | None = 2.0
    """Scale of the Cauchy kernel on the balance and on the cone [standard deviations]; None is a plain square. A knock
    breaks both."""
    friction_ratio: tuple[float, float] = (0.2, 0.66)
    """Logarithm of the ratio of c^2 to that of the chosen pressure, mean and standard deviation: from uniform to rim
    pressure it grows by 0.8."""
    friction_center: float = 0.06
    """Distance of the centre of friction from the centroid along x and along y, as a share of c."""
    grip: tuple[float, float] = (0.4, 0.1)
    """Coulomb friction between sensor and object, mean and standard deviation."""
    depth: tuple[float, float] = (3e-4, 4e-4)
    """How deep the object lies in the gel, mean and standard deviation [m], and what else outline, gel and motion
    capture are apart by all the time."""
    direction_bias: float = 1e-2
    """Error that all directions of one sensor and object have in common [rad]."""
    direction_share: float = 2.0
    """Variance of a direction beside that, as a share of what touch says."""
    turn_share: float = 88.0
    """Variance of a turn as a share of what touch says: on round objects a turn is too small or too large by some
    percent all the way, and its errors add up."""
    contact: float = 1e-3
    """Distance between sensor and outline in contact [m]: how well outline, gel and motion capture agree."""
    contact_kernel: float | None = 3.0
    """Scale of the Cauchy kernel on the contact row [standard deviations]; None is a plain square."""
    feeling_kernel: float | None = 3.0
    """Scale of the Cauchy kernels on contact direction and turn, each by itself [standard deviations]; None is a plain
    square. What an image says is now and then wrong by far more than its variance, and one bad image must not bend the
    path."""
    sensor: tuple[float, float, float] = (1e-4, 1e-4, 1e-3)
    """Measured sensor pose [m, m, rad], body frame: a good robot's kinematics or motion capture."""
    first_pose: tuple[float, float, float] = (5e-4, 5e-4, 5e-3)
    """The object's known first pose [m, m, rad], body frame."""
    rest: tuple[float, float, float] = (1e-5, 1e-5, 1e-4)
    """The object's motion between two contacts [m, m, rad]."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None and field.name in _OFF:
                continue
            numbers = np.asarray(value, dtype=np.float64)  # None is not a number
            if field.name in _WITH_MEAN:
                usable, allowed = numbers[1] > 0.0, "a mean and a standard deviation above 0"
            elif field.name.endswith("share"):
                usable, allowed = (numbers >= 0.0).all(), "at least 0"
            else:
                usable, allowed = (numbers > 0.0).all(), "above 0"
            if not (usable and np.isfinite(numbers).all()):
                raise SettingError(f"noise {field.name} is {value!r}; it must be finite and {allowed}")

    @property
    def lasting(self) -> tuple[Array, Array]:
        """Mean and standard deviation (LASTING,) of what lasts from contact to contact, before the first one."""
        center = (0.0, self.friction_center)
        columns = [(0.0, self.direction_bias), self.depth, self.friction_ratio, center, center, self.grip]
        mean, deviation = np.array(columns).T
        return mean, deviation

    def pushing_weight(self, residual: Array, moved: Array, tip: ContactModel, angle: Array, grip: float) -> Array:
        """Inverse variances (N, 4) of the pushing rows, kernels included.

        It takes the residual (N, 4), how far the sensor moved (N,) [m], the angle (N,) of the pushing force from the
        outline's normal [rad] and the friction of the contact, the tangent of the friction cone's half angle.
        """
        edge = np.arctan(grip)
        slides, outside = (_step((np.abs(angle) - at) / self.cone_width) for at in (edge - self.cone_margin, edge))
        if not tip.alone:
            slides = outside = np.zeros_like(moved)
        holding, free = (np.hypot(self.sticking, share * moved) for share in (self.sticking_share, self.sliding_share))
        weight = np.zeros((len(moved), 4))
        weight[:, :2] = ((free / holding) ** slides * holding)[:, None] ** -2.0
        if tip.alone:
            weight[:, 2] = np.hypot(self.turning, self.turning_share * moved * tip.friction_radius) ** -2.0
            if self.cone_share is not None:
                weight[:, 3] = outside * np.hypot(self.sticking, self.cone_share * moved) ** -2.0
        square = weight * residual**2
        weight[:, :2] *= cauchy_weight(square[:, :2].sum(axis=1, keepdims=True), self.sticking_kernel)
        weight[:, 2:] *= cauchy_weight(square[:, 2:], self.turning_kernel)
        return weight

    def contact_weight(self, residual: Array) -> Array:
        """Inverse variance (...) of the contact row, kernel included, at the residual (...) [m]."""
        return cauchy_weight((residual / self.contact) ** 2, self.contact_kernel) / self.contact**2

    def feeling_weight(self, residual: Array, information: Array | float) -> Array:
        """Inverse variance (...) of a contact direction or turn, kernel included, at the residual (...) [rad].

        information (...) is the inverse variance that touch says [1/rad^2]; 0 where it says nothing.
        """
        return information * cauchy_weight(information * residual**2, self.feeling_kernel)


def _step(values: Array) -> Array:
    """From 0 to 1 around values of 0."""
    return 0.5 + 0.5 * np.tanh(values)


def cauchy_weight(squared_error: Array, scale: float | None) -> Array:
    """Weight (...) that the Cauchy kernel leaves to whitened rows of squared length squared_error (...)."""
    if scale is None:
        return np.ones_like(squared_error)
    return 1.0 / (1.0 + squared_error / scale**2)


STICKING = GraphNoise(
    tactile=(1.0, 1.0, 2e-2),
    sticking_share=0.05,
    sliding_share=0.05,
    cone_share=None,
    sticking_kernel=2.0,
    turning=1e-6,
    turning_share=0.5,
    friction_ratio=(0.0, 1e-6),
    friction_center=1e-6,
    direction_share=0.8,
    turn_share=20.0,
)
"""A contact that sticks, c and the centre of friction taken as known and the balance hardly believed: better where the
object is knocked and touch tells yaw alone, far too sure of itself where the contact slides."""

PUBLISHED = GraphNoise(
    tactile=(1.0, 1.0, 1e-5),
    constant=(1.0, 1.0, 1e-5),
    sticking=1e-3,
    sticking_share=0.0,
    sliding_share=0.0,
    cone_share=None,
    sticking_kernel=None,
    turning=1e-3,
    turning_share=0.0,
    turning_kernel=None,
    friction_ratio=(0.0, 1e-9),
    friction_center=1e-9,
    depth=(0.0, 1e-9),
    direction_bias=1e-9,
    direction_share=1.0,
    turn_share=1.0,
    contact=1e-2,
    contact_kernel=None,
    feeling_kernel=None,
    sensor=(1e-5, 1e-5, 1e-5),
    first_pose=(1e-5, 1e-5, 1e-5),
    rest=(1e-9, 1e-9, 1e-9),
)
"""The settings of the paper's experiments, taken from the authors' published code. Pushing is hardly believed, so that
a contradiction between it and touch does not show as strain."""

PRESETS = {"palpate": GraphNoise(), "sticking": STICKING, "published": PUBLISHED}
