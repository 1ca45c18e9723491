"""Recordings as a LeRobotDataset v3, which `palpate.io.lerobot` describes."""

import json
import logging
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.files import write_json
from palpate.geometry.shapes import shape_to_dict
from palpate.io.lerobot import ABOUT, STATE, TRUTH, is_lerobot, libraries
from palpate.io.recording import Recording

logger = logging.getLogger(__name__)

IMAGES = "observation.images.tactile"
POSE_NAMES = ["x", "y", "theta"]
TASK = "Find the pose of the object by touch."
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"


def write_lerobot(
    recordings: Sequence[Recording],
    folder: Path,
    overwrite: bool = False,
    progress: Callable[[int], None] = lambda done: None,
) -> None:
    """Write recordings as the episodes of a new dataset, whole or not at all; an existing one only if `overwrite`.

    Frames come at the rate of the sensor: at each time stands the nearest frame of the recording. Images are H.264 at a
    high quality; ground truth is written if it is known in all frames. Raises PalpateError.
    """
    libraries()
    first = recordings[0]
    for recording in recordings:
        if recording.hand is not None:
            raise FileError(
                f"{recording.file or 'recording'}: is of a hand; a LeRobot dataset takes images of one sensor"
            )
        if recording.image is None:
            raise FileError(f"{recording.file or 'recording'}: has no images, which a LeRobot dataset needs")
        if (recording.shape, recording.sensor) != (first.shape, first.sensor):
            raise FileError(f"{recording.file or 'recording'}: is of another object or sensor than {first.file}")
    fps = round(first.sensor.rate)
    has_truth = all(np.isfinite(recording.truth).all() for recording in recordings)
    with _new_folder(folder, overwrite) as part:
        episodes: list[dict[str, Any]] = []
        data: dict[str, list[NDArray[Any]]] = {}
        start = 0
        for number, recording in enumerate(recordings):
            nearest = _nearest(recording, fps)
            table = _rows(recording, nearest, number, start, fps, has_truth)
            where = {"chunk_index": number // 1000, "file_index": number % 1000}
            _write_data(part / DATA_PATH.format(**where), table)
            _write_video(part / VIDEO_PATH.format(video_key=IMAGES, **where), recording, nearest, fps)
            episodes.append(_episode_row(number, len(nearest), start, where, fps))
            for name, values in table.items():
                data.setdefault(name, []).append(values)
            start += len(nearest)
            progress(number + 1)
        _write_meta(part, first, episodes, {name: np.concatenate(each) for name, each in data.items()}, fps)


@contextmanager
def _new_folder(folder: Path, overwrite: bool) -> Iterator[Path]:
    """Yield a temporary folder that becomes `folder` on success; an earlier dataset is replaced if `overwrite`."""
    if folder.exists() and not (overwrite and is_lerobot(folder)):
        allowed = "--force replaces it" if is_lerobot(folder) else "allowed is a new folder"
        raise FileError(f"{folder}: already exists; {allowed}")
    if not folder.parent.is_dir():
        raise FileError(f"{folder}: the folder {folder.parent} does not exist")
    with TemporaryDirectory(prefix=f".{folder.name}.", suffix=".part", dir=folder.parent) as temporary:
        part = Path(temporary) / folder.name
        part.mkdir()
        yield part
        if folder.exists():
            shutil.rmtree(folder)
        part.rename(folder)


def _nearest(recording: Recording, fps: int) -> NDArray[Any]:
    """Return the frame nearest to each time of a fixed rate; warns if some stand more than once."""
    time = recording.time - recording.time[0]
    wanted = np.arange(round(float(time[-1]) * fps) + 1) / fps
    after = np.clip(np.searchsorted(time, wanted), 1, max(len(time) - 1, 1))
    nearest = np.where(wanted - time[after - 1] < time[after % len(time)] - wanted, after - 1, after % len(time))
    repeated = len(nearest) - len(np.unique(nearest))
    if repeated:
        words = "%s: at %d Hz, %d of %d frames stand for missing ones"
        logger.warning(words, recording.file or "recording", fps, repeated, len(nearest))
    return nearest


def _rows(
    recording: Recording, nearest: NDArray[Any], number: int, start: int, fps: int, has_truth: bool
) -> dict[str, NDArray[Any]]:
    """Return the columns of an episode."""
    count = len(nearest)
    rows: dict[str, NDArray[Any]] = {STATE: recording.sensor_pose[nearest].astype(np.float32)}
    if has_truth:
        rows[TRUTH] = recording.truth[nearest].astype(np.float32)
    rows["timestamp"] = (np.arange(count) / fps).astype(np.float32)
    rows["frame_index"] = np.arange(count)
    rows["episode_index"] = np.full(count, number)
    rows["index"] = start + np.arange(count)
    rows["task_index"] = np.zeros(count, np.int64)
    return rows


def _write_data(path: Path, rows: Mapping[str, NDArray[Any]]) -> None:
    _, pyarrow, parquet = libraries()
    columns = {}
    for name, values in rows.items():
        if values.ndim == 1:
            columns[name] = pyarrow.array(values)
        else:
            columns[name] = pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(values.ravel()), values.shape[1])
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(pyarrow.table(columns), path)


def _write_video(path: Path, recording: Recording, nearest: NDArray[Any], fps: int) -> None:
    """Write frames of a recording as a video whose every second frame is a key frame, as LeRobot's are."""
    av, _, _ = libraries()
    path.parent.mkdir(parents=True, exist_ok=True)
    size = (recording.sensor.image_height, recording.sensor.image_width)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=fps, options={"crf": "8", "g": "2"})
        stream.height = size[0]
        stream.width = size[1]
        stream.pix_fmt = "yuv420p"
        last: Any = np.zeros((*size, 3), np.uint8)
        for index in nearest.tolist():
            with suppress(FileError):  # a damaged image stands as the one before it
                last = recording[index].image
            container.mux(stream.encode(av.VideoFrame.from_ndarray(last, format="rgb24")))
        container.mux(stream.encode())


def _episode_row(number: int, count: int, start: int, where: Mapping[str, int], fps: int) -> dict[str, Any]:
    """Return the place of an episode, as a row of meta/episodes."""
    row: dict[str, Any] = {"episode_index": number, "tasks": [TASK], "length": count}
    row |= {f"data/{name}": index for name, index in where.items()}
    row |= {"dataset_from_index": start, "dataset_to_index": start + count}
    row |= {f"videos/{IMAGES}/{name}": index for name, index in where.items()}
    row |= {f"videos/{IMAGES}/from_timestamp": 0.0, f"videos/{IMAGES}/to_timestamp": count / fps}
    return row | {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}


def _write_meta(
    part: Path, first: Recording, episodes: list[dict[str, Any]], data: Mapping[str, NDArray[Any]], fps: int
) -> None:
    """Write the folder meta."""
    _, pyarrow, parquet = libraries()
    sensor = first.sensor
    about = {"shape": shape_to_dict(first.shape), "sensor": asdict(sensor)}
    video = {
        "video.height": sensor.image_height,
        "video.width": sensor.image_width,
        "video.codec": "h264",
        "video.pix_fmt": "yuv420p",
        "video.is_depth_map": False,
        "video.fps": fps,
        "video.channels": 3,
        "has_audio": False,
    }
    shape = [sensor.image_height, sensor.image_width, 3]
    names = ["height", "width", "channels"]
    features: dict[str, Any] = {IMAGES: {"dtype": "video", "shape": shape, "names": names, "info": video}}
    for name, values in data.items():
        wide = values.ndim == 2
        features[name] = {
            "dtype": str(values.dtype),
            "shape": [values.shape[1] if wide else 1],
            "names": POSE_NAMES if wide else None,
        }
    info = {
        "codebase_version": "v3.0",
        "robot_type": None,
        "total_episodes": len(episodes),
        "total_frames": len(data["index"]),
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH,
        "features": features,
    }
    (part / "meta/episodes/chunk-000").mkdir(parents=True)
    write_json(part / "meta/info.json", info)
    write_json(part / ABOUT, about)
    write_json(part / "meta/stats.json", {name: _statistics(values) for name, values in data.items()})
    parquet.write_table(pyarrow.Table.from_pylist(episodes), part / "meta/episodes/chunk-000/file-000.parquet")
    parquet.write_table(_tasks(pyarrow), part / "meta/tasks.parquet")


def _statistics(values: NDArray[Any]) -> dict[str, Any]:
    """Return the statistics of a feature by which LeRobot normalises."""
    rows = values.reshape(len(values), -1).astype(np.float64)
    found = {"min": rows.min(axis=0), "max": rows.max(axis=0), "mean": rows.mean(axis=0), "std": rows.std(axis=0)}
    return {name: each.tolist() for name, each in found.items()} | {"count": [len(rows)]}


def _tasks(pyarrow: Any) -> Any:
    """Return the table of tasks, whose index of pandas is the words of the task."""
    index = {"name": None, "field_name": "__index_level_0__", "pandas_type": "unicode", "numpy_type": "object"}
    number = {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"}
    columns = [{**column, "metadata": None} for column in (number, index)]
    pandas = {"index_columns": ["__index_level_0__"], "column_indexes": [], "columns": columns}
    table = pyarrow.table({"task_index": [0], "__index_level_0__": [TASK]})
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})
