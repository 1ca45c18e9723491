"""Beliefs at the places where a contact of one sensor, or of the fingers of a hand, may have begun.

Places are those of the first finger that touches. What the others see of the object there, and that one which touches
nothing is outside it, makes them more or less likely and moves them.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array, Flags, Integers
from palpate.config import UNLIKELY
from palpate.geometry import se2
from palpate.hypotheses.proposals.contact_places import (
    BeliefsAtPlaces,
    beliefs_at_places,
    is_contradicted,
    is_rough,
)
from palpate.models.pushing.belief import Belief, clearances
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.measurements import Step


@dataclass(frozen=True)
class _Fit:
    """Numbers of the fit to another finger. They are no settings: the graph of the contact takes over."""

    gap_sigma: float = 1.5e-3
    """[m] Standard deviation of the distance of another finger from the outline, in contact and just outside."""
    least_direction_sigma: float = 0.06
    """[rad] Least standard deviation of a direction that another finger measures."""
    iterations: int = 4
    """Gauss-Newton steps towards a pose that fits another finger."""
    difference: float = 1e-6
    """[m], [rad] Change of a pose over which derivatives are taken."""


_FIT = _Fit()


def leaves_several_places(belief: Belief, touch_sign: Array, model: ContactModel, step: Step) -> Flags:
    """Return True (B,) for beliefs that are rough, or that the measured direction of a contact contradicts."""
    if step.fingers is None:
        return is_rough(belief, model) | is_contradicted(belief, touch_sign, model, step)
    leaves = is_rough(belief, model.fingers[0])
    no_sign = np.ones(len(belief))
    for number in np.flatnonzero(step.fingers.touches).tolist():
        own = model.fingers[number]
        as_stated = is_contradicted(belief, no_sign, own, step.of_finger(number, is_exchanged=False))
        exchanged = is_contradicted(belief, no_sign, own, step.of_finger(number, is_exchanged=True))
        leaves = leaves | np.where(touch_sign < 0.0, exchanged, as_stated)
    return leaves


def places_of_contact(
    beliefs: Belief, searched: Integers, touch_sign: Array, model: ContactModel, step: Step, is_guess: Flags
) -> BeliefsAtPlaces:
    """Return the beliefs at all likely places, for some rows `searched` of the beliefs (B,).

    See `contact_places.beliefs_at_places`; in rows of sign -1 the fingers of a hand are exchanged.
    """
    if step.fingers is None:
        return beliefs_at_places(beliefs, searched, touch_sign, model, step, is_guess)
    exchanged = touch_sign[searched] < 0.0
    stated = _places_of_hand(beliefs, searched[~exchanged], model, step, is_guess, is_exchanged=False)
    if not exchanged.any():
        return stated
    return _joined(stated, _places_of_hand(beliefs, searched[exchanged], model, step, is_guess, is_exchanged=True))


def _places_of_hand(
    beliefs: Belief, searched: Integers, model: ContactModel, step: Step, is_guess: Flags, is_exchanged: bool
) -> BeliefsAtPlaces:
    """Return the beliefs at the places of the first finger that touches, as far as they fit the other fingers."""
    assert step.fingers is not None
    touching = np.flatnonzero(step.fingers.touches).tolist()
    first = touching[0]
    no_sign = np.ones(len(beliefs))
    of_first = step.of_finger(first, is_exchanged)
    places = beliefs_at_places(beliefs, searched, no_sign, model.fingers[first], of_first, is_guess)
    for number, other in enumerate(model.fingers):
        if number != first and len(places.parent):
            places = _fitted(places, _Other(other, step.of_finger(number, is_exchanged), number in touching))
    return places


class _Other(NamedTuple):
    """Another finger of the hand."""

    model: ContactModel
    step: Step
    touches: bool


def _fitted(places: BeliefsAtPlaces, other: _Other) -> BeliefsAtPlaces:
    """Return the places with what another finger says of them, without those that it contradicts."""
    moved = np.zeros((len(places.parent), 3))  # in the tangent space at the places
    update = _updated(places.belief, moved, other)
    if not other.touches:
        outside = np.minimum(update.off, 0.0)
        squares = np.einsum("nr,nrs,ns->n", outside, np.linalg.inv(update.expected), outside)
        kept = np.flatnonzero(squares < UNLIKELY**2)
        likely = BeliefsAtPlaces(places.belief, places.parent, places.log_likelihood - 0.5 * squares)
        return likely.take(kept) if len(kept) else places
    for _ in range(_FIT.iterations):
        moved = -np.einsum("nir,nr->ni", update.gain, update.off)
        update = _updated(places.belief, moved, other)
    squares = np.einsum("nr,nrs,ns->n", update.off, np.linalg.inv(update.expected), update.off)
    unfit = np.square(update.residual) / update.variances
    kept = np.flatnonzero((squares < 2.0 * UNLIKELY**2) & (unfit < UNLIKELY**2).all(axis=1))
    if not len(kept):
        return places
    joint = places.belief.covariance.copy()
    joint[:, :3, :3] -= update.gain @ update.expected @ update.gain.transpose(0, 2, 1)
    belief = Belief(se2.compose(places.belief.pose, se2.exp(moved)), places.belief.values, joint)
    log_likelihood = places.log_likelihood - 0.5 * squares - 0.5 * np.linalg.slogdet(update.expected)[1]
    return BeliefsAtPlaces(belief, places.parent, log_likelihood).take(kept)


class _Update(NamedTuple):
    """The object at N places as another finger sees it, linearised at poses near these."""

    residual: Array
    """Seen there, less measured, (N, R)."""
    variances: Array
    """Of what is measured, (R,)."""
    off: Array
    """The same at the places themselves, (N, R)."""
    expected: Array
    """Covariance of that, (N, R, R)."""
    gain: Array
    """Gain (N, 3, R) on the pose."""


def _updated(belief: Belief, moved: Array, other: _Other) -> _Update:
    """Return the update by another finger once the object has moved from the beliefs by tangent vectors (N, 3)."""
    pose = se2.compose(belief.pose, se2.exp(moved))
    residual, deviations = _residual(belief, pose, other)
    slopes = np.empty((*residual.shape, 3))
    for k, change in enumerate(_FIT.difference * np.eye(3)):
        difference = _residual(belief, se2.compose(pose, change), other)[0] - residual
        difference[:, 1:] = se2.wrap(difference[:, 1:])
        slopes[..., k] = difference / _FIT.difference
    variances = np.square(deviations)
    across = belief.pose_covariance @ slopes.transpose(0, 2, 1)
    expected = slopes @ across + np.diag(variances)
    off = residual - np.einsum("nri,ni->nr", slopes, moved)
    return _Update(residual, variances, off, expected, across @ np.linalg.inv(expected))


def _residual(belief: Belief, pose: Array, other: _Other) -> tuple[Array, list[float]]:
    """Return the residuals (N, R) of another finger at poses (N, 3), and their standard deviations (R,)."""
    at = Belief(pose, belief.values, belief.covariance)
    gap, _ = clearances(at, other.model, other.step.sensor_pose[None])
    directions = other.step.directions(at, np.ones(len(pose))) if other.touches else []
    if not directions or other.model.radius == 0.0:
        return gap, [_FIT.gap_sigma]
    angle, variance = directions[0]
    off = se2.wrap(other.model.directions(se2.between(pose, other.step.sensor_pose)) - angle)
    sigma = max(float(np.sqrt(variance)), _FIT.least_direction_sigma)
    return np.column_stack([gap[:, 0], off]), [_FIT.gap_sigma, sigma]


def _joined(one: BeliefsAtPlaces, other: BeliefsAtPlaces) -> BeliefsAtPlaces:
    """Return the places of both."""
    return BeliefsAtPlaces(
        one.belief.joined(other.belief),
        np.concatenate([one.parent, other.parent]),
        np.concatenate([one.log_likelihood, other.log_likelihood]),
    )
