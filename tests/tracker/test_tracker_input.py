"""Input that cannot be used, and arrays that belong to the caller."""

from pathlib import Path

import numpy as np
import pytest
from push_samples import SHAPES, frames, in_two_contacts, pushed, sensor
from tracker_samples import SMOOTHERS, disc_tracker, poses, same, settings, small_frame, track

from palpate import Disc, EstimationError, Frame, Polygon, Rectangle, SettingError, ShapeError, Tracker

NO_POSES = [(0, 0), (0, 0, np.nan), (np.inf, 0, 0), ((0, 0, 0),), "here", 1e-3, -np.eye(3)]
NO_SIGMAS = [*NO_POSES, (0.0, 1e-3, 1e-2), (1e-3, 1e-3, -1e-2)]


@pytest.mark.parametrize(("first", "sigma"), [*((one, None) for one in NO_POSES), *((None, one) for one in NO_SIGMAS)])
def test_a_first_pose_and_a_sigma_that_are_none(first, sigma):
    with pytest.raises(SettingError, match=r"^first pose (sigma )?is (.|\n)*; it must be three (finite )?numbers"):
        Tracker(SHAPES["disc"], sensor(), first, first_pose_sigma=sigma)


ROUGH = (0.01, 0.01, 0.1)


@pytest.mark.parametrize(
    ("first", "sigma", "words"),
    [
        ((0.028, 0.071, 148.6), ROUGH, "first pose has theta 148.6 rad, 23.7 turns: are these degrees?"),
        ((28.0, 71.0, 2.59), ROUGH, "first pose is 76.4 m from the sensor: is one of both in millimetres?"),
        ((0.0, 0.0, 0.0), (3e-3, 3e-3, 5.0), "first pose sigma has theta 5 rad, any yaw at all: are these degrees?"),
        ((0.0, 0.0, 0.0), (10.0, 10.0, 0.1), "first pose sigma has 10 and 10 m: are these millimetres?"),
    ],
)
def test_a_first_pose_in_another_unit_is_asked_about_and_taken(first, sigma, words, caplog):
    def told(tracker: Tracker) -> list[str]:
        tracker.update(small_frame())
        return [record.getMessage() for record in caplog.records]

    assert told(Tracker(SHAPES["disc"], sensor(), first, first_pose_sigma=sigma)) == [words]
    caplog.clear()
    tracker = disc_tracker()
    tracker.reset(first, sigma)
    assert told(tracker) == [words]


def test_an_outline_in_millimetres_is_asked_about():
    for shape in (Rectangle(240, 160), Disc(50.0), Polygon([(0, 0), (90, 0), (90, 60)]), Disc(12.0)):
        with pytest.raises(
            ShapeError, match=r"the outline is .* m wide, .* 0.005 to 2 m: are these (milli|centi)metres"
        ):
            Tracker(shape, sensor(), np.zeros(3))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"shape": "rectangle"}, "shape is 'rectangle'; it must be an outline, which palpate.load_shape reads"),
        ({"shape": np.zeros((4, 2))}, "shape is array"),
        ({"sensor": "digits"}, "sensor is 'digits'; allowed are digit, gelsight-mini, point, "),
        ({"settings": "learnt"}, "settings is 'learnt'; it must be palpate.TrackerSettings"),
        ({"model": "folder"}, "model is 'folder'; it must be a palpate.TouchModel"),
        ({"calibration": Path("unit.npz")}, "calibration is 'unit.npz'; .* which palpate.load_calibration reads"),
        ({"touch": "learnt"}, r"touch is 'learnt'; it must be an object with methods measure\(frame\) and end_contact"),
        ({"touch": Tracker}, "touch is <class '.*Tracker'>; it must be an object"),
    ],
)
def test_arguments_of_another_kind(arguments, words):
    with pytest.raises(SettingError, match=f"^{words}"):
        Tracker(**{"shape": SHAPES["disc"], "sensor": sensor(), "first_pose": np.zeros(3), **arguments})


def test_before_the_first_frame_there_is_none_to_tell_of():
    tracker = disc_tracker()
    for _ in range(2):
        with pytest.raises(EstimationError, match="no frame has been taken so far"):
            tracker.frame  # noqa: B018
        tracker.update(small_frame())
        assert tracker.frame.time == 1.0
        tracker.reset()


def test_a_caller_may_change_the_estimate_it_was_given():
    tracker = disc_tracker()
    found = tracker.update(small_frame())
    found.pose[2] = 90.0  # say, in degrees
    found.answers[0].pose[2] = 90.0
    found.covariance[:] = found.answers[0].covariance[:] = 0.0
    again = tracker.update(small_frame(time=1.1))
    assert again.pose.tolist() == again.answers[0].pose.tolist() == [0, 0, 0]
    assert np.linalg.eigvalsh(again.covariance).min() > 0.0


@pytest.mark.parametrize("smoother", SMOOTHERS)
def test_a_live_sensor_may_reuse_its_buffer(smoother):
    o, e = pushed("rectangle", 20)
    _, wanted = track("rectangle", frames(o, e), o[0], settings("none", smoother))
    tracker = Tracker(SHAPES["rectangle"], sensor(), o[0], settings("none", smoother))
    buffer = np.empty(3)
    found = []
    for k in range(21):
        buffer[:] = e[k]
        found.append(tracker.update(Frame(k / 30, buffer, contact=True)))
    np.testing.assert_allclose(poses(found), poses(wanted), atol=1e-12)
    np.testing.assert_allclose(found[-1].covariance, wanted[-1].covariance)


@pytest.mark.parametrize("smoother", SMOOTHERS)
def test_a_tracker_that_is_reset_is_as_a_new_one(smoother):
    o, e = pushed("rectangle", 20)
    how = settings("oracle", smoother)
    used = Tracker(SHAPES["rectangle"], sensor(), o[0], how)
    for frame in frames(o, e, start=1000.0):
        used.update(frame)
    for pose, sigma in ((None, None), (o[0] + [1e-3, 0.0, 0.0], None), (o[0], (1e-3, 1e-3, 1e-2))):
        used.reset(pose, sigma)
        first = o[0] if pose is None else pose
        fresh = Tracker(SHAPES["rectangle"], sensor(), first, how, first_pose_sigma=sigma)
        # The clock may begin anew, too.
        same([used.update(frame) for frame in frames(o, e)], [fresh.update(frame) for frame in frames(o, e)])
    used.reset()  # to the pose and sigma that were given last
    surer = Tracker(SHAPES["rectangle"], sensor(), o[0], how, first_pose_sigma=(1e-3, 1e-3, 1e-2))
    same([used.update(small_frame())], [surer.update(small_frame())])
    with pytest.raises(SettingError, match="first pose is 'here'"):
        used.reset("here")
    with pytest.raises(SettingError, match="first pose sigma is"):
        used.reset(o[0], (0.0, 0.0, 0.0))


def test_accuracy_of_the_set_up_is_part_of_the_covariance_and_of_nothing_else():
    o, e, contact = in_two_contacts("rectangle", 20)
    found = []
    for sigma in (np.zeros(3), [2e-3, 3e-3, 0.02]):
        tracker = Tracker(SHAPES["rectangle"], sensor(), o[0], settings("none"), set_up_sigma=sigma)
        found.append([tracker.update(frame) for frame in frames(o, e, contact)])
    for exact, usual in zip(*found, strict=True):
        assert exact.pose.tolist() == usual.pose.tolist()
        assert usual.covariance - exact.covariance == pytest.approx(np.diag(np.square([2e-3, 3e-3, 0.02])), abs=1e-12)
    with pytest.raises(
        SettingError, match=r"sensor_pose.calibration is .*-1.*; it must be 3 finite numbers at least 0"
    ):
        Tracker(SHAPES["rectangle"], sensor(), o[0], set_up_sigma=(-1.0, 0.0, 0.0))
