"""Places of the variables of pushing in vectors and matrices, and the names of its factors."""

from palpate.models.pushing.model import MODEL

NAMES = MODEL.names
"""Names of the factors, in the order of `Estimate.innovations`; the last is that of measurements of one's own."""
STEP_SIZE = MODEL.step_size
"""Numbers of one step."""
SHARED_SIZE = MODEL.shared_size
"""Numbers of the variables that all steps of a contact share."""
CONTACT_SIZE = MODEL.contact_size
"""Numbers of the variables of a contact."""
OBJECT_SIZE = MODEL.object_size
"""Numbers of the variables of the object."""
LAST_SIZE = MODEL.last_size
"""Numbers of one step and the shared variables."""
WIDTH = MODEL.width
"""Numbers of two steps and the shared variables."""
IN_SHARED = MODEL.in_shared
"""Places of variables in the vector of the shared ones."""
IN_OBJECT = MODEL.in_object
"""Places of variables in the vector of the object's."""
column = MODEL.column
