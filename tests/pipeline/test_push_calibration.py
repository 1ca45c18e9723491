"""A robot's errors by ordinary pushes: simulated ones, whose touch is read without noise."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate import Calibration, ContactDirection, FileError, Frame, Tracker, Turn
from palpate.geometry import se2
from palpate.geometry.named_shapes import SHAPES
from palpate.geometry.shapes import scaled
from palpate.pipeline.push_calibration import Push, PushFit, learn_from_pushes, read_push
from palpate.touch.background import background_of
from palpate.touch.calibration import SetUp, load_calibration, write_calibration
from palpate.touch.touch_model import shipped_model
from palpate_lab.simulate.recordings import Simulation

GEL = Calibration(background_of([np.full((320, 240, 3), 100, np.uint8)]))
OFFSET, SCALE, OUTLINE, SIDEWAYS = 0.05, 1.15, 0.985, 1e-3
SHOWS_LATE = 3  # frames: two that a touch takes to show, and one


@pytest.fixture(scope="module")
def exact() -> list:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")
    kinds = (("disc", "disc"), ("ellipse", "ellipse"), ("rectangle", "rectangle-edges"))
    return [Simulation(SHAPES[name], kind, 5, 12.0, images=False, ideal=True).run() for name, kind in kinds]


def as_read(recording, offset: float = OFFSET) -> Push:
    """What a robot with these errors has of a recording."""
    shown = np.maximum(np.arange(len(recording)) - SHOWS_LATE, 0)
    turn = se2.between(recording.object_pose, recording.sensor_pose)[:, 2]
    angle = offset + SCALE * np.nan_to_num(recording.extra["pad_angle"])  # NaN out of contact
    measured = [(ContactDirection(float(angle[k]), 1e-4), Turn(float(SCALE * turn[k]), 1e-4)) for k in shown.tolist()]
    contact = recording.contact[shown]
    robot = replace(
        recording,
        sensor_pose=se2.compose(recording.sensor_pose, (0.0, SIDEWAYS, 0.0)),
        shape=scaled(recording.shape, OUTLINE),
        contact=contact,
    )
    return Push(robot, [each if touching else () for each, touching in zip(measured, contact, strict=True)])


@pytest.fixture(scope="module")
def begun(exact) -> list:
    """Return the first seven seconds of these, enough where no numbers count."""
    return [each.until(210) for each in exact]


@pytest.fixture(scope="module")
def fit(exact) -> PushFit:
    return learn_from_pushes([as_read(each) for each in exact], GEL)


def test_errors_of_a_robot_are_found(fit):
    true = np.array([OFFSET / SCALE, 1.0 - 1.0 / SCALE, np.nan, 1.0 / OUTLINE - 1.0, SIDEWAYS, 1 / 30])
    mean, sigma = fit.after.T
    known = np.isfinite(true)
    assert (np.abs(mean - true)[known] < 2.5 * sigma[known]).all()
    assert mean[3] > 0.005 and mean[4] > 2e-4  # not of the other sign
    assert (sigma < [0.012, 0.04, 5e-4, 0.012, 1e-3, 0.05]).all() and (sigma <= fit.before[:, 1]).all()
    assert fit.misfit < 2.0
    found = fit.calibration
    assert found.direction.offset == pytest.approx(OFFSET, abs=0.02)
    assert found.direction.scale == pytest.approx(SCALE, abs=0.08)
    assert found.is_view_known


def test_pushes_that_do_not_go_together_are_refused(begun):
    other = [as_read(each, -0.15) for each in begun]
    with pytest.raises(FileError, match="do not belong together"):
        learn_from_pushes([*map(as_read, begun[:2]), other[2]], GEL)
    with pytest.raises(FileError, match="found 1 pushes"):
        learn_from_pushes(other[:1], GEL)
    with pytest.raises(FileError, match="has no images"):
        read_push(begun[0], shipped_model("DIGIT"), GEL)


def test_mirrored_images_are_named(begun):
    mirrored: list[Any] = [*map(as_read, begun)]
    for index, each in enumerate(mirrored):
        touch = [tuple(replace(one, angle=-one.angle) for one in some) for some in each.measurements]
        mirrored[index] = Push(each.recording, touch)
    with pytest.raises(FileError, match="--orientation"):
        learn_from_pushes(mirrored, GEL)
    mirrored[:2] = [Push(each.recording, [()] * len(each.measurements)) for each in mirrored[:2]]
    assert not learn_from_pushes(mirrored, GEL).calibration.is_view_known  # the last may have a wrong solution


def test_a_file_holds_what_pushes_show(fit, tmp_path):
    write_calibration(fit.calibration, tmp_path / "unit.npz")
    found = load_calibration(tmp_path / "unit.npz")
    assert (found.set_up, found.direction) == (fit.calibration.set_up, fit.calibration.direction)
    arrays: Any = dict(np.load(tmp_path / "unit.npz"))
    np.savez(tmp_path / "bad.npz", **(arrays | {"set_up": np.full((4, 2), np.nan)}))
    with pytest.raises(FileError, match="set_up: found"):
        load_calibration(tmp_path / "bad.npz")
    del arrays["set_up"]
    np.savez(tmp_path / "old.npz", **(arrays | {"version": 5}))
    assert load_calibration(tmp_path / "old.npz").set_up is None


def test_the_tracker_takes_poses_as_they_were_when_the_image_was_taken(exact):
    recording = exact[2]
    set_up = SetUp((SIDEWAYS, 1e-4), (0.1, 0.01), (3e-4, 4e-4), (0.0, 0.007))
    off = {}
    for name, calibration in (("as stated", None), ("corrected", replace(GEL, set_up=set_up))):
        tracker = Tracker(recording.shape, recording.sensor, recording.object_pose[0], calibration=calibration)
        stated = se2.compose(recording.sensor_pose, (0.0, SIDEWAYS, 0.0))
        late = np.maximum(np.arange(len(recording)) - 3, 0)
        errors = []
        for index, when in enumerate(recording.time):
            estimate = tracker.update(Frame(when, stated[index], contact=bool(recording.contact[late[index]])))
            errors.append(np.hypot(*(estimate.pose - recording.object_pose[index])[:2]))
        off[name] = np.sqrt(np.mean(np.square(errors)))
    assert off["corrected"] < 0.7 * off["as stated"]
