"""Contact: the sensor's surface is on the outline, up to a depth by which it overlaps (paper Eq. 11, two-sided).

The residual is `gap + depth - scale reach` [m]: positive where sensor and object are further apart than the depth says,
negative where they overlap more. The gap is the outline's signed distance at the tip's centre of curvature less the
tip's radius; of several parts it is that of those which bear the load, see `contact_model`. The reach is how far the
outline is from its centroid along its normal; an object that is larger than its outline by a small share, the scale,
reaches farther by that share.
"""

from palpate.config import ContactSettings
from palpate.filter.belief import Prior
from palpate.graph.compiled import Array, Complex, Given, Places, Records, compiled
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.factor import NOTHING, Factor, Step, Terms, kernel_scale, term_now
from palpate.graph.se2_kernels import cauchy, dot
from palpate.graph.values import State
from palpate.graph.variables import DEPTH, IN_SHARED, OUTLINE_SCALE, SENSOR_IN_OBJECT

_DEPTH, _SCALE = IN_SHARED[DEPTH].start, IN_SHARED[OUTLINE_SCALE].start


@compiled
def _linearise(
    state: State,
    places: Places,
    data: Records,
    given: Given,
    residual: Array,
    jacobian: Array,
    information: Array,
    weight: Array,
) -> None:
    g, _e, shared, touching, _angle, _c, model_center, _knocks = state
    inverse_variance, kernel = given
    for b in range(len(g)):
        scale = shared[_SCALE, b]
        for t in range(len(places)):
            touch = touching[b, places[t, 0]]
            arm = touch.point - model_center
            reach = dot(touch.normal, arm) - touch.gap
            residual[b, t, 0] = touch.gap + shared[_DEPTH, b] - scale * reach
            for k in range(3):
                reach_by = dot(touch.normal_by_g[k], arm) + dot(touch.normal, touch.point_by_g[k]) - touch.gap_by_g[k]
                jacobian[b, t, 0, k] = touch.gap_by_g[k] - scale * reach_by
            jacobian[b, t, 0, 3], jacobian[b, t, 0, 4] = 1.0, -reach
            information[b, t, 0] = inverse_variance
            weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * residual[b, t, 0] ** 2, kernel)


def reaches(model: ContactModel, points: Complex, normals: Complex) -> Array:
    """Return how far the outline is from its centroid along its outward normals (N,) at its points (N,) [m]."""
    return (normals.conjugate() * (points - model.friction_center)).real


def overlap(prior: Prior, reach: Array) -> Array:
    """Return how far the tip is in the outline (N,) [m] where it touches the object, by what is believed of both.

    `reach` (N,) [m] is how far the outline is from its centroid there; see `reaches`.
    """
    return prior[DEPTH][0] - prior[OUTLINE_SCALE][0] * reach


class Contact(Factor):
    """One term a step: sensor and object touch."""

    name = "contact"
    steps = ((SENSOR_IN_OBJECT,),)
    shared = (DEPTH, OUTLINE_SCALE)
    rows = 1
    data = NOTHING
    kernel = _linearise

    def __init__(self, settings: ContactSettings) -> None:
        self.given = settings.deviation**-2.0, kernel_scale(settings.kernel)

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return term_now()
