"""Contact of a flat pad and of several tips with an outline, and the place on a pad that touch measures."""

import math

import numpy as np
import pytest
from push_samples import rows_of, values_at, with_settings

from palpate import GELSIGHT_MINI, ContactPlace, Disc, Ellipse, EstimationError, NoiseSettings, Rectangle, SensorProfile
from palpate.geometry import se2
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.contact_geometry import contact_model
from palpate.models.pushing.graph import Graph
from palpate.models.pushing.layout import IN_OBJECT, column
from palpate.models.pushing.measurements import Step
from palpate.models.pushing.priors import object_prior
from palpate.models.pushing.settings import settings_record
from palpate.models.pushing.variables import PLACE_BIAS
from palpate.models.pushing.window import ContactWindow

SQUARE = contact_model(Rectangle(0.09, 0.09), GELSIGHT_MINI)
DISC = contact_model(Disc(0.05), GELSIGHT_MINI)
HALF = 0.5 * GELSIGHT_MINI.flat_width
FINGERS = contact_model(Rectangle(0.09, 0.09), SensorProfile("hand", radius=0.0025, tips=((0.0, 0.01), (0.001, -0.01))))


def touch(model, *pose):
    return model.touching(np.array(pose, np.float64)[None, None])[0, 0]


def test_flush_on_a_side_it_is_touched_in_the_middle_and_leaning_at_its_edge():
    flush = touch(SQUARE, -0.045, 0.01, 0.0)
    assert flush["gap"] == pytest.approx(0.0, abs=1e-7)
    assert flush["material"] == pytest.approx(0.0, abs=1e-7)
    assert flush["point"] == pytest.approx(-0.045 + 0.01j, abs=1e-7)
    places = [touch(SQUARE, -0.045, 0.01, math.radians(tilt))["material"].imag for tilt in (0.2, 1.0, 5.0, 12.0)]
    # Turned counter-clockwise the right edge, which is at -y, comes to the side first.
    assert np.all(np.diff(places) < 0.0)
    assert -HALF < places[-1] < -0.8 * HALF
    # Little tilted, the centre moves as an elastic foundation's of that depth does: by theta h^2 / (3 depth).
    assert places[0] == pytest.approx(-math.radians(0.2) * HALF**2 / (3.0 * 2e-4), rel=0.2)
    for tilt in (-12.0, -3.0, 3.0):
        found = touch(SQUARE, -0.045, 0.01, math.radians(tilt))
        assert np.angle(-found["normal"]) == pytest.approx(0.0, abs=1e-6)


def test_a_round_outline_is_touched_where_it_lies_on_the_pad():
    for y in (-0.003, 0.0, 0.002):
        found = touch(DISC, -0.05, -y, 0.0)
        assert found["material"].imag == pytest.approx(y, abs=4e-4)
        assert abs(found["normal"]) == pytest.approx(1.0, abs=0.01)
    # Beyond the flat part the edge is round: its centre is 2 mm behind the front.
    beyond = touch(DISC, -0.05, -HALF - 0.02, 0.0)
    at_edge = np.hypot(-0.052, -0.02) - 0.052
    assert at_edge < beyond["gap"] < at_edge + 2e-4 * math.log(15)


def test_fingers_bear_the_more_the_deeper_they_are():
    # The second finger stands 1 mm ahead, 0.2 mm in the side: it bears e^2 times as much as the first, 0.8 mm off it.
    s = 2e-4
    both = touch(FINGERS, -0.0458, 0.0, 0.0)
    first = 1.0 / (1.0 + math.exp(1e-3 / s))
    assert both["gap"] == pytest.approx(-s * math.log(0.5 * (math.exp(-0.8e-3 / s) + math.exp(0.2e-3 / s))), abs=1e-7)
    assert both["material"] == pytest.approx(first * 0.01j + (1.0 - first) * (0.001 - 0.01j), abs=1e-7)
    # One that is beyond the side's end, many times s off, bears nothing.
    alone = touch(FINGERS, -0.045, -0.053, -0.1)
    assert alone["material"].imag == pytest.approx(0.01, abs=5e-4)


@pytest.mark.parametrize("model", [SQUARE, DISC, FINGERS, contact_model(Ellipse(0.105, 0.131), GELSIGHT_MINI)])
def test_derivatives(model):
    def numbers(pose):
        found = touch(model, *pose)
        return np.array([found["gap"], *(found[name] for name in ("point", "material", "normal"))])

    rng = np.random.default_rng(0)
    for _ in range(20):
        start = np.array([-0.0455, rng.uniform(-0.02, 0.02), rng.uniform(-0.1, 0.1)])
        found = touch(model, *start)
        for axis in range(3):
            step = 1e-6 * np.eye(3)[axis]
            ahead, behind = (se2.compose(start, se2.exp(sign * step)) for sign in (1.0, -1.0))
            by = [found[f"{name}_by_g"][axis] for name in ("gap", "point", "material", "normal")]
            np.testing.assert_allclose((numbers(ahead) - numbers(behind)) / 2e-6, by, rtol=1e-3, atol=2e-4)


def test_the_factor_of_the_place():
    g = np.array([[[-0.05, -0.003, 0.02]]])
    noise = with_settings(NoiseSettings(), place={"share": 4.0, "kernel": None})
    at = values_at(DISC, g, shared={PLACE_BIAS: 3e-4})
    rows = rows_of("place", at, [ContactPlace(0.001, 1e-6)], noise=noise)
    assert rows.residual[0, 0, 0] == pytest.approx(touch(DISC, *g[0, 0])["material"].imag + 3e-4 - 0.001)
    np.testing.assert_allclose(rows.jacobian[0, 0, 0, 6:9], touch(DISC, *g[0, 0])["material_by_g"].imag)
    assert rows.jacobian[0, 0, 0, column(PLACE_BIAS)] == 1.0
    assert rows.weight[0, 0, 0] == pytest.approx(1.0 / 4e-6)
    with pytest.raises(EstimationError, match="ContactPlace has place nan"):
        ContactPlace(math.nan, 1.0)


def test_what_all_places_are_off_by_is_learnt_where_the_pose_is_known():
    """A pad pushes a disc straight ahead, known to 0.1 mm, and all places are told 1 mm too large."""
    settings = NoiseSettings()
    sure = np.concatenate([[1e-4, 1e-4, 1e-3], object_prior(settings.priors).deviation])
    first, way = np.array([-0.05, 0.0, 0.0]), np.array([1e-3, 0.0, 0.0])
    belief = Belief(np.zeros((1, 3)), object_prior(settings.priors).mean[None], np.diag(sure**2)[None])
    said = [ContactPlace(touch(DISC, *first)["material"].imag + 1e-3, 1e-8)]
    contact = ContactWindow(Graph(settings_record(settings, DISC), DISC), belief, Step(first, said))
    for step in range(1, 8):
        contact.add(Step(first + step * way, said))
    known = contact.belief()
    bias, of_bias = known[PLACE_BIAS][0, 0], 3 + IN_OBJECT[PLACE_BIAS].start
    assert bias == pytest.approx(1e-3, abs=1e-4)
    assert math.sqrt(known.covariance[0, of_bias, of_bias]) < 0.3 * settings.priors.place_bias[1]
    assert known.pose[0, 1] == pytest.approx(0.0, abs=1e-4)
