import dataclasses
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed

from palpate.geometry.lines import ellipses_95
from palpate.pipeline.figures import run_figure, shown_instants
from palpate.pipeline.track import Run, track
from palpate.types.images import encode_image
from palpate.types.sensor import DIGIT


@pytest.fixture(scope="module")
def tracked() -> Run:
    return track(pushed())


def legend(figure: Any) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def lines(axes: Any) -> dict[str, Any]:
    return {line.get_label(): np.column_stack(line.get_data()) for line in axes.get_lines()}


def test_figure_shows_paths_errors_and_contact(tracked):
    figure = run_figure(tracked)
    above, translation, rotation = figure.axes
    assert (above.get_xlabel(), above.get_ylabel()) == ("x [mm]", "y [mm]")
    assert above.get_aspect() == 1.0
    assert translation.get_ylabel() == "translation error [mm]"
    assert rotation.get_ylabel() == "rotation error [°]"
    assert rotation.get_xlabel() == "time [s]"
    wanted = {
        "start",
        "truth",
        "estimate",
        "95 % ellipses",
        "contact",
        "1 sigma of the estimate",
        "error",
    }
    assert wanted < set(legend(figure))
    assert lines(above)["truth"] == pytest.approx(tracked.recording.object_pose[:, :2] * 1e3)
    assert lines(above)["estimate"] == pytest.approx(tracked.online.pose[:, :2] * 1e3)
    final = tracked.summary["final_translation_error_mm"]
    turned = tracked.summary["final_rotation_error_deg"]
    assert f"final error {final:.1f} mm and {turned:.1f}°, at 1.3 s" in figure.get_suptitle()
    assert lines(translation)["error"][-1] == pytest.approx([tracked.online.time[-1], final])


def test_figure_of_a_run_without_truth_shows_sigma(tracked):
    recording = dataclasses.replace(tracked.recording, object_pose=None)
    figure = run_figure(track(recording, first_pose=tracked.first_pose))
    assert figure.axes[1].get_ylabel() == "translation 1 sigma [mm]"
    assert "no ground truth" in figure.get_suptitle()
    assert not {"truth", "error", "truth unknown"} & set(legend(figure))


def test_the_title_tells_the_final_pose_with_its_sigma(tracked):
    x, y, yaw = tracked.online.pose[-1]
    # Along the world's axes, not the object's, which is turned by some 3 rad.
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    covariance = turn @ tracked.online.covariance[-1][:2, :2] @ turn.T
    sx, sy = np.sqrt(np.diag(covariance)) * 1e3
    syaw = np.degrees(np.sqrt(tracked.online.covariance[-1, 2, 2]))
    pose = f"x {1e3 * x:.1f} ± {sx:.1f} mm, y {1e3 * y:.1f} ± {sy:.1f} mm, yaw {np.degrees(yaw):.1f} ± {syaw:.1f}°"
    assert f"final pose {pose} (1 sigma)" in run_figure(tracked).get_suptitle()


def test_ellipses_stand_along_the_way_at_the_instants_and_at_the_end(tracked):
    above = run_figure(tracked).axes[0]
    along = lines(above)["95 % ellipses"]
    pieces = np.split(along, np.flatnonzero(np.isnan(along[:, 0])))
    middles = [np.nanmean(piece[:-1], axis=0) for piece in pieces if np.isfinite(piece).any()]
    assert len(middles) == 12
    assert middles[-1] == pytest.approx(tracked.online.pose[-1, :2] * 1e3, abs=0.1)
    filled: Any = [patch.get_path().vertices for patch in above.patches if patch.get_alpha() == 0.25]
    centers = [ellipse[:-2].mean(axis=0) for ellipse in filled]
    assert np.array(centers) == pytest.approx(tracked.online.pose[[8, 16, 35, 39], :2] * 1e3, abs=0.1)
    expected = ellipses_95(tracked.online.pose[39:], tracked.online.covariance[39:])[0] * 1e3
    assert filled[-1][:-1] == pytest.approx(expected)


def test_time_begins_at_the_first_frame(tracked):
    recording = tracked.recording
    later = track(dataclasses.replace(recording, time=recording.time + 1.7e9))
    figure = run_figure(later)
    assert figure.axes[1].get_xlim() == pytest.approx((0.0, 39 / 30), abs=1e-6)
    assert "at 1.3 s" in figure.get_suptitle()


def test_a_name_that_is_no_text_or_a_formula_is_drawn_as_it_is(tracked, tmp_path):
    odd = Path(os.fsdecode(b"push \xff $x^2$.mcap"))
    run = dataclasses.replace(tracked, recording=dataclasses.replace(tracked.recording, file=odd))
    figure = run_figure(run)
    assert figure.get_suptitle().startswith("push ? $x^2$.mcap\n")
    figure.savefig(tmp_path / "figure.png")  # x^2$ alone would be no formula and raise


def test_unknown_truth_and_missing_frames_are_left_blank(tracked):
    recording = tracked.recording
    truth = recording.object_pose.copy()
    truth[8:12] = np.nan
    time = recording.time + (np.arange(40) >= 25) * 2.0
    figure = run_figure(track(dataclasses.replace(recording, object_pose=truth, time=time)))
    assert "truth unknown" in legend(figure)
    error = lines(figure.axes[1])["error"]
    assert np.isnan(error[8:12, 1]).all()
    # One NaN more, in the gap after frame 24.
    assert len(error) == 41
    assert np.isnan(error[25, 1])


def test_figure_of_a_single_frame(tracked, tmp_path):
    run_figure(track(pushed(1))).savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 1000


def test_three_frames_are_shown_one_of_each_long_contact(tracked):
    # Contact in frames 5 to 19 and 32 to 39: the first is cut into 5 to 12 and 13 to 19.
    assert shown_instants(tracked) == [8, 16, 35]
    assert shown_instants(at_contacts(tracked, (2, 9), (12, 19), (22, 22), (24, 31))) == [5, 15, 27]
    assert shown_instants(at_contacts(tracked, (7, 8))) == [7, 8]
    assert shown_instants(at_contacts(tracked)) == []


def at_contacts(tracked: Run, *contacts: tuple[int, int]) -> Run:
    """The run as if tracking had found these contacts, of a recording without flags."""
    contact = np.zeros(40, np.bool_)
    for first, last in contacts:
        contact[first : last + 1] = True
    blind = dataclasses.replace(tracked.recording, contact=None)
    return dataclasses.replace(tracked, recording=blind, online=dataclasses.replace(tracked.online, contact=contact))


def test_touch_images_are_upright_and_in_millimetres(tracked):
    images = np.zeros((40, 320, 240, 3), np.uint8)
    images[:, :80, :120] = 250  # the upper left
    images[35, :, 200:] = 120
    encoded = tuple(encode_image(image, "png") for image in images)
    run = dataclasses.replace(
        tracked, recording=dataclasses.replace(tracked.recording, sensor=DIGIT, image=encoded, codec="png")
    )
    figure = run_figure(run)
    strip = figure.axes[3:]
    assert [axes.get_title() for axes in strip] == ["touch at 0.3 s", "touch at 0.5 s", "touch at 1.2 s"]
    for axes, index in zip(strip, (8, 16, 35), strict=True):
        shown: Any = axes.get_images()[0]
        assert np.array_equal(shown.get_array(), images[index])
        # 240 columns across the pad of 18.4 mm, so that 320 rows are 24.53 mm; row 0 is at the top.
        assert shown.get_extent() == pytest.approx([-9.2, 9.2, -12.267, 12.267], abs=1e-3)
        assert shown.origin == "upper"
        assert axes.get_aspect() == 1.0
    assert len(run_figure(at_contacts(run)).axes) == 3  # nothing was touched, so nothing to show


def test_the_pad_is_drawn_where_the_sensor_is(tracked):
    recording = dataclasses.replace(tracked.recording, sensor=DIGIT)
    figure = run_figure(dataclasses.replace(tracked, recording=recording))
    pad: Any = figure.axes[0].patches[-1].get_path().vertices  # at the last frame
    x, y, yaw = recording.sensor_pose[-1]
    forward = np.array([np.cos(yaw), np.sin(yaw)])
    along = (pad * 1e-3 - (x, y)) @ forward
    across = (pad * 1e-3 - (x, y)) @ np.array([-forward[1], forward[0]])
    assert along.max() == pytest.approx(0.0, abs=1e-4)
    assert np.abs(across).max() == pytest.approx(0.0092)
    # At its edge a gel of radius R falls back by R - sqrt(R^2 - w^2): 21 - sqrt(441 - 84.64) = 2.12 mm.
    edge = along[np.isclose(np.abs(across), 0.0092)]
    assert edge.max() == pytest.approx(-2.12e-3, abs=1e-5)
