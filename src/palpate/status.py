"""Status and reason of an estimate: one table, read from top to bottom; the first row that applies decides.

To add a status, add a row here, its name to `palpate.types.estimate.Status`, and its colour to `pipeline/figures.py`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from palpate.types.estimate import Origin, Status

ORIGINS: Mapping[Origin, str] = {
    "as before": "the pose as before",
    "first contact": "another place of contact",
    "shove": "a shove",
    "mirrored images": "images that lie the other way",
    "rough start": "a first pose that is known roughly",
}
"""Each origin of a hypothesis in words."""

VARIABLES: Mapping[str, str] = {
    "direction_bias": "the error of all contact directions",
    "direction_scale": "the scale of contact directions",
    "place_bias": "the error of all contact places",
    "depth": "the indentation",
    "outline_scale": "the size of the outline",
    "friction_ratio": "the radius of friction with the table",
    "friction_center": "the centre of friction with the table",
    "grip": "the friction at the contact",
}
"""Each variable of the object in words."""

SLANTED_PUSH = math.radians(12.0)
"""[rad] Angle of a push from the sensor's x axis from which a turned frame is asked about before turned images."""
DEEP = 2.5e-3
"""[m] Indentation beyond the usual one that no object of a kilogram shows in simulation."""

LACKS_DIRECTIONS = (
    "an unknown outline needs touch images or contact directions; contact flags alone do not tell its form"
)
"""Sentence on an outline that nothing tells of."""
MIRRORED = "touch fits the push only with images upside down or mirrored; confirm by --orientation 180 or mirrored"
"""Sentence once touch images are taken as mirrored."""
EXCHANGED = (
    "what the fingers see fits the push only if these are exchanged; confirm by exchanging their names or mounts"
)
"""Sentence once the fingers of a hand are taken as exchanged."""


@dataclass(frozen=True)
class FrameTurn:
    """A turn about z that the sensor's frame, as it was given, lacks."""

    angle: float | None
    """[rad] Counter-clockwise seen from above, if images are upright; None if it is not known well."""
    mirrored_angle: float | None
    """[rad] The same if images lie the other way."""
    may_be_mirrored: bool
    """True if nothing is turned once images lie the other way."""


class InputEvidence(NamedTuple):
    """Signs that the stream of frames is faulty or weak."""

    hidden_motion: float = 0.0
    """Distance that the sensor may have moved in a contact while its pose was frozen [m]."""
    touches_since_start: bool = False
    """True in a contact since before the untouched gel was known, so that touch cannot measure."""
    doubt: str = ""
    """Reason to doubt the calibration's untouched gel; empty if there is none."""
    weakness: str = ""
    """Weakness of the stream; empty if there is none."""
    push_angle: float = 0.0
    """Angle of the sensor's motion while it touches from its x axis [rad]; 0 while it is not known."""
    sunk: float = 0.0
    """Indentation of the tip beyond the usual one [m]."""
    turn: FrameTurn | None = None
    """The turn that the sensor's frame lacks, if one shows."""


@dataclass(frozen=True)
class Ambiguity:
    """Hypotheses that fit what was measured, one of which is likely and beyond the tolerance from the best."""

    distance: float
    """Distance of the farthest from the best [m]."""
    angle: float
    """Largest angle from the best [rad]."""
    origins: Mapping[Origin, int]
    """Number of hypotheses of each origin, the best among them."""


class Implausible(NamedTuple):
    """A variable of the object as all that is measured has it, far from what is usual."""

    variable: str
    """Its name; see `palpate.models.pushing.variables`."""
    deviations: float
    """Distance from its prior [standard deviations]."""


class FormEvidence(NamedTuple):
    """Signs of how well an outline that is learnt is known, and of what contradicts what was given of it."""

    untouched_share: float
    """Longest part of the outline that was not touched, as a share of it, if it is too long for a guess; else 0."""
    deviation: float
    """Root mean square of the standard deviations of what was touched [m]."""
    is_beyond_tolerance: bool
    """True if two of these are more than the tolerance."""
    has_directions: bool
    """True if touch measured directions or turns: contact alone does not tell how an object turns."""
    exceeding_width: float = 0.0
    """Width of what was touched, if it is more than the stated size [m]; else 0."""
    from_sketch: float = 0.0
    """Largest distance of what was touched from the sketch, if it is implausible [m]; else 0."""
    larger_than_sketch: float = 0.0
    """Share by which the object is larger than the sketch, negative if it is smaller, if it is implausible; else 0."""
    shoved_share: float = 0.0
    """Share of contacts in which something else seems to have moved the object, if these are many; else 0."""


class PoseEvidence(NamedTuple):
    """Signs of how well the pose is known, and of what contradicts it."""

    in_contact: bool
    """True while the sensor touches the object."""
    position_deviation: float
    """Standard deviation of the outline's centroid along its least known axis [m]."""
    yaw_deviation: float
    """Standard deviation of the yaw [rad]."""
    is_beyond_tolerance: bool
    """True if two of these are more than the tolerance."""
    ambiguity: Ambiguity | None = None
    """The ambiguity, if there is one."""
    has_begun_anew: bool = False
    """True if the estimator had no solution at this frame and began anew from the last pose."""
    contradicting_poses: float = 0.0
    """Largest distance of measured poses of the object from the estimate [m], if they contradict it."""
    contradicting_outline: float = 0.0
    """Largest distance of the outline, as measured poses put it, from the contact [m], if they contradict it."""
    implausible: Implausible | None = None
    """The least plausible variable of the object, if there is one that is implausible."""
    is_displaced: bool = False
    """True if the object was moved while nothing touched it, and is not found again."""
    takes_images_as_mirrored: bool = False
    """True if touch fits the push only with images that are upside down or mirrored."""
    may_images_be_mirrored: bool = False
    """True if it is not yet known how images lie."""
    are_of_hand: bool = False
    """True for images of a hand's fingers, which may be exchanged in place of mirrored."""
    form: FormEvidence | None = None
    """Evidence on the outline; None if it is known."""


class Evidence(NamedTuple):
    """All that decides status and reason of one estimate."""

    pose: PoseEvidence
    input: InputEvidence = InputEvidence()


class StatusRow(NamedTuple):
    """One row of the table."""

    status: Status
    applies: Callable[[Evidence], bool]
    reason: Callable[[Evidence], str]
    """The reason in one sentence; empty if all is well."""
    is_whole_reason: bool = False
    """True if nothing is added on the stream."""


def is_unknown(yaw_deviation: float) -> bool:
    """Return True for a standard deviation [rad] of a yaw that may be any: two of them are half a turn."""
    return 2.0 * yaw_deviation >= math.pi


def _contradiction(on: Evidence) -> str:
    if on.pose.contradicting_poses > 0.0:
        return f"measured object poses are up to {1e3 * on.pose.contradicting_poses:.0f} mm from the estimate"
    if on.pose.contradicting_outline > 0.0:
        distance = f"{1e3 * on.pose.contradicting_outline:.0f} mm"
        return f"measured object poses put the outline up to {distance} from where the sensor touches it"
    if on.pose.implausible is not None:
        name, deviations = on.pose.implausible
        variable = VARIABLES.get(name, name)
        return (
            f"all that is measured fits only if {variable} is {deviations:.0f} standard deviations from what is usual: "
            "measured object poses, outline or mounting may be off"
        )
    return "" if on.pose.form is None else _contradicting_form(on.pose.form)


def _contradicting_form(form: FormEvidence) -> str:
    if form.exceeding_width > 0.0:
        return f"what was touched is {1e3 * form.exceeding_width:.0f} mm wide, more than the size that was stated"
    if form.from_sketch > 0.0:
        distance = f"{1e3 * form.from_sketch:.0f} mm"
        return (
            f"what was touched is up to {distance} from the sketch, more than its sigma allows; sketch or first pose "
            "may be off"
        )
    if form.larger_than_sketch != 0.0:
        share = f"{abs(form.larger_than_sketch):.0%} {'larger' if form.larger_than_sketch > 0.0 else 'smaller'}"
        return f"what was touched so far makes the object {share} than the sketch, more than its sigma allows"
    if form.shoved_share > 0.0:
        share = f"{form.shoved_share:.0%}"
        return f"something else seems to have moved the object in {share} of contacts; the sketch may be off"
    return ""


def _unknown_form(on: Evidence) -> str:
    form = on.pose.form
    if form is None:
        return ""
    if form.untouched_share >= 1.0:
        return "nothing was touched so far, and the outline is a guess"
    if not form.has_directions:
        return LACKS_DIRECTIONS
    if form.untouched_share > 0.5:
        return "the contacts so far enclose nothing, and over half of the outline is a guess: push other sides"
    if form.untouched_share > 0.0:
        return f"{form.untouched_share:.0%} of the outline, in one piece, is a guess, as nothing touched it: push there"
    if form.is_beyond_tolerance:
        return f"the outline is known to {2e3 * form.deviation:.0f} mm at 95 % where it was touched"
    return ""


def _ambiguity(on: Evidence) -> str:
    ambiguity = on.pose.ambiguity
    assert ambiguity is not None
    count = sum(ambiguity.origins.values())
    farthest = f"{1e3 * ambiguity.distance:.0f} mm and {math.degrees(ambiguity.angle):.0f} degrees"
    words = {**ORIGINS, "mirrored images": "fingers that are exchanged"} if on.pose.are_of_hand else ORIGINS
    causes = ", ".join(f"{words[origin]} ({number})" for origin, number in ambiguity.origins.items())
    sentence = f"{count} poses up to {farthest} from the best fit what was measured: {causes}"
    return _joined(_slant(on), sentence) if "mirrored images" in ambiguity.origins else sentence


def turn_words(turn: FrameTurn) -> str:
    """Return a sentence on a turn that the sensor's frame lacks, with the option that mends it."""
    fits = "with this first pose the image of the first contact fits the outline only if"
    if turn.angle is None:
        return (
            f"{fits} the sensor's frame is turned about z: is --sensor-T-gel right, or is w the first of each "
            "quaternion?"
        )
    half = 0.5 * turn.angle
    option = f"--sensor-T-gel 0 0 0 0 0 {math.sin(half):.3f} {math.cos(half):.3f}, or as much after one that is given"
    turned = f"the sensor's frame is turned about z by {math.degrees(turn.angle):+.0f} degrees ({option})"
    if turn.may_be_mirrored:
        images = "images lie the other way (--orientation 180 or mirrored)"
        return f"{fits} {images} or if {turned}"
    words = f"{fits} {turned}"
    if abs(turn.angle) > math.radians(150.0):
        words += "; is w the first of each quaternion?"
    other = turn.mirrored_angle
    if other is not None and abs(math.remainder(other - turn.angle, math.tau)) > math.radians(5.0):
        words += f"; by {math.degrees(other):+.0f} degrees if images lie the other way"
    return words


def _slant(on: Evidence) -> str:
    """Return a question about the sensor's frame if it moves off its x axis, which looks like mirrored images."""
    if on.input.turn is not None:
        return ""  # it is told
    angle = math.degrees(on.input.push_angle)
    if abs(on.input.push_angle) < SLANTED_PUSH or on.input.weakness:
        return ""
    return (
        f"the sensor moves {angle:+.0f} degrees off the x axis of its own frame in contact: if it does not push at a "
        "slant, its frame is turned (sensor_T_gel)"
    )


def _uncertainty(on: Evidence) -> str:
    position = f"{2e3 * on.pose.position_deviation:.0f} mm"
    if is_unknown(on.pose.yaw_deviation):
        return f"the pose is known to {position} at 95 %, its yaw is unknown"
    yaw = f"{math.degrees(2.0 * on.pose.yaw_deviation):.0f} degrees"
    return f"the pose is known to {position} and {yaw} at 95 %"


def _orientation_of_images(on: Evidence) -> str:
    if on.pose.are_of_hand:
        return EXCHANGED if on.pose.takes_images_as_mirrored else ""
    if on.input.turn is not None:
        return ""  # a turned frame looks like mirrored images
    if on.pose.takes_images_as_mirrored:
        return _joined(_slant(on), MIRRORED)
    if on.pose.may_images_be_mirrored:
        return "not yet known if touch images are upside down or mirrored; --orientation upright says that they are not"
    return ""


def _depth_of(on: Evidence) -> str:
    if on.input.sunk <= DEEP:
        return ""
    return (
        f"the tip has sunk in by some {1e3 * on.input.sunk:.0f} mm more than usual, so that touch says little of where "
        "the object is: it may be too heavy for this tip, or stuck"
    )


TABLE = (
    StatusRow(
        status="faulty",
        applies=lambda on: on.input.hidden_motion > 0.0,
        reason=lambda on: (
            f"the sensor's pose is frozen; the sensor may have moved {1e3 * on.input.hidden_motion:.0f} mm since"
        ),
        is_whole_reason=True,
    ),
    StatusRow(
        status="uncertain",
        applies=lambda on: on.input.touches_since_start,
        reason=lambda on: "in contact since before the untouched gel was known: touch cannot measure before a release",
        is_whole_reason=True,
    ),
    StatusRow(
        status="ambiguous",
        applies=lambda on: on.pose.ambiguity is not None,
        reason=lambda on: _joined(_contradiction(on), _ambiguity(on)),
    ),
    StatusRow(
        status="indeterminate",
        applies=lambda on: on.pose.has_begun_anew,
        reason=lambda on: "the graph had no solution and began anew",
    ),
    StatusRow(
        status="strained",
        applies=lambda on: _contradiction(on) != "",
        reason=_contradiction,
    ),
    StatusRow(
        status="displaced",
        applies=lambda on: on.pose.is_displaced,
        reason=lambda on: "the object was moved while nothing touched it",
    ),
    StatusRow(
        status="uncertain",
        applies=lambda on: _unknown_form(on) != "",
        reason=_unknown_form,
    ),
    StatusRow(
        status="uncertain",
        applies=lambda on: on.pose.is_beyond_tolerance,
        reason=_uncertainty,
    ),
    StatusRow(
        status="tracking",
        applies=lambda on: on.pose.in_contact,
        reason=_orientation_of_images,
    ),
    StatusRow(
        status="resting",
        applies=lambda on: True,
        reason=_orientation_of_images,
    ),
)


class Verdict(NamedTuple):
    """Status of an estimate, and the reason for it."""

    status: Status
    reason: str


def decide(evidence: Evidence) -> Verdict:
    """Return the status of the first row that applies, and its reason, with doubts and weaknesses of the stream."""
    row = next(row for row in TABLE if row.applies(evidence))
    reason = row.reason(evidence)
    if not row.is_whole_reason:
        turn = evidence.input.turn
        sentences = [reason, evidence.input.weakness if turn is None else turn_words(turn)]
        if turn is not None or abs(evidence.input.push_angle) >= SLANTED_PUSH:
            sentences.reverse()  # a turned frame explains what follows
        reason = _joined(evidence.input.doubt, *sentences, _depth_of(evidence))
    return Verdict(row.status, reason)


def _joined(*sentences: str) -> str:
    """Return sentences as one, without empty ones."""
    return "; ".join(sentence for sentence in sentences if sentence)
