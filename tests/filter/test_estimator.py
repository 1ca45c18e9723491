"""Contacts and rests one after the other: what passes from one to the next, and what a graph is given."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from push_samples import SHAPES, frames, in_two_contacts, model_of, sensor
from smoother_samples import ROBUST, contact, felt
from tracker_samples import SMOOTHERS, settings

from palpate.errors import EstimationError
from palpate.filter.belief import Belief, Prior
from palpate.filter.estimator import Estimator
from palpate.geometry import se2
from palpate.graph.smoother import BeginContact, Smoother, make_smoother
from palpate.graph.variables import GRIP
from palpate.tracker import Tracker
from palpate.types.frame import Frame
from palpate.types.measurements import ContactDirection, Measurement, ObjectPose, RelativePoses, Turn

Array = np.ndarray
Said = Sequence[Measurement]
FIRST = np.array(ROBUST.first_pose.deviation)
CALIBRATION = np.diag(np.square(ROBUST.sensor_pose.calibration))


class Told:
    """A touch that says what it is told for each frame of a contact, whatever the image."""

    def __init__(self) -> None:
        self.age, self.ends = -1, 0

    def measure(self, frame: Frame) -> Said:
        self.age += 1
        pair = (RelativePoses(np.array([1]), np.zeros((1, 3)), np.eye(3)[None]),) if self.age else ()
        return (ContactDirection(0.1, 1.0 + self.age), Turn(0.2, 1.0 + self.age), *pair)

    def end_contact(self) -> None:
        self.age, self.ends = -1, self.ends + 1


class Noting:
    """Smoothers that keep what they are given, the third `add` of which fails."""

    def __init__(self, begin: BeginContact) -> None:
        self.begin = begin
        self.begun: list[Said] = []
        self.priors: list[Prior] = []
        self.added: list[Said] = []
        self.times: list[float] = []

    def __call__(self, prior: Prior, sensor_pose: Array, said: Said, time: float) -> Smoother:
        self.begun.append(said)
        self.priors.append(prior)
        self.times.append(time)
        return Noted(self, self.begin(prior, sensor_pose, said, time))


class Noted:
    def __init__(self, noting: Noting, smoother: Smoother) -> None:
        self.noting, self.smoother = noting, smoother

    def add(self, sensor_pose: Array, measurements: Said = (), time: float = 0.0) -> None:
        self.noting.added.append(measurements)
        self.noting.times.append(time)
        if len(self.noting.added) == 3:
            raise EstimationError("for the test")
        self.smoother.add(sensor_pose, measurements, time)

    def belief(self) -> Belief:
        return self.smoother.belief()

    def path(self) -> tuple[Array, Array]:
        return self.smoother.path()

    def last_errors(self) -> dict[str, Array]:
        return self.smoother.last_errors()


@pytest.mark.parametrize("smoother", SMOOTHERS)
def test_all_that_is_measured_is_passed_on(smoother, monkeypatch):
    o, e, touched = in_two_contacts("rectangle", 4)
    found: list[Noting] = []

    def noting(name: Any, *rest: Any) -> Noting:
        found.append(Noting(make_smoother(name, *rest)))
        return found[-1]

    monkeypatch.setattr("palpate.filter.estimator.make_smoother", noting)
    touch = Told()
    tracker = Tracker(SHAPES["rectangle"], sensor(), o[0], settings("none", smoother), touch=touch)
    seen = frames(o, e, touched)
    statuses = [tracker.update(frame).status for frame in seen]
    (noted,) = found
    # Five frames a contact: in the first one the fourth frame could not be solved and began anew, as did the second
    # contact. Two ends, one of them between the contacts.
    assert [index for index, status in enumerate(statuses) if status == "indeterminate"] == [3]
    assert noted.begun == [(ContactDirection(0.1, 1.0), Turn(0.2, 1.0))] * 3
    ages = [1, 2, 3, 1, 1, 2, 3, 4]
    assert [said[:2] for said in noted.added] == [
        (ContactDirection(0.1, 1.0 + age), Turn(0.2, 1.0 + age)) for age in ages
    ]
    assert all(isinstance(said[2], RelativePoses) for said in noted.added)
    assert touch.ends == 2
    assert noted.times == [frame.time for frame in seen if frame.contact for _ in range(2 if frame is seen[3] else 1)]


def assert_same(one: Prior, other: Prior) -> None:
    for name in ("pose", "values", "covariance"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def fed(estimator: Estimator, given: Any, start: float = 0.0) -> list[Prior]:
    """What is known after each frame of a contact."""
    known = []
    for t in range(len(given.sensor)):
        estimator.touch(given.sensor[t], given.said(t), start + t / 30)
        known.append(estimator.known)
    return known


@pytest.mark.parametrize("name", SMOOTHERS)
def test_a_contact_begins_with_what_the_one_before_left(name: Any):
    given = felt(contact(15, ROBUST))
    estimator = Estimator(given.model, ROBUST, name, given.prior.pose, FIRST)
    assert estimator.status == "resting" and not estimator.in_contact
    first = fed(estimator, given)[-1]
    assert estimator.in_contact and estimator.status == "tracking"
    estimator.end_contact()
    assert not estimator.in_contact
    away = given.sensor[-1] - [0.2, 0.0, 0.0]
    estimator.rest(away, (), 1.0)
    known = first.at_next_contact(ROBUST.priors)
    assert_same(estimator.known, known)
    assert estimator.status == "resting"
    assert CALIBRATION.any()
    np.testing.assert_allclose(estimator.covariance, first.pose_covariance + CALIBRATION, rtol=1e-12)
    # The same graph, begun by hand: the pose is less certain by the motion of resting, and not by calibration.
    again = felt(contact(15, ROBUST, seed=1), seed=1)
    second = estimator
    second.touch(given.sensor[-1], again.said(0), 2.0)
    rest = np.diag(np.square(ROBUST.first_pose.rest))
    begin = make_smoother(name, ROBUST, given.model)
    wanted = begin(known.loosened(rest), given.sensor[-1], again.said(0), 2.0).belief().prior
    np.testing.assert_allclose(second.known.pose, wanted.pose, atol=1e-12)
    np.testing.assert_allclose(second.known.covariance, wanted.covariance, rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("name", SMOOTHERS)
def test_a_new_contact_forgets_the_old_one(name: Any):
    # All that passes is what is known; a graph begun with the same is the same.
    given = felt(contact(15, ROBUST, seed=5), seed=5)
    begin = make_smoother(name, ROBUST, given.model)
    paths = []
    for _ in range(2):
        smoother = begin(given.prior, given.sensor[0], given.said(0), 0.0)
        for t in range(1, len(given.sensor)):
            smoother.add(given.sensor[t], given.said(t), t / 30)
        paths.append(smoother.path()[0])
    np.testing.assert_array_equal(paths[0], paths[1])


def test_the_path_is_smoothed_contact_by_contact():
    given = felt(contact(15, ROBUST))
    estimator = Estimator(given.model, ROBUST, "fixed-lag", given.prior.pose, FIRST)
    away = given.sensor[0] - [0.2, 0.0, 0.0]
    assert estimator.path().shape == (0, 3)
    estimator.rest(away, (), -0.1)
    np.testing.assert_array_equal(estimator.path(), given.prior.pose[None])
    known = fed(estimator, given)
    smoother = make_smoother("fixed-lag", ROBUST, given.model)(
        known[0].loosened(np.zeros((3, 3))), given.sensor[0], (), 0.0
    )
    assert len(smoother.path()[0]) == 1
    path = estimator.path()
    assert path.shape == (17, 3)
    np.testing.assert_allclose(path[-1], known[-1].pose, atol=1e-12)
    # Later measurements bear on earlier steps.
    online = np.array([each.pose for each in known])
    assert np.abs(path[1:-1] - online[:-1]).max() > 1e-6
    estimator.end_contact()
    estimator.rest(away, (), 1.0)
    np.testing.assert_array_equal(estimator.path()[:17], path)
    np.testing.assert_array_equal(estimator.path()[17], known[-1].pose)


def test_a_graph_that_is_lost_begins_anew_where_it_was(caplog):
    given = felt(contact(8, ROBUST))
    estimator = Estimator(given.model, ROBUST, "fixed-lag", given.prior.pose, FIRST)
    fed(estimator, given)
    before, path = estimator.known, estimator.path()
    pair = RelativePoses(np.array([1]), np.zeros((1, 3)), np.eye(3)[None])
    pair.pose[:] = np.nan  # which is refused when it is made
    sensor_pose = given.sensor[-1] + [2e-3, 0.0, 0.0]
    with pytest.raises(EstimationError) as caught:
        estimator.touch(sensor_pose, [pair], 0.3)
    estimator.begin_anew(sensor_pose, (), 0.3, caught.value)
    assert estimator.status == "indeterminate" and estimator.in_contact
    assert "frame at 0.300 s: " in caplog.text and "starting a new graph from the last pose" in caplog.text
    # The object is about where it was, and less well known, by as much as the sensor moved.
    off = se2.log(se2.between(before.pose, estimator.known.pose))
    assert np.hypot(*off[:2]) < 3e-3
    assert (np.diag(estimator.covariance) > np.diag(before.pose_covariance)).all()
    # What was said online until then stays; the new graph has one step.
    assert len(estimator.path()) == len(path) + 1
    with pytest.raises(EstimationError, match=r"frame at 0.400 s: for the test; the likely reason"):
        estimator.begin_anew(np.full(3, np.nan), (), 0.4, EstimationError("for the test"))
    assert not estimator.in_contact


def test_model_and_first_pose_are_taken_as_they_are():
    model = model_of("disc")
    pose, first = np.array([0.1, 0.2, 3.0]), np.array([0.02, 0.03, 0.4])
    estimator = Estimator(model, ROBUST, "fixed-lag", pose, first)
    np.testing.assert_array_equal(estimator.known.pose, pose)
    np.testing.assert_array_equal(estimator.known.values, ROBUST.priors.mean)
    deviation = [*first, *ROBUST.priors.deviation]
    np.testing.assert_allclose(estimator.known.covariance, np.diag(np.square(deviation)))


def test_what_a_contact_is_expected_to_begin_with():
    given = felt(contact(8, ROBUST))
    estimator = Estimator(given.model, ROBUST, "fixed-lag", given.prior.pose, FIRST)
    rest, known = np.diag(np.square(ROBUST.first_pose.rest)), estimator.known
    assert_same(estimator.unmoved, known.loosened(rest))
    assert_same(estimator.see_first_touch(given.sensor[0], []), known.loosened(rest))
    # Met 20 mm before it, it was moved: by twice that, and by an angle at c of it.
    away = se2.compose(given.sensor[0], np.array([-0.02, 0.0, 0.0]))
    found = estimator.see_first_touch(away, [])
    length = np.sqrt(found.covariance[0, 0] - estimator.unmoved.covariance[0, 0])
    np.testing.assert_allclose(length, 2.0 * 0.02, rtol=0.1)
    moved = np.diag(np.square([length, length, length / given.model.friction_radius]))
    np.testing.assert_allclose(found.covariance, known.loosened(rest + moved).covariance, rtol=1e-9, atol=1e-18)
    assert_same(estimator.unmoved, known.loosened(rest))
    assert estimator.known is known and not estimator.in_contact
    # A contact begins with that.
    estimator.touch(away, (), 0.0)
    begin = make_smoother("fixed-lag", ROBUST, given.model)
    wanted = begin(found, away, (), 0.0).belief().prior
    assert_same(estimator.known, wanted)


def test_what_something_else_moved_after_a_contact_is_less_certain():
    given = felt(contact(8, ROBUST))
    c = given.model.friction_radius
    for length in (0.0, 0.012):
        estimator = Estimator(given.model, ROBUST, "fixed-lag", given.prior.pose, FIRST)
        last = fed(estimator, given)[-1]
        estimator.end_contact(length)
        moved = np.diag(np.square([length, length, length / c]))
        known = last.at_next_contact(ROBUST.priors).loosened(moved)
        assert_same(estimator.known, known)
        # Nothing is left to end.
        estimator.end_contact(length)
        assert_same(estimator.known, known)


def test_an_object_that_goes_away_from_the_sensor_is_displaced():
    given = felt(contact(8, ROBUST))
    estimator = Estimator(given.model, ROBUST, "fixed-lag", given.prior.pose, FIRST)
    fed(estimator, given)
    estimator.end_contact()
    back, on = (se2.compose(given.sensor[-1], np.array([x, 0.0, 0.0])) for x in (-0.02, 2e-3))
    estimator.rest(back, (), 8 / 30 + 0.01)
    assert estimator.status == "resting"
    # It goes on by 2 mm and touches nothing, 40 ms after the last touch: 6 mm, twice over.
    before = estimator.covariance
    estimator.rest(on, (), 8 / 30 + 0.04)
    assert estimator.status == "displaced"
    length = 2.0 * 6e-3
    moved = np.diag(np.square([length, length, length / given.model.friction_radius]))
    np.testing.assert_allclose(estimator.covariance - before, moved, rtol=1e-6, atol=1e-12)
    # Seen elsewhere it is found; that the sensor comes near it there says nothing.
    elsewhere = se2.compose(se2.compose(given.sensor[-1], np.array([0.05, 0.0, 0.0])), se2.inverse(given.truth[-1]))
    estimator.rest(on, [ObjectPose(elsewhere, 1e-8 * np.eye(3))], 1.0)
    assert estimator.status == "resting"
    for x in (0.01, 0.03, 0.045):
        estimator.rest(se2.compose(given.sensor[-1], np.array([x, 0.0, 0.0])), (), 1.0 + x)
        assert estimator.status == "resting"


def test_a_copy_begins_with_something_else():
    given = felt(contact(8, ROBUST))
    estimator = Estimator(given.model, ROBUST, "fixed-lag", given.prior.pose, FIRST)
    estimator.rest(se2.compose(given.sensor[0], np.array([-0.2, 0.0, 0.0])), (), -1.0)
    known, path = estimator.known, estimator.path()
    elsewhere = Prior(se2.compose(known.pose, [0.0, 0.03, 0.0]), known.values + 1e-4, 4.0 * known.covariance)
    other = estimator.started(elsewhere)
    assert other.known is known and not other.in_contact
    other.touch(given.sensor[0], given.said(0), 0.0)
    begin = make_smoother("fixed-lag", ROBUST, given.model)
    assert_same(other.known, begin(elsewhere, given.sensor[0], given.said(0), 0.0).belief().prior)
    # The one it was taken from goes its own way.
    assert estimator.known is known and not estimator.in_contact and len(other.path()) == 2
    np.testing.assert_array_equal(estimator.path(), path)
    estimator.touch(given.sensor[0], given.said(0), 0.0)
    wanted = begin(known.loosened(np.diag(np.square(ROBUST.first_pose.rest))), given.sensor[0], given.said(0), 0.0)
    assert_same(estimator.known, wanted.belief().prior)
    # The contact after that begins with what the one before left.
    other.end_contact()
    last = other.known
    other.touch(given.sensor[0], given.said(0), 1.0)
    wanted = begin(last.loosened(np.diag(np.square(ROBUST.first_pose.rest))), given.sensor[0], given.said(0), 1.0)
    assert_same(other.known, wanted.belief().prior)


def test_a_copy_in_which_something_else_moved_the_object():
    given = felt(contact(12, ROBUST))
    estimator = Estimator(given.model, ROBUST, "fixed-lag", given.prior.pose, FIRST)
    fed(estimator, given)
    known, path, costs = estimator.known, estimator.path(), estimator.costs()
    other = estimator.knocked(6, (0.01, 1e-3))
    # Nothing but the slide says where the sensor is on its side: 10 mm on, seen from the object clockwise, which is +y
    # on the left side.
    g = [se2.between(one.known.pose, given.sensor[-1]) for one in (estimator, other)]
    np.testing.assert_allclose(g[1][1] - g[0][1], 0.01, atol=2e-3)
    np.testing.assert_allclose(g[1][0], g[0][0], atol=1e-3)
    assert other.known.pose_covariance[1, 1] > 2.0 * known.pose_covariance[1, 1]
    # The one it was taken from stays as it was.
    assert estimator.known is known
    np.testing.assert_array_equal(estimator.path(), path)
    np.testing.assert_array_equal(estimator.costs(), costs)
    other.touch(given.sensor[-1], given.said(12), 0.5)
    assert len(other.path()) == len(path) + 1
    np.testing.assert_array_equal(estimator.path(), path)
    # One that is to be more slippery is held to be so.
    slippery = estimator.knocked(6, (0.0, 0.012), (0.15, 0.05))
    assert slippery.known[GRIP][0] < 0.2 < estimator.known[GRIP][0]
