import dataclasses
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed

from palpate.evaluation.figures import run_figure
from palpate.evaluation.run import Run, track


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
    wanted = {"start", "truth", "estimate", "contact", "1 sigma of the estimate", "error"}
    assert wanted < set(legend(figure))
    assert "final error" in figure.get_suptitle()
    assert lines(above)["truth"] == pytest.approx(tracked.recording.object_pose[:, :2] * 1e3)
    assert lines(above)["estimate"] == pytest.approx(tracked.online.pose[:, :2] * 1e3)
    final = tracked.summary["final_translation_error_mm"]
    assert lines(translation)["error"][-1] == pytest.approx([tracked.online.time[-1], final])


def test_figure_of_a_run_without_truth_shows_sigma(tracked):
    recording = dataclasses.replace(tracked.recording, object_pose=None)
    figure = run_figure(track(recording, first_pose=tracked.first_pose))
    assert figure.axes[1].get_ylabel() == "translation 1 sigma [mm]"
    assert "no ground truth" in figure.get_suptitle()
    assert not {"truth", "error", "truth unknown"} & set(legend(figure))


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
