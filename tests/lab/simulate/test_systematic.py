"""What is stated wrongly all through a recording is as large as it is said to be, and truth stays the truth."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Disc
from palpate.lab.simulate import systematic
from palpate.lab.simulate.ageing import Ageing
from palpate.lab.simulate.folder import plan, simulate_folder
from palpate.lab.simulate.recordings import simulate_recording
from palpate.lab.simulate.systematic import SystematicErrors, draw_errors, misstated

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")

DISC = Disc(0.088)
ERRORS = SystematicErrors(
    mounting=np.array([6e-4, -8e-4, 0.02]),
    outline=1.02,
    late=1,
    first_pose=np.array([3e-3, 0.0, -0.03]),
    first_pose_sigma=np.array([2e-3, 2e-3, 0.03]),
    gel_drift=(0.0, 0.0),
    ageing=Ageing(np.zeros(3), ()),
)


def test_what_is_stated_is_off_by_the_errors_and_truth_is_not():
    exact = simulate_recording(DISC, "disc", 3, 3.0, ideal=True)
    stated = misstated(exact, ERRORS)
    assert exact.image is not None and stated.image is not None and exact.object_pose is not None
    mounting = se2.between(exact.sensor_pose, stated.sensor_pose)
    np.testing.assert_allclose(mounting, np.tile(ERRORS.mounting, (90, 1)), atol=1e-12)
    assert stated.shape == Disc(1.02 * 0.088)
    assert [stated.image[index] for index in (0, 1, 89)] == [exact.image[index] for index in (0, 0, 88)]
    assert stated.first_pose is not None
    np.testing.assert_allclose(se2.between(exact.object_pose[0], stated.first_pose), ERRORS.first_pose, atol=1e-12)
    np.testing.assert_array_equal(stated.object_pose, exact.object_pose)
    np.testing.assert_array_equal(stated.contact, exact.contact)
    assert stated.frames["image"] == "1 frame late"
    assert misstated(exact, replace(ERRORS, late=0)).frames["image"] == "0 frames late"
    assert stated.frames["first_pose"] == "stated with an error; first_pose_sigma is its standard deviation"


def test_errors_are_drawn_as_large_as_they_are_said_to_be():
    drawn = [draw_errors(np.random.default_rng(seed)) for seed in range(400)]
    mounting, first = (np.array([getattr(one, name) for one in drawn]) for name in ("mounting", "first_pose"))
    np.testing.assert_allclose(np.hypot(*mounting[:, :2].T), 1e-3)
    np.testing.assert_allclose(np.abs(mounting[:, 2]), np.radians(1.0))
    length, turn = np.hypot(*first[:, :2].T), np.abs(first[:, 2])
    assert 2e-3 <= length.min() < 2.2e-3 and 4.8e-3 < length.max() <= 5e-3
    assert np.radians(1.0) <= turn.min() and turn.max() <= np.radians(3.0)
    outline = np.array([one.outline for one in drawn])
    assert (np.abs(outline - 1.0) >= 0.01).all() and (np.abs(outline - 1.0) <= 0.02).all()
    for signs in (mounting[:, 0], mounting[:, 2], first[:, 1], first[:, 2], outline - 1.0):
        assert abs(np.mean(signs > 0.0) - 0.5) < 0.1
    assert {one.late for one in drawn} == {0, 1}
    # The sigma that goes with a first pose is that of all of them.
    np.testing.assert_allclose(np.sqrt(np.mean(first**2, axis=0)), drawn[0].first_pose_sigma, rtol=0.1)
    assert np.abs([one.gel_drift for one in drawn]).max() <= 0.2 / 15.0
    assert len({one.ageing.light[0] for one in drawn}) == 400


def test_ageing_leaves_what_is_drawn_next_from_the_same_generator_as_it_is(monkeypatch):
    rng, other = (np.random.default_rng(5) for _ in range(2))
    drawn = draw_errors(rng)
    monkeypatch.setattr(systematic, "draw_ageing", lambda rng: rng.random(9))
    assert draw_errors(other).gel_drift == drawn.gel_drift and rng.random() == other.random()


def test_a_recording_is_misstated_unless_it_is_to_be_ideal():
    ideal, usual = (simulate_recording(DISC, "disc", 3, 3.0, images=False, ideal=ideal) for ideal in (True, False))
    assert ideal.first_pose is None and ideal.shape == DISC
    assert usual.first_pose is not None and usual.shape != DISC and "systematic errors" in usual.source
    assert usual.source.startswith(ideal.source)
    # Its clean pose is where the sensor is, which the mounting hides.
    off = np.hypot(*(usual.sensor_pose - usual.extra["sensor_pose_clean"])[:, :2].T)
    assert off.mean() == pytest.approx(1e-3, rel=0.1)


def test_ideal_recordings_are_not_those_of_a_folder_with_errors(tmp_path):
    usual, ideal = (plan({"disc": DISC}, 1, ideal=ideal) for ideal in (False, True))
    simulate_folder(tmp_path, usual, 3.0, images=False)
    with pytest.raises(SettingError, match="other options"):
        simulate_folder(tmp_path, ideal, 3.0, images=False, resume=True)
