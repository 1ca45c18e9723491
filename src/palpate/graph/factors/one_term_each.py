"""What factors have in common of which touch tells a number with a variance: one term for each such measurement."""

from typing import ClassVar, Protocol

from palpate.graph.factors.factor import Factor, Step, Terms, kernel_scale, terms_now
from palpate.types.measurements import ContactDirection, ContactPlace, Turn


class Believed(Protocol):
    """Settings of such a factor."""

    @property
    def share(self) -> float:
        """Variance of what is told as a share of what touch says."""
        ...

    @property
    def kernel(self) -> float | None:
        """Scale of the Cauchy kernel [standard deviations]; None is a plain square."""
        ...


class OneTermEach(Factor):
    """One term of one row for each measurement of a kind, tied to the step that it arrives with.

    `data` holds the measured number and its inverse variance, `given` the scale of the kernel.
    """

    measurement: ClassVar[type[ContactDirection | ContactPlace | Turn]]
    """The kind."""
    value: ClassVar[str]
    """Its field with the number that touch tells; its variance is in `variance`."""
    rows = 1

    def __init__(self, settings: Believed) -> None:
        """Take how far touch is to be believed."""
        self.given = (kernel_scale(settings.kernel),)
        self._share = settings.share

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        said = [one for one in step.measurements if isinstance(one, self.measurement)]
        return terms_now([(getattr(one, self.value), 1.0 / (one.variance * self._share)) for one in said], self.data)
