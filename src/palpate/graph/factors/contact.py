"""Contact: the sensor's surface lies on the outline, except for an indentation (paper Eq. 11, two-sided).

The residual is `gap + depth - scale reach` [m]: positive if sensor and object are further apart than the indentation
says. The gap is the outline's signed distance at the tip's centre of curvature minus the tip's radius; with several
parts it is the load-weighted one, see `ContactModel`. The reach is the distance of the outline from its centroid along
its normal: an object larger than its outline by a small relative scale reaches farther by that share.
"""

from palpate.config import ContactSettings
from palpate.graph.belief import Belief
from palpate.graph.compiled import Array, Complex, Integers, Records, compiled
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.factor import Factor, Linear, Step, Terms, kernel_scale, term_now
from palpate.graph.se2_kernels import cauchy, dot
from palpate.graph.values import State
from palpate.graph.variables import DEPTH, IN_SHARED, OUTLINE_SCALE, SENSOR_IN_OBJECT

_DEPTH, _SCALE = IN_SHARED[DEPTH].start, IN_SHARED[OUTLINE_SCALE].start


@compiled
def _linearise(state: State, step: Integers, data: Records, given: tuple[float, float], out: Linear) -> None:
    inverse_variance, kernel = given
    for b in range(len(state.sign)):
        scale = state.shared[b, _SCALE]
        for t in range(len(step)):
            touch, row = state.contact[b, step[t]], out.jacobian[b, t, 0]
            arm = touch.point - state.centroid
            reach = dot(touch.normal, arm) - touch.gap
            error = touch.gap + state.shared[b, _DEPTH] - scale * reach
            for c in range(3):
                reach_by = dot(touch.normal_by_g[c], arm) + dot(touch.normal, touch.point_by_g[c]) - touch.gap_by_g[c]
                row[c] = touch.gap_by_g[c] - scale * reach_by
            row[3], row[4] = 1.0, -reach
            out.residual[b, t, 0] = error
            out.information[b, t, 0] = inverse_variance
            out.weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * error**2, kernel)


def reaches(model: ContactModel, points: Complex, normals: Complex) -> Array:
    """Return the distance (N,) [m] of outline points (N,) from the centroid along their outward normals (N,)."""
    return (normals.conjugate() * (points - model.friction_center)).real


def overlap(belief: Belief, reach: Array) -> Array:
    """Return the believed overlap (B,) [m] of tip and outline in contact, where the outline has this reach (B,) [m]."""
    return belief[DEPTH][:, 0] - belief[OUTLINE_SCALE][:, 0] * reach


class Contact(Factor):
    """One term a step."""

    name = "contact"
    on = (SENSOR_IN_OBJECT,)
    shared = (DEPTH, OUTLINE_SCALE)
    rows = 1
    kernel = _linearise

    def __init__(self, settings: ContactSettings) -> None:
        self.given = settings.deviation**-2.0, kernel_scale(settings.kernel)

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return term_now()
