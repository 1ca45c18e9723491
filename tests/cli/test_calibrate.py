"""`palpate calibrate` without presses (see tests/touch for these), and calibration files."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from recording_samples import encoded, pushed

import palpate

pytestmark = pytest.mark.usefixtures("folder")

SENSOR = palpate.SensorProfile("small", radius=0.02, image_height=48, image_width=32)


def recorded(n: int = 80, touched: slice = slice(40, 60), flags: bool = True, shown: slice | None = None) -> None:
    """Write rest.mcap, whose images are noise of 2 levels about 100, brighter by 60 in a corner where touched."""
    images = 100.0 + np.random.default_rng(0).normal(0.0, 2.0, (n, 48, 32, 3))
    images[shown or touched, :20, :20] += 60.0
    contact = np.zeros(n, np.bool_)
    contact[touched] = True
    coded = tuple(encoded(np.rint(image).astype(np.uint8)) for image in images)
    given = palpate.Recording(
        np.arange(n) / 30.0, np.zeros((n, 3)), palpate.Disc(0.05), SENSOR, None, contact if flags else None,
        image=coded,
    )  # fmt: skip
    palpate.write_recording(given, "rest.mcap", overwrite=True)


def stills(count: int, height: int = 320, width: int = 240) -> list[str]:
    """Write images of an untouched gel with noise of 2 levels; return their names."""
    rng = np.random.default_rng(0)
    gel = np.add.outer(np.linspace(80, 140, height), np.linspace(0, 30, width))[..., None] + (0.0, 10.0, 20.0)
    names = [f"{height}-{number}.png" for number in range(count)]
    for name in names:
        assert cv2.imwrite(name, np.rint(gel + rng.normal(0.0, 2.0, gel.shape)).astype(np.uint8))
    return names


def test_the_first_half_second_without_contact_is_a_calibration(succeeds, json_of, fails):
    recorded(touched=slice(10, 60))
    shown = " ".join(succeeds("calibrate", "rest.mcap", "--out", "unit.npz").split())
    assert "out unit.npz untouched 10 height 48 width 32" in shown
    found = palpate.load_calibration("unit.npz").background
    assert found.mean.shape == (48, 32, 3)
    assert found.mean.mean() == pytest.approx(100.0, abs=0.1)
    assert np.median(found.noise) == pytest.approx(1.3, abs=0.1)  # of cells of a pixel and a bit
    assert "--force replaces it" in fails("calibrate", "rest.mcap", "--out", "unit.npz")
    assert "'.png' is of no calibration" in fails("calibrate", "rest.mcap", "--out", "unit.png")
    told = json_of("calibrate", "rest.mcap", "--out", "unit.npz", "--force")
    assert told.pop("noise_levels") == pytest.approx(1.3, abs=0.1)
    shown = {"file": "rest.mcap", "out": "unit.npz", "untouched": 10, "height": 48, "offset_sigma_deg": None}
    assert shown.items() <= told.items()
    lines = [line.split() for line in succeeds("info", "unit.npz").splitlines()]
    assert ["height", "48"] in lines and ["is_view_measured", "no"] in lines


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: recorded(touched=slice(0, 80)), "rest.mcap: a background needs an untouched image"),
        (lambda: palpate.write_recording(pushed(), "rest.mcap"), "rest.mcap: a background needs an untouched image"),
        (lambda: None, "no such file"),
    ],
)
def test_recordings_that_show_no_untouched_gel(fails, make: Callable[[], Any], message):
    make()
    assert message in fails("calibrate", "rest.mcap", "--out", "unit.npz")
    assert not Path("unit.npz").exists()


def test_untouched_images_are_a_calibration(json_of):
    names = stills(4)
    told = json_of("calibrate", "--untouched", *names, "--out", "unit.npz")
    assert told["untouched"] == 4 and 0.1 < told["noise_levels"] < 0.4
    read: Any = [cv2.imread(name) for name in names]
    mean = np.array(read, np.float32)[..., ::-1].mean(axis=0)
    np.testing.assert_allclose(palpate.load_calibration("unit.npz").background.mean, mean, atol=1e-3)
    told = json_of("calibrate", "--untouched", names[0], "--sensor", "digit", "--out", "unit.npz", "--force")
    size = {"height": 320, "width": 240, "noise_levels": None, "untouched": 1}
    assert ({"file": None, "out": "unit.npz"} | size).items() <= told.items()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--untouched", "320-0.png", "240-0.png"), "240-0.png: found 240 rows and 320 columns"),
        (("--untouched", "320-0.png", "--sensor", "gelsight-mini"), "320-0.png: found 320 rows and 240 columns"),
        (("--untouched", "320-0.png", "--sensor", "point"), "320-0.png: is an image, and the sensor has none"),
        (("--untouched", "320-0.png", "other.png"), "other.png: shows a touch, or another gel than the first image"),
        (("--pushes", "rest.mcap"), "no touch model comes with palpate for sensor 'small'; give one"),
        (("--pushes", "rest.mcap", "rest.mcap", "disc.mcap"), "the recordings are of several sensors, point, small"),
        (("--untouched", "320-0.png", "--ruler", "8mm"), "found '8mm'; expected words such as 8mm caliper.png"),
        ((), "give either a recording or --untouched images"),
        (("rest.mcap", "--untouched", "320-0.png"), "give either a recording or --untouched images"),
    ],
)
def test_bad_input_is_one_line(fails, words, message):
    recorded()
    palpate.write_recording(pushed(), "disc.mcap")
    stills(1)
    stills(1, 240, 320)
    assert cv2.imwrite("other.png", np.asarray(cv2.imread("320-0.png"))[::-1])
    assert message in fails("calibrate", *words, "--out", "unit.npz")
    assert not Path("unit.npz").exists()


def test_a_run_names_its_calibration(succeeds, json_of, folder):
    recorded()
    succeeds("calibrate", "rest.mcap", "--out", "unit.npz")
    run = palpate.track(
        palpate.load_recording("rest.mcap"),
        palpate.TrackerSettings("none"),
        (0.0, 0.0, 0.0),
        calibration=palpate.load_calibration("unit.npz"),
    )
    assert run.calibration and run.calibration.file == Path("unit.npz")
    json_of("track", "rest.mcap", "--tactile", "none", "--first-pose", 0, 0, 0, "--calibration", "unit.npz")
    assert f'"calibration": "{folder / "unit.npz"}"' in Path("runs/rest/settings.json").read_text()


WHOLE = {
    "version": 5,
    **{name: np.ones((4, 4, 3), np.float32) for name in ("mean", "noise")},
    "view": [0, 0, 0, 1, 2],
    "view_known": False,
    "direction": [0.0, 1.0, 0.1, 0.1],
    "pixel_pitch": [6e-5, 0.04],
}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"view_known": None}, "'view_known' is missing"),
        ({"version": 3}, "version: found 3, expected 9; calibrate the unit anew"),
        ({"mean": np.ones((4, 4), np.float32)}, r"mean: found shape \(4, 4\), expected \(N, N, 3\)"),
        ({"mean": np.ones((4, 4, 3))}, "mean: found float64"),
        ({"mean": np.full((4, 4, 3), np.nan, np.float32)}, "mean: found .* not grey levels"),
        ({"mean": np.array([[[None, 1, 2]]])}, "damaged"),
        ({"noise": np.ones((2, 2, 3), np.float32)}, r"noise: found shape \(2, 2, 3\), expected \(4, 4, 3\)"),
        ({"view": [4, 0, 0, 1, 2]}, "view: found .4, 0, 0, 1, 2., expected quarter turns"),
        ({"pixel_pitch": [0.06, 0.04]}, r"pixel_pitch: found .0\.06, 0\.04., expected a length from 1e-6 to 0\.01 m"),
        ({"direction": [0.0, 1.0, 0.1, 0.0]}, "sigmas above 0"),
    ],
)
def test_other_calibration_files_are_refused_in_one_sentence(fields, message):
    np.savez("unit.npz", **{name: value for name, value in (WHOLE | fields).items() if value is not None})
    with pytest.raises(palpate.FileError, match=message) as error:
        palpate.load_calibration("unit.npz")
    assert str(error.value).startswith("unit.npz: ") and "\n" not in str(error.value)


def test_images_of_an_own_sensor_are_read_by_no_model_until_one_is_given(json_of, fails):
    recorded()
    start = ("--first-pose", -0.08, 0.0, 0.0)
    told = json_of("track", "rest.mcap", *start)
    assert (
        told["tactile"] == "none" and "no touch model comes with palpate for sensor 'small'" in told["tactile_reason"]
    )
    assert "for sensor 'small'; give one" in fails("track", "rest.mcap", *start, "--tactile", "learnt", "--force")
    other = fails("track", "rest.mcap", *start, "--tactile", "learnt", "--model", "digit", "--force")
    assert "sensor 'small' has images of 48 x 32 px, and the touch model is of 'DIGIT'" in other


def test_pushes_show_a_robot(json_of, fails, succeeds):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")
    assert "folder" in succeeds("simulate", "made", "--shape", "disc", "--count", "1", "--seconds", "4", "--unit", "3")
    push = palpate.load_recording("made/disc-000000.mcap")
    names = []
    for turn in (0.0, 2.0, 4.0):  # the same push in three places of the world
        names.append(f"{turn:g}.mcap")
        poses = {name: np.array(getattr(push, name)) for name in ("sensor_pose", "object_pose", "first_pose")}
        for pose in poses.values():
            x, y, theta = pose.T
            pose.T[:] = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y, theta + turn
        palpate.write_recording(dataclasses.replace(push, extra={}, **poses), names[-1])
    told = json_of("calibrate", "--pushes", *names, "--out", "unit.npz")
    assert told["pushes"] == 3 and told["untouched"] == 15 and Path("unit.png").stat().st_size > 1000
    assert {"delay [ms]", "outline size [%]"} < set(told["robot"])
    assert all(0.0 < row["sigma"] <= row["sigma_before"] for row in told["robot"].values())
    assert json_of("info", "unit.npz")["sideways"][1] > 0.0
    assert json_of("track", names[0], "--calibration", "unit.npz")["contact_frames"] > 10
    palpate.write_recording(dataclasses.replace(push, image=None), "unseen.mcap")
    other = (encoded(np.full((320, 240, 3), (90, 20, 160), np.uint8)),) * len(push)
    palpate.write_recording(dataclasses.replace(push, image=other), "other.mcap")
    for given, message in (
        ([*names[:2], names[1]], "found 2 pushes; at least 3 different ones that fit are needed"),
        (["unseen.mcap", *names[:2]], "unseen.mcap: a background needs an untouched image, found none"),
        ([*names[:2], "unseen.mcap"], "unseen.mcap: has no images"),
        ([*names[:2], "other.mcap"], "other.mcap: frame 0: image: 85% of it is unlike the untouched gel"),
        (["gone.mcap", *names[:2]], "gone.mcap"),
    ):
        assert message in fails("calibrate", "--pushes", *given, "--out", "other.npz")
        assert not Path("other.npz").exists() and not Path("other.png").exists()
