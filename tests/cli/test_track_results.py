"""What `palpate track` leaves for people and other programs: report, trajectories, videos, and numbers with units."""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, ImageSequence
from view_samples import imaged_push

import palpate

pytestmark = pytest.mark.usefixtures("folder")


def test_the_report_is_short_and_all_shows_the_rest(succeeds):
    sigma = ("--first-pose-sigma", "20mm", "20mm", "17deg")
    out = succeeds("track", "push.mcap", *sigma)
    lines = out.splitlines()
    found = json.loads(Path("runs/push/summary.json").read_text())
    assert len(lines) <= 8 and not any(line.rstrip().endswith(" -") for line in lines)
    assert f"{found['final_translation_error_mm']:.1f} mm" in out and found["final_status"] in out
    assert str(Path("runs/push/figure.png")) in out
    (ambiguous,) = [line for line in lines if line.startswith("ambiguous")]
    assert f"{found['statuses']['ambiguous'] / 40:.0%}" in ambiguous and "first pose that is known roughly" in ambiguous
    assert succeeds("info", "runs/push").splitlines()[1:] == lines[1:]
    everything = succeeds("info", "runs/push", "--all")
    assert "nees_mean" in everything and "nees_mean" not in out
    (reasons,) = [line for line in everything.splitlines() if line.startswith("reasons")]
    assert f"ambiguous: {found['reasons']['ambiguous']}" in reasons  # sentences, which hold commas of their own


def test_a_trajectory_holds_the_estimates_and_the_truth(succeeds):
    succeeds("track", "push.mcap", "--tum")
    found, truth = (np.loadtxt(f"runs/push/{name}.tum") for name in ("trajectory", "truth"))
    run = palpate.track(palpate.load_recording("push.mcap"))
    for table, pose in ((found, run.online.pose), (truth, run.recording.truth)):
        assert table[:, 0].tolist() == run.online.time.tolist()
        assert table[:, 1:3] == pytest.approx(pose[:, :2]) and not table[:, 3:6].any()
        assert np.cos(2.0 * np.arctan2(table[:, 6], table[:, 7])) == pytest.approx(np.cos(pose[:, 2]))
        assert np.sin(2.0 * np.arctan2(table[:, 6], table[:, 7])) == pytest.approx(np.sin(pose[:, 2]))
    succeeds("track", "blind.mcap", "--tum", "--first-pose", 0, 0, 3)
    assert not Path("runs/blind/truth.tum").exists()


@pytest.mark.parametrize("name", ["push.gif", "push.mp4"])
def test_a_video_shows_the_push(succeeds, fails, name, monkeypatch):
    monkeypatch.setattr("palpate.viewer.video.RATE", 4.0)
    palpate.write_recording(imaged_push(), "seen.mcap")
    succeeds("track", "seen.mcap", "--video", name)
    if name.endswith("gif"):
        with Image.open(name) as animation:
            pictures = [np.array(picture.convert("RGB")) for picture in ImageSequence.Iterator(animation)]
    else:
        video = cv2.VideoCapture(name)
        pictures = []
        while (read := video.read())[0]:
            pictures.append(cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB))
    assert 6 <= len(pictures) <= 9
    columns = []
    for picture in (pictures[0], pictures[-1]):
        left = picture[100:460, : picture.shape[1] // 2].astype(int)
        orange = np.abs(left - (222, 119, 51)).max(axis=-1) < 40  # the sensor, over white
        columns.append(np.median(np.flatnonzero(orange) % left.shape[1]))
    assert columns[0] + 20 < columns[1]
    assert (pictures[0][200:400, 980:] != pictures[-1][200:400, 980:]).any()  # the touch image
    assert "already exists" in fails("track", "seen.mcap", "--video", name, "--out", "again")
    assert not Path("again").exists() and not list(Path().glob(".*.part*"))


def test_a_library_of_an_extra_that_is_missing_is_one_sentence(succeeds, fails, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    monkeypatch.setitem(sys.modules, "cv2", None)
    assert "[video]'" in fails("track", "push.mcap", "--video", "push.mp4")
    assert not Path("runs").exists()
    camera = ("--poses", "udp:5005", "--shape", "disc", "--first-pose", 0, 0, 0)
    assert "[camera]'" in fails("live", "--camera", 7, *camera)
    palpate.write_recording(imaged_push(), "seen.mcap")
    succeeds("track", "seen.mcap", "--video", "push.gif", "--html")  # which need neither


def test_videos_that_cannot_be_are_one_sentence(fails):
    assert ".mp4 and .gif" in fails("track", "push.mcap", "--video", "push.avi")
    assert "is of one recording, found 2" in fails("track", "push.mcap", "blind.mcap", "--video", "push.gif")
    assert not Path("runs").exists()


def test_numbers_have_units(succeeds, fails):
    succeeds(
        "track", "blind.mcap", "--first-pose", "120mm", "-5cm", "-17deg", "--first-pose-sigma", "1cm", ".02", "0.3rad"
    )
    found = json.loads(Path("runs/blind/settings.json").read_text())
    assert found["first_pose"] == pytest.approx([0.12, -0.05, -0.29670597])
    assert found["first_pose_sigma"] == pytest.approx([0.01, 0.02, 0.3])
    for wrong in ("17grad", "17mm", "x", ""):
        assert f"--first-pose: found {wrong!r}" in fails("track", "blind.mcap", "--first-pose", "0", "0", wrong)


def test_an_option_of_a_bag_that_is_no_number(fails):
    assert "--plane: found 1 2; allowed is X Y Z or fit" in fails("track", "push.mcap", "--plane", "1", "2")
