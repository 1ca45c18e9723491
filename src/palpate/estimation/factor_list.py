"""Which factors there are: a new one is a file in `factors`, a field of `settings` and a line here."""

from palpate.estimation.contact_model import ContactModel
from palpate.estimation.factors.balance import Balance
from palpate.estimation.factors.contact import Contact
from palpate.estimation.factors.direction import Direction
from palpate.estimation.factors.factor import Factor
from palpate.estimation.factors.friction_cone import FrictionCone
from palpate.estimation.factors.measured import Measured
from palpate.estimation.factors.object_pose import ObjectPose
from palpate.estimation.factors.place import Place
from palpate.estimation.factors.relative_pose import RelativePose
from palpate.estimation.factors.sensor_pose import SensorPose
from palpate.estimation.factors.sticking import Sticking
from palpate.estimation.factors.turn import Turn
from palpate.estimation.settings import NoiseSettings


def make_factors(settings: NoiseSettings, model: ContactModel) -> tuple[Factor, ...]:
    """Return the factors of a graph, all but that of what is known when a contact begins, which each contact makes."""
    return (
        SensorPose(settings.sensor_pose),
        Contact(settings.contact),
        Sticking(settings.sticking),
        Balance(settings.balance, model),
        FrictionCone(settings.friction_cone),
        RelativePose(),
        Direction(settings.direction),
        Place(settings.place),
        Turn(settings.turn),
        ObjectPose(),
        Measured(),
    )
