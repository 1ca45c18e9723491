"""The paper's system: pairs, networks and graph by hand, and the command."""

import signal
import subprocess
import sys
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from palpate import Rectangle, SensorProfile
from palpate.geometry import se2
from palpate.models.pushing.contact_geometry import contact_model
from palpate_lab.paper.transform_network import expanded, fit_linear, reversed_pairs, validation_loss

pytest.importorskip("gtsam", reason="GTSAM is not installed: pip install 'palpate-lab[paper]'")
from palpate_lab.paper.graph import (
    PhysicsNoise,
    compared_frames,
    contact_residual,
    physics_errors,
    quasi_static_residual,
    tactile_error,
    track_episodes,
)
from palpate_lab.paper.helps import level_of, panels_of
from palpate_lab.paper.scores import loss_of_constant, order_scores, turn_followed
from palpate_lab.paper.tracking import WAYS


def pairs(count=3000, seed=0):
    rng = np.random.default_rng(seed)
    return *rng.normal(size=(2, count, 2)), np.eye(4)[rng.integers(4, size=count)]


def test_the_linear_network_recovers_weights_by_class():
    wanted = np.array([[0.3, -0.1], [0.0, 0.5], [-0.2, 0.2], [0.1, 0.1]])
    earlier, later, classes = given = pairs()
    sine = np.sum((later - earlier) * (classes @ wanted), axis=1)
    weights = fit_linear(given, sine)
    np.testing.assert_allclose(expanded(given) @ weights, sine, atol=1e-3)
    np.testing.assert_allclose(expanded(reversed_pairs(given)) @ weights, -sine, atol=1e-3)
    assert validation_loss(lambda each: expanded(each) @ weights, given, sine) < 1e-6
    # The constant model errs by the sine itself; the loss is half of its mean square.
    assert validation_loss(lambda each: 0.0 * sine, given, sine) == pytest.approx(0.5 * np.mean(sine**2))


def test_residuals_by_hand():
    model = replace(contact_model(Rectangle(0.2, 0.1), SensorProfile("tip", 0.01)), friction_radius=0.05)
    # The tip touches the left side of the resting object head on, 2 mm deep; then both move by 1 mm along x.
    g = np.array([-0.1 + 0.002, 0.0, 0.0])
    assert contact_residual(model, g[None]) == pytest.approx(-0.002, abs=1e-6)
    e0, e1 = np.array([0.0, 0.0, 0.0]), np.array([0.001, 0.0, 0.0])
    np.testing.assert_allclose(quasi_static_residual(model, np.array([g, e0, g, e1])), 0.0, atol=1e-9)
    # The sensor alone moves: the object's velocity is 0, the contact point's 1 mm.
    later = se2.compose(g, [0.001, 0.0, 0.0])
    found = quasi_static_residual(model, np.array([g, e0, later, e1]))
    np.testing.assert_allclose(found, [-0.001, 0.0, 0.0], atol=1e-6)
    assert compared_frames(0) == [] and compared_frames(3) == [3] and compared_frames(50) == list(range(10, 40))


def test_the_oracle_keeps_the_yaw_of_a_push():
    model = replace(contact_model(Rectangle(0.2, 0.1), SensorProfile("tip", 0.01)), friction_radius=0.05)
    count = 40
    e = np.column_stack([np.linspace(0.0, 0.04, count), np.zeros(count), np.zeros(count)])
    g = np.array([-0.1, 0.0, 0.0])
    truth = se2.compose(e, se2.inverse(g))
    turns = {t: [(back, 0.0) for back in compared_frames(t)] for t in range(count)}
    noise = PhysicsNoise((8e-5, 8e-5, 2.7e-5), 8e-3)
    pose, covariance, _ = track_episodes(model, noise, e, np.zeros(count, int), turns, truth[0], 1e-3)
    np.testing.assert_allclose(pose, truth, atol=1e-4)
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()


def test_the_deviation_of_touch_follows_from_errors_that_last():
    # Two ways from the first frame to the last: 0.3 in one pair, and 0.1 twice. The mean has weights 2 and 1, thirds
    # of the whole, and a variance of 2 / 3.
    earlier, later, error = np.array([0, 0, 1]), np.array([2, 1, 2]), np.array([0.3, 0.1, 0.1])
    assert tactile_error(earlier, later, error) == pytest.approx((2 * 0.3 + 0.2) / 3 / np.sqrt(2 / 3))


def test_physics_has_no_error_where_it_holds():
    # The tip pushes the left side head on, and the object follows without turning: no torque, no gap.
    model = replace(contact_model(Rectangle(0.2, 0.1), SensorProfile("tip", 0.01)), friction_radius=0.05)
    e = np.column_stack([np.linspace(0.0, 0.04, 20), np.zeros(20), np.zeros(20)])
    truth = se2.compose(e, se2.inverse(np.array([-0.1, 0.0, 0.0])))
    np.testing.assert_allclose(physics_errors(model, truth, e), 0.0, atol=1e-7)
    # The object stays: each of 19 steps of the contact point lacks 40 / 19 mm, 40 mm over the root of 19 in all.
    still = np.tile(truth[0], (20, 1))
    assert physics_errors(model, still, e)[0] == pytest.approx(-0.04 / np.sqrt(19.0), abs=1e-6)


def trials_of(method: str, finals: list[float], level: str = "") -> list[Any]:
    """Trials of the rectangle by their final errors in mm, of which degrees are a tenth."""
    names = [f"rect-edges-{k}{level}.mcap" for k in range(len(finals))]
    summaries = [{"final_translation_error_mm": mm, "final_rotation_error_deg": 0.1 * mm} for mm in finals]
    return [
        SimpleNamespace(recording=name, method=method, summary=summary)
        for name, summary in zip(names, summaries, strict=True)
    ]


def test_the_order_is_that_of_medians_and_oracle_may_equal_learnt():
    apart = [*trials_of("none", [9.0, 8.0, 9.0]), *trials_of("const", [7.0, 6.0, 7.0])]
    same = [*trials_of("learnt", [5.0, 4.0, 5.0]), *trials_of("oracle", [5.0, 4.0, 5.0])]
    assert set(order_scores(apart + same)["rect"]["in order"].values()) == {1.0}
    swapped = [*trials_of("const", [9.0, 8.0, 9.0]), *trials_of("none", [7.0, 6.0, 7.0])]
    shares = order_scores(swapped + same)["rect"]
    assert shares["in order"]["mm"] == shares["none > const"]["deg"] == 0.0 and shares["const > learnt"]["mm"] == 1.0


def test_a_constant_errs_by_the_turns_within_a_contact_alone():
    # Each frame of two contacts turns by 1 degree, so pairs of one contact differ by 10 to 19 degrees.
    relative = np.zeros((60, 3))
    relative[:, 2] = np.radians(np.arange(60))
    episode = np.full(60, -1)
    episode[:20] = 0
    episode[40:] = 1
    back = np.arange(10, 20)
    wanted = 0.5 * np.average(np.sin(np.radians(back)) ** 2, weights=20 - back)
    assert loss_of_constant(relative, episode) == pytest.approx(wanted)
    assert np.isnan(loss_of_constant(relative, np.full(60, -1)))


def test_an_estimate_that_turns_by_half_has_followed_by_half():
    time = np.arange(90) / 30.0
    truth = np.column_stack([np.zeros((90, 2)), np.sin(time)])
    half = truth * [1.0, 1.0, 0.5] + [0.0, 0.0, 0.3]
    trial: Any = SimpleNamespace(time=time, truth=truth, pose=half)
    assert turn_followed([trial]) == pytest.approx(0.5)


def test_panels_take_pushes_by_setting_and_ways_by_what_is_given():
    levels = {"turning-along": 1.0, "as-is": 2.0, "held-still": 3.0, "friction-0.5": 4.0, "friction-0.25": 5.0}
    modes = ("none", "const", "learnt", "oracle", "palpate")
    trials = [trial for level, mm in levels.items() for mode in modes for trial in trials_of(mode, [mm], f"@{level}")]
    ways = [trial for name in WAYS if "+" in name for trial in trials_of(name, [20.0], "@as-is")]
    of_level = {level: {"turn_deg": mm, "slip_mm": mm} for level, mm in levels.items()}
    panels = panels_of(trials, ways, of_level)
    assert [point[:2] for point in panels["mm"]["turn_deg"]["none"]] == [(1.0, 1.0), (2.0, 2.0), (3.0, 3.0)]
    assert [point[:2] for point in panels["mm"]["slip_mm"]["learnt"]] == [(2.0, 2.0), (4.0, 4.0), (5.0, 5.0)]
    # The authors' c and a right first pose are those of the pushes as they are, and palpate has its own c.
    assert [point[1] for point in panels["deg"]["c_factor"]["const"]] == pytest.approx([2.0, 2.0, 2.0, 0.2])
    assert [point[1] for point in panels["mm"]["c_factor"]["palpate"]] == [2.0] * 4
    assert [point[1] for point in panels["mm"]["first_mm"]["oracle"]] == [2.0, 20.0, 20.0]
    assert level_of("rect-edges-3@as-is.mcap") == "as-is" and level_of("rect-edges-3.mcap") == ""


def test_a_folder_of_other_code_and_features_that_are_none_are_named(fails, tmp_path):
    (tmp_path / "settings.json").write_text("{}")
    assert "take another folder" in fails("paper", "--small", "--out", tmp_path)
    assert "allowed is FILE.py:Class" in fails("paper", "--features", "nowhere.py:Net", "--out", tmp_path / "new")
    (tmp_path / "own.py").write_text("import torch\nclass Net(torch.nn.Identity):\n    pass\n")
    assert "failed on images" in fails("paper", "--features", f"{tmp_path}/own.py:Net", "--out", tmp_path / "new")


@pytest.mark.parametrize("name", ["gtsam", "torch", "mujoco"])
def test_missing_extras_are_named(name, fails, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    assert f"palpate paper needs {name}, which is not installed" in fails("paper", "--out", "nowhere")


def test_a_study_that_is_stopped_goes_on(fails, tmp_path):
    seen: set[tuple[str, int]] = set()
    words = [sys.executable, "-m", "palpate", "paper", "--small", "--out", "."]
    for number in (signal.SIGINT, signal.SIGTERM):
        with subprocess.Popen(words, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
            while process.poll() is None and len([*tmp_path.glob("train/[!.]*")]) <= len(seen):
                time.sleep(0.1)
            process.send_signal(number)
            assert process.communicate()[1] == "palpate: stopped; the same command goes on\n"
        assert process.returncode == 130 and not [*tmp_path.rglob(".*")]
        found = {(path.name, path.stat().st_mtime_ns) for path in tmp_path.glob("train/*.mcap")}
        assert seen < found
        seen = found
    assert "--small or --full, not both" in fails("paper", "--small", "--full", "--out", tmp_path)
