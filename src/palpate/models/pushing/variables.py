"""Variables of pushing. A new one stands in the file of the factor that needs it, or here, and in `model.MODEL`."""

from palpate.estimation.variable import Variable

SENSOR_IN_OBJECT = Variable("sensor_in_object", "step", 3, symbol="g")
"""Sensor pose in the object frame, g = o^-1 e [m, m, rad]."""
SENSOR = Variable("sensor", "step", 3, symbol="e")
"""Sensor pose in the world, e [m, m, rad]."""
TURN_OFFSET = Variable("turn_offset", "contact", prior=(0.0, 10.0))
"""Sensor yaw in the object frame minus the measured turn [rad]. The wide prior keeps it determined without any turn."""
CORNER_BIAS = Variable("corner_bias", "contact", prior=(0.0, 0.16))
"""Common error of the angles of a contact's corner [rad]."""
DIRECTION_BIAS = Variable("direction_bias", "object")
"""Common error of all contact directions [rad]."""
DIRECTION_SCALE = Variable("direction_scale", "object")
"""Relative scale error of contact directions."""
PLACE_BIAS = Variable("place_bias", "object")
"""Common error of all contact places [m]."""
DEPTH = Variable("depth", "object")
"""Indentation of the gel, including any constant offset between outline, gel and mounting [m]."""
SINKING = Variable("sinking", "contact", prior=(1.2, 0.8))
"""Ratio of the indentation beyond the usual one to what the imprint says of it."""
OUTLINE_SCALE = Variable("outline_scale", "object")
"""Relative size error of the outline."""
FRICTION_RATIO = Variable("friction_ratio", "object", change=(0.44, 0.006))
"""Logarithm of c^2 over the c^2 of an even pressure on the table."""
FRICTION_CENTER = Variable("friction_center", "object", 2, change=(0.44, 0.006))
"""Centre of friction relative to the centroid, along x and y of the object, in units of c."""
GRIP = Variable("grip", "object", change=(0.44, 0.006))
"""Logarithm of the Coulomb friction coefficient between sensor and object."""

OBJECT_POSE = Variable("object_pose", "step", 3, symbol="o")
"""Object pose in the world, o = e g^-1 [m, m, rad], which follows from the variables of a step."""
