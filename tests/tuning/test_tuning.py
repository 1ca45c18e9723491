"""Learning noise from pushes drawn with a noise that is known."""

import logging
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from push_samples import SHAPES, direction_rows, noisy, sensor, tips_of, touching

from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.graph.noise import GraphNoise
from palpate.recording.measurements import ContactDirection, Feeling, Turn
from palpate.recording.recording import Recording
from palpate.simulation.limit_surface import Steering, draw_residuals, push
from palpate.tracker import TrackerSettings
from palpate.tuning import tuning
from palpate.tuning.likelihood import negative_log_likelihood
from palpate.tuning.parameters import PARAMETERS, check_parameters, value_of, with_value
from palpate.tuning.recorded_touch import RecordedTouch, track_recorded
from palpate.tuning.tuning import LOST, Tuning, judge, tune

FELT, STEPS = 0.01, 16
TRUE = replace(
    GraphNoise(),
    sticking_share=0.3,
    sliding_share=0.3,
    cone_share=None,
    turning=1e-6,
    turning_share=0.5,
    # What lasts is as nominal as it is drawn.
    friction_ratio=(0.0, 1e-6),
    friction_center=1e-6,
    depth=(0.0, 1e-6),
    direction_bias=1e-6,
    direction_share=1.0,
    turn_share=1.0,
    contact=3e-4,
    sensor=(3e-4, 3e-4, 3e-3),
    first_pose=(1e-5, 1e-5, 1e-5),
    sticking_kernel=None,
    turning_kernel=None,
    contact_kernel=None,
    feeling_kernel=None,
)


@cache
def drawn(count: int, seed: int = 0) -> tuple[RecordedTouch, ...]:
    """Pushes of a rectangle, with what a sensor says of each frame, all drawn with TRUE."""
    rng = np.random.default_rng(seed)
    tip, steering = tips_of("rectangle")[0], Steering()
    gap, slip, torque = draw_residuals(tip, TRUE, steering.speed, np.pi, STEPS, count, rng)
    g = touching(tip, rng.uniform(-0.03, 0.03, count), rng.uniform(-0.2, 0.2, count))
    g[:, 0] -= gap
    o, e = push(tip, rng.uniform(-1, 1, (count, 3)), g, STEPS, steering, rng.uniform(0, 6, count), slip, torque)
    g, measured = se2.between(o, e), noisy(e, TRUE.sensor, rng)
    directions = direction_rows(g, 0.0, 0.0, tip)[0][..., 0] + rng.normal(0.0, FELT, g.shape[:-1])
    turns = g[..., 2] + rng.normal(0.0, FELT, g.shape[:-1])
    time, touched = np.arange(STEPS + 1) / 30, np.ones(STEPS + 1, np.bool_)
    found = []
    for k in range(count):
        recording = Recording(time, measured[:, k], SHAPES["rectangle"], sensor(), o[:, k], touched)
        feelings = tuple(
            Feeling(None, ContactDirection(float(direction), FELT**2), Turn(float(turn), FELT**2))
            for direction, turn in zip(directions[:, k], turns[:, k], strict=True)
        )
        found.append(RecordedTouch(recording, o[:, k], feelings))
    return tuple(found)


def settings(**noise) -> TrackerSettings:
    return TrackerSettings(tactile="learnt", noise=replace(TRUE, **noise))


def test_noise_that_pushes_were_drawn_with_is_found_again():
    """On six short pushes, in twelve evaluations, from a start off by ten; the score on two others falls with it."""
    start = settings(contact=10.0 * TRUE.contact, sensor=tuple(10.0 * sigma for sigma in TRUE.sensor))
    seen: list[Tuning] = []
    found = tune(drawn(8), start, ("contact", "sensor"), 12, progress=seen.append)
    for name, true in (("contact", TRUE.contact), ("sensor", TRUE.sensor[0])):
        before, after = found.values[name]
        assert before == pytest.approx(10.0 * true)
        assert abs(np.log(after / true)) < np.log(3.0)
    assert found.held_out is not None
    before, after = found.held_out
    truth = judge(drawn(8)[3::4], settings())
    assert after.score < before.score - 0.5 and after.score < truth.score + 0.3
    # What is reported is what the settings do, and nothing but what was asked for has changed.
    noise = found.settings.noise
    assert judge([recorded for index, recorded in enumerate(drawn(8)) if index % 4 != 3], found.settings) == found.after
    assert noise == replace(TRUE, contact=noise.contact, sensor=noise.sensor)
    assert noise.sensor[2] == pytest.approx(10.0 * noise.sensor[0], rel=1e-3)
    # It never gets worse on the way, and says so.
    assert [each.evaluations for each in seen] == list(range(1, 13))
    assert (np.diff([each.after.score for each in seen]) <= 0.0).all()
    assert seen[0].after == seen[0].before == found.before and seen[-1].after == found.after


def test_tuning_twice_is_the_same():
    start = settings(contact=1e-3)
    assert tune(drawn(3), start, ("contact",), 4) == tune(drawn(3), start, ("contact",), 4, workers=2)


def test_few_recordings_leave_none_to_judge_by():
    found = tune(drawn(3), settings(), ("contact",), 1)
    assert found.held_out is None and found.evaluations == 1
    assert found.settings == settings() and found.before == found.after
    with pytest.raises(SettingError, match="no recordings"):
        tune([], settings())


def test_a_start_out_of_range_is_only_replaced_by_something_better():
    start = settings(sticking_share=0.0, contact=3e-5)
    found = tune(drawn(2), replace(start, tactile="learnt-turn"), ("sticking_share",), 3)
    assert found.values["sticking_share"][0] == 0.0
    assert found.after.score <= found.before.score


def test_c_of_one_object():
    start = TrackerSettings(noise=TRUE)
    found = tune(drawn(2), start, ("pressure",), 2)
    c = SHAPES["rectangle"].friction_radius("uniform")
    assert found.values["pressure"][0] == c and isinstance(found.settings.pressure, float)
    other = replace(drawn(2)[1], recording=replace(drawn(2)[1].recording, shape=SHAPES["disc"]))
    with pytest.raises(SettingError, match=r"'pressure' is c .* of one object"):
        tune([drawn(2)[0], other], start, ("pressure",), 2)


def test_which_parameters():
    names = set(GraphNoise.__dataclass_fields__) | {"pressure"}
    assert set(PARAMETERS) & names == set(PARAMETERS)  # no entry is left over
    usual = TrackerSettings(tactile="learnt")
    pushing = {"sticking_share", "sliding_share", "cone_margin", "cone_share", "turning_share", "sticking_kernel"}
    friction = {"friction_ratio", "friction_center", "grip"}
    assert pushing | friction | {"direction_share", "turn_share"} == set(check_parameters(usual))
    # And not the floors, other kernels, what is hardly seen of and what robot and laboratory know.
    oracle = set(check_parameters(TrackerSettings(tactile="oracle")))
    assert {"tactile", "sticking_share"} <= oracle
    assert not {"direction_share", "turn_share", "constant"} & oracle  # nothing there that they are of
    direction = set(check_parameters(replace(usual, tactile="learnt-direction")))
    assert "direction_share" in direction and "turn_share" not in direction
    assert "cone_share" not in check_parameters(replace(usual, noise=TRUE))  # it is off
    assert check_parameters(usual, ("contact_kernel", "grip")) == ("contact_kernel", "grip")
    assert check_parameters(usual, ("rest", "contact", "rest")) == ("rest", "contact")
    for name in ("magic", "first_pose"):
        with pytest.raises(SettingError, match=f"'{name}' cannot be tuned; allowed are .*contact"):
            check_parameters(usual, (name,))
    with pytest.raises(SettingError, match="'cone_share' is off"):
        check_parameters(replace(usual, noise=TRUE), ("cone_share",))
    with pytest.raises(SettingError, match="'contact_kernel' is off"):
        check_parameters(replace(usual, noise=TRUE), ("contact_kernel",))
    with pytest.raises(SettingError, match="evaluations is 0; it must be at least 1"):
        check_parameters(usual, evaluations=0)


def test_of_a_mean_and_a_deviation_the_deviation_is_tuned():
    start = settings(friction_ratio=(0.2, 0.3), grip=(0.5, 0.1), depth=(3e-4, 1e-4))
    for name in ("friction_ratio", "grip", "depth"):
        before, now = getattr(start.noise, name), with_value(start, name, 0.05)
        assert value_of(start, name) == before[1]
        assert getattr(now.noise, name) == (before[0], pytest.approx(0.05, rel=1e-4))
        assert replace(now.noise, **{name: before}) == start.noise


def test_yaw_alone_of_a_relative_pose_is_scaled():
    noise = tune(drawn(2), TrackerSettings(tactile="oracle", noise=TRUE), ("tactile",), 2).settings.noise
    assert noise.tactile[:2] == TRUE.tactile[:2]


def test_the_score_of_a_recording_by_hand():
    recorded = replace(drawn(1)[0], truth=drawn(1)[0].truth.copy())
    recorded.truth[5] = recorded.truth[-1] = np.nan
    contact = np.ones(STEPS + 1, np.bool_)
    contact[-4:] = False
    recorded = replace(recorded, recording=replace(recorded.recording, contact=contact))
    online = track_recorded(recorded, settings())
    each = negative_log_likelihood(online.pose, online.covariance, recorded.truth)  # pyright: ignore[reportArgumentType]
    # Frames 0 to 12 are in contact, 5 is not known; 15 is the last that is.
    touched = [*range(5), *range(6, 13)]
    assert judge([recorded], settings()).score == pytest.approx(0.5 * (each[touched].mean() + each[15]))


def test_a_recording_that_is_given_up_has_the_worst_score(monkeypatch, caplog):
    def gives_up(recorded, settings):
        if recorded is drawn(2)[0]:
            logging.getLogger("palpate.tracker").warning("new graph")
            raise EstimationError("no")
        return track_recorded(recorded, settings)

    alone = judge(drawn(2)[1:], settings())
    monkeypatch.setattr(tuning, "track_recorded", gives_up)
    both = judge(drawn(2), settings())
    assert both.score == pytest.approx(0.5 * (LOST + alone.score))
    assert (both.given_up, both.translation_rmse_mm) == (1, alone.translation_rmse_mm)
    none = judge(drawn(2)[:1], settings())
    assert (none.score, none.inside_95, none.given_up) == (LOST, None, 1)
    assert not caplog.records
