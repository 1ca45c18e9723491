"""A factor: a residual over named variables, its noise and its robust kernel."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from palpate.arrays import Array
from palpate.manifolds.functions import Scalar

Steps = Literal["every", "pair", "first"]
"""Steps that have a factor without a measurement: every one, every one but the first with the one before it, or the
first one of a contact."""
Role = Literal["measurement", "process", "belief"]
"""Side of the evidence that a factor's cost is on: what is measured; how the object moves while nothing but the sensor
moves it; or the belief with which a contact begins, which is no evidence."""
Kernel = Literal["none", "each", "together"]
"""Cauchy kernel, of the scale `noise.kernel`: none, on each row by itself, or on all rows together."""
READS = ("before", "now", "measured", "belief", "noise", "support", "known")
"""Parameters of a residual that are no variables: the step before and this one, the numbers of the measurement, the
belief with which a contact begins, the factor's own settings, the support of the object on the table, and the numbers
that `Factor.lookup` found."""


@dataclass(frozen=True, eq=False)
class Factor:
    """A residual over named variables.

    The parameters of its functions name what they read: variables of the model, or the names in `READS`. They are
    called with symbols when code is generated, and with numbers in tests; their formulas use `manifolds.planar` and
    `manifolds.functions`.
    """

    name: str
    """Name in settings and messages."""
    residual: Callable[..., Sequence[Scalar]]
    """The residual's rows, in the units of its noise."""
    variance: Callable[..., Sequence[Scalar]] | None = None
    """Variance of each row, which counts as constant in the derivatives; None if a joint covariance whitens the rows:
    that of the belief with which a contact begins, or of the measurement."""
    steps: Steps | None = None
    """Steps that have this factor; None if measurements bring it."""
    measurement: type | None = None
    """Class of the measurements that bring this factor."""
    data: tuple[str, ...] = ()
    """Numbers of a measurement that residual and variance read as `measured.NAME`. There are two more: `variance`, and
    `sign`, which is -1 if the measurement is read from images that are taken as mirrored."""
    numbers: Callable[[Any], Sequence[float]] | None = None
    """The numbers named by `data` of a measurement; by default its attributes of these names."""
    root: Callable[[Any], Array] | None = None
    """Inverse Cholesky root (R, R), R <= 3, of the joint covariance of a measurement."""
    settings: str = ""
    """Group of `NoiseSettings` that is `noise`; by default the name of the factor, if there is one."""
    kernel: Kernel = "none"
    """Robust kernel. Its scale is `noise.kernel`, so that the settings need this field, and the rows need variances."""
    role: Role = "measurement"
    """Side of the evidence."""
    weight: Callable[..., Scalar] | None = None
    """Share of the factor that counts, from 0 to 1; by default all of it."""
    applies: Callable[..., Any] | None = None
    """Condition under which the factor has rows; by default always."""
    lookup: Callable[..., Any] | None = None
    """Compiled function of a step, the number of the finger if it has one, and the table of `Given.places`, for what no
    formula gives, such as the nearest of several places; returns the numbers `found`. For factors of measurements."""
    found: tuple[str, ...] = ()
    """Names of the numbers that `lookup` returns, read as `known.NAME`."""
    finger: int | None = None
    """Number of the finger at whose contact it holds, in a model of several: it has rows while that finger touches,
    reads g and e of that finger and the variables of its contact. None for the hand as a whole."""
    is_compared: bool = True
    """False if the residual is no innovation, so that no consistency test can be made of it."""

    @property
    def reads(self) -> tuple[str, ...]:
        """Names that the functions read, in the order in which they first stand."""
        functions = (self.residual, self.variance, self.weight, self.applies)
        names = [name for function in functions if function for name in inspect.signature(function).parameters]
        return tuple(dict.fromkeys(names))

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the variables that are shared by steps and that the functions read."""
        return tuple(name for name in self.reads if name not in READS)
