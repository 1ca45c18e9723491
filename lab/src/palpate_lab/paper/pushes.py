"""The paper's pushes, as far as it describes them (Sec. V-C, appendix), and the sides of its objects."""

from dataclasses import replace

from palpate_lab.simulate.gel import Side
from palpate_lab.simulate.push_settings import PushSettings

_ANY = PushSettings(
    # "Trajectories are varied as combinations of straight-line and curved pushes."
    speed=(0.028, 0.055),
    curvature=5.0,
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
    "disc": _ANY,
    # "Pushing along a corner cause large object rotations about the contact point."
    "rect": replace(_ANY, speed=(0.057, 0.100), follows=(0.1, 0.3), heading=20.0, beside=0.6),
    "ellip": _ANY,
}
"""Pushes of each object; each recording "makes and breaks contact typically 2-3 times", as all recordings do."""
LEFT_OUT = ("rectangle-corners",)
"""Kinds of contact that are not made: "pushing at both edges and corners for the rect object"."""
SIDE = Side()
"""Upright sides, 20 mm high: the paper's three objects are prisms, and stay the same."""
