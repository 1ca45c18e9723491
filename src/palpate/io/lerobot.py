"""LeRobotDataset: a folder of episodes at a fixed rate, with tables in Parquet and touch images as videos.

Version 3 has several episodes in a file:

    meta/info.json                              rate, and the features with their shapes and names
    meta/episodes/chunk-000/file-000.parquet    of each episode, where its rows and the frames of its videos are
    data/chunk-000/file-000.parquet             rows of all features but videos
    videos/KEY/chunk-000/file-000.mp4           the frames of one or several episodes

Version 2 has a table and videos for each episode: data/chunk-000/episode_000000.parquet and
videos/chunk-000/KEY/episode_000000.mp4.

The pose of the sensor is `observation.state`, that of the object `observation.environment_state`, x, y, theta each.
What such a dataset does not know, outline and sensor, is in meta/palpate.json, which LeRobot ignores.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import Array, Image
from palpate.errors import FileError, SettingError, one_line
from palpate.files import existing_file, in_file, read_json
from palpate.geometry.shapes import Shape, shape_from_dict
from palpate.hints import library, own_command
from palpate.io.pose_tables import poses_of_numbers
from palpate.io.recording import Recording
from palpate.types.choices import BagChoices, TableChoices
from palpate.types.images import UprightImage, camera_view, encode_image, fitted, turned_image
from palpate.types.sensor import SensorProfile, is_named_touch, sensor_from_dict

STATE = "observation.state"
TRUTH = "observation.environment_state"
ABOUT = "meta/palpate.json"


def is_lerobot(path: Path) -> bool:
    """Return true for the folder of a dataset."""
    return (path / "meta/info.json").is_file()


def libraries() -> tuple[Any, Any, Any]:
    """Return the modules `av`, `pyarrow` and its `parquet`. Raises SettingError if they are not installed."""
    av, pyarrow, parquet = (library(name, "lerobot", "LeRobot") for name in ("av", "pyarrow", "pyarrow.parquet"))
    return av, pyarrow, parquet


def about_dataset(folder: Path) -> dict[str, Any]:
    """Return the features of a dataset, and the command that converts an episode of it. Raises FileError."""
    info = _info(folder)
    features = info["features"]
    rows = [
        {
            "feature": key,
            "type": feature["dtype"],
            "shape": "x".join(map(str, feature["shape"])),
            "names": _names(feature),
        }
        for key, feature in features.items()
    ]
    about = {
        "format": "lerobot",
        "episodes": info["total_episodes"],
        "frames": info["total_frames"],
        "fps": info["fps"],
    }
    images = _image_key(features, None)
    options = "" if images else " --images FEATURE"
    if STATE not in features:
        options += " --sensor-poses FEATURE"
    if not (folder / ABOUT).exists():
        options += " --shape NAME|AxB|FILE"
    return about | {"advice": f"{own_command()} convert {folder} OUT.mcap --episode 0{options}", "features": rows}


def has_outline(folder: Path) -> bool:
    """Return True for a dataset that states what the object is."""
    return (folder / ABOUT).exists()


def read_lerobot(
    folder: Path,
    episode: int,
    shape: Shape | None,
    choices: BagChoices,
    tables: TableChoices,
    sensor: SensorProfile,
    progress: Callable[[int], None] = lambda done: None,
) -> Recording:
    """Read an episode as a recording of an object of this shape; None if the dataset itself states one.

    `choices.images`, `sensor_poses` and `object_poses` are names of features. Raises PalpateError.
    """
    with in_file(folder):
        info = _info(folder)
        features = info["features"]
        place = _episode(folder, info, episode)
        columns = _columns(folder, info, place)
        state = choices.sensor_poses or STATE
        poses = poses_of_numbers(folder, *_numbers(features, columns, state), tables).poses
        truth = choices.object_poses or (TRUTH if TRUTH in features and (folder / ABOUT).exists() else None)
        objects = truth and poses_of_numbers(folder, *_numbers(features, columns, truth), tables).poses
        if (folder / ABOUT).exists() and shape is None:
            about = read_json(folder / ABOUT)
            shape = shape_from_dict(about.get("shape") or {})
            sensor = sensor_from_dict(about.get("sensor") or {})
        if shape is None:
            raise SettingError("--shape NAME|AxB|FILE is missing: the dataset does not say what the object is")
        key = _image_key(features, choices.images)
        if key is None:
            raise FileError(f"which images? {', '.join(_image_keys(features)) or 'there are none'}: --images FEATURE")
        images = _images(folder, info, key, place, columns, choices.orientation, sensor, progress)
        if len(images) != len(poses):
            raise FileError(f"{key}: found {len(images)} images in episode {episode}, expected {len(poses)}, as rows")
        time = np.round(np.array(columns["frame_index"]) * (1e9 / info["fps"])).astype(np.int64)
        return Recording.from_arrays(
            time,
            images,
            time,
            poses,
            shape,
            sensor,
            orientation=choices.orientation,
            sensor_T_gel=choices.sensor_T_gel,
            time_offset=choices.time_offset,
            plane=choices.plane,
            off_plane=choices.off_plane,
            object_poses=objects,
            source=f"LeRobot dataset {folder.name}, episode {episode}: {key}, {state}",
        )


def _info(folder: Path) -> dict[str, Any]:
    """Return the description of a dataset. Raises FileError if it is of another version than 2 or 3."""
    path = folder / "meta/info.json"
    info = read_json(path)
    version = str(info.get("codebase_version"))
    if not version.startswith(("v2.", "v3.")):
        raise FileError(f"{path}: codebase_version is {version!r}, allowed are v2.0, v2.1 and v3.0")
    for name in ("fps", "features", "data_path", "total_episodes", "total_frames"):
        if name not in info:
            raise FileError(f"{path}: {name} is missing")
    for name in ("fps", "total_episodes", "chunks_size"):
        value = info.get(name, 1)
        if not isinstance(value, int | float) or value <= 0:
            raise FileError(f"{path}: {name} is {value!r}, allowed is a number above 0")
    return info


def _names(feature: Mapping[str, Any]) -> list[str]:
    """Return the names of a feature's numbers; none if there are not as many."""
    names = feature.get("names") or []
    if isinstance(names, dict):  # as {"motors": [...]}
        names = next(iter(names.values()), [])
    fits = isinstance(names, list) and len(names) == int(np.prod(feature["shape"]))
    return [str(name) for name in names] if fits and all(isinstance(name, str) for name in names) else []


def _image_keys(features: Mapping[str, Any]) -> list[str]:
    return [key for key, feature in features.items() if feature["dtype"] in ("video", "image")]


def _image_key(features: Mapping[str, Any], chosen: str | None) -> str | None:
    """Return the feature of the touch images: the chosen one, the only one, or the only one named so; else None."""
    keys = _image_keys(features)
    if chosen is not None:
        return chosen if chosen in keys else None
    touch = [key for key in keys if is_named_touch(key)]
    return next((some[0] for some in (touch, keys) if len(some) == 1), None)


def _parquet(path: Path, wanted: Sequence[str] | None = None) -> Any:
    """Return a table of Parquet. Raises FileError."""
    _, pyarrow, parquet = libraries()
    try:
        return parquet.read_table(existing_file(path), columns=wanted)
    except (OSError, pyarrow.ArrowException) as error:
        raise FileError(f"{path}: cannot be read ({one_line(error)})") from error


def _episode(folder: Path, info: Mapping[str, Any], episode: int) -> dict[str, Any]:
    """Return the place of an episode in the files. Raises FileError if there is none of this number."""
    if info["codebase_version"].startswith("v2."):
        count = info["total_episodes"]
        if not 0 <= episode < count:
            raise FileError(f"there is no episode {episode}; there are {count}, from 0: --episode N")
        return {"episode_index": episode, "episode_chunk": episode // info.get("chunks_size", 1000)}
    count = 0
    for path in sorted((folder / "meta/episodes").glob("*/*.parquet")):
        table = _parquet(path)
        numbers = table["episode_index"].to_pylist()
        count += len(numbers)
        if episode in numbers:
            row = table.slice(numbers.index(episode), 1)
            return {name: row[name][0].as_py() for name in row.column_names if not name.startswith("stats/")}
    raise FileError(f"there is no episode {episode}; there are {count}, from 0: --episode N")


def _columns(folder: Path, info: Mapping[str, Any], place: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Return the rows of an episode, column by column."""
    path = folder / _path_of(info, "data_path", "data", place)
    table = _parquet(path)
    is_of_episode = np.array(table["episode_index"].to_pylist()) == place["episode_index"]
    if not is_of_episode.any():
        raise FileError(f"{path}: holds no rows of episode {place['episode_index']}")
    rows = table.take(np.flatnonzero(is_of_episode))
    return {name: rows[name].to_pylist() for name in rows.column_names}


def _path_of(info: Mapping[str, Any], name: str, kind: str, place: Mapping[str, Any], **others: str) -> str:
    """Return the path of the file with the rows, "data", or the frames, "videos/KEY", of an episode.

    Raises FileError if the template of this name does not fit the version.
    """
    indices = {index: place.get(f"{kind}/{index}") for index in ("chunk_index", "file_index")}
    indices |= {index: place.get(index) for index in ("episode_index", "episode_chunk")}
    known = {index: number for index, number in indices.items() if number is not None}
    template = info.get(name)
    try:
        if isinstance(template, str):
            return template.format(**known, **others)
        problem = "it is no text"
    except (LookupError, ValueError) as error:
        problem = f"it asks for {error}"
    raise FileError(
        f"meta/info.json: {name} is {template!r}, which does not fit {info['codebase_version']} ({problem})"
    )


def _numbers(features: Mapping[str, Any], columns: Mapping[str, Any], key: str) -> tuple[list[str], Array]:
    """Return the names and the numbers (N, columns) of a feature. Raises FileError if there is none."""
    if key not in columns:
        numeric = [name for name in columns if name in features and np.prod(features[name]["shape"]) > 1]
        raise FileError(f"there is no feature {key!r}; there are {', '.join(numeric)}: --sensor-poses FEATURE")
    return _names(features[key]), np.array(columns[key], np.float64).reshape(len(columns[key]), -1)


def _images(
    folder: Path,
    info: Mapping[str, Any],
    key: str,
    place: Mapping[str, Any],
    columns: Mapping[str, Any],
    orientation: str,
    sensor: SensorProfile,
    progress: Callable[[int], None],
) -> list[UprightImage]:
    """Return the images of an episode, upright and encoded, from its video or its table."""
    view = camera_view(orientation)
    size = (sensor.image_height, sensor.image_width)
    images: list[UprightImage] = []
    if key in columns:
        for cell in columns[key]:
            if not cell["bytes"] and not cell["path"]:
                raise FileError(f"{key}: image {len(images)} of the episode has neither bytes nor a path")
            data = cell["bytes"] or existing_file(folder / cell["path"]).read_bytes()
            images.append(UprightImage(turned_image(data, size, view)))
            progress(len(images))
        return images
    path = existing_file(folder / _path_of(info, "video_path", f"videos/{key}", place, video_key=key))
    start = float(place.get(f"videos/{key}/from_timestamp", 0.0))
    for pixels in _frames(path, start, len(columns["frame_index"]), info["fps"]):
        with in_file(path):
            images.append(UprightImage(encode_image(fitted(pixels, size, view), "png")))
        progress(len(images))
    return images


def _frames(path: Path, start: float, count: int, fps: float) -> Iterator[Image]:
    """Yield frames of a video, as many as `count` from a time on [s]. Raises FileError."""
    av, _, _ = libraries()
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            container.seek(int(start / stream.time_base), stream=stream)  # to the key frame before it
            done = 0
            for frame in container.decode(stream):
                if done == count:
                    return
                if float(frame.pts * stream.time_base) > start - 0.5 / fps:
                    done += 1
                    yield _pixels(frame)
    except (OSError, IndexError, av.FFmpegError) as error:
        raise FileError(f"{path}: cannot be read as a video ({one_line(error)})") from error


def _pixels(frame: Any) -> Image:
    """Return the pixels of a frame of a video, in RGB."""
    # Straight from 4:2:0 to RGB, FFmpeg makes each image a level darker (findings/video-420-loses-brightness.sh).
    whole = frame if frame.format.is_rgb else frame.reformat(format="yuv444p")
    return np.asarray(whole.to_ndarray(format="rgb24"), np.uint8)
