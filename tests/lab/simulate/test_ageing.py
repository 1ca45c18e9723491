"""Light that drifts and marks that come on the gel are as large as they are said to be, and are not taken for touch."""

import dataclasses

import numpy as np
import pytest

from palpate.geometry.shapes import Disc
from palpate.lab.simulate import systematic
from palpate.lab.simulate.ageing import Ageing, aged, draw_ageing, over_time
from palpate.lab.simulate.gel import touch_image
from palpate.lab.simulate.marks import GRAIN_LEVELS, GRAIN_RADIUS, Mark
from palpate.lab.simulate.recordings import simulate_recording
from palpate.lab.simulate.scene import WARMS_FOR
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.pipeline.run import track
from palpate.types.sensor import DIGIT

DISC = Disc(0.088)
STILL = np.zeros(3)
RISE = np.array([0.1, -0.1, 0.02]) / WARMS_FOR
GRAIN = Mark(0.5, (0.25, 0.75), 2.0, 0.0, 0.0, (40.0, -20.0, 10.0))
SCRATCH = Mark(0.0, (0.5, 0.5), 3.0, 0.25, 0.0, (-30.0, -30.0, -30.0))


@pytest.fixture(scope="module")
def unit() -> SensorUnit:
    """A unit of one even level, so that marks on it do not saturate."""
    drawn = draw_unit(DIGIT, 3)
    return dataclasses.replace(drawn, no_contact=np.full_like(drawn.no_contact, 120))


def test_what_is_drawn_is_as_large_as_it_is_said_to_be():
    drawn = [draw_ageing(np.random.default_rng(seed)) for seed in range(500)]
    light = np.array([one.light * WARMS_FOR for one in drawn])
    assert 0.08 < np.abs(light).max() <= 0.1 and np.abs(light.mean(axis=0)).max() < 0.01
    # All together and each besides, in equal parts.
    assert np.mean(light[:, 0] * light[:, 1]) == pytest.approx(0.5 * np.mean(light**2), rel=0.2)
    assert np.abs(light - light.mean(axis=1, keepdims=True)).max() > 0.05
    counts = np.bincount([len(one.marks) for one in drawn])
    np.testing.assert_allclose(counts / len(drawn), 1 / 3, atol=0.1)
    marks = [mark for one in drawn for mark in one.marks]
    assert np.mean([mark.when for mark in marks]) == pytest.approx(0.5, abs=0.05)
    grains, scratches = ([mark for mark in marks if bool(mark.length) == long] for long in (False, True))
    assert 0.4 < len(grains) / len(marks) < 0.6
    for mark in grains:
        assert GRAIN_RADIUS[0] <= mark.width <= GRAIN_RADIUS[1]
        assert all(GRAIN_LEVELS[0] <= level <= GRAIN_LEVELS[1] for level in mark.levels)
    for mark in scratches:
        assert 2.0 <= mark.width <= 4.0 and 0.1 <= mark.length <= 0.5 and len(set(mark.levels)) == 1
        assert 20.0 <= abs(mark.levels[0]) <= 60.0


def test_the_untouched_gel_changes_as_the_lights_do_that_reach_it():
    drawn = draw_unit(DIGIT, 5)
    ageing = Ageing(RISE, ())
    later = aged(drawn, ageing, WARMS_FOR, 60.0)
    np.testing.assert_allclose(later.colour, drawn.colour * (1.0 + WARMS_FOR * RISE)[:, None])
    assert aged(drawn, ageing, 50.0, 60.0).no_contact.tolist() == later.no_contact.tolist()  # they have warmed up
    bright = (drawn.no_contact > 60) & (drawn.no_contact < 220)
    share = later.no_contact / np.maximum(drawn.no_contact, 1.0) - 1.0
    assert np.abs(share[bright]).max() < 0.115
    # Red grows where its light reaches, and falls where green's does that reaches red as well: one side to the other.
    red, reach = share[..., 0][bright[..., 0]], (drawn.illumination[0] / drawn.illumination[1])[bright[..., 0]]
    own, foreign = red[reach > np.quantile(reach, 0.8)].mean(), red[reach < np.quantile(reach, 0.2)].mean()
    assert own > foreign + 0.02 and own > 0.05


def test_an_imprint_is_lit_by_the_lights_as_they_are_by_then(unit):
    overlap = np.zeros((320, 240), np.float32)
    overlap[140:180, 100:140] = 4e-4
    dark = aged(unit, Ageing(np.full(3, -0.1 / WARMS_FOR), ()), WARMS_FOR, WARMS_FOR)
    before, after = (touch_image(one, overlap).astype(float) - one.no_contact for one in (unit, dark))
    strong = np.abs(before) > 30.0
    # The camera answers a little otherwise where it is darker; folds take light away whatever the lights are.
    assert np.median(after[strong] / before[strong]) == pytest.approx(0.9, abs=0.04)


def test_a_grain_and_a_scratch_come_and_stay(unit):
    ageing = Ageing(STILL, (GRAIN, SCRATCH))
    early, late = (aged(unit, ageing, seconds, 10.0).no_contact.astype(int) - 120 for seconds in (4.9, 5.0))
    np.testing.assert_array_equal(late[80, 180], GRAIN.levels)
    assert not early[80, 180].any() and not late[80, 190].any()
    for seen in (early, late):  # the scratch is there from the first image on, 3 px across and 60 px long
        assert np.argwhere((seen == -30).all(axis=2)).min(axis=0).tolist() == [131, 119]
        assert np.argwhere((seen == -30).all(axis=2)).max(axis=0).tolist() == [189, 121]


def test_a_unit_changes_by_less_than_a_grey_level_from_image_to_image_and_not_without_ageing(unit):
    time = np.arange(20 * 30) / 30.0
    levels = [float(now.no_contact.mean(axis=(0, 1))[1]) for now in over_time(unit, Ageing(RISE, ()), time)]
    assert levels[0] == 120.0 and levels[-1] < 118.0 and levels[-1] == levels[16 * 30]
    assert np.abs(np.diff(levels)).max() < 1.0
    assert all(now is unit for now in over_time(unit, None, time))


def test_the_images_of_a_recording_drift_unless_it_is_ideal(monkeypatch):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")
    ageing = Ageing(RISE, (dataclasses.replace(GRAIN, when=0.3), dataclasses.replace(SCRATCH, when=0.6)))
    monkeypatch.setattr(systematic, "draw_ageing", lambda rng: ageing)
    ideal, usual = (simulate_recording(DISC, "disc", 3, 5.0, unit=2, ideal=ideal) for ideal in (True, False))
    touched = usual.contact
    assert touched is not None and touched.any() and not touched[:15].any() and not touched[-8:].any()

    def seen(recording, frames):
        return np.mean([recording[index].image for index in frames], axis=0)

    first, last = range(8), range(142, 150)  # nothing touches; two thirds of a second before the end
    rise = {name: seen(of, last) - seen(of, first) for name, of in (("ideal", ideal), ("usual", usual))}
    assert np.abs(rise["ideal"].mean(axis=(0, 1))).max() < 0.1
    # A third of the way: reds are 3 % brighter by their own light, greens 3 % darker.
    red, green, _ = rise["usual"].mean(axis=(0, 1)) / seen(usual, first).mean(axis=(0, 1))
    assert 0.01 < red < 0.034 and -0.034 < green < -0.01
    at_grain = rise["usual"][78:83, 178:183].mean(axis=(0, 1)) - rise["ideal"][78:83, 178:183].mean(axis=(0, 1))
    assert at_grain[0] > 15.0 and at_grain[1] < -5.0
    # None of it is taken for a touch; images may be a frame late, and a contact's ends hardly show.
    found = track(usual).online.contact
    assert found is not None
    near = np.convolve(touched, np.ones(5), mode="same") > 0
    well_within = np.convolve(~touched, np.ones(7), mode="same") < 0.5
    assert not found[~near].any() and found[well_within].all()
