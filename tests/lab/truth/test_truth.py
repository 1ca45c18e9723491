"""`palpate truth`, `truth-camera` and `truth-print`: ground truth from rendered overhead videos."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import planar
import pytest

from palpate import DIGIT, Recording, load_recording, load_shape, write_recording

Gray = np.ndarray
ROWS, COLUMNS, COUNT = 720, 960, 45
MATRIX = np.array([[1200.0, 0.0, 480.0], [0.0, 1200.0, 360.0], [0.0, 0.0, 1.0]])
TAGS = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
ON_OBJECT, ON_SENSOR = (0, 0.06, 0.04), (1, 0.03, 0.07)  # number, side [m], height over the table [m]
ON_TABLE = {10: (-0.1, 0.06), 11: (0.1, 0.06), 12: (-0.1, -0.06), 13: (0.1, -0.06)}  # places [m], of 50 mm
WORLD_T_TABLE, SENSOR_T_TAG, DELAY = np.array([0.5, -0.2, 0.6]), np.array([-0.02, 0.004, 0.1]), 3.237
SHEET = np.array([0.0, 0.07, 0.0])  # pose of the table's sheet in the view; the push happens beside it


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def drawn(canvas: Gray, patches: list[tuple[int, float, float, Any]]) -> Gray:
    """Draw tags of a number, side, height and pose on a canvas of half pixels, seen from 0.6 m above at an angle."""
    canvas, c, s = canvas.copy(), np.cos(0.12), np.sin(0.12)
    rotation = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) @ np.diag([1.0, -1.0, -1.0])
    shift = -rotation @ (np.array([0.0, -0.01, 0.0]) - 0.6 * (rotation.T @ np.array([0.0, 0.0, 1.0])))
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # pixels have their coordinates in the middle
    for number, size, height, pose in patches:
        side, border = 200, 30
        image = np.pad(TAGS.generateImageMarker(number, side), border, constant_values=255)
        scale, middle = size / side, side / 2 + border
        flat = np.array([[scale, 0.0, -scale * middle], [0.0, -scale, scale * middle], [0.0, 0.0, 1.0]])
        c, s = np.cos(pose[2]), np.sin(pose[2])
        lay = np.array([[c, -s, pose[0]], [s, c, pose[1]], [0.0, 0.0, 1.0]])
        seen = np.column_stack([rotation[:, 0], rotation[:, 1], rotation[:, 2] * height + shift])
        whole = np.linalg.inv(half) @ np.diag([2, 2, 1.0]) @ half @ MATRIX @ seen @ lay @ flat @ half
        cv2.warpPerspective(image, whole, canvas.shape[::-1], canvas, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)
    return canvas


def motion(time: Any) -> tuple[Any, Any]:
    """Return poses of the tags on object and sensor on the table at times (N,) [s] of the video, (N, 3) each."""
    object_pose = np.column_stack([-0.05 + 0.03 * np.sin(time), -0.13 + 0.015 * time, 0.5 * np.sin(0.7 * time)])
    x, y = 0.13 + 0.06 * np.cos(3.0 * time), -0.1 + 0.04 * np.sin(4.0 * time)
    return object_pose, np.column_stack([x, y, np.sin(5.0 * time)])


@cache
def video() -> list[Gray]:
    """Return 45 pictures at 30 Hz; in some of them a hand is over the object's tag."""
    rng, pictures = np.random.default_rng(3), []
    on_table = [(number, 0.05, 0.0, SHEET + np.array([*place, 0.0])) for number, place in ON_TABLE.items()]
    table = drawn(np.full((ROWS * 2, COLUMNS * 2), 150, np.uint8), on_table)
    for when in np.arange(COUNT) / 30.0:
        on_object, on_sensor = (pose[0] for pose in motion(np.array([when])))
        canvas = drawn(table, [(*ON_OBJECT, on_object), (*ON_SENSOR, on_sensor)])
        blurred = cv2.GaussianBlur(cv2.resize(canvas, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA), (0, 0), 0.8)
        picture = (20.0 + 0.8 * blurred + rng.normal(0.0, 3.0, blurred.shape)).clip(0, 255).astype(np.uint8)
        if 20 <= len(pictures) < 26:
            picture[300:560, 300:480] = 90
        pictures.append(picture)
    return pictures


def boards(count: int) -> list[Gray]:
    """Return pictures of the board of 7 x 5 squares of 35 mm, held at an angle all over the view."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    fine = cv2.aruco.CharucoBoard((7, 5), 0.035, 0.026, family).generateImage((7 * 80, 5 * 80), None, 0, 1)
    rng, pictures = np.random.default_rng(5), []
    for k in range(count):
        turned = np.array([0.5 * np.sin(k), 0.5 * np.cos(1.7 * k), 0.3 * np.sin(2.9 * k)])
        turn = np.asarray(cv2.Rodrigues(turned)[0], np.float64)
        middle = np.array([0.06 * np.cos(2.3 * k), 0.04 * np.sin(1.1 * k), 0.5])
        corner = middle - turn @ (0.5 * 0.035 * np.array([7, 5, 0.0]))
        see = MATRIX @ np.column_stack([turn[:, 0] * 0.035 / 80, turn[:, 1] * 0.035 / 80, corner])
        image = cv2.warpPerspective(fine, see, (COLUMNS, ROWS), borderValue=(150,), flags=cv2.INTER_AREA)
        noisy = cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(0.0, 3.0, image.shape)
        pictures.append(noisy.clip(0, 255).astype(np.uint8))
    return pictures


def write_video(name: str, pictures: list[Gray]) -> str:
    writer = cv2.VideoWriter(name, cv2.VideoWriter.fourcc(*"MJPG"), 30.0, pictures[0].shape[::-1])
    for picture in pictures:
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    writer.release()
    return name


def write_inputs(**changes: Any) -> tuple[Recording, Any]:
    """Write the robot's recording, at 60 Hz by its own clock, and the camera; return it and the object's true poses."""
    time = DELAY + np.arange(2 * COUNT) / 60.0
    objects, tags = (planar.compose(planar.inverse(SHEET), pose) for pose in motion(time - DELAY))
    sensor = planar.compose(planar.compose(WORLD_T_TABLE, tags), planar.inverse(SENSOR_T_TAG))
    given = {"sensor_pose": sensor, "contact": np.zeros(len(time), np.bool_)} | changes
    made = Recording(time, shape=load_shape("disc"), sensor=DIGIT, **given)
    write_recording(made, "push.mcap", overwrite=True)
    camera = {"size": [ROWS, COLUMNS], "matrix": MATRIX.tolist(), "distortion": [0.0] * 5, "error": 0.1}
    Path("camera.json").write_text(json.dumps(camera))
    return made, planar.compose(WORLD_T_TABLE, objects)


def truth(push: str) -> tuple[str, ...]:
    return ("truth", "push.mcap", push, "--camera", "camera.json", "--out", "true.mcap")


def test_truth_is_within_0_3_mm_and_0_1_degrees(run_palpate):
    given, true = write_inputs()
    words = truth(write_video("push.avi", video()))
    code, out, err = run_palpate(*words, "--json")
    assert code == 0, err
    said, found = json.loads(out), load_recording("true.mcap")
    assert said["object_height_mm"] == pytest.approx(40.0, abs=1.0)
    assert said["sensor_height_mm"] == pytest.approx(70.0, abs=1.0)
    assert said["delay_s"] == pytest.approx(DELAY, abs=2e-3)
    assert found.object_pose is not None
    known = ~np.isnan(found.object_pose[:, 0])
    assert (said["frames"], said["with_truth"]) == (len(given), known.sum())
    error = np.abs(planar.between(true[known], found.object_pose[known]))
    assert (error <= (3e-4, 3e-4, np.radians(0.1))).all()
    # A hand was over the tag from 0.67 to 0.87 s; the video ends before the recording.
    hidden = (given.time - DELAY > 20 / 30) & (given.time - DELAY < 25 / 30)
    assert not known[hidden].any() and known[given.time - DELAY < 19 / 30].all() and 70 <= known.sum() <= 80
    sigma = np.asarray(found.extra["object_pose_sigma"])
    assert np.array_equal(np.isnan(sigma[:, 0]), ~known)
    assert (3.0 * sigma[known] > error).all() and np.nanmax(sigma[:, :2]) < 1.5e-3
    code, _, err = run_palpate(*words)
    assert code == 2 and "true.mcap: already exists" in err


def test_a_sensor_that_never_turns_does_not_locate_the_table(fails):
    write_inputs(sensor_pose=np.zeros((2 * COUNT, 3)))
    said = fails(*truth(write_video("push.avi", video()[:25])))
    assert "push.avi: the sensor turns by 0 degrees; let it turn by 60" in said


@pytest.mark.parametrize(
    ("pictures", "said"),
    [
        ([np.full((ROWS, COLUMNS), 90, np.uint8)], "push.avi: tag 10, of the table, is seen in none of its 1 pictures"),
        ([np.zeros((64, 64), np.uint8)], "have (64, 64) rows and columns, the camera file is for (720, 960)"),
        ([], "push.avi: is no video that OpenCV can read"),
    ],
)
def test_unusable_videos_are_named(fails, pictures, said):
    write_inputs()
    if pictures:
        write_video("push.avi", pictures)
    else:
        Path("push.avi").write_text("no video")
    assert said in fails(*truth("push.avi")) and not Path("true.mcap").exists()


def test_a_camera_is_calibrated_by_the_board(run_palpate, fails):
    write_video("board.avi", boards(12))
    assert run_palpate("truth-camera", "board.avi", "--out", "board.json")[0] == 0
    found = json.loads(Path("board.json").read_text())
    assert found["size"] == [ROWS, COLUMNS] and found["error"] < 0.5
    assert np.array(found["matrix"])[:2] == pytest.approx(MATRIX[:2], rel=0.01, abs=3.0)
    few = write_video("few.avi", boards(3))
    assert "seen in 3 pictures, at least 8" in fails("truth-camera", few, "--out", "few.json")
    write_inputs()
    Path("camera.json").write_text('{"size": [3, 4]}')
    assert "camera.json: is no camera of palpate truth-camera" in fails(*truth("board.avi"))


def test_the_sheets_to_print(run_palpate, fails):
    assert run_palpate("truth-print", "sheets.pdf", "--shape", "disc")[0] == 0
    data = Path("sheets.pdf").read_bytes()
    assert data.count(b"/Type /Page ") == 4 and b"841.8" in data and b"595.2" in data  # points of A4
    said = fails("truth-print", "large.pdf", "--shape", "ellipse")
    assert "ellipse is 164 x 243 mm, larger than a4" in said and not Path("large.pdf").exists()
