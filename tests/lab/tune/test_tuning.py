"""Learning noise from pushes drawn with a noise that is known."""

from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from limit_surface import Steering, push
from push_samples import SHAPES, draw_residuals, model_of, noisy, sensor, touching, with_settings
from scipy.stats import multivariate_normal

from palpate import (
    EstimationError,
    FileError,
    NoiseSettings,
    Recording,
    SettingError,
    TrackerSettings,
    track,
    write_recording,
)
from palpate.config import Priors
from palpate.geometry import se2
from palpate.touch.background import background_of
from palpate.touch.calibration import Calibration, SetUp
from palpate_lab.study.study import StudySettings, track_file
from palpate_lab.tune import tuning
from palpate_lab.tune.tuning import (
    TUNABLE,
    WORST,
    Judgement,
    Tuning,
    judge,
    parameters_of,
    scores_of,
    tune,
    value_of,
    with_value,
)

Files = dict[str, Path]
STEPS = 16
TRUE = with_settings(
    NoiseSettings(),
    sensor_pose={"deviation": (3e-4, 3e-4, 3e-3), "calibration": (0.0, 0.0, 0.0)},
    first_pose={"deviation": (1e-5, 1e-5, 1e-5)},
    contact={"deviation": 3e-4, "kernel": None},
    direction={"share": 1.0, "kernel": None},
    turn={"share": 1.0, "kernel": None},
    sticking={"share": 0.3, "sliding_share": 0.3, "kernel": None},
    balance={"still": 1e-6, "share": 0.5, "kernel": None},
    friction_cone={"share": None, "kernel": None},
    # What belongs to the object is as nominal as it is drawn.
    priors={field.name: (0.0, 1e-6) for field in fields(Priors) if field.name != "grip"},
)


@cache
def drawn(count: int, seed: int = 0) -> tuple[Recording, ...]:
    """Pushes of a rectangle, all drawn with TRUE."""
    rng = np.random.default_rng(seed)
    model, steering = model_of("rectangle"), Steering()
    gap, slip, torque = draw_residuals(model, TRUE, steering.speed, np.pi, STEPS, count, rng)
    g = touching(model, rng.uniform(-0.03, 0.03, count), rng.uniform(-0.2, 0.2, count))
    g[:, 0] -= gap
    o, e = push(model, rng.uniform(-1, 1, (count, 3)), g, STEPS, steering, rng.uniform(0, 6, count), slip, torque)
    measured = noisy(e, TRUE.sensor_pose.deviation, rng)
    time, touched = np.arange(STEPS + 1) / 30, np.ones(STEPS + 1, np.bool_)
    made = (Recording(time, measured[:, k], SHAPES["rectangle"], sensor(), o[:, k], touched) for k in range(count))
    return tuple(made)


@pytest.fixture
def written(tmp_path):
    """Write recordings as files, and return them by name."""

    def write(recordings, names=()) -> Files:
        names = names or [f"push-{k}.mcap" for k in range(len(recordings))]
        for name, recording in zip(names, recordings, strict=True):
            write_recording(recording, tmp_path / name)
        return {name: tmp_path / name for name in names}

    return write


def settings(**groups: dict[str, Any]) -> StudySettings:
    return StudySettings(("oracle",), TrackerSettings(noise=with_settings(TRUE, **groups), hypotheses=1))


def judged(files: Files, using: StudySettings | None = None) -> Judgement:
    found = judge(scores_of(files, using or settings()))
    assert found is not None
    return found


@pytest.fixture
def _sticking_is_tuned(monkeypatch):
    """Tune one setting alone, for few evaluations."""
    monkeypatch.setattr(tuning, "TUNABLE", {"sticking.share": (1e-3, 10.0)})


@pytest.mark.usefixtures("_sticking_is_tuned")
def test_noise_that_pushes_were_drawn_with_is_found_again(written):
    """On six short pushes, in twelve evaluations, from a start off by ten; the score on two others falls with it."""
    true, files = TRUE.sticking.share, written(drawn(8))
    assert true is not None
    start = settings(sticking={"share": 10.0 * true})
    seen: list[Tuning] = []
    found = tune(files, start, 12, progress=seen.append)
    before, after = found.parameters["sticking.share"].values()
    assert before == pytest.approx(10.0 * true) and abs(np.log(after / true)) < np.log(3.0)
    assert found.held_out == ("push-3.mcap", "push-7.mcap")
    worse, better = found.held_out_before, found.held_out_after
    assert worse is not None and better is not None
    truth = judged({name: files[name] for name in found.held_out})
    assert better.nats > worse.nats + 0.1 and better.nats > truth.nats - 0.4
    # What is reported is what the settings do, and nothing but what was asked for has changed.
    noise = found.settings.noise
    learning = {name: files[name] for name in found.recordings}
    assert judged(learning, replace(start, tracker=found.settings)) == found.after
    assert noise == with_settings(TRUE, sticking={"share": noise.sticking.share})
    # It never gets worse on the way, and says so.
    assert [each.evaluations for each in seen] == list(range(1, len(seen) + 1)) and len(seen) > 4
    assert (np.diff([each.after.nats for each in seen]) >= 0.0).all()
    assert seen[0].after == seen[0].before == found.before and seen[-1].after == found.after


@pytest.mark.usefixtures("_sticking_is_tuned")
def test_tuning_twice_is_the_same(written):
    start, files = settings(sticking={"share": 1.0}), written(drawn(3))
    assert tune(files, start, 2) == tune(files, start, 2, workers=2)  # two pools of processes


def test_all_of_a_calibration_is_used_its_set_up_too(written):
    files, still = written(drawn(2)), background_of([np.zeros((1, 1, 3), np.uint8)])
    moved = SetUp(sideways=(5e-3, 1e-4), delay=(0.0, 1e-3), depth=(3e-4, 1e-4), outline_scale=(0.0, 1e-3))
    found = judged(files, replace(settings(), calibration=Calibration(still, set_up=moved)))
    assert found.nats < judged(files, replace(settings(), calibration=Calibration(still))).nats - 0.3


def test_few_recordings_leave_none_to_judge_by(written):
    found = tune(written(drawn(3)), settings(), 1)
    assert found.held_out_after is None and found.evaluations == 1
    assert found.settings == settings().tracker and found.before == found.after
    with pytest.raises(FileError, match="no recording can be tuned on"):
        tune({}, settings())
    with pytest.raises(SettingError, match="evaluations is 0"):
        tune({}, settings(), 0)


def test_parameters_are_those_that_matter_with_the_touch():
    learnt = set(parameters_of(TrackerSettings(), "learnt"))
    assert {"direction.share", "turn.share", "sticking.share", "priors.grip"} <= learnt
    oracle = set(parameters_of(TrackerSettings(), "oracle"))
    assert "turn.share" in oracle and "direction.share" not in oracle
    assert learnt == set(parameters_of(TrackerSettings(), "auto"))
    assert "friction_cone.share" not in parameters_of(TrackerSettings(noise=TRUE), "learnt")  # it is off


@pytest.mark.parametrize("name", TUNABLE)
def test_each_parameter_is_read_from_the_settings_and_put_into_them(name):
    start = TrackerSettings()
    lowest, highest = TUNABLE[name]
    value = value_of(start, name)
    assert 0.0 < lowest <= value <= highest
    now = with_value(start, name, 1.5 * value)
    assert value_of(now, name) == pytest.approx(1.5 * value, rel=1e-3)
    assert with_value(now, name, value) == start


def test_of_a_mean_and_a_deviation_the_deviation_is_tuned():
    given = {"friction_ratio": (0.2, 0.3), "friction_center": (0.1, 0.2), "grip": (0.5, 0.1), "depth": (3e-4, 1e-4)}
    start = settings(priors=given).tracker
    for name, before in given.items():
        now = with_value(start, f"priors.{name}", 0.05)
        assert value_of(start, f"priors.{name}") == before[1]
        assert getattr(now.noise.priors, name) == (before[0], pytest.approx(0.05, rel=1e-4))
        assert with_settings(now.noise, priors={name: before}) == start.noise


def test_the_score_of_a_recording_by_hand(written):
    truth, contact = np.array(drawn(1)[0].object_pose), np.ones(STEPS + 1, np.bool_)
    truth[5] = truth[-1] = np.nan
    contact[-4:] = False
    given = replace(drawn(1)[0], object_pose=truth, contact=contact)
    online = track(given, replace(settings().tracker, tactile="oracle")).online
    touched = [*range(5), *range(6, 13)]  # 5 is not known
    normal = [multivariate_normal(np.zeros(3), covariance) for covariance in online.covariance[touched]]
    off = se2.log(se2.between(online.pose, truth))[touched]
    wanted = np.mean([one.logpdf(each) for one, each in zip(normal, off, strict=True)])
    assert judged(written([given])).nats == pytest.approx(wanted)


def test_kinds_of_recordings_count_alike_and_one_that_is_lost_hardly(written):
    lost = replace(drawn(4)[2], first_pose=np.array([5.0, 5.0, 0.0]))
    names = [*(f"edges-{k}.mcap" for k in range(3)), "disc-3.mcap"]
    files = written([*drawn(4)[:2], lost, drawn(4)[3]], names)
    nats = [judged({name: path}).nats for name, path in files.items()]
    assert nats[2] == WORST and judged(files).nats == pytest.approx(0.5 * (min(nats[:2]) + nats[3]))


def test_a_recording_that_is_given_up_has_the_worst_score(written, monkeypatch):
    files = written(drawn(2))
    first, second = files

    def gives_up(path, method, settings):
        if path == files[first]:
            raise EstimationError("no")
        return track_file(path, method, settings)

    alone = judged({second: files[second]})
    monkeypatch.setattr(tuning, "track_file", gives_up)
    both = judged(files)
    assert both.nats == pytest.approx(0.5 * (WORST + alone.nats))
    assert (both.given_up, both.translation_rmse_mm) == (1, alone.translation_rmse_mm)
    none = judged({first: files[first]})
    assert (none.nats, none.inside_95, none.given_up) == (WORST, None, 1)
