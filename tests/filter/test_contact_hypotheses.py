"""How answers begin a contact: weighed by how likely each is touched so until the object is found, and not after."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from push_samples import model_of, pushed
from tracker_samples import CALIBRATED

from palpate.filter.contact_hypotheses import Beginning, ways_to_begin, ways_to_begin_unfound
from palpate.filter.estimator import Estimator
from palpate.filter.hypothesis_bank import Hypotheses
from palpate.geometry import se2
from palpate.types.measurements import ContactDirection

Array = np.ndarray
MODEL = model_of("rectangle")
SURE, ROUGH = (1e-3, 1e-3, 0.01), (0.03, 0.03, 0.5)
Begin = Callable[..., list[Beginning]]


def sensed() -> tuple[Array, Array, list[ContactDirection]]:
    """Poses of object and sensor at the first frame of a push on the left side, and what is felt."""
    o, e = pushed("rectangle", 1)
    normal = MODEL.touching_at(se2.between(o[0], e[0]))["normal"]
    yaw = se2.between(o[0], e[0])[2]
    return o[0], e[0], [ContactDirection(float(np.angle(-normal * np.exp(-1j * yaw))), 1e-3)]


def answer(off: Any, deviation: Any) -> Estimator:
    return Estimator(MODEL, CALIBRATED, "fixed-lag", se2.compose(sensed()[0], off), np.array(deviation))


def began(begin: Begin, *answers: tuple[Estimator, float]) -> list[Beginning]:
    _, sensor_pose, felt = sensed()
    return begin(answers, MODEL, sensor_pose, felt)


def test_an_answer_counts_by_how_likely_it_is_touched_so_until_the_object_is_found():
    wrong, right, along = (answer((*off, 0.0), (3e-3, 3e-3, 0.02)) for off in ((0.008, 0.0), (0.0, 0.0), (0.0, 0.01)))
    ways = {one.of: one for one in began(ways_to_begin_unfound, (wrong, 0.5), (right, 0.0), (along, 0.0))}
    assert len(ways) == 3 and not any(one.is_place for one in ways.values())
    # Moved along the side it is touched as before; across it, by hand of standard deviations of 3 mm twice, it is not.
    assert abs(ways[1].log_prior) < 1.0 and abs(ways[2].log_prior - ways[1].log_prior) < 0.5
    assert ways[0].log_prior - 0.5 - ways[1].log_prior == pytest.approx(-0.5 * 8**2 / (3**2 + 3**2), abs=0.3)
    # Once it was found each goes on as it was.
    ways = began(ways_to_begin, (wrong, 0.5), (right, 0.0))
    assert [(one.of, one.log_prior, one.prior, one.is_place) for one in ways] == [
        (0, 0.5, None, False),
        (1, 0.0, None, False),
    ]


def test_a_touch_where_it_cannot_be_leaves_an_answer_alive():
    far = [began(ways_to_begin_unfound, (answer((off, 0.0, 0.0), SURE), 2.0)) for off in (0.3, 0.5)]
    assert {max(one.log_prior for one in ways if not one.is_place) for ways in far} == {2.0 - 12.0}


@pytest.mark.parametrize("begin", [ways_to_begin, ways_to_begin_unfound])
def test_one_known_roughly_begins_at_several_places_likely_ones_first(begin):
    ways = began(begin, (answer((0.0, 0.0, 0.0), ROUGH), 0.0))
    log_prior = [one.log_prior for one in ways]
    assert 3 < len(ways) <= 20 and log_prior == sorted(log_prior, reverse=True)
    assert sum(one.is_place for one in ways) >= len(ways) - 1


def test_beginnings_at_the_same_pose_become_one():
    one, same = (answer((0.0, 0.0, 0.0), SURE) for _ in range(2))
    (alone,) = began(ways_to_begin_unfound, (one, 0.0))
    (both,) = began(ways_to_begin_unfound, (one, 0.0), (same, -1.0))
    assert both.of == 0
    assert both.log_prior == pytest.approx(alone.log_prior + np.log1p(np.exp(-1.0)))
    assert len(began(ways_to_begin, (one, 0.0), (same, -1.0))) == 2


@pytest.mark.parametrize(("deviation", "counts"), [(SURE, False), (ROUGH, True)])
def test_only_a_rough_first_pose_counts_until_there_is_one_sure_answer(monkeypatch, deviation, counts):
    weighed: list[int] = []

    def ways_and_count(answers: Any, *given: Any) -> list[Beginning]:
        weighed.append(len(answers))
        return ways_to_begin_unfound(answers, *given)

    monkeypatch.setattr("palpate.filter.hypothesis_bank.ways_to_begin_unfound", ways_and_count)
    o, e = pushed("rectangle", 12)
    together = Hypotheses(MODEL, CALIBRATED, "fixed-lag", o[0], np.array(deviation), 9)
    _, _, felt = sensed()
    for contact in range(2):
        for frame, pose in enumerate(e):
            together.touch(pose, felt, 0.1 * frame)
        together.end_contact()
        assert len(weighed) == (contact + 1 if counts else 0)
    # With one sure answer left, it is found: from the next contact on nothing of the kind counts.
    together._all = together._all[:1]
    together._best.estimator = answer((0.0, 0.0, 0.0), SURE)
    for frame, pose in enumerate(e):
        together.touch(pose, felt, 0.1 * frame)
    together.end_contact()
    before = len(weighed)
    together.touch(e[0], felt, 0.0)
    assert len(weighed) == before
