"""How to track."""

from dataclasses import dataclass
from numbers import Integral
from typing import get_args

from palpate.config.settings import NoiseSettings
from palpate.errors import SettingError
from palpate.geometry.shapes import PRESSURES
from palpate.graph.smoother import SmootherName
from palpate.touch.modes import TactileChoice
from palpate.types.measurements import finite_numbers


@dataclass(frozen=True)
class TrackerSettings:
    """How to track; raises SettingError on a word that is not known."""

    tactile: TactileChoice = "auto"
    """What touch says; see `touch.modes.Tactile`. auto is learnt where there are images that fit the model, else
    none."""
    smoother: SmootherName = "fixed-lag"
    """How the graph of a contact is solved; see `estimation.smoother.SmootherName`."""
    noise: NoiseSettings = NoiseSettings()
    """How much each factor is believed."""
    pressure: str | float = "uniform"
    """How the object's weight is spread over the table, by name, which gives its friction radius c: the largest torque
    of friction over its largest force; or c itself [m]."""
    hypotheses: int = 9
    """How many answers are kept at most while touch cannot tell which is right; a contact may begin with more for its
    first frames. 1 keeps one whatever happens."""

    def __post_init__(self) -> None:
        for name, allowed in (("tactile", get_args(TactileChoice)), ("smoother", get_args(SmootherName))):
            if (found := getattr(self, name)) not in allowed:
                raise SettingError(f"{name} is {found!r}; allowed are {', '.join(allowed)}")
        if not isinstance(self.noise, NoiseSettings):
            raise SettingError(f"noise is {self.noise!r}; it must be palpate.NoiseSettings(...)")
        radius = None if isinstance(self.pressure, str) else finite_numbers(self.pressure, ())
        if self.pressure not in PRESSURES and (radius is None or radius <= 0.0):
            raise SettingError(
                f"pressure is {self.pressure!r}; allowed are {', '.join(PRESSURES)} or a friction radius above 0 [m]"
            )
        if not isinstance(self.hypotheses, Integral) or isinstance(self.hypotheses, bool) or self.hypotheses < 1:
            raise SettingError(f"hypotheses is {self.hypotheses!r}; allowed is a whole number from 1 on")
        # NumPy's numbers go into no JSON.
        object.__setattr__(self, "hypotheses", int(self.hypotheses))
        if radius is not None:
            object.__setattr__(self, "pressure", float(radius))
