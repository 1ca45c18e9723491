"""List of all factors. A new factor is one file in `factors`, a group of settings and a line here."""

from palpate.config import NoiseSettings
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.balance import Balance
from palpate.graph.factors.contact import Contact
from palpate.graph.factors.direction import Direction
from palpate.graph.factors.factor import Factor
from palpate.graph.factors.friction_cone import FrictionCone
from palpate.graph.factors.measured import Measured
from palpate.graph.factors.object_pose import ObjectPose
from palpate.graph.factors.place import Place
from palpate.graph.factors.sensor_pose import SensorPose
from palpate.graph.factors.sticking import Sticking
from palpate.graph.factors.turn import Turn


def make_factors(settings: NoiseSettings, model: ContactModel) -> tuple[Factor, ...]:
    """Return all factors except `FirstPose`, which each contact makes for itself."""
    return (
        SensorPose(settings.sensor_pose),
        Contact(settings.contact),
        Sticking(settings.sticking),
        Balance(settings.balance, model),
        FrictionCone(settings.friction_cone),
        Direction(settings.direction),
        Place(settings.place),
        Turn(settings.turn),
        ObjectPose(),
        Measured(),
    )
