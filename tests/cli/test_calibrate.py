"""Calibrations: from recordings, their file, and the command."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed

from palpate.cli import main
from palpate.errors import FileError, SettingError
from palpate.io.recording_mcap import write_recording
from palpate.touch.background import Background, background_of
from palpate.touch.calibration import (
    MARGIN,
    NEEDED,
    Calibration,
    DirectionCorrection,
    calibrate,
    load_calibration,
    untouched_frames,
    write_calibration,
)
from palpate.touch.camera_view import CameraView
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile

SENSOR = SensorProfile("small", radius=0.02, image_height=48, image_width=32)


def recorded(n: int = 80, touched: slice = slice(40, 60), flags: bool = True, shown: slice | None = None) -> Recording:
    """A recording whose images are noise of 2 levels about 100, brighter by 60 in a corner where touched."""
    rng = np.random.default_rng(0)
    images = 100.0 + rng.normal(0.0, 2.0, (n, 48, 32, 3))
    images[shown or touched, :20, :20] += 60.0
    contact = np.zeros(n, np.bool_)
    contact[touched] = True
    coded = tuple(encode_image(np.rint(image).astype(np.uint8), "png") for image in images)
    poses = np.zeros((n, 3))
    return Recording(
        np.arange(n) / 30.0, poses, pushed().shape, SENSOR, None, contact if flags else None, image=coded, codec="png"
    )


@pytest.fixture
def background() -> Background:
    rng = np.random.default_rng(1)
    return Background(*rng.uniform(1.0, 200.0, (2, 48, 32, 3)).astype(np.float32))


def palpate(*words: Any) -> int:
    return main.main([str(word) for word in words])


def test_statistics_are_those_of_numpy():
    images = np.random.default_rng(2).integers(0, 256, (9, 6, 5, 3)).astype(np.uint8)
    found = background_of(image for image in images)
    assert np.allclose(found.mean, images.mean(axis=0), rtol=1e-6)
    assert np.allclose(found.deviation, images.std(axis=0, ddof=1), rtol=1e-5)
    assert found.mean.dtype == found.deviation.dtype == np.float32
    for count in (0, 1):
        with pytest.raises(SettingError, match=f"2 or more untouched images, found {count}"):
            background_of(images[:count])


def test_frames_near_a_contact_are_left_out():
    recording = recorded()
    expected = [*range(40 - MARGIN), *range(60 + MARGIN, 80)]
    assert untouched_frames(recording).tolist() == expected
    counted: list[int] = []
    background, frames = calibrate(recording, counted.append)
    assert frames == len(expected) and counted == list(range(1, frames + 1))
    assert background.mean.mean() == pytest.approx(100.0, abs=0.1)
    assert np.median(background.deviation) == pytest.approx(2.0, abs=0.1)


def test_without_flags_all_frames_count_and_a_touch_is_an_error():
    untouched = recorded(touched=slice(0, 0), flags=False)
    assert calibrate(untouched)[1] == 80
    with pytest.raises(FileError, match=r"frame 40 is off the first ones in \d\d\.\d% of its values, as if touched"):
        calibrate(recorded(flags=False))
    # From the start on: then its end shows.
    with pytest.raises(FileError, match="frame 30 is off"):
        calibrate(recorded(touched=slice(0, 30), flags=False))


def test_flags_that_miss_a_touch_are_found_out():
    with pytest.raises(FileError, match="frame 62 is off"):
        calibrate(recorded(shown=slice(40, 70)))  # 60 and 61 are beside the flagged contact
    assert untouched_frames(recorded())[38] == 62


def test_too_few_frames_and_no_images_are_told():
    with pytest.raises(FileError, match=f"found {NEEDED - 1} frames .* needs {NEEDED}"):
        calibrate(recorded(touched=slice(NEEDED - 1 + MARGIN, 80)))
    assert calibrate(recorded(touched=slice(NEEDED + MARGIN, 80)))[1] == NEEDED
    with pytest.raises(FileError, match="has no images"):
        calibrate(replace(recorded(), image=None))


def test_a_file_gives_back_what_was_written(tmp_path, background):
    path = tmp_path / "unit.npz"
    correction = DirectionCorrection(0.01, 0.95, 0.002, 0.03)
    given = Calibration(background, CameraView(3, True, (2, 0, 1)), correction, is_view_known=True)
    write_calibration(given, path)
    again = load_calibration(path)
    assert (again.background.mean == background.mean).all()
    assert (again.background.deviation == background.deviation).all()
    assert (again.background.noise == background.noise).all()
    assert (again.view, again.direction, again.file) == (given.view, given.direction, path)
    assert again.is_view_known and again.hash == given.hash != replace(given, is_view_known=False).hash
    with pytest.raises(FileError, match="already exists"):
        write_calibration(given, path)
    brighter = Background(background.mean + 1.0, background.deviation)
    write_calibration(Calibration(brighter), path, overwrite=True)
    again = load_calibration(path)
    assert (again.background.mean == background.mean + 1.0).all()
    assert (again.view, again.direction, again.is_view_known) == (CameraView(), DirectionCorrection(), False)
    assert [each.name for each in tmp_path.iterdir()] == ["unit.npz"]


WHOLE = {
    "version": 4,
    **{name: np.ones((4, 4, 3), np.float32) for name in ("mean", "deviation", "noise")},
    "view": [0, 0, 0, 1, 2],
    "view_known": False,
    "direction": [0.0, 1.0, 0.1, 0.1],
}


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"view_known": None}, "'view_known' is missing"),
        ({"version": None}, "'version' is missing"),
        ({"version": 3}, "version: found 3, expected 4; calibrate the unit anew"),
        ({"mean": np.ones((4, 4), np.float32)}, r"mean: found shape \(4, 4\), expected \(N, N, 3\)"),
        ({"mean": np.ones((4, 4, 3))}, "mean: found values of type float64, expected float32"),
        ({"mean": np.full((4, 4, 3), np.nan, np.float32)}, "mean: found .* not grey levels"),
        ({"mean": np.array([[[None, 1, 2]]])}, "damaged"),
        ({"deviation": np.full((4, 4, 3), -1.0, np.float32)}, "deviation: found .* not grey levels"),
        ({"deviation": np.ones((4, 5, 3), np.float32)}, r"deviation: found shape \(4, 5, 3\), expected \(4, 4, 3\)"),
        ({"noise": np.ones((2, 2, 3), np.float32)}, r"noise: found shape \(2, 2, 3\), expected \(4, 4, 3\)"),
        ({"view": [4, 0, 0, 1, 2]}, "view: found .4, 0, 0, 1, 2., expected quarter turns"),
        ({"view": [0, 0, 0, 1, 1]}, "view: found"),
        ({"direction": [0.0, 1.0, 0.1]}, "direction: found shape"),
        ({"direction": [0.0, 0.0, 0.1, 0.1]}, "direction: found"),
        ({"direction": [0.0, 1.0, 0.1, 0.0]}, "sigmas above 0"),
    ],
)
def test_other_files_are_refused_in_one_sentence(tmp_path, fields, words):
    path = tmp_path / "unit.npz"
    np.savez(path, **{name: value for name, value in (WHOLE | fields).items() if value is not None})
    with pytest.raises(FileError, match=words) as error:
        load_calibration(path)
    assert str(error.value).startswith(f"{path}: ") and "\n" not in str(error.value)


def test_damaged_files_are_refused(tmp_path, background):
    path = tmp_path / "unit.npz"
    write_calibration(Calibration(background), path)
    data = path.read_bytes()
    middle = len(data) // 2
    for content in (b"", b"no archive", data[:middle], data[:middle] + bytes(64) + data[middle + 64 :]):
        path.write_bytes(content)
        with pytest.raises(FileError, match=r"unit\.npz: is "):
            load_calibration(path)
    with pytest.raises(FileError, match="no such file"):
        load_calibration(tmp_path / "none.npz")


def test_command_writes_a_calibration_and_says_so(tmp_path, capsys):
    source, out = tmp_path / "rest.mcap", tmp_path / "unit.npz"
    write_recording(recorded(), source)
    assert palpate("calibrate", source, "--out", out) == 0
    line = f"{out}: 48 x 32 px, noise 2.0 grey levels, from 56 frames without contact\n"
    assert capsys.readouterr() == (line, "")
    assert load_calibration(out).background.mean.shape == (48, 32, 3)
    assert palpate("calibrate", source, "--out", out) == 2
    assert "--force replaces it" in capsys.readouterr().err
    assert palpate("calibrate", source, "--out", out, "--force", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert palpate("info", out) == 0
    assert "48 x 32 px" in (shown := capsys.readouterr().out) and "2.0 grey levels" in shown and "not measured" in shown
    assert told.pop("noise_levels") == pytest.approx(2.0, abs=0.1)
    assert told == {"file": str(source), "out": str(out), "frames": 56, "height": 48, "width": 32}


def test_a_run_names_its_calibration(tmp_path, monkeypatch, capsys, no_figures):
    monkeypatch.chdir(tmp_path)
    write_recording(recorded(), "rest.mcap")
    assert palpate("calibrate", "rest.mcap", "--out", "unit.npz") == 0
    for options, wanted in (((), None), (("--calibration", "unit.npz"), "unit.npz")):
        assert (
            palpate(
                "track",
                "rest.mcap",
                "--tactile",
                "none",
                "--out",
                "run",
                "--force",
                "--first-pose",
                "0",
                "0",
                "0",
                *options,
            )
            == 0
        )
        named = json.loads(Path("run/settings.json").read_text())["calibration"]
        assert named == (wanted and str(tmp_path / wanted))  # so that it is found from any folder


def test_command_fails_in_one_line_and_leaves_nothing(tmp_path, capsys):
    blind, short = tmp_path / "blind.mcap", tmp_path / "short.mcap"
    write_recording(pushed(), blind)
    write_recording(recorded(touched=slice(20, 80)), short)
    text = tmp_path / "text.mcap"
    text.write_text("no recording")
    for file, words in (
        (blind, "has no images"),
        (short, "found 18 frames"),
        (text, "text.mcap"),
        (Path("no.mcap"), "no such"),
    ):
        assert palpate("calibrate", file, "--out", tmp_path / "unit.npz") == 2
        out, err = capsys.readouterr()
        assert out == "" and words in err and err.count("\n") == 1
    assert not (tmp_path / "unit.npz").exists()
