"""How much each factor is believed, all of them in one, and the sets of them that have a name."""

from dataclasses import dataclass

from palpate.graph.factors.balance import BalanceSettings
from palpate.graph.factors.contact import ContactSettings
from palpate.graph.factors.direction import DirectionSettings
from palpate.graph.factors.first_pose import FirstPoseSettings
from palpate.graph.factors.friction_cone import FrictionConeSettings
from palpate.graph.factors.place import PlaceSettings
from palpate.graph.factors.relative_pose import RelativePoseSettings
from palpate.graph.factors.sensor_pose import SensorPoseSettings
from palpate.graph.factors.sticking import StickingSettings
from palpate.graph.factors.turn import TurnSettings
from palpate.graph.variables import Priors


@dataclass(frozen=True)
class NoiseSettings:
    """How much each factor is believed: standard deviations, shares and kernels, a group a factor.

    The defaults are palpate's: those of what touches and slides are learnt by `palpate tune` from simulated recordings,
    the others have their reasons.
    """

    sensor_pose: SensorPoseSettings = SensorPoseSettings()
    """How well the sensor's pose is measured and calibrated."""
    first_pose: FirstPoseSettings = FirstPoseSettings()
    """How well the object's pose is known when tracking begins, and while it rests."""
    contact: ContactSettings = ContactSettings()
    """How closely the sensor's tip and the object's outline meet in a contact."""
    direction: DirectionSettings = DirectionSettings()
    """Where touch says that the tip is touched."""
    place: PlaceSettings = PlaceSettings()
    """Where touch says that a flat pad is touched."""
    turn: TurnSettings = TurnSettings()
    """How touch says that the sensor has turned."""
    relative_pose: RelativePoseSettings = RelativePoseSettings()
    """How touch says that the sensor has moved on the object."""
    sticking: StickingSettings = StickingSettings()
    """How firmly a contact holds while its force is inside the friction cone."""
    balance: BalanceSettings = BalanceSettings()
    """How closely the object moves as the limit surface has it: push and friction in balance, force and torque."""
    friction_cone: FrictionConeSettings = FrictionConeSettings()
    """How closely the force stays at the edge of the friction cone while the contact slides."""
    priors: Priors = Priors()
    """What is believed of the other unknowns, such as friction, before the object is first touched."""


STICKING = NoiseSettings(
    direction=DirectionSettings(share=0.8),
    turn=TurnSettings(share=20.0),
    relative_pose=RelativePoseSettings(oracle=(1.0, 1.0, 2e-2)),
    sticking=StickingSettings(share=0.05, sliding_share=0.05),
    balance=BalanceSettings(still=1e-6, share=0.5),
    friction_cone=FrictionConeSettings(share=None),
    priors=Priors(friction_ratio=(0.0, 1e-6), friction_center=(0.0, 1e-6)),
)
"""A contact that sticks, c and the centre of friction taken as known and the balance hardly believed: better where the
object is knocked and touch tells yaw alone, far too sure of itself where the contact slides."""

PUBLISHED = NoiseSettings(
    sensor_pose=SensorPoseSettings(deviation=(1e-5, 1e-5, 1e-5), calibration=(0.0, 0.0, 0.0)),
    first_pose=FirstPoseSettings(deviation=(1e-5, 1e-5, 1e-5), truth=(1e-5, 1e-5, 1e-5), rest=(1e-9, 1e-9, 1e-9)),
    contact=ContactSettings(deviation=1e-2, kernel=None),
    direction=DirectionSettings(share=1.0, kernel=None),
    place=PlaceSettings(share=1.0, kernel=None),
    turn=TurnSettings(share=1.0, kernel=None),
    relative_pose=RelativePoseSettings(oracle=(1.0, 1.0, 1e-5), constant=(1.0, 1.0, 1e-5), linear=1e-5),
    sticking=StickingSettings(still=1e-3, share=0.0, sliding_share=0.0, kernel=None),
    balance=BalanceSettings(still=1e-3, share=0.0, load=0.0, kernel=None),
    friction_cone=FrictionConeSettings(still=1e-3, share=None, kernel=None),
    priors=Priors(
        direction_bias=(0.0, 1e-9),
        direction_scale=(0.0, 1e-9),
        place_bias=(0.0, 1e-9),
        depth=(0.0, 1e-9),
        outline_scale=(0.0, 1e-9),
        friction_ratio=(0.0, 1e-9),
        friction_center=(0.0, 1e-9),
    ),
)
"""The settings of the paper's experiments, taken from the authors' published code. Pushing is hardly believed, so that
a contradiction between it and touch does not show as strain."""

PRESETS = {"palpate": NoiseSettings(), "sticking": STICKING, "published": PUBLISHED}
