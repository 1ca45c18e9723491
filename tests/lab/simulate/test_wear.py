"""Wear of the gel has the stated size, and is not taken for touch."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from palpate import DIGIT, Disc, SettingError, track
from palpate.geometry import se2
from palpate_lab.simulate import set_up_errors
from palpate_lab.simulate.recordings import Simulation
from palpate_lab.simulate.scene import WARM_UP
from palpate_lab.simulate.set_up_errors import Mark, draw_errors, worn
from palpate_lab.simulate.unit import draw_unit

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")

DISC = Disc(0.088)
RISE = np.array([0.1, -0.1, 0.02]) / WARM_UP
GRAIN = Mark(0.5, (0.25, 0.75), 2.0, 0.0, 0.0, (40.0, -20.0, 10.0))
SCRATCH = Mark(0.0, (0.5, 0.5), 3.0, 0.25, 0.0, (-30.0, -30.0, -30.0))
UNIT = dataclasses.replace(draw_unit(DIGIT, 3), no_contact=np.full((320, 240, 3), 120, np.uint8))
"""A unit of one even level, on which marks do not saturate."""


def wear(light, *marks):
    return dataclasses.replace(draw_errors(np.random.default_rng(0)), light=light, marks=marks)


def worn_at(unit, errors, seconds, duration):
    return next(iter(worn(unit, errors, np.array([seconds, duration]))))


def test_the_image_without_contact_follows_the_lights():
    drawn, warming = draw_unit(DIGIT, 5), wear(RISE)
    later = worn_at(drawn, warming, WARM_UP, 60.0)
    np.testing.assert_allclose(later.colour, drawn.colour * (1.0 + WARM_UP * RISE)[:, None])
    assert (worn_at(drawn, warming, 50.0, 60.0).no_contact == later.no_contact).all()  # the lights have warmed up
    bright = (drawn.no_contact > 60) & (drawn.no_contact < 220)
    share = later.no_contact / np.maximum(drawn.no_contact, 1.0) - 1.0
    assert np.abs(share[bright]).max() < 0.115
    # The red channel grows at the red light, and falls where the green light dominates.
    red, reach = share[..., 0][bright[..., 0]], (drawn.illumination[0] / drawn.illumination[1])[bright[..., 0]]
    own, foreign = red[reach > np.quantile(reach, 0.8)].mean(), red[reach < np.quantile(reach, 0.2)].mean()
    assert own > foreign + 0.02 and own > 0.05


def test_a_grain_and_a_scratch_appear_and_stay():
    marked = wear(np.zeros(3), GRAIN, SCRATCH)
    early, late = (worn_at(UNIT, marked, seconds, 10.0).no_contact.astype(int) - 120 for seconds in (4.9, 5.0))
    np.testing.assert_array_equal(late[80, 180], GRAIN.levels)
    assert not early[80, 180].any() and not late[80, 190].any()
    for image in (early, late):  # the scratch is there from the first image on, 3 px across and 60 px long
        rows_columns = np.argwhere((image == -30).all(axis=2))
        assert rows_columns.min(axis=0).tolist() == [131, 119] and rows_columns.max(axis=0).tolist() == [189, 121]


def test_wear_of_a_recording_is_not_taken_for_touch(monkeypatch):
    marks = dataclasses.replace(GRAIN, when=0.3), dataclasses.replace(SCRATCH, when=0.6)
    monkeypatch.setattr(set_up_errors, "draw_wear", lambda rng: (RISE, marks))
    ideal, usual = (Simulation(DISC, "disc", 3, 5.0, unit=2, ideal=ideal).run() for ideal in (True, False))
    touched = usual.contact
    assert touched is not None and touched.any() and not touched[:15].any() and not touched[-8:].any()

    def mean_image(recording, frames):
        return np.mean([recording[index].image for index in frames], axis=0)

    rise = {
        name: mean_image(of, range(142, 150)) - mean_image(of, range(8))
        for name, of in (("ideal", ideal), ("usual", usual))
    }
    assert np.abs(rise["ideal"].mean(axis=(0, 1))).max() < 0.1
    # After a third of the warm-up: red 3 % brighter by its own light, green 3 % darker.
    red, green, _ = rise["usual"].mean(axis=(0, 1)) / mean_image(usual, range(8)).mean(axis=(0, 1))
    assert 0.01 < red < 0.034 and -0.034 < green < -0.01
    at_grain = rise["usual"][78:83, 178:183].mean(axis=(0, 1)) - rise["ideal"][78:83, 178:183].mean(axis=(0, 1))
    assert at_grain[0] > 15.0 and at_grain[1] < -5.0
    # Images may be a frame late, and the ends of a contact hardly show.
    found = track(usual).online.contact
    assert found is not None
    near = np.convolve(touched, np.ones(5), mode="same") > 0
    well_within = np.convolve(~touched, np.ones(7), mode="same") < 0.5
    assert not found[~near].any() and found[well_within].all()


def test_marks_that_are_given_are_those_that_appear_and_tracking_does_without_them():
    long = dataclasses.replace(SCRATCH, when=0.497, length=0.45, angle=0.3, width=4.0, levels=(-50.0, -50.0, -50.0))
    plain, marked = (Simulation(DISC, "disc", 3, 5.0, unit=2, marks=marks).run() for marks in ((), (long,)))
    assert plain.image is not None and marked.image is not None and plain.contact is not None
    assert plain.contact[60:90].all()
    first = next(index for index in range(150) if plain.image[index] != marked.image[index])
    assert first in (75, 76)  # images may be a frame late
    one, other = (track(each).online for each in (plain, marked))
    assert (one.contact == other.contact).mean() > 0.98
    assert np.hypot(*(one.pose - other.pose)[:, :2].T).max() < 5e-4
    with pytest.raises(SettingError, match="marks"):
        Simulation(DISC, "disc", 3, 5.0, ideal=True, marks=(long,))


def test_recordings_of_a_unit_are_of_one_robot():
    robot: Any = [Simulation(DISC, "disc", seed, 3.0, images=False, unit=4).run() for seed in (1, 2)]
    other = Simulation(DISC, "disc", 1, 3.0, images=False, unit=3).run()
    one, two, three = (
        np.median(se2.between(each.extra["sensor_pose_clean"], each.sensor_pose), axis=0) for each in (*robot, other)
    )
    np.testing.assert_allclose(one, two, atol=1e-3)
    assert np.abs(one - three).max() > 1e-2
    assert robot[0].shape.extent == pytest.approx(robot[1].shape.extent, rel=1e-6)
    placed = [se2.between(each.object_pose[0], each.first_pose) for each in robot]
    assert np.hypot(*(placed[0] - placed[1])[:2]) > 5e-4
