"""Innovations: measured against what is predicted without the measurement, and scores of stated variances."""

import math

import numpy as np
import pytest
from push_samples import contact_directions, frames, model_of, pushed, sensor
from tracker_samples import SHAPES, settings

from palpate import ContactDirection, Estimate, Measurement, ObjectPose, OwnMeasurement, Tracker, Turn
from palpate.geometry import se2
from palpate.models.pushing.layout import NAMES
from palpate.pipeline.metrics import innovation_scores

OWN, OBJECT_POSE, CONTACT = map(NAMES.index, ("own", "object_pose", "contact"))


class SeenAtX(OwnMeasurement):
    on = ("object_pose",)

    def __init__(self, x: float) -> None:
        self.x = x

    def residual(self, pose: np.ndarray) -> np.ndarray:
        return (pose[:1] - self.x) / 1e-3  # to a millimetre


def tracked(o: np.ndarray, e: np.ndarray, said: dict[int, list[Measurement]]) -> list[Estimate]:
    tracker = Tracker(SHAPES["rectangle"], sensor(), o[0], settings("none", hypotheses=1))
    return [tracker.update(frame, said.get(k, [])) for k, frame in enumerate(frames(o, e))]


def test_an_innovation_is_of_what_is_predicted_without_the_measurement():
    o, e = pushed(steps=30)
    without = tracked(o, e, {})[-1]
    found = tracked(o, e, {30: [SeenAtX(o[30, 0] + 2e-3)]})[-1]
    turn = se2.rotation(without.pose[2])
    variance = (turn @ without.covariance[:2, :2] @ turn.T)[0, 0]
    assert found.innovations is not None and without.innovations is not None
    difference, predicted, stated = found.innovations[OWN, 0]
    assert difference == pytest.approx((without.pose[0] - o[30, 0]) / 1e-3 - 2.0, rel=1e-3)
    assert (predicted, stated) == (pytest.approx(variance / 1e-6, rel=1e-3), 1.0)
    assert not without.innovations[OWN].any() and without.innovations[CONTACT, 0, 2]


def test_a_late_pose_counts_when_it_arrives():
    o, e = pushed(steps=30)
    estimates = tracked(o, e, {25: [ObjectPose(o[20], 1e-6 * np.eye(3), 20 / 30)]})
    stated = np.array([one.innovations[OBJECT_POSE, :, 2] for one in estimates])  # pyright: ignore[reportOptionalSubscript]
    assert stated[25].tolist() == [1.0] * 3 + [0.0] * 3 and not np.delete(stated, 25, axis=0).any()


@pytest.mark.parametrize("factor", [0.1, 1.0, 10.0])
def test_variances_that_are_stated_ten_times_too_small_or_large_are_told(factor):
    o, e = pushed(steps=200)
    rng, g, sigma = np.random.default_rng(4), se2.between(o, e), math.radians(2.0)
    angles = np.stack([contact_directions(g, model_of("rectangle")), g[:, 2]], axis=1) + rng.normal(0, sigma, (201, 2))
    stated = factor * sigma**2
    said = {k: [ContactDirection(way, stated), Turn(turn, stated)] for k, (way, turn) in enumerate(angles.tolist())}
    scores = innovation_scores([one.innovations for one in tracked(o, e, said)])
    for name in ("direction", "turn"):
        ratio, autocorrelation = scores[name]["variance_ratio"], scores[name]["autocorrelation"]
        assert ratio is not None and 0.6 < factor * ratio < 1.6
        assert autocorrelation is not None and abs(autocorrelation) < 0.25
    assert scores["contact"]["count"] == 201 and scores["sticking"]["count"] == 400


def test_scores_by_hand():
    table = np.zeros((3, len(NAMES), 6, 3))
    table[:, OWN, 0] = [(1.0, 0.0, 1.0), (2.0, 3.0, 1.0), (-8.0, 15.0, 1.0)]  # 1, 1 and -2 in units of both
    wanted = {"count": 3, "mean_square": 2.0, "variance_ratio": 23.0, "autocorrelation": pytest.approx(-0.25)}
    assert innovation_scores([*table, None]) == {"own": wanted} and innovation_scores([None]) == {}
