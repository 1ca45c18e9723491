"""The figure of a run."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import BLIND, pushed

import palpate
from palpate.pipeline.figures import STATUS_COLOURS, run_figure
from palpate.types.estimate import Answer


@pytest.fixture(scope="module")
def tracked() -> palpate.Run:
    return palpate.track(pushed())


def legend(figure: Any) -> set[str]:
    return {text.get_text() for text in figure.legends[0].get_texts()}


def lines(axes: Any) -> dict[str, Any]:
    return {line.get_label(): np.column_stack(line.get_data()) for line in axes.get_lines()}


def test_a_figure_shows_paths_errors_and_contact(tracked):
    figure = run_figure(tracked)
    above, translation, rotation, _ = figure.axes
    assert (above.get_xlabel(), above.get_ylabel(), above.get_aspect()) == ("x [mm]", "y [mm]", 1.0)
    assert (translation.get_ylabel(), rotation.get_ylabel()) == ("translation error [mm]", "rotation error [°]")
    assert {"start", "truth", "estimate", "95 % ellipses", "contact", "error", "resting"} < legend(figure)
    assert lines(above)["truth"] == pytest.approx(tracked.recording.object_pose[:, :2] * 1e3)
    assert lines(above)["estimate"] == pytest.approx(tracked.online.pose[:, :2] * 1e3)
    final, turned = (tracked.summary[f"final_{name}"] for name in ("translation_error_mm", "rotation_error_deg"))
    assert f"final error {final:.1f} mm and {turned:.1f}°, at 1.3 s" in figure.get_suptitle()
    assert lines(translation)["error"][-1] == pytest.approx([tracked.online.time[-1], final])


def test_a_run_without_truth_shows_sigma(tracked):
    blind = replace(tracked.recording, **BLIND)
    figure = run_figure(palpate.track(blind, first_pose=tracked.first_pose))
    assert figure.axes[1].get_ylabel() == "translation 1 sigma [mm]"
    assert "no ground truth" in figure.get_suptitle() and not {"truth", "error"} & legend(figure)


def test_an_outline_that_is_learnt_is_drawn_with_its_band(tracked):
    run = palpate.track(tracked.recording, palpate.TrackerSettings("oracle"), outline=palpate.Unknown((0.1, 0.3)))
    figure = run_figure(run)
    assert {"truth", "95 % band of the outline", "touched"} < legend(figure) and "start" not in legend(figure)
    outline = run.outlines[-1]
    x, y, theta = run.online.pose[-1]
    turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    placed = 1e3 * (np.stack((outline.points, *outline.edges())) @ turn.T + (x, y))
    drawn = [np.column_stack(line.get_data()) for line in figure.axes[0].get_lines()]
    assert any(len(line) == len(placed[0]) + 1 and np.allclose(line[:-1], placed[0]) for line in drawn)
    touched = placed[0][outline.touched]
    (thick,) = (line for line in drawn if len(line) == 4 * len(touched) > 0)
    assert np.allclose(thick[1::4], touched) and np.isnan(thick[3::4]).all()
    patches: Any = figure.axes[0].patches
    (band,) = (area.get_xy() for area in patches if len(area.get_xy()) > 2 * len(outline.points))
    assert np.allclose(band[: len(outline.points)], placed[2])
    assert np.allclose(band[-2 : -len(outline.points) - 2 : -1], placed[1])
    without = run_figure(palpate.track(replace(tracked.recording, is_shape_known=False), outline=palpate.Unknown()))
    assert len(without.axes[0].patches) == len(figure.axes[0].patches) - 1  # the true outline


def test_an_object_that_nobody_drew_has_no_place_before_its_first_contact():
    anywhere = {"first_pose": np.zeros(3), "first_pose_sigma": (1.0, 1.0, 2.0)}
    blind = replace(pushed(), **BLIND)
    run = palpate.track(blind, palpate.TrackerSettings("none"), outline=palpate.Unknown((0.1, 0.3)), **anywhere)
    figure = run_figure(run)
    assert run.online.covariance[0, 0, 0] > 0.9 and figure.axes[1].get_ylim()[1] < 500.0  # [mm]
    ellipses = lines(figure.axes[0])["95 % ellipses"]
    assert np.nanmax(np.abs(ellipses)) < 1000.0
    away = palpate.track(replace(blind, contact=np.zeros(40, np.bool_)), outline=palpate.Unknown(), **anywhere)
    drawn = [line for line in run_figure(away).axes[0].get_lines() if np.size(line.get_xdata()) > 100]
    assert not drawn


def test_the_legend_of_a_video_names_other_answers_where_there_are_some(tracked):
    answer = Answer(np.zeros(3), np.eye(3), 0.5, "shove")
    one = replace(tracked, answers=((),) * len(tracked.answers))
    several = replace(tracked, answers=(*one.answers[:-1], (answer, answer)))
    shown = [legend(run_figure(run, at_end=False)) for run in (one, several)]
    assert ["other answers" in texts for texts in shown] == [False, True]
    assert "other answers" not in legend(run_figure(several))


def test_a_legend_with_every_status_is_not_cut(tracked):
    answer = Answer(np.zeros(3), np.eye(3), 0.5, "shove")
    status = np.resize(list(STATUS_COLOURS), len(tracked.online)).tolist()
    online = replace(tracked.online, status=status)
    answers = ((answer, answer),) * len(status)
    figure = run_figure(replace(tracked, online=online, answers=answers), at_end=False)
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert set(STATUS_COLOURS) < legend(figure) and box.x0 > 0.0 and box.x1 < figure.bbox.width


def test_unknown_truth_is_left_blank(tracked):
    truth = tracked.recording.object_pose.copy()
    truth[8:12] = np.nan
    time = 1.7e9 + tracked.recording.time
    figure = run_figure(palpate.track(replace(tracked.recording, object_pose=truth, time=time)))
    assert figure.axes[1].get_xlim() == pytest.approx((0.0, 39 / 30), abs=1e-6)  # since the first frame
    assert np.isnan(lines(figure.axes[1])["error"][8:12, 1]).all()


def test_names_and_lengths_at_the_edge(tracked, tmp_path):
    odd = replace(tracked.recording, file=Path(os.fsdecode(b"push \xff $x^2$.mcap")))
    figure = run_figure(replace(tracked, recording=odd))
    assert figure.get_suptitle().startswith("push ? $x^2$.mcap\n")
    figure.savefig(tmp_path / "figure.png")  # x^2$ alone would be no formula and raise
    run_figure(palpate.track(pushed(1))).savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 1000


def test_the_pad_is_in_millimetres(tracked):
    run = replace(tracked, recording=replace(tracked.recording, sensor=palpate.DIGIT))
    pad: Any = run_figure(run).axes[0].patches[-1].get_path().vertices  # at the last frame
    x, y, yaw = run.recording.sensor_pose[-1]
    forward, across = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    along, aside = (pad * 1e-3 - (x, y)) @ forward, (pad * 1e-3 - (x, y)) @ across
    assert along.max() == pytest.approx(0.0, abs=1e-4)
    # At its edge a gel of radius R falls back by R - sqrt(R^2 - w^2): 21 - sqrt(441 - 84.64) = 2.12 mm.
    edge = along[np.isclose(np.abs(aside), np.abs(aside).max())]
    assert np.abs(aside).max() == pytest.approx(0.0092) and edge.max() == pytest.approx(-2.12e-3, abs=1e-5)
