"""The paper's pushes, as far as it describes them (Sec. V-C, appendix), and the sides of its objects."""

from dataclasses import replace

from palpate_lab.simulate.gel import Side
from palpate_lab.simulate.push_settings import PushSettings

_ANY = PushSettings(
    # "Trajectories are varied as combinations of straight-line and curved pushes."
    curvature=5.0,
    speed=(0.038, 0.050),
    heading=35.0,
    beside=0.2,
    # "For sticking contact, the contact point pushing velocity must lie inside the motion cone": clean, tacky silicone,
    # one gel and not one for each recording.
    gel_friction=(1.0, 1.6),
    gel_stiffness=(4000.0, 4000.0),
    deep_as_pressed=True,
    # The paper's sensor is on a stick in a person's hand (Fig. 3), which yields to the object's turning. Not stated.
    begins=15.0,
    # The contact stays in the image, which shows a DIGIT's pad up to 20 degrees or so to either side.
    turns_after=20.0,
    ends=20.0,
    follows=(0.2, 0.5),
)
PUSHES = {
    "disc": replace(_ANY, speed=(0.028, 0.038)),
    # "Pushing along a corner cause large object rotations about the contact point."
    "rect": replace(_ANY, speed=(0.070, 0.100), heading=20.0, beside=0.6, follows=(0.2, 0.4)),
    "ellip": _ANY,
}
"""Pushes of each object; each recording "makes and breaks contact typically 2-3 times", as all recordings do.

Speeds, and how far a push passes beside the centroid, are such that a constant's loss is that of Table II.
"""
AS_IS = "as-is"
VARIED = {
    AS_IS: PUSHES["rect"],
    "held-still": replace(PUSHES["rect"], follows=(0.0, 0.0)),
    "turning-along": replace(PUSHES["rect"], follows=(0.8, 0.9)),
    "friction-0.5": replace(PUSHES["rect"], gel_friction=(0.5, 0.5)),
    "friction-0.25": replace(PUSHES["rect"], gel_friction=(0.25, 0.25)),
}
"""Pushes of the rectangle that differ in one thing each: how far the sensor turns with the object, or its friction."""
BY_TURNING = ("turning-along", AS_IS, "held-still")
"""Those of VARIED that differ in turning about the contact."""
BY_SLIP = (AS_IS, "friction-0.5", "friction-0.25")
"""Those of VARIED that differ in slip of the contact."""
LEFT_OUT = ("rectangle-corners",)
"""Kinds of contact that are not made: "pushing at both edges and corners for the rect object"."""
SIDE = Side()
"""Upright sides, 20 mm high: the paper's three objects are prisms, and stay the same."""
