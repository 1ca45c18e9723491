"""How much each factor is believed: standard deviations, the published ones and ours."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.graph.factors import ContactModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GraphNoise:
    """Standard deviations of the factors. The defaults are palpate's, each with its reason."""

    tactile: tuple[float, float, float] = (1.0, 1.0, 2e-2)
    """Relative pose from touch where touch does not say itself [m, m, rad], for one pair of images. Only yaw counts. An
    image yields yaw to about 4e-3 rad and takes part in 30 pairs a step: as independent measurements of variance 30
    times larger they say as much as the images do."""
    constant: tuple[float, float, float] = (1.0, 1.0, 0.5)
    """The same for the constant model: the sensor turns by about 0.1 rad in 10 to 40 frames, thirty pairs a step."""
    sticking: float = 2e-5
    """Sliding in one step when nothing moves [m]."""
    sticking_share: float = 0.05
    """Sliding in one step as a share of the sensor's motion in it: real contacts creep by some percent of the way."""
    felt_sticking_share: float = 1.0
    """The same where touch tells the contact's direction. Then the graph need not lean on sticking: on 30 simulated
    recordings, used for nothing else, the final error was 3.3 mm (27 at worst) instead of 4.9 (84). Relative yaw alone,
    on real pushes that are knocked, does need it."""
    turning: float = 1e-6
    """Imbalance of force and torque in one step when nothing moves [m^2]."""
    turning_share: float = 0.5
    """The same as a share of the sensor's motion times c: c^2 differs by a factor of 2 from uniform to rim pressure."""
    pushing_kernel: float | None = 2.0
    """Scale of the Cauchy kernel on the pushing rows together [standard deviations]; None is a plain square. A slip or
    a knock breaks all rows at once, and the kernel lets them go."""
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
            if field.name.endswith("kernel") and value is None:
                continue
            is_share = field.name.endswith("share")
            large_enough = np.greater_equal(value, 0.0) if is_share else np.greater(value, 0.0)
            if not (np.all(large_enough) and np.isfinite(value).all()):
                raise SettingError(
                    f"noise {field.name} is {value!r}; it must be finite and {'at least' if is_share else 'above'} 0"
                )

    def felt(self) -> "GraphNoise":
        """Return what holds where touch tells the contact's direction."""
        return replace(self, sticking_share=self.felt_sticking_share)

    def pushing_sigmas(self, moved: Array, tip: ContactModel) -> Array:
        """Standard deviations (..., 3) [m, m, m^2] of the pushing rows where the sensor moved by moved (...) [m]."""
        slide = np.hypot(self.sticking, self.sticking_share * moved)
        turn = np.hypot(self.turning, self.turning_share * moved * tip.friction_radius)
        if not tip.alone:
            turn = np.full_like(slide, np.inf)
        return np.stack([slide, slide, turn], axis=-1)

    def pushing_weight(self, residual: Array, moved: Array, tip: ContactModel) -> Array:
        """Inverse variances (..., 3) of the pushing rows, kernel included, at the residual (..., 3)."""
        weight = self.pushing_sigmas(moved, tip) ** -2.0
        return weight * cauchy_weight(np.sum(weight * residual**2, axis=-1, keepdims=True), self.pushing_kernel)

    def contact_weight(self, residual: Array) -> Array:
        """Inverse variance (...) of the contact row, kernel included, at the residual (...) [m]."""
        return cauchy_weight((residual / self.contact) ** 2, self.contact_kernel) / self.contact**2

    def feeling_weight(self, residual: Array, information: Array | float) -> Array:
        """Inverse variance (...) of a contact direction or turn, kernel included, at the residual (...) [rad].

        information (...) is the inverse variance that touch says [1/rad^2]; 0 where it says nothing.
        """
        return information * cauchy_weight(information * residual**2, self.feeling_kernel)


def cauchy_weight(squared_error: Array, scale: float | None) -> Array:
    """Weight (...) that the Cauchy kernel leaves to whitened rows of squared length squared_error (...)."""
    if scale is None:
        return np.ones_like(squared_error)
    return 1.0 / (1.0 + squared_error / scale**2)


PUBLISHED = GraphNoise(
    tactile=(1.0, 1.0, 1e-5),
    constant=(1.0, 1.0, 1e-5),
    sticking=1e-3,
    sticking_share=0.0,
    felt_sticking_share=0.0,
    turning=1e-3,
    turning_share=0.0,
    pushing_kernel=None,
    contact=1e-2,
    contact_kernel=None,
    feeling_kernel=None,
    sensor=(1e-5, 1e-5, 1e-5),
    first_pose=(1e-5, 1e-5, 1e-5),
    rest=(1e-9, 1e-9, 1e-9),
)
"""The settings of the paper's experiments, taken from the authors' published code. Pushing is hardly believed, so that
a contradiction between it and touch does not show as strain."""

PRESETS = {"palpate": GraphNoise(), "published": PUBLISHED}
