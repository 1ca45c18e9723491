"""Planar pushes with a DIGIT as the original authors and the Theseus example keep them: JSON.

Keys: `obj_poses_2d` and `ee_poses_2d` [m, rad], `contact_flag`, `contact_episode`, and `params` with the object's size;
lists of frames, or of episodes that are lists of frames. There is no time: frames are taken as 30 Hz, with a second
between episodes. Image features (`img_feats`) are not images and are left out.

Their sensor frame has its origin at the contact point and the push along +y, so our theta is theirs + pi/2, and the
sensor is a point. Each episode was cut out of a longer run. As in the published evaluation, both poses of an episode
are moved so that the object goes on from where it was at the end of the last one.
"""

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.checks import FARTHEST, NUMBERS, check_rows, checked_array, is_near
from palpate.errors import FileError
from palpate.files import in_file, read_json, text_start
from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Rectangle, Shape
from palpate.types.recording import Recording
from palpate.types.sensor import POINT

WIDTHS = {"obj_poses_2d": 3, "ee_poses_2d": 3, "contact_flag": 1, "contact_episode": 1}
SIZES = {("obj_radius",): Disc, ("block_size_x", "block_size_y"): Rectangle}
QUARTER_TURN = np.array([[0.0, 0.0, np.pi / 2]])


def is_theseus_json(path: Path) -> bool:
    """Return true for a JSON object that begins with one of the keys and has poses, or the object's size, soon."""
    start = text_start(path)
    first = re.match(r'\s*\{\s*"(obj_poses_2d|ee_poses_2d|img_feats|contact_flag|contact_episode|params)"\s*:', start)
    # "params" alone could begin many files.
    return bool(first) and (first[1] != "params" or bool(re.search("obj_poses_2d|obj_radius|block_size", start)))


def read_theseus_json(path: Path) -> Recording:
    """Read a file. Raises FileError."""
    with in_file(path):
        return _recording(read_json(path), path)


def _recording(data: dict[str, Any], path: Path) -> Recording:
    if missing := [key for key in WIDTHS if key not in data]:
        raise FileError(f"lacks {', '.join(missing)}")
    numbers = {key: _numbers(key, data[key]) for key in WIDTHS}
    count = len(numbers["contact_flag"])
    if not count or any(len(numbers[key]) != width * count for key, width in WIDTHS.items()):
        found = ", ".join(f"{key} {len(values)}" for key, values in numbers.items())
        raise FileError(f"lengths differ: found numbers of {found}; expected three a frame of poses, and one of flags")
    truth, hand, flag, number = (values.reshape(count, -1) for values in numbers.values())
    for name, rows in (("obj_poses_2d", truth), ("ee_poses_2d", hand)):
        check_rows(name, rows, is_near(rows).all(axis=1), f"three numbers up to {FARTHEST:g}")
    sensor = se2.compose(hand, QUARTER_TURN)
    is_new = number[1:, 0] != number[:-1, 0]
    for start, end in pairwise([*(np.flatnonzero(is_new) + 1).tolist(), len(number)]):
        move = se2.compose(truth[start - 1], se2.inverse(truth[start]))
        truth[start:end] = se2.compose(move[None], truth[start:end])
        sensor[start:end] = se2.compose(move[None], sensor[start:end])
    contact = flag[:, 0] > 0.5
    return Recording(
        time=np.append(0.0, np.cumsum(np.where(is_new, 1.0, 1.0 / 30.0))),
        sensor_pose=sensor,
        shape=_shape(data.get("params")),
        sensor=POINT,
        object_pose=truth,
        contact=contact,
        episode=np.where(contact, np.append(0, np.cumsum(is_new)), -1),
        source=f"Theseus tactile pushing data, {path.name}; its image features are left out",
        frames={
            "sensor_pose": "motion capture, contact point; episodes moved to where the object was left",
            "object_pose": "motion capture; episodes moved to where the object was left",
            "time": "no time in the file: 30 Hz, 1 s between episodes",
        },
        file=path,
    )


def _numbers(name: str, value: Any) -> NDArray[np.float64]:
    """Return the numbers in lists of lists, one after the other."""
    while isinstance(value, list) and any(isinstance(each, list) for each in value):
        value = [number for each in value for number in (each if isinstance(each, list) else [each])]
    return checked_array(name, value, ("fiub", "numbers"), ("N",)).astype(np.float64)


def _shape(params: Any) -> Shape:
    params = params if isinstance(params, dict) else {}
    for names, kind in SIZES.items():
        if all(name in params for name in names):
            return kind(*(float(checked_array(f"params.{name}", params[name], NUMBERS, ())) for name in names))
    raise FileError(
        "params has no shape: expected obj_radius, or block_size_x and block_size_y; "
        f"found {', '.join(params) or 'nothing'}"
    )
