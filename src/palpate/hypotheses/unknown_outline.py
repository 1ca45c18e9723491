"""Filter of an object whose outline is unknown, or known as a sketch: its outline is a variable with a band.

The outline is a curve and heights across it. When a contact begins, and where a contact shows that the outline is
elsewhere or turned by more than the heights describe, the curve takes over the heights of the best hypothesis.

Without a drawing, the object frame is what the first contact makes it: its origin is some way in front of the tip,
its x axis along the direction of contact.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import Array, Flags
from palpate.config import NoiseSettings, TrackerSettings
from palpate.geometry import se2
from palpate.geometry.closed_curve import KNOTS, POINTS, best_pole
from palpate.hypotheses.consistency import ConsistencyMonitor
from palpate.hypotheses.filter import MultiHypothesisFilter
from palpate.hypotheses.posterior import Posterior
from palpate.hypotheses.rows import Hypotheses
from palpate.hypotheses.weigher import Weigher
from palpate.models.pushing.graph import Graph
from palpate.models.pushing.measurements import Fingers, OfFinger, Step
from palpate.models.pushing.outline_change import changed_outline
from palpate.models.pushing.outline_prior import OUTLINE_PLACE, deviation_at_points, outline_prior, with_friction
from palpate.models.pushing.outline_variable import OUTLINE
from palpate.models.pushing.priors import object_prior
from palpate.models.pushing.settings import settings_record
from palpate.models.pushing.unknown_outline import OUTLINE_PUSHING, OutlineContactModel, outline_contact_model
from palpate.models.pushing.window import ContactWindow
from palpate.types.measurements import ContactDirection, Frame, Measurement, Turn
from palpate.types.outline import LACKS_DIRECTIONS, Outline, Sketch, Unknown
from palpate.types.sensor import SensorProfile

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Settings:
    """Settings of the filter of an unknown outline."""

    gauge: tuple[float, float, float] = (1e-4, 1e-4, 1e-4)
    """[m, m, rad] Standard deviations of the pose that defines an object frame."""
    highest: float = 2e-3
    """[m] Height across the curve at the contact from which the curve is made anew."""
    steepest: float = 0.12
    """[rad] Angle between curve and outline at the contact from which the curve is made anew."""
    most_curves: int = 5
    """Curves that a contact may need until heights and angle are small, at its first frame."""
    near: float = 6.0
    """Knots from a contact from which the curve stays as it was while the contact lasts."""
    far: float = 4.0
    """Standard deviations from which what was touched contradicts what was given of the outline."""
    lag: int = 120
    """Steps in a window: what leaves it is linearised once and for all, which makes an outline that is hardly known too
    sure."""
    cone: float = 2.5
    """Factor on the share of the friction cone: where the centre of friction is hardly known, so is the force."""
    contact: float = 4.0
    """Factor on the deviation of contact. Its errors last for a whole contact: the outline, unlike a drawing, takes a
    hundred equal ones for its own form. On tuned recordings the truth is in the 95 % region in 95 % of frames, with 1
    in 40 to 70 %."""
    touch: float = 5.0
    """Factor on the variances of touch, for the same reason."""
    unmodelled: float = 3.0
    """Factor on the standard deviations that are stated of an outline without a drawing, of pose and band alike: on
    tuned pushes of angular and concave objects the errors of corners and of lasting errors of touch exceed those of the
    graph by as much. More noise in the graph makes the errors larger and not the regions honest."""
    widest_gap: float = 0.3
    """Longest part of an outline, as a share of it, that may be a guess between contacts from all sides."""
    pole_off: float = 0.25
    """Distance of a better pole from which it is taken, as a share of the mean distance of the outline from its
    pole."""
    patch: int = 2
    """Points to either side of the place of contact that count as touched."""


_SETTINGS = _Settings()


class UnknownOutlineFilter(MultiHypothesisFilter):
    """Estimates pose and outline of one object; see `MultiHypothesisFilter`."""

    def __init__(
        self,
        given: Unknown | Sketch,
        sensor: SensorProfile,
        settings: TrackerSettings,
        first_pose: Array | None,
        first_covariance: Array,
        may_be_mirrored: bool = False,
    ) -> None:
        """Take what is known of the outline, and the first world_T_object (3,); if None, the first touch defines it."""
        self._sensor = sensor
        self._given = given
        self._outline_prior = outline_prior(given)
        self._first_model = outline_contact_model(self._outline_prior.curve, sensor)
        self._is_placed_by_touch = first_pose is None
        pose = np.zeros(3) if first_pose is None else first_pose
        settings = replace(settings, noise=_of_learnt(settings.noise), hypotheses=1)
        super().__init__(self._first_model, settings, pose, first_covariance, may_be_mirrored, OUTLINE_PUSHING)
        self._lag = max(self._lag, _SETTINGS.lag)

    def begin(self, pose: Array, covariance: Array) -> None:
        """Begin with what is given of the outline, and the object's pose (3,) with its covariance (3, 3)."""
        self._contact_model = self._first_model
        self._usual = object_prior(self._settings.priors, self._compiled.model)
        self._prior = self._usual
        super().begin(pose, covariance)
        rows = self._bank.rows
        joint = rows.belief.covariance[0].copy()
        at = slice(3 + OUTLINE_PLACE.start, 3 + OUTLINE_PLACE.stop)
        joint[at, at] = self._outline_prior.covariance
        self._is_placed = not self._is_placed_by_touch
        if self._is_placed and isinstance(self._given, Unknown):
            joint[:3, :3] = np.diag(np.square(_SETTINGS.gauge))
        belief = replace(rows.belief, covariance=joint[None])
        belief = with_friction(belief, self._first_model.curve, self._usual)
        self._bank.rows = replace(rows, belief=belief)
        deviation = np.sqrt(belief.covariance[0].diagonal()[3:])
        deviation[OUTLINE_PLACE] = OUTLINE.prior[1]  # heights are from the present curve, which says how usual they are
        self._prior = replace(self._usual, deviation=deviation)
        self._weigher = Weigher(self._prior)
        self._use(self._first_model)
        self._is_found = True
        self._has_felt = False  # a direction or a turn
        self._touched_points: Flags = np.zeros(POINTS, np.bool_)

    def step(
        self,
        frame: Frame,
        from_touch: Sequence[Measurement] = (),
        hidden_motion: float = 0.0,
        sunk: float = 0.0,
        fingers: Fingers | None = None,
        of_fingers: Sequence[OfFinger] = (),
    ) -> Posterior:
        """Take a frame of one sensor, and return the posterior with the outline; see `MultiHypothesisFilter`."""
        measured = (*frame.measurements, *from_touch)
        self._has_felt = self._has_felt or any(isinstance(one, ContactDirection | Turn) for one in measured)
        posterior = super().step(frame, from_touch, hidden_motion, sunk, fingers, of_fingers)
        outline = self._outline()
        if isinstance(self._given, Unknown):
            posterior = self._widened(posterior)
        evidence = replace(
            posterior.evidence,
            contradicting_form=self._contradiction(outline),
            unknown_form=self._unknown_form(outline),
        )
        return replace(posterior, outline=outline, evidence=evidence)

    def _contradiction(self, outline: Outline) -> str:
        """Return a sentence if the outline is far from what was given of it; else ""."""
        if not outline.touched.any():
            return ""
        if isinstance(self._given, Unknown):
            largest = self._given.size[1]
            touched = outline.points[outline.touched]
            width = float(np.ptp(touched, axis=0).max()) - _SETTINGS.far * float(
                outline.deviation[outline.touched].max()
            )
            return "" if width <= largest else f"what was touched is over {1e3 * width:.0f} mm wide, more than the size"
        off = np.abs(self._given.shape.signed_distance(outline.points))[outline.touched]
        farthest = int(np.argmax(off))
        if off[farthest] <= _SETTINGS.far * self._given.sigma:
            return ""
        limit = f"{_SETTINGS.far:g} of its sigmas"
        return f"the outline is up to {1e3 * off[farthest]:.0f} mm from its sketch, more than {limit}"

    def _widened(self, posterior: Posterior) -> Posterior:
        """Return a posterior with errors that the graph has no variables for; see `_Settings.unmodelled`."""
        variance = _SETTINGS.unmodelled**2
        evidence = posterior.evidence
        position = _SETTINGS.unmodelled * evidence.position_deviation
        yaw = _SETTINGS.unmodelled * evidence.yaw_deviation
        is_beyond = 2.0 * position > self._tolerance.length or 2.0 * yaw > self._tolerance.angle
        return replace(
            posterior,
            covariances=variance * posterior.covariances,
            covariance=variance * posterior.covariance,
            evidence=replace(evidence, position_deviation=position, yaw_deviation=yaw, is_beyond_tolerance=is_beyond),
        )

    def _unknown_form(self, outline: Outline) -> str:
        """Return a sentence if too little is known of the outline; else ""."""
        if isinstance(self._given, Sketch):
            return ""
        if not self._has_felt:
            return LACKS_DIRECTIONS
        gap = _widest_gap(outline)
        if gap > 0.5:
            return "the contacts so far enclose nothing: over half of the outline is a guess"
        if gap > _SETTINGS.widest_gap:
            return f"{gap:.0%} of the outline, all on one side, were not touched and are a guess"
        band = 2.0 * float(np.sqrt(np.mean(np.square(outline.deviation[outline.touched]))))
        if band > self._tolerance.length:
            return f"the outline is known to {1e3 * band:.0f} mm where it was touched"
        return ""

    def _outline(self) -> Outline:
        """Return the outline of the best hypothesis with its band."""
        belief = self._bank.rows.belief
        curve = self._contact_model.curve.moved(belief.values[0, OUTLINE_PLACE])
        nearest = np.rint(curve.evenly()).astype(int) % POINTS
        points = curve.points[nearest]
        deviation = deviation_at_points(belief.covariance[0], curve)
        if isinstance(self._given, Unknown):
            deviation = _SETTINGS.unmodelled * deviation
        at = np.column_stack((points.real, points.imag))
        return Outline(at, deviation[nearest], self._touched_points[nearest])

    def _use(self, model: OutlineContactModel) -> None:
        """Take another contact model."""
        self._contact_model = model
        self._settings_record = settings_record(self._settings, model)
        self._monitor = ConsistencyMonitor(model, self._settings, self._prior)
        self._graph = Graph(self._settings_record, model, self._own, self._compiled)

    def _begin_contact(self, step: Step) -> bool:
        if not self._is_placed:
            self._place(step)
        self._take_over(self._bank.rows.belief.values[0, OUTLINE_PLACE], may_move_pole=True)
        rows = self._bank.rows
        belief = with_friction(rows.belief, self._contact_model.curve, self._usual)
        self._bank.rows = replace(rows, belief=belief)
        return super()._begin_contact(step)

    def _begin_window(self, step: Step) -> None:
        """Begin the graph of a contact, anew from a nearer curve until heights and angle at the contact are small."""
        for _ in range(_SETTINGS.most_curves):
            super()._begin_window(step)
            window = self._bank.window
            assert window is not None
            if window.rows["is_lost"][0] or not self._is_far(window):
                break
            self._take_over(window.belief().values[0, OUTLINE_PLACE])
        self._mark()

    def _continue_contact(self, step: Step, window: ContactWindow) -> bool:
        measures_pose = super()._continue_contact(step, window)
        if self._is_far(window):
            near = _near(int(window.last(0)["touch"]["knot"]) + 1)
            heights = near * window.belief().values[0, OUTLINE_PLACE]
            change = changed_outline(self._contact_model, heights, self._sensor)
            self._use(change.model)
            window.change_outline(change, self._settings_record)
        self._mark()
        return measures_pose

    def _with_places(self, rows: Hypotheses, step: Step) -> Hypotheses:
        return replace(rows, belief=rows.belief.inflated(np.diag(np.square(self._settings.first_pose.rest))))

    def _place(self, step: Step) -> None:
        """Put the object where it is touched first, in all hypotheses."""
        rows = self._bank.rows
        directions = step.directions(rows.belief, rows.touch_sign)
        ahead = directions[0][0] if directions else np.zeros(len(rows))
        radius = abs(self._first_model.curve.points[POINTS // 2])
        tip = se2.transform(step.sensor_pose, self._sensor.center)
        way = step.sensor_pose[2] + ahead
        reach = self._sensor.radius + radius
        pose = np.column_stack((tip[0] + reach * np.cos(way), tip[1] + reach * np.sin(way), way))
        joint = rows.belief.covariance.copy()
        joint[:, :3, :3] = np.diag(np.square(_SETTINGS.gauge))
        self._bank.rows = replace(rows, belief=replace(rows.belief, pose=pose, covariance=joint))
        self._is_placed = True

    def _is_far(self, window: ContactWindow) -> bool:
        """Return True if the outline at the contact of the best hypothesis is far from the curve, or turned."""
        touch = window.last(0)["touch"]
        heights = window.rows["shared"][0, -(OUTLINE_PLACE.stop - OUTLINE_PLACE.start) :]
        knots = (int(touch["knot"]) + np.arange(4)) % len(heights)
        height = float(touch["weights"] @ heights[knots])
        reach = abs(complex(touch["point"]) - self._contact_model.curve.pole)
        per_knot = max(reach, _SETTINGS.highest) * 2.0 * np.pi / len(heights)
        slope = float(touch["slopes"] @ heights[knots]) / per_knot
        return abs(height) > _SETTINGS.highest or abs(slope) > _SETTINGS.steepest

    def _take_over(self, heights: Array, may_move_pole: bool = False) -> None:
        """Make the curve anew with these heights (K,), and let the beliefs before this contact read by it."""
        if not heights.any():
            return
        pole = self._better_pole(heights) if may_move_pole else None
        change = changed_outline(self._contact_model, heights, self._sensor, pole)
        self._bank.rows = replace(self._bank.rows, belief=change.belief(self._bank.rows.belief))
        if pole is not None:
            before = self._contact_model.curve
            angle = np.angle(change.model.curve.points - before.pole)
            self._touched_points = self._touched_points[np.rint(angle * (POINTS / (2.0 * np.pi))).astype(int) % POINTS]
        self._use(change.model)

    def _better_pole(self, heights: Array) -> complex | None:
        """Return a pole from which the outline with these heights (K,) is seen better; None if the present one is."""
        curve = self._contact_model.curve.moved(heights)
        pole = best_pole(curve.points, complex(*curve.shape.centroid.tolist()))
        limit = _SETTINGS.pole_off * float(np.mean(curve.radii))
        return pole if abs(pole - curve.pole) > limit else None

    def _mark(self) -> None:
        """Mark the place of contact of the best hypothesis as touched."""
        window = self._bank.window
        if window is None:
            return
        point = complex(window.last(0)["touch"]["point"])
        nearest = int(np.rint(np.angle(point - self._contact_model.curve.pole) * (POINTS / (2.0 * np.pi))))
        self._touched_points[(nearest + np.arange(-_SETTINGS.patch, _SETTINGS.patch + 1)) % POINTS] = True


def _near(knot: int) -> Array:
    """Return the shares (K,) of heights that a contact at a knot shows: all near it, none far away."""
    apart = np.abs((np.arange(KNOTS) - knot + KNOTS // 2) % KNOTS - KNOTS // 2)
    return np.clip((_SETTINGS.near - apart) / (0.5 * _SETTINGS.near), 0.0, 1.0)


def _of_learnt(noise: NoiseSettings) -> NoiseSettings:
    """Return the noise of an outline that is a variable."""
    cone = noise.friction_cone
    return replace(
        noise,
        contact=replace(noise.contact, deviation=_SETTINGS.contact * noise.contact.deviation),
        direction=replace(noise.direction, share=_SETTINGS.touch * noise.direction.share),
        place=replace(noise.place, share=_SETTINGS.touch * noise.place.share),
        friction_cone=cone if cone.share is None else replace(cone, share=_SETTINGS.cone * cone.share),
    )


def _widest_gap(outline: Outline) -> float:
    """Return the longest part of an outline that was not touched, as a share of it."""
    places = np.flatnonzero(outline.touched)
    if not len(places):
        return 1.0
    gaps = np.diff(np.append(places, places[0] + len(outline.touched)))
    return float(gaps.max()) / len(outline.touched)
