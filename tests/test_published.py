"""Readers of published data sets, on small files of their layouts."""

import importlib
import pickle
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import palpate

READERS = Path(__file__).parents[1] / "examples" / "published"
QUARTER = np.sqrt(0.5)


@pytest.fixture
def reader(monkeypatch, tmp_path) -> Any:
    """A reader by its name, in an empty working folder."""
    monkeypatch.syspath_prepend(str(READERS))
    monkeypatch.chdir(tmp_path)
    return importlib.import_module


def gels(count: int, height: int, width: int, touched: int) -> list[np.ndarray]:
    """Images of a gel with noise, brighter in the middle from a frame on."""
    images = np.random.default_rng(0).normal((130.0, 110.0, 115.0), 2.0, (count, height, width, 3))
    images[touched:, height // 3 : height // 2, width // 3 : width // 2] += 60.0
    return list(np.rint(images).astype(np.uint8))


def write_video(path: Path, images: list[np.ndarray], rate: float, codec: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width, _ = images[0].shape
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), rate, (width, height))
    for image in images:
        video.write(np.ascontiguousarray(image[..., ::-1]))
    video.release()


def sequence(folder: Path, **fields: Any) -> Path:
    """A pickle of digit-pose-estimation: the object goes 1 mm a frame along y, turned by a quarter about z."""
    path = folder / "test" / "sugar" / "bag_00.pkl"
    path.parent.mkdir(parents=True, exist_ok=True)
    images = gels(40, 320, 240, 30)
    encoded = [cv2.imencode(".jpg", image[..., ::-1])[1].tobytes() for image in images]
    poses = np.array([[0.1, 1e-3 * frame, 0.05, QUARTER, 0.0, 0.0, QUARTER] for frame in range(40)])
    turns = np.tile(np.eye(4), (40, 1, 1))
    content = {"digit_index": encoded, "digit_middle": images, "tag": poses, "object_index_rel_pose_n5": turns}
    path.write_bytes(pickle.dumps(content | fields))
    return path


def test_fingers_of_digit_pose_estimation(reader, tmp_path):
    read, path = reader("digit_pose").read_sequence, sequence(tmp_path)
    found = read(path, "index")
    assert "sugar bag_00, index: 40 images of 240 x 320 over 1.3 s; 0 poses of the sensor and 40" in found.about()
    assert "25% of the images show a touch" in found.about()
    np.testing.assert_allclose(found.object_poses[7], [0.1, 7e-3, 0.05, 0.0, 0.0, QUARTER, QUARTER])
    assert read(path, "middle").about().startswith("digit-pose-estimation, sugar bag_00, middle: 40 images")
    with pytest.raises(palpate.FileError, match="no pose of the sensor was measured"):
        found.recording(palpate.Disc(0.04))
    with pytest.raises(palpate.SettingError, match="finger is 'thumb'; allowed are index, middle, ring"):
        read(path, "thumb")


class Foreign:
    """What runs code when it is unpickled."""

    def __reduce__(self) -> Any:
        return Path.touch, (Path("was-run"),)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"more": Foreign()}, r"bag_00.pkl: cannot be read as a sequence: asks for .*, which is not allowed"),
        ({"tag": np.zeros((40, 6))}, r"has 0 fields of poses \(N, 7\), expected one"),
        ({"tag": np.zeros((39, 7))}, "found 39 poses for 40 images"),
        ({"digit_index": []}, "holds no images"),
    ],
)
def test_other_pickles_are_refused_in_a_sentence(reader, tmp_path, fields, message):
    with pytest.raises(palpate.FileError, match=message) as error:
        reader("digit_pose").read_sequence(sequence(tmp_path, **fields), "index")
    assert "\n" not in str(error.value) and not Path("was-run").exists()


def test_no_module_beside_a_pickle_is_run(reader, tmp_path):
    for name in ("numpy", "pickle"):
        Path(f"{name}.py").write_text("raise SystemExit('was run')")
    assert len(reader("digit_pose").read_sequence(sequence(tmp_path), "index").images) == 40
    with pytest.raises(palpate.FileError, match=r"gone.pkl: cannot be read as a sequence: .*No such file"):
        reader("digit_pose").read_sequence(Path("gone.pkl"), "index")


def trial(folder: Path, count: int = 20) -> Path:
    """A trial of TactileTracking, whose sensor turns about its z axis and is lost in one frame."""
    write_video(folder / "gelsight.avi", gels(20, 240, 320, 20), 25.0, "MJPG")
    poses = np.tile(np.eye(4), (count, 1, 1))
    for frame, pose in enumerate(poses):
        cos, sin = np.cos(0.01 * frame), np.sin(0.01 * frame)
        pose[:2] = [[cos, -sin, 0.0, 1e-4 * frame], [sin, cos, 0.0, 0.0]]
    poses[5] = np.nan
    np.save(folder / "true_start_T_currs.npy", poses)
    return folder


def test_a_trial_of_tactile_tracking(reader, tmp_path):
    read = reader("tactile_tracking").read_trial
    found = read(trial(tmp_path / "bead1"))
    assert "bead1: 20 images of 320 x 240 over 0.8 s; 19 poses of the sensor and 0" in found.about()
    np.testing.assert_allclose(found.time[:3], [0.0, 0.04, 0.08])
    np.testing.assert_allclose(found.sensor_poses[9], [9e-4, 0, 0, 0, 0, np.sin(0.045), np.cos(0.045)], atol=1e-12)
    with pytest.raises(palpate.FileError, match="found 19 poses for 20 images"):
        read(trial(tmp_path / "bead1", 19))
    (tmp_path / "bead1" / "true_start_T_currs.npy").write_bytes(b"none")
    with pytest.raises(palpate.FileError, match=r"true_start_T_currs.npy: is missing, or no array"):
        read(tmp_path / "bead1")
    with pytest.raises(palpate.FileError, match=r"gelsight.avi: is missing, or no video"):
        read(tmp_path / "gone")


def test_an_episode_of_react(reader, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    task = tmp_path / "motherboard"
    path = task / "meta" / "2026-09-11" / "episode_003.parquet"
    path.parent.mkdir(parents=True)
    images = gels(30, 480, 640, 20)
    write_video(task / "videos" / "2026-09-11" / "episode_003" / "tactile_left.mp4", images, 30.0, "mp4v")
    poses = [[0.001 * frame, 0.2, 0.1, 0.0, 0.0, 0.0, 1.0] for frame in range(30)]
    columns = {
        "timestamp": (1e3 + np.arange(30) / 30.0).tolist(),
        "sensor_left_pose": poses,
        "object_pose": [[np.nan] * 7] * 10 + [[0.3, 0.2, 0.1, 0.0, 0.0, 0.0, 1.0]] * 20,
        "tactile_left_is_new": [frame % 3 != 2 for frame in range(30)],
    }
    table = importlib.import_module("pyarrow").table
    parquet.write_table(table(columns), path)
    read = reader("react").read_episode
    found = read(path, "left")
    assert "2026-09-11 episode_003, left: 20 images of 640 x 480 over 0.9 s; 20 poses of the sensor and 13" in (
        found.about()
    )
    pushed = found.recording(palpate.Rectangle(0.1, 0.1), sensor_T_gel=(0.02, 0.0, 0.0))
    np.testing.assert_allclose(pushed.sensor_pose[3], [0.024, 0.2, 0.0], atol=1e-9)
    assert pushed.sensor == palpate.GELSIGHT_MINI and np.isnan(pushed.truth[:7]).all() and pushed[3].image is not None
    for side, message in (("right", "sensor_right_pose is missing: side left or right"), ("up", "sensor_up_pose")):
        with pytest.raises(palpate.FileError, match=message):
            read(path, side)
    parquet.write_table(table(columns).slice(0, 29), path)
    with pytest.raises(palpate.FileError, match="found 29 rows for 30 images"):
        read(path, "left")
    path.write_bytes(b"PAR1 and no more")
    with pytest.raises(palpate.FileError, match="is missing, or no table in Parquet"):
        read(path, "left")
