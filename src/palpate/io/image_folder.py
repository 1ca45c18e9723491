"""A folder of touch images with tables of times and poses beside it, as a recording.

PNG and JPEG files go into the recording byte by byte; only those that have to be turned are encoded anew.
"""

import logging
import re
import shlex
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

from palpate.arrays import Times
from palpate.errors import FileError, PalpateError, SettingError
from palpate.files import counting_order, existing_file, in_file
from palpate.geometry.shapes import Shape
from palpate.hints import own_command
from palpate.io.pose_tables import NANOSECONDS, PoseTable, is_of_calendar, read_pose_table, read_times, time_unit
from palpate.io.recording import Recording
from palpate.io.table_rows import are_even
from palpate.io.time_order import UNKNOWN
from palpate.types.choices import BagChoices, TableChoices, TimeUnit
from palpate.types.images import UprightImage, camera_view, decode_image, turned_image
from palpate.types.sensor import SensorProfile
from palpate.types.space import STEEPEST, onto_gel, placed_at

logger = logging.getLogger(__name__)

SUFFIXES = (".png", ".jpg", ".jpeg")
_LAST_NUMBER = re.compile(r"(?<!\d)(?:\d+\.\d+|\d{10}_\d{9}|\d{10}_\d{6}|\d+)(?=\D*$)")
"""The last number of a name, of which a stamp of ROS may have two parts."""


def image_files(folder: Path) -> list[Path]:
    """Return the PNG and JPEG files of a folder, in the order in which people count; none if there are none."""
    files = [path for path in folder.glob("[!.]*") if path.suffix.lower() in SUFFIXES and path.is_file()]
    return sorted(files, key=lambda path: counting_order(path.name))


def read_folder(
    folder: Path,
    shape: Shape,
    choices: BagChoices,
    tables: TableChoices,
    sensor: SensorProfile,
    progress: Callable[[int], None] = lambda done: None,
) -> Recording:
    """Read a folder of images and its tables as a recording of an object of this shape.

    Each image gets the sensor's pose interpolated at its time. Times are those of a table, `choices.image_times`, of
    the names of the files, or counted by `tables.rate`; ground truth is a table too, `choices.object_poses`. `progress`
    is called with the number of images that are done. Raises PalpateError.
    """
    if tables.poses is None:
        raise SettingError("--poses is missing: a folder of images needs a table of times and poses")
    poses = read_pose_table(tables.poses, tables)
    files, time = _files_and_times(folder, choices, tables, poses)
    pose_time = _times_of(tables.poses, poses, time)
    _check_quaternions(tables.poses, poses, choices)
    truth: dict[str, Any] = {}
    if choices.object_poses is not None:
        table = Path(choices.object_poses)
        objects = read_pose_table(table, tables)
        truth = {"object_poses": objects.poses, "object_time": _times_of(table, objects, time)}
    _check_same_unit(folder, time, pose_time)
    placement = {name: getattr(choices, name) for name in ("sensor_T_gel", "time_offset", "plane", "off_plane")}
    images = _upright(files, choices.orientation, sensor, progress)
    source = f"folder {folder.name}: {tables.poses.name} of {poses.about}"
    with in_file(folder):
        return Recording.from_arrays(
            time,
            images,
            pose_time,
            poses.poses,
            shape,
            sensor,
            orientation=choices.orientation,
            source=source,
            **placement,
            **truth,
        )


def _files_and_times(
    folder: Path, choices: BagChoices, tables: TableChoices, poses: PoseTable
) -> tuple[list[Path], Times]:
    """Return the images in the order of their times, and these (N,) [ns]. Raises PalpateError if nothing tells them."""
    files = image_files(folder)
    if not files:
        others = sorted({path.suffix for path in folder.glob("*") if path.is_file()})
        raise FileError(f"{folder}: holds no PNG or JPEG images; found files {', '.join(others) or 'of no kind'}")
    if choices.image_times is not None:
        return _listed(folder, files, Path(choices.image_times), tables)
    if tables.rate is not None:
        if not 0.1 <= tables.rate <= 1000.0:
            raise SettingError(f"--rate is {tables.rate:g}; allowed are 0.1 to 1000 images a second")
        start = 0 if poses.time is None else int(poses.time[poses.time != UNKNOWN][0])
        if poses.time is not None:
            logger.warning(
                "%s: the first image is taken to be as old as the first pose; --time-offset moves it", folder
            )
        return files, start + np.round(_counted(files) * (1e9 / tables.rate)).astype(np.int64)
    _check_one_suffix(files)
    stamps = times_of_names(files, tables.time_unit)
    if stamps is not None:
        order = np.argsort(stamps, kind="stable")
        return [files[index] for index in order], stamps[order]
    if poses.time is not None and len(poses.time) == len(files):
        _check_alike(files)
        logger.warning("%s: as there is a pose for each image, its time is taken to be that of the image", folder)
        return files, poses.time
    raise FileError(
        f"{folder}: the names of the images, such as {files[0].name}, hold no times: give --image-times TABLE with "
        "columns time and file, or --rate HZ"
    )


def _listed(folder: Path, files: list[Path], table: Path, tables: TableChoices) -> tuple[list[Path], Times]:
    """Return images and their times (N,) [ns] as a table lists them. Raises FileError."""
    stamps, names = read_times(table, tables)
    if not names and len(stamps) != len(files):
        raise FileError(f"{table}: found {len(stamps)} times for the {len(files)} images in {folder}, expected as many")
    if not names:
        _check_alike(files)
        return files, stamps
    listed = [
        next((path for path in (folder / name, folder / PureWindowsPath(name).name) if path.exists()), None)
        for name in names
    ]
    missing = [name for name, path in zip(names, listed, strict=True) if path is None]
    if len(missing) == len(names):
        raise FileError(f"{table}: none of its {len(names)} files, such as {missing[0]}, is in {folder}")
    if missing:
        logger.warning(
            "%s: %d of %d files are not in %s, the first %s", table, len(missing), len(names), folder, missing[0]
        )
    kept = [(path, stamp) for path, stamp in zip(listed, stamps.tolist(), strict=True) if path is not None]
    return [path for path, _ in kept], np.array([stamp for _, stamp in kept], np.int64)


def _counted(files: Sequence[Path]) -> Times:
    """Return the numbers of images from the first on (N,), by their names if these are counted, so that gaps count.

    Names may be counted by tens and the like. Raises FileError if names are of several kinds, or differ in their suffix
    alone.
    """
    numbers = [re.findall(r"\d+", path.stem)[-1:] for path in files]
    _check_alike(files)
    if len(files) > 1 and all(numbers):
        counted = np.array([int(number) for (number,) in numbers], dtype=object)
        steps = np.diff(counted)
        usual = sorted(steps)[len(steps) // 2]
        if min(steps) > 0 and max(counted) < 2**53 and not (steps % usual).any():
            return ((counted - counted[0]) // usual).astype(np.int64)
    return np.arange(len(files))


def _check_alike(files: Sequence[Path]) -> None:
    """Raise FileError if names, but for their numbers, are of several kinds, or one is there with two suffixes."""
    _check_one_suffix(files)
    kinds = [re.sub(r"\d+", "0", path.stem) for path in files]
    ((usual, count),) = Counter(kinds).most_common(1)
    odd = [path.name for path, kind in zip(files, kinds, strict=True) if kind != usual]
    if odd and count > 1:
        like = files[kinds.index(usual)].name
        raise FileError(
            f"{files[0].parent}: {odd[0]} is named unlike {count} of the {len(files)} images, such as {like}, and "
            "would count as one of them: move away what is of another kind or camera, or give --image-times with "
            "columns time and file"
        )
    if not odd:
        _check_one_camera(files)


def _check_one_camera(files: Sequence[Path]) -> None:
    """Raise FileError if names are those of two cameras or takes, counted alike but for a number: cam0_12, cam1_12."""
    numbers = [tuple(re.findall(r"\d+", path.stem)) for path in files]
    for place in range(len(numbers[0])):
        of_value: dict[str, dict[tuple[str, ...], Path]] = {}
        for path, words in zip(files, numbers, strict=True):
            of_value.setdefault(words[place], {})[words[:place] + words[place + 1 :]] = path
        if len(of_value) != 2:
            continue
        one, other = of_value.values()
        both = [count for count in one if count in other]
        if len(both) > 1 and 2 * len(both) > max(len(one), len(other)):
            first, second = one[both[0]].name, other[both[0]].name
            raise FileError(
                f"{files[0].parent}: {first} and {second} are counted alike: are they of two cameras? Move those of "
                "one away, or give --image-times with columns time and file"
            )


def _check_one_suffix(files: Sequence[Path]) -> None:
    """Raise FileError if a name is there with two suffixes."""
    (twice, count) = Counter(path.stem for path in files).most_common(1)[0]
    if count > 1:
        raise FileError(
            f"{files[0].parent}: holds {twice} with two suffixes; which one is the image? Move the other away"
        )


def times_of_names(files: Sequence[Path], unit: TimeUnit | None = None) -> Times | None:
    """Return the times [ns] that names of files hold: of a calendar clock, with decimals, or in a unit that is given.

    None if they are only counted, as frame_0012.png. Raises FileError if the unit is open.
    """
    found = [re.findall(_LAST_NUMBER, path.stem) for path in files]
    if len(files) < 2 or not all(found):
        return None
    words = [numbers[-1].replace("_", ".") for numbers in found]
    values = np.array([float(word) for word in words])
    is_calendar = any(is_of_calendar(values, each) for each in NANOSECONDS)
    have_decimals = all("." in word for word in words)
    is_counted = np.median(np.diff(np.sort(values))) <= 1.0 and not have_decimals
    if len(set(words)) < len(words) or (is_counted and not is_calendar):
        return None
    if unit is None and not is_calendar and not have_decimals:
        return None
    if unit is None:
        with in_file(files[0].parent):
            unit = time_unit(np.sort(values))
    kinds = {re.sub(_LAST_NUMBER, "", path.stem) for path in files}
    are_shuffled = (np.diff(values) < 0.0).any()  # files are in the order in which people count
    if are_shuffled and not (len(kinds) == 1 and is_calendar and are_even(np.diff(np.sort(values)))):
        index = int(np.argmax(np.diff(values) < 0.0)) + 1
        raise FileError(
            f"{files[0].parent}: the times in the names go back from {files[index - 1].name} to {files[index].name}: "
            "allowed are those of one camera, whose last number is the whole time; else give --image-times"
        )
    if all(word.isdecimal() for word in words):
        return np.array([int(word) * NANOSECONDS[unit] for word in words], np.int64)
    return np.round(values * NANOSECONDS[unit]).astype(np.int64)


def _times_of(path: Path, table: PoseTable, image_time: Times) -> Times:
    """Return the times of poses; without a column of them those of the images, if there are as many."""
    if table.time is not None:
        return table.time
    if len(table.poses) != len(image_time):
        raise FileError(
            f"{path}: found no column of times, and {len(table.poses)} poses for {len(image_time)} images; allowed are "
            "a column named time, or a row for each image"
        )
    return image_time


def _check_same_unit(folder: Path, time: Times, pose_time: Times) -> None:
    """Raise FileError if images last a thousand times as long as poses or the reverse, as in different units."""
    # Without their ends, as a single time may be wrong.
    middles = [np.quantile(each[each != UNKNOWN], (0.1, 0.9)) for each in (time, pose_time)]
    spans = [float(np.ptp(middle)) * 1e-9 / 0.8 for middle in middles]
    if min(spans) > 0.0 and max(spans) > 300.0 * min(spans):
        raise FileError(
            f"{folder}: the images last {spans[0]:.4g} s, the poses {spans[1]:.4g} s; were times read in a wrong unit? "
            "Name the columns time_ms and the like"
        )


def _check_quaternions(path: Path, table: PoseTable, choices: BagChoices) -> None:
    """Raise FileError if quaternions without names hold the gel upright only if their w comes first."""
    if table.is_order_known:
        return
    is_known = np.isfinite(table.poses).all(axis=1)
    given = table.poses[is_known]
    gel = onto_gel(choices)
    normal = np.array([0.0, 0.0, 1.0]) if isinstance(choices.plane, str) else np.array(choices.plane, np.float64)
    normal /= np.linalg.norm(normal) or 1.0
    time = np.arange(len(given))
    shares = []
    for order in ([0, 1, 2, 3, 4, 5, 6], [0, 1, 2, 4, 5, 6, 3]):
        try:
            z_axis = gel(placed_at(str(path), time, given[:, order], time)).rotation.apply([0.0, 0.0, 1.0])
        except PalpateError:
            return  # from_arrays says what is wrong
        shares.append(float(np.mean(z_axis @ normal > np.cos(np.radians(STEEPEST)))))
    if shares[1] > 0.9 and shares[0] < 0.1:
        raise FileError(
            f"{path}: with the w of quaternions last, the gel's z axis does not point up; with w first it does: give "
            "--quaternion wxyz or xyzw"
        )


def _upright(files: list[Path], orientation: str, sensor: SensorProfile, progress: Callable[[int], None]) -> list[Any]:
    """Return the bytes of images, turned in parallel if they lie otherwise; in place of a damaged file its error."""
    view = camera_view(orientation)
    size = (sensor.image_height, sensor.image_width)

    def read(path: Path) -> bytes | FileError:
        try:
            with in_file(path):
                return UprightImage(turned_image(existing_file(path).read_bytes(), size, view))
        except FileError as error:
            return error

    images: list[Any] = []
    with ThreadPoolExecutor() as pool:
        for image in pool.map(read, files):
            images.append(image)
            progress(len(images))
    return images


def about_folder(folder: Path) -> dict[str, Any]:
    """Return the contents of a folder of images, the tables in it and beside it, and the command that converts it."""
    files = image_files(folder)
    with in_file(files[0]):
        height, width = decode_image(existing_file(files[0]).read_bytes()).shape[:2]
    stamps = times_of_names(files)
    about: dict[str, Any] = {"format": "images", "images": len(files), "height": height, "width": width}
    about |= {"first": files[0].name, "last": files[-1].name}
    about["times_in_names"] = stamps is not None
    tables = _tables_beside(folder)
    about["tables"] = [{"file": str(path), "content": kind} for path, kind in tables.items()]
    times = next((path for path, kind in tables.items() if kind.startswith("times of")), None)
    poses = [path for path, kind in tables.items() if kind.startswith("poses:")]
    words = [f"{own_command()} convert --images", shlex.quote(str(folder))]
    if stamps is None:
        words.append(f"--image-times {shlex.quote(str(times))}" if times else "--rate HZ")
    words.append(f"--poses {shlex.quote(str(poses[0])) if len(poses) == 1 else 'TABLE'}")
    about["advice"] = " ".join([*words, "--shape NAME|AxB|FILE OUT.mcap"])
    return about


def _tables_beside(folder: Path) -> dict[Path, str]:
    """Return the content in words of each table in a folder of images or beside it."""
    found: dict[Path, str] = {}
    for path in sorted([*folder.glob("[!.]*"), *folder.parent.glob("[!.]*")]):
        if path.suffix.lower() in (".csv", ".txt", ".tsv") and path.is_file():
            found[path] = _content_of(path)
    return found


def _content_of(path: Path) -> str:
    """Return the content of a table in words, or the reason why it cannot be read as one of poses."""
    try:
        return f"poses: {read_pose_table(path, TableChoices()).about}"
    except PalpateError as error:
        with suppress(PalpateError):
            return f"times of {len(read_times(path, TableChoices())[0])} images"
        return str(error).removeprefix(f"{path}: ")
