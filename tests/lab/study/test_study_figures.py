import io
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from matplotlib.figure import Figure
from palpate.graph.smoother import SmootherName
from PIL import Image
from study_samples import drawn_results, drawn_trial, drawn_trials, with_summary

from palpate.geometry.shapes import Disc, shape_to_dict
from palpate.lab.study.figures import Key, Sheet, Tile, render, study_sheets
from palpate.lab.study.figures.final_errors import ROTATION, TRANSLATION, against_sheets, box_sheet, slid_sheet
from palpate.lab.study.figures.methods import COLOURS, DASHES, groups_of, main_method, methods_of
from palpate.lab.study.figures.over_time import coverage_sheet, nees_sheet, sigma_sheets, translation_sheet
from palpate.lab.study.figures.samples import Samples, quartiles, share
from palpate.lab.study.figures.step_time import step_time_sheet
from palpate.lab.study.figures.trajectories import trajectory_sheet
from palpate.lab.study.trial import Method, Trial
from palpate.touch.modes import Tactile

NONE, LEARNT, ORACLE = (Method(tactile, "fixed-lag") for tactile in ("none", "learnt", "oracle"))
SIX = ["error-translation", "error-rotation", "final-translation", "final-rotation", "step-time", "trajectories"]
ALL_SHEETS = [*SIX, "nees", "coverage", "sigma-translation", "sigma-rotation", "slid"]


def drawn(tile: Tile) -> Any:
    """Return the axes with the picture."""
    axes = Figure().add_subplot()
    tile.draw(axes)
    return axes


def line(axes: Any, colour: str) -> Any:
    """Return the known points (n, 2) of the one line of a colour."""
    (found,) = (each for each in axes.get_lines() if each.get_color() == colour)
    points = np.column_stack(found.get_data())
    return points[np.isfinite(points).all(axis=1)]


def off(millimetres: Any, number: int = 0, method: Method = LEARNT, group: str = "disc", rate: float = 10.0) -> Trial:
    """Return a trial that is off by so much at each frame; contact from frame 2 on, sigmas of 1 mm and 1 mrad."""
    error = np.asarray(millimetres, np.float64) * 1e-3
    n = len(error)
    truth = np.zeros((n, 3))
    trial = drawn_trial(method, group, number)
    return with_summary(
        replace(
            trial,
            time=5.0 + np.arange(n) / rate,
            truth=truth,
            pose=truth + np.column_stack([error, 0.0 * error, 0.0 * error]),
            covariance=np.full((n, 3, 3), 1e-6 * np.eye(3)),
            contact=np.arange(n) >= 2,
            sensor_pose=truth,
            slid=np.linspace(0.0, 5e-3, n),
            step_ms=np.arange(1.0, n + 1.0),
            summary={},
        )
    )


def test_samples_take_the_nearest_frame_from_the_first_contact_on():
    samples = Samples([off(np.arange(12.0)), off(np.arange(31.0), rate=28.0)])
    assert samples.time == pytest.approx(np.arange(12) * 0.1)
    found = samples.of(lambda trial: trial.translation_error * 1e3)
    assert np.isnan(found[0, :2]).all()  # contact begins at frame 2
    assert found[0, 2:] == pytest.approx(np.arange(2, 12))
    # Frame 2.8 k rounded, and at the end the last but none; instant 0 is before contact.
    assert found[1] == pytest.approx([np.nan, 3, 6, 8, 11, 14, 17, 20, 22, 25, 28, 30], nan_ok=True)


def test_samples_in_a_gap_and_after_the_end_are_unknown():
    long, gap = off(np.zeros(40)), off(np.zeros(20), rate=12.5)
    time = gap.time + (np.arange(20) >= 10) * 1.0
    found = Samples([long, replace(gap, time=time)]).of(lambda trial: trial.translation_error)
    # Frames 0 to 9 stand at 0 to 0.72 s, 10 to 19 at 1.8 to 2.52 s: up to 0.075 s to either side is known. Contact
    # begins with frame 2, at 0.16 s, to which 0.2 s is nearest.
    assert np.flatnonzero(np.isnan(found[1])).tolist() == [0, 1, *range(8, 18), *range(26, 40)]
    assert np.flatnonzero(np.isnan(found[0])).tolist() == [0, 1]


def test_a_trial_without_contact_is_taken_as_a_whole():
    trial = off(np.zeros(10))
    found = Samples([replace(trial, contact=np.zeros(10, np.bool_))]).of(lambda trial: trial.translation_error)
    assert np.isfinite(found).all()


def test_quartiles_leave_out_what_is_unknown_and_end_with_half_of_the_sequences():
    values = np.random.default_rng(0).normal(size=(5, 40))
    values[1:3, 10:] = np.nan
    values[3, 30:] = np.nan
    found = quartiles(values)
    wanted = np.nanpercentile(values[:, :30], (25, 50, 75), axis=0)
    assert np.array([found.low, found.median, found.high])[:, :30] == pytest.approx(wanted)
    assert np.isnan(found.median[30:]).all()  # two of five
    assert np.isnan(quartiles(np.full((3, 2), np.nan)).low).all()
    assert share(np.array([[1.0, 0.0, np.nan], [1.0, 1.0, np.nan]])) == pytest.approx([1.0, 0.5, np.nan], nan_ok=True)


def test_every_method_has_its_own_look_and_place():
    assert set(COLOURS) == set(get_args(Tactile))
    assert len(set(COLOURS.values())) == len(COLOURS)
    assert set(get_args(SmootherName)) <= set(DASHES)
    assert len(set(DASHES.values())) == len(DASHES)
    isam2 = Method("none", "isam2")
    trials = [
        drawn_trial(method, group) for group in ("mit", "butterfly", "ellipse", "disc") for method in (ORACLE, isam2)
    ]
    assert methods_of(trials) == [ORACLE, isam2]
    assert groups_of(trials) == ["disc", "ellipse", "butterfly", "mit"]
    assert main_method([NONE, LEARNT]) == LEARNT
    assert main_method([NONE, ORACLE, Method("oracle", "isam2")]) == ORACLE


def test_error_over_time_shows_the_median_and_the_spread():
    trials = [off(np.full(20, each), number) for number, each in enumerate((1.0, 2.0, 4.0, 7.0, 100.0))]
    trials += [off(np.full(20, 0.001), 0, ORACLE)]
    sheet = translation_sheet(Samples(trials))
    assert sheet and [tile.title for tile in sheet.tiles] == ["disc"]
    assert [key.label for key in sheet.legend] == ["learnt", "oracle"]
    axes = drawn(sheet.tiles[0])
    assert line(axes, COLOURS["learnt"])[:, 1] == pytest.approx(4.0)
    assert line(axes, COLOURS["oracle"])[:, 1] == pytest.approx(0.1)  # the floor
    band: Any = axes.collections[0].get_paths()[0].get_extents()
    assert (band.ymin, band.ymax) == pytest.approx((2.0, 7.0))
    assert axes.get_yscale() == "log"
    assert axes.get_ylim() == pytest.approx((0.1, 1.3 * 7.0))
    assert "learnt 4" in sheet.tiles[0].alt


def test_groups_share_their_axis_and_come_together_first():
    trials = [off(np.full(20, 1.0)), off(np.full(30, 50.0), group="ellipse")]
    sheet = translation_sheet(Samples(trials))
    assert sheet and [tile.title for tile in sheet.tiles] == ["all groups", "disc", "ellipse"]
    everything, disc, _ = map(drawn, sheet.tiles)
    assert disc.get_ylim()[1] == pytest.approx(1.3 * 50.0)
    # The disc is known from 0.2 to 1.9 s of 2.9 s; after it, one of two sequences is half of them.
    assert line(disc, COLOURS["learnt"])[:, 0] == pytest.approx(np.arange(2, 20) * 0.1)
    assert line(everything, COLOURS["learnt"])[[0, -1], 1] == pytest.approx([25.5, 50.0])


def test_consistency_over_time():
    # Off by 1, 2 and 3 sigma: NEES 1, 4 and 9, of which two are below 7.81.
    trials = [off(np.full(10, sigma), int(sigma)) for sigma in (1.0, 2.0, 3.0)]
    nees, coverage = nees_sheet(Samples(trials)), coverage_sheet(Samples(trials))
    assert nees and coverage
    axes = drawn(nees.tiles[0])
    assert line(axes, COLOURS["learnt"])[:, 1] == pytest.approx(4.0)
    box: Any = axes.patches[0].get_extents().transformed(axes.transData.inverted())
    assert (box.ymin, box.ymax) == pytest.approx((0.2158, 9.3484), abs=1e-3)
    assert "mean 3 (thin line), median 2.4, and 95 % of single values between 0.22 and 9.3" in nees.caption
    assert "NEES below 7.81" in coverage.caption
    assert line(drawn(coverage.tiles[0]), COLOURS["learnt"])[:, 1] == pytest.approx(200.0 / 3.0)


def test_uncertainty_over_time_and_where_contact_is():
    touching, away = off(np.zeros(10)), off(np.zeros(10), 1)
    away = replace(away, contact=np.arange(10) == 2)
    translation, rotation = sigma_sheets(Samples([touching, away]))
    # The root of 1 + 1 mm^2, and 1 mrad = 0.0573 degrees.
    assert line(drawn(translation.tiles[0]), COLOURS["learnt"])[:, 1] == pytest.approx(np.sqrt(2.0))
    axes = drawn(rotation.tiles[0])
    assert line(axes, COLOURS["learnt"])[:, 1] == pytest.approx(0.0573, rel=1e-3)
    strip = np.asarray(axes.child_axes[0].get_images()[0].get_array())
    assert strip[0] == pytest.approx([np.nan, np.nan, 1.0, *[0.5] * 7], nan_ok=True)


def test_boxes_of_final_errors():
    trials = [off([0.0, 0.0, 0.0, end], number, LEARNT) for number, end in enumerate((1.0, 2.0, 3.0, 4.0, 50.0))]
    trials += [off([0.0, 0.0, 0.0, 0.0], 0, NONE)]
    sheet = box_sheet(trials, TRANSLATION)
    assert sheet and sheet.tiles[0].title == "disc (5)"
    axes = drawn(sheet.tiles[0])
    assert [label.get_text() for label in axes.get_yticklabels()] == ["none", "learnt"]
    assert [patch.get_edgecolor()[:3] for patch in axes.patches] == [
        (0.0, 0.0, 0.0),
        pytest.approx((0.0, 0.447, 0.698), abs=1e-3),
    ]
    box: Any = axes.patches[1].get_path().get_extents()
    assert (box.xmin, box.xmax) == pytest.approx((2.0, 4.0))
    medians = [each.get_xdata() for each in axes.get_lines() if each.get_linewidth() == 2.0]
    assert np.array(medians) == pytest.approx(np.array([[0.1, 0.1], [3.0, 3.0]]))
    assert "50 % " not in sheet.caption
    rotation = box_sheet(trials, ROTATION)
    assert rotation and drawn(rotation.tiles[0]).get_xlabel() == "final rotation error [°]"


def test_slip_is_shown_where_it_is_known():
    known, unknown = off([0.0, 0.0, 0.0, 20.0]), drawn_trial(LEARNT, "mit", slip=False)
    sheet = slid_sheet([known, with_summary(unknown)])
    assert sheet and [tile.title for tile in sheet.tiles] == ["learnt (1)"]
    assert "are left out: 1." in sheet.caption
    axes = drawn(sheet.tiles[0])
    assert line(axes, COLOURS["learnt"]) == pytest.approx(np.array([[5.0, 20.0]]))
    ends = line(axes, "#666666")
    assert ends[:, 0] == pytest.approx(ends[:, 1])
    assert slid_sheet([with_summary(unknown)]) is None


def test_time_per_step_over_the_sequence():
    # 120 frames in 60 spans: each holds two of each trial, steps k and k + 1 of one, twice that of the other.
    trials = [off(np.zeros(121), number) for number in range(2)]
    trials[1] = replace(trials[1], step_ms=2.0 * trials[1].step_ms)
    sheet = step_time_sheet(trials)
    median, high = (line(drawn(tile), COLOURS["learnt"]) for tile in sheet.tiles)
    assert median[[0, -1], 0] == pytest.approx([0.1, 11.9])  # middles of 12 s / 60
    # 1, 2, 2, 4: median 2, and at 95 % 0.85 of the way from 2 to 4.
    assert (median[0, 1], high[0, 1]) == pytest.approx((2.0, 3.7))


def test_trajectories_are_the_typical_and_the_worst_with_outlines():
    trials = [off([0.0, 0.0, 0.0, end], number) for number, end in enumerate((3.0, 1.0, 50.0, 4.0, 2.0))]
    shape = {"shape": shape_to_dict(Disc(0.08))}
    sheet = trajectory_sheet([*trials, off([0.0] * 4, 9, NONE)], {trial.recording: shape for trial in trials})
    assert sheet and [key.label for key in sheet.legend] == ["truth", "estimate, learnt", "start", "sensor in contact"]
    assert [tile.title for tile in sheet.tiles] == [
        "disc, typical\ndisc-1100000\n3.0 mm, 0.0°",
        "disc, worst\ndisc-1100002\n50.0 mm, 0.0°",
    ]
    worst = drawn(sheet.tiles[1])
    assert worst.get_aspect() == 1.0
    outlines = [np.column_stack(each.get_data()) for each in worst.get_lines() if len(each.get_xdata()) == 101]
    assert len(outlines) == 1 + 2 * 3 + 2
    truth, estimate = outlines[-2:]
    assert np.hypot(*truth.T) == pytest.approx(80.0)
    assert np.hypot(*(estimate - (50.0, 0.0)).T) == pytest.approx(80.0)
    bare = trajectory_sheet(trials[:1], {})
    assert bare and len(bare.tiles) == 1  # no outline known, and no worst one
    assert len(drawn(bare.tiles[0]).get_lines()) == 3


def test_another_study_is_compared_sequence_by_sequence():
    trials = [off([0.0] * 4), off([0.0] * 4, 0, NONE)]
    sequence = {"recording": "a", "method": "learnt", "group": "disc", "change": -5.0}
    errors = {"final_mm": 2.0, "final_deg": 1.0, "rmse_mm": 1.0, "rmse_deg": 1.0}
    against = {
        "folder": "old",
        "methods": {},
        "sequences": [{**sequence, "before": errors, "after": errors | {"final_mm": 7.0}}],
    }
    translation, rotation = against_sheets(trials, against)
    assert line(drawn(translation.tiles[0]), COLOURS["learnt"]) == pytest.approx(np.array([[2.0, 7.0]]))
    assert line(drawn(rotation.tiles[0]), COLOURS["learnt"]) == pytest.approx(np.array([[1.0, 1.0]]))
    assert "error in old" in translation.caption


def test_the_figures_that_the_data_allow():
    trials = drawn_trials(["disc", "mit"], [NONE, LEARNT], 2, seconds=3.0)
    assert [sheet.name for sheet in study_sheets(trials, drawn_results(trials))] == ALL_SHEETS
    blind = [with_summary(drawn_trial(LEARNT, truth=False, slip=False))]
    assert [sheet.name for sheet in study_sheets(blind, {})] == ["step-time", "sigma-translation", "sigma-rotation"]
    assert study_sheets([], {}) == []


def test_trials_of_a_single_frame_and_without_contact():
    single, away = off([0.0, 0.0, 0.0]), off(np.zeros(5), 1)
    single = replace(single, **{name: getattr(single, name)[:1] for name in ("time", "truth", "pose", "covariance")})
    single = replace(
        single, **{name: getattr(single, name)[:1] for name in ("contact", "sensor_pose", "slid", "step_ms")}
    )
    for trials in ([single], [single, replace(away, contact=np.zeros(5, np.bool_))]):
        for sheet in study_sheets(trials, {}):
            assert render(sheet)[0]


def test_rendering_takes_a_sheet_apart_into_its_pictures():
    def draw(axes: Any) -> None:
        axes.plot([0.0, 1.0], [0.0, 1.0], color="#0072B2")

    tiles = tuple(Tile(f"tile {number}\ntwo lines", "", draw) for number in range(3))
    legend = (Key("a", "#0072B2", (2.0, 1.0)), Key("b", "#000000", marker=True), Key("c", "#dddddd", band=True))
    sheet = Sheet("name", "Title", "", tiles, legend, width=2.0, height=1.8, columns=2)
    whole, pictures = render(sheet)
    images = [np.asarray(Image.open(io.BytesIO(data)).convert("RGB")) for data in (whole, *pictures)]
    # 150 pixels an inch; two rows of two, and the header with two rows of legend above.
    assert [image.shape for image in images] == [(540 + 138, 600, 3), *[(270, 300, 3)] * 3]
    assert np.array_equal(images[0][138 : 138 + 270, 300:], images[2])
    assert all((image < 200).any(axis=-1).mean() > 0.01 for image in images)
