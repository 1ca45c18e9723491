"""Datasets of LeRobot, version 3, out and in."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from planar import wrap
from recording_samples import UNSTATED, encoded
from scipy.spatial.transform import Rotation

import palpate

av = pytest.importorskip("av")
pyarrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

COUNT = 10


def push(start=0.0, truth=True):
    time = np.arange(COUNT) / 30
    poses = np.column_stack([0.4 + start + 0.05 * time, -0.1 * time, 0.3 + 0.8 * time])
    images = tuple(encoded(image) for image in smooth(COUNT))
    shape = palpate.Rectangle(0.09, 0.06)
    recording = palpate.Recording(1e9 + time, poses, shape, palpate.DIGIT, poses + 0.2, None, images)
    return recording if truth else replace(recording, object_pose=None, **UNSTATED)


def smooth(count):
    """Images that differ from one another in smooth waves, so that a video shows them well."""
    rows, columns = np.mgrid[0:320, 0:240]
    images = []
    for number in range(count):
        red = 120 + 80 * np.sin(rows / 25 + number)
        green = 120 + 60 * np.cos(columns / 30 + 0.7 * number)
        images.append(np.stack([red, green, np.full_like(red, 60 + 8 * number)], axis=-1).astype(np.uint8))
    return np.stack(images)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    palpate.write_recording(push(), "a.mcap")
    palpate.write_recording(push(1.0), "b.mcap")
    return tmp_path


def same_frames(recording, wanted):
    assert np.abs(recording.time - recording.time[0] - wanted.time + wanted.time[0]).max() < 1e-6
    assert np.abs(recording.sensor_pose[:, :2] - wanted.sensor_pose[:, :2]).max() < 1e-6
    assert np.abs(wrap(recording.sensor_pose[:, 2] - wanted.sensor_pose[:, 2])).max() < 1e-6
    for frame, other in zip(recording, wanted, strict=True):
        error = frame.image.astype(int) - other.image
        assert np.abs(error).mean() < 3.0  # that of neighbours is above 10
        assert np.abs(error.mean(axis=(0, 1))).max() < 0.6  # a video has no images that are darker throughout


def test_recordings_become_episodes_and_come_back(folder, run_palpate):
    code, _, err = run_palpate("convert", "a.mcap", "b.mcap", "pushes", "--lerobot")
    assert code == 0, err
    for episode, name in enumerate(("a.mcap", "b.mcap")):
        code, _, err = run_palpate("convert", "pushes", "back.mcap", "--episode", episode, "--force")
        assert code == 0, err
        recording = palpate.load_recording("back.mcap")
        wanted = palpate.load_recording(name)
        assert (recording.shape, recording.sensor) == (wanted.shape, wanted.sensor)
        same_frames(recording, wanted)
        assert np.abs(recording.truth - wanted.truth).max() < 1e-6
    code, out, _ = run_palpate("info", "pushes")
    assert code == 0 and "palpate convert pushes OUT.mcap --episode 0\n" in out


def test_the_layout_is_that_of_version_3(folder, run_palpate):
    run_palpate("convert", "a.mcap", "b.mcap", "pushes", "--lerobot")
    info = json.loads(Path("pushes/meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["total_episodes"], info["total_frames"]) == ("v3.0", 30, 2, 20)
    assert info["features"]["observation.state"] == {"dtype": "float32", "shape": [3], "names": ["x", "y", "theta"]}
    episodes = parquet.read_table("pushes/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(row["dataset_from_index"], row["dataset_to_index"]) for row in episodes] == [(0, 10), (10, 20)]
    for row in episodes:
        key = "observation.images.tactile"
        where = {"chunk_index": row[f"videos/{key}/chunk_index"], "file_index": row[f"videos/{key}/file_index"]}
        with av.open(str(Path("pushes") / info["video_path"].format(video_key=key, **where))) as video:
            times = [float(frame.pts * frame.time_base) for frame in video.decode(video=0)]
        assert times == pytest.approx(np.arange(COUNT) / 30, abs=1e-4)
        data = parquet.read_table(Path("pushes") / info["data_path"].format(**where))
        assert set(data.column_names) == set(info["features"]) - {key}
        assert data["timestamp"].to_pylist() == pytest.approx(times, abs=1e-4)
    tasks = parquet.read_table("pushes/meta/tasks.parquet")
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["__index_level_0__"]


def write_other(folder, names, version="v3.0"):
    """A dataset as LeRobot records it: two episodes in one file each, two cameras, poses and a gripper in the state."""
    state = []
    for start in (0.0, 1.0):
        poses = push(start).sensor_pose
        turns = Rotation.from_euler("z", poses[:, 2:]).as_quat()
        state += np.column_stack([poses[:, :2], np.full(COUNT, 0.1), turns, np.full(COUNT, 0.5)]).tolist()
    rows = {
        "observation.state": pyarrow.array(state, pyarrow.list_(pyarrow.float32())),
        "frame_index": [*range(COUNT)] * 2,
        "episode_index": [0] * COUNT + [1] * COUNT,
    }
    keys = ("observation.images.tactile_left", "observation.images.wrist")
    features = {key: {"dtype": "video", "shape": [320, 240, 3], "names": None} for key in keys}
    features["observation.state"] = {"dtype": "float32", "shape": [8], "names": {"motors": names}}
    for name in ("frame_index", "episode_index"):
        features[name] = {"dtype": "int64", "shape": [1], "names": None}
    info = {
        "codebase_version": version,
        "fps": 30,
        "total_episodes": 2,
        "total_frames": 2 * COUNT,
        "features": features,
    }
    info |= {"data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"}
    info |= {"video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"}
    for path in ("meta/episodes/chunk-000", "data/chunk-000", f"videos/{keys[0]}/chunk-000"):
        (folder / path).mkdir(parents=True)
    if version < "v3":
        info |= {"chunks_size": 1000, "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"}
        info["video_path"] = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
        write_file_for_each_episode(folder, info, rows, keys[0])
        return
    (folder / "meta/info.json").write_text(json.dumps(info))
    places = []
    for episode in range(2):
        place = {"episode_index": episode, "data/chunk_index": 0, "data/file_index": 0}
        place |= {f"videos/{keys[0]}/chunk_index": 0, f"videos/{keys[0]}/file_index": 0}
        places.append(place | {f"videos/{keys[0]}/from_timestamp": episode * COUNT / 30})
    parquet.write_table(pyarrow.Table.from_pylist(places), folder / "meta/episodes/chunk-000/file-000.parquet")
    parquet.write_table(pyarrow.table(rows), folder / "data/chunk-000/file-000.parquet")
    write_video(folder / f"videos/{keys[0]}/chunk-000/file-000.mp4", [*smooth(COUNT)[::-1], *smooth(COUNT)])


def write_video(path, images):
    with av.open(str(path), "w") as video:
        stream = video.add_stream("libx264", rate=30, options={"crf": "5", "g": "7"})
        stream.width = 240
        stream.height = 320
        for image in images:
            video.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        video.mux(stream.encode())


def write_file_for_each_episode(folder, info, rows, key):
    """Write two episodes in the layout of version 2."""
    videos = folder / f"videos/chunk-000/{key}"
    videos.mkdir(parents=True)
    (folder / "meta/info.json").write_text(json.dumps(info))
    for episode, images in enumerate((smooth(COUNT)[::-1], smooth(COUNT))):
        part = pyarrow.table(rows).slice(episode * COUNT, COUNT)
        parquet.write_table(part, folder / f"data/chunk-000/episode_{episode:06d}.parquet")
        write_video(videos / f"episode_{episode:06d}.mp4", images)


NAMES = ["x", "y", "z", "qx", "qy", "qz", "qw", "gripper"]


def test_an_episode_amid_a_file_with_a_gripper_in_its_state(folder, run_palpate):
    write_other(folder / "other", NAMES)
    code, out, _ = run_palpate("info", "other")
    assert code == 0 and "--shape" in out
    code, _, err = run_palpate("convert", "other", "out.mcap", "--episode", 1, "--shape", "0.09x0.06")
    assert code == 0, err
    same_frames(palpate.load_recording("out.mcap"), push(1.0))
    start = ("--first-pose", 0, 0, 0, "--tactile", "none")
    code, _, err = run_palpate("track", "other", "--episode", 1, "--shape", "0.09x0.06", *start)
    assert code == 0, err
    same_frames(palpate.load_recording("runs/other/recording.mcap"), push(1.0))


@pytest.mark.parametrize("version", ["v2.0", "v2.1"])
def test_a_file_for_each_episode_as_in_version_2(folder, run_palpate, fails, version):
    write_other(folder / "old", NAMES, version)
    code, _, err = run_palpate("convert", "old", "out.mcap", "--episode", 1, "--shape", "0.09x0.06")
    assert code == 0, err
    same_frames(palpate.load_recording("out.mcap"), push(1.0))
    assert "there are 2, from 0" in fails("convert", "old", "late.mcap", "--episode", 2, "--shape", "disc")


def test_what_does_not_fit_in_version_2_is_named(folder, fails):
    def refused(name, **changes):
        write_other(folder / name, NAMES, "v2.1")
        path = folder / name / "meta/info.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | changes))
        return fails("convert", name, "out.mcap", "--shape", "disc")

    assert "data_path is" in refused("rows", data_path="data/file-{file_index:03d}.parquet")
    assert "video_path is None" in refused("frames", video_path=None)
    assert "total_episodes is '2'" in refused("count", total_episodes="2")
    assert "chunks_size is 0" in refused("chunks", chunks_size=0)
    assert "no such file" in refused("absent", data_path="data/{episode_index}.parquet")
    assert "no rows of episode 0" in refused("other", data_path="data/chunk-000/episode_000001.parquet")


def test_what_does_not_fit_is_named(folder, fails):
    write_other(folder / "other", NAMES)
    words = ("convert", "other", "out.mcap", "--shape", "disc")
    assert "episode 7" in fails(*words, "--episode", 7)
    assert "observation.state" in fails(*words, "--sensor-poses", "action")
    assert "tactile_left" in fails(*words, "--images", "observation.images.top")
    assert "--shape" in fails("convert", "other", "out.mcap")
    write_other(folder / "joints", [f"joint_{k}.pos" for k in range(8)])
    assert "joint" in fails("convert", "joints", "out.mcap", "--shape", "disc")
    write_other(folder / "old", NAMES, "v1.6")
    assert "v1.6" in fails("convert", "old", "out.mcap", "--shape", "disc")
    assert not Path("out.mcap").exists()


def test_a_dataset_is_written_whole_or_not_at_all(folder, fails):
    palpate.write_recording(replace(push(), shape=palpate.Disc(0.05)), "disc.mcap")
    assert "disc.mcap" in fails("convert", "a.mcap", "disc.mcap", "pushes", "--lerobot")
    Path("mine").mkdir()
    assert "already exists" in fails("convert", "a.mcap", "mine", "--lerobot", "--force")
    assert sorted(path.name for path in folder.iterdir()) == ["a.mcap", "b.mcap", "disc.mcap", "mine"]


def test_the_extra_is_named_where_it_is_missing(folder, fails, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    assert "[lerobot]" in fails("convert", "a.mcap", "pushes", "--lerobot")
