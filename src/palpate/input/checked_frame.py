"""A frame that can be used, with all that later steps need to know of how it came."""

from typing import NamedTuple

from palpate.arrays import Array
from palpate.status import InputEvidence
from palpate.touch.background import Background
from palpate.touch.cells import Light
from palpate.types.measurements import Frame


class CorrectedFrame(NamedTuple):
    """A frame with the pose that the sensor had when its image was taken."""

    frame: Frame
    """The frame with that pose."""
    latest_pose: Array
    """world_T_sensor at the frame's own time, without the sideways error of its mounting, (3,) [m, m, rad]."""
    motion_since_image: Array | None = None
    """Motion of the sensor from the image's time to the frame's, in the world, (3,) [m, m, rad]; None if images are
    not late."""


class CheckedFrame(NamedTuple):
    """A plausible frame, its image in the profile's view, and contact as the image shows it."""

    corrected: CorrectedFrame
    """The frame as it was before its image and its contact were checked."""
    frame: Frame
    """The frame as it can be used; its contact is True or False."""
    is_first: bool
    """True for the first frame of a stream."""
    ends_contact: bool
    """True if the contact of the frame before is over. A contact in this frame is then another one."""
    unobserved_push: float
    """Largest distance by which the object may have been pushed while it was not observed [m], if a contact ends."""
    background: Background | None
    """The untouched gel as known now; None before the first images, and without images."""
    light: Light | None
    """The light in the image relative to the untouched gel's; None where it was not compared with that."""
    shows_touch: bool
    """True if the contact shows in the image, or is given; False where it goes on unseen."""
    evidence: InputEvidence
    """Signs that the stream is faulty or weak, for the status."""
