"""When pushing is in doubt, and in which of several hypotheses."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from push_samples import RADIUS, SHAPES, sensor

from palpate.config import NoiseSettings
from palpate.filter import hypothesis_bank as hypotheses
from palpate.filter.disturbance import ALARM_DEAD_STEPS, is_contradicted, is_doubtful
from palpate.filter.estimator import Estimator
from palpate.filter.hypothesis_bank import Hypotheses
from palpate.filter.weighing import Hypothesis, Weighing
from palpate.geometry.shapes import Rectangle
from palpate.graph.contact_geometry import contact_model


def estimator(measured: Any = (), pushing: Any = (), errors: Any = ()) -> Any:
    """One whose last steps cost so much, and whose factors have these mean square errors, each over so many steps."""
    measured = np.asarray(measured, np.float64)
    costs = np.column_stack((measured, np.broadcast_to(np.asarray(pushing or 0.0, np.float64), len(measured))))
    return SimpleNamespace(costs=lambda: costs, mean_square=lambda name, steps: dict(errors).get((name, steps), 0.0))


@pytest.mark.parametrize(
    ("measured", "is_in_doubt"), [([0.5] * 9 + [0.9], False), ([0.1] * 5 + [0.1, 2.8, 0.1, 0.1, 0.1], True)]
)
def test_what_all_that_is_measured_costs_in_five_steps_raises_an_alarm(measured, is_in_doubt):
    assert is_contradicted(estimator(measured), 10) == is_in_doubt
    # What pushing costs does not, nor what is long past, nor a contact that has just begun.
    assert not is_contradicted(estimator([0.1] * 10, pushing=9.0), 10)
    assert not is_contradicted(estimator([9.0, *[0.1] * 5]), 6)
    assert not is_contradicted(estimator([9.0] * 4), 4)


def test_one_factor_alone_raises_an_alarm():
    for name, steps, error in (("relative_pose", 5, 0.14), ("direction", 30, 0.06), ("sticking", 5, 31.0)):
        told = estimator([0.0] * 30, errors={(name, steps): error}.items())
        assert is_contradicted(told, 30) and not is_contradicted(told, steps - 1)


def test_other_answers_are_looked_at_before_touch_and_pushing_contradict_each_other():
    told = {error: estimator([0.0] * 30, errors={("direction", 30): error}.items()) for error in (0.02, 0.03, 0.06)}
    assert [is_doubtful(one, 30) for one in told.values()] == [False, True, True]
    assert [is_contradicted(one, 30) for one in told.values()] == [False, False, True]
    assert not is_doubtful(told[0.03], 29)
    assert is_doubtful(estimator([3.5, *[0.0] * 4]), 5)  # what contradicts is doubtful


def test_every_likely_hypothesis_is_watched_the_likeliest_first(monkeypatch):
    # The best one may be a way past an object at rest, which nothing contradicts.
    model = contact_model(SHAPES["rectangle"], sensor())
    bank = Hypotheses(model, NoiseSettings(), "fixed-lag", np.zeros(3), np.full(3, 1e-3), 9)
    found: list[Any] = []
    monkeypatch.setattr(hypotheses, "is_doubtful", lambda one, steps: one.contradicted)
    monkeypatch.setattr(hypotheses, "knock_hypotheses", lambda one, steps, priors: found.append(one) or [])

    def one(weight: float, contradicted: bool, knock_steps_left: int = 0) -> Any:
        return Hypothesis(SimpleNamespace(contradicted=contradicted), knock_steps_left=knock_steps_left, weight=weight)  # pyright: ignore[reportArgumentType]

    best, being_moved, second, third, unlikely = (
        one(0.4, False),
        one(0.2, True, knock_steps_left=2),
        one(0.2, True),
        one(0.15, True),
        one(0.05, True),
    )
    bank._all = [best, being_moved, second, third, unlikely]
    bank._steps = 20
    for _ in range(3):
        bank._doubt_pushing()
    assert found == [second, third]  # one a frame; the same hand raises no second alarm
    bank._steps += ALARM_DEAD_STEPS
    bank._doubt_pushing()
    assert found == [second, third, second]


def test_images_are_judged_by_the_answer_in_which_nothing_moved_the_object(monkeypatch):
    # The best answer may be one in which something did, which explains away what mirrored images contradict.
    model = contact_model(SHAPES["rectangle"], sensor())
    bank = Hypotheses(model, NoiseSettings(), "fixed-lag", np.zeros(3), np.full(3, 1e-3), 9)
    monkeypatch.setattr(hypotheses, "is_contradicted", lambda one, steps: one.contradicted)

    def one(contradicted: bool, without_pushing: list[tuple[int, int]]) -> Any:
        return Hypothesis(SimpleNamespace(contradicted=contradicted), without_pushing=without_pushing)  # pyright: ignore[reportArgumentType]

    bank._all = [one(False, [(3, 13)]), one(True, [])]
    assert bank.is_contradicted
    bank._all = [one(True, [(3, 13)]), one(False, [])]
    assert not bank.is_contradicted
    bank._all = [one(True, [(3, 13)]), one(False, [(2, 12)])]  # all are disturbed: the likeliest
    assert bank.is_contradicted


def test_a_sensor_pushes_rather_than_glides_past_an_object_at_rest():
    # It goes straight on, without a word of touch: into the left side of one object, along the lower side of the other.
    settings, model = NoiseSettings(), contact_model(Rectangle(0.24, 0.16), sensor())
    poses = [[0.12 + RADIUS, 0.0, 0.0], [0.0, 0.08 + RADIUS, 0.0]]
    ways = [
        Hypothesis(Estimator(model, settings, "fixed-lag", np.array(pose), np.array([1e-3, 1e-3, 1e-2])))
        for pose in poses
    ]
    for step in range(40):
        for one in ways:
            one.estimator.touch(np.array([2e-3 * step, 0.0, 0.0]), (), step / 30.0)
    pushed, passed = (one.estimator.known.pose for one in ways)
    assert pushed[0] > poses[0][0] + 0.03 and abs(passed[0]) < 0.01  # one moves, the other rests
    better, worse = Weighing(settings.priors).scores(ways, 40)
    assert better > worse + 5.0
