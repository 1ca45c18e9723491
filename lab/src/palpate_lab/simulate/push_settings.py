"""Settings of how a robot or a hand pushes an object."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PushSettings:
    """Ranges that pushes are drawn from, uniformly unless it says otherwise; the defaults are those of a robot."""

    speed: tuple[float, float] = (0.010, 0.040)
    """Speed of the sensor [m/s], uniform in its logarithm."""
    curvature: float = 5.0
    """Largest curvature of the half of the paths that are not straight, either way [1/m]."""
    heading: float = 45.0
    """Largest angle between path and normal at the first contact with a round gel, either way [deg]."""
    beside: float = 0.0
    """Least sine of the angle between path and arm from the object's centroid to a round gel's first contact."""
    begins: float = 12.0
    """Largest angle of the first contact from a round gel's apex, either way [deg]."""
    turns_after: float = 20.0
    """Angle from a round gel's apex past which the sensor turns after its contact [deg]."""
    ends: float = 30.0
    """Angle from a round gel's apex past which the push ends [deg]."""
    follows: tuple[float, float] | None = None
    """Share of the object's turning by which the sensor turns with it; None for a robot, which does not."""
    gel_friction: tuple[float, float] = (0.25, 0.6)
    """Coulomb friction between gel and object."""
    gel_stiffness: tuple[float, float] = (2600.0, 6500.0)
    """Normal force per indentation of a round gel [N/m]."""
    deep_as_pressed: bool = False
    """Images show the gel at least as deep as its normal force presses it: MuJoCo's contact opens where it slides."""


ROBOT = PushSettings()
"""Pushes by a robot, those of recordings that say nothing else."""
