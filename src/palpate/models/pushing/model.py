"""The model of quasi-static pushing: its variables and factors. A new one of either is an import and an entry here.

After a change, `make kernels` writes `models/generated.py` anew.
"""

from palpate.errors import SettingError
from palpate.estimation.model import Model
from palpate.estimation.variable import Variable
from palpate.models.pushing import variables
from palpate.models.pushing.balance import BALANCE
from palpate.models.pushing.contact import CONTACT
from palpate.models.pushing.contact_geometry import CONTACT_GEOMETRY
from palpate.models.pushing.corner import CORNER
from palpate.models.pushing.direction import DIRECTION
from palpate.models.pushing.disturbance import DISTURBED_SLIDE, DISTURBED_TURN
from palpate.models.pushing.first_pose import FIRST_POSE
from palpate.models.pushing.friction_cone import FRICTION_CONE
from palpate.models.pushing.object_pose import OBJECT_POSE
from palpate.models.pushing.place import PLACE
from palpate.models.pushing.sensor_pose import SENSOR_POSE
from palpate.models.pushing.sticking import STICKING
from palpate.models.pushing.turn import TURN

MODEL = Model(
    variables=(
        variables.SENSOR_IN_OBJECT,
        variables.SENSOR,
        variables.TURN_OFFSET,
        variables.CORNER_BIAS,
        variables.SINKING,
        variables.DIRECTION_BIAS,
        variables.DIRECTION_SCALE,
        variables.PLACE_BIAS,
        variables.DEPTH,
        variables.OUTLINE_SCALE,
        variables.FRICTION_RATIO,
        variables.FRICTION_CENTER,
        variables.GRIP,
    ),
    factors=(
        STICKING,
        BALANCE,
        FRICTION_CONE,
        DISTURBED_SLIDE,
        DISTURBED_TURN,
        FIRST_POSE,
        SENSOR_POSE,
        CONTACT,
        DIRECTION,
        PLACE,
        TURN,
        CORNER,
        OBJECT_POSE,
    ),
    geometry=CONTACT_GEOMETRY,
    step_numbers=("moved", "force_angle", "sliding", "slide", "spread", "is_resting", "sunk"),
    step_poses=("measured",),
)
"""Variables and factors, in the order of their places in vectors and tables."""


def named(name: str) -> Variable:
    """Return the variable of this name; raises SettingError if there is none."""
    known = {variable.name: variable for variable in (variables.OBJECT_POSE, *MODEL.variables)}
    if name not in known:
        raise SettingError(f"variable {name!r} is not known; known are {', '.join(known)}")
    return known[name]
