"""Planar pushes with a DIGIT as the original authors and the Theseus example keep them: JSON.

Keys: `obj_poses_2d` and `ee_poses_2d` [m, rad], `contact_flag`, `contact_episode`, `img_feats`, and `params`
with the object's size. Either one list of frames, or a list of episodes that each are a list of frames; flags
may be numbers or lists of one number. There is no time: frames are taken as 30 Hz, with a second between
episodes.

Their sensor frame has its origin at the contact point and the push along +y, so our theta is theirs + pi/2,
and the sensor is a point. Each episode was cut out of a longer run. As in the published evaluation, both
poses of an episode are moved so that the object goes on from where it was at the end of the last one. The
image features `img_feats` are not images and are left out.
"""

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.checks import FARTHEST, NUMBERS, check_rows, checked_array, is_near
from palpate.errors import FileError, PalpateError
from palpate.files import read_json
from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Rectangle, Shape
from palpate.io.text_files import text_start
from palpate.types.recording import Recording
from palpate.types.sensor import POINT

DESCRIPTION = "DIGIT pushes of the Theseus example (.json)"

POSES = ("obj_poses_2d", "ee_poses_2d")
FLAGS = ("contact_flag", "contact_episode")
QUARTER_TURN = np.array([0.0, 0.0, np.pi / 2])
FIRST_KEY = re.compile(r'\s*\{\s*"(obj_poses_2d|ee_poses_2d|img_feats|contact_flag|contact_episode|params)"\s*:')


def detect(path: Path) -> bool:
    """Return true for a JSON object that begins with one of the keys."""
    start = text_start(path)
    if not (found := FIRST_KEY.match(start)):
        return False
    # "params" alone could begin many files; what follows it settles it if it is in reach.
    return found[1] != "params" or "obj_radius" in start or "block_size" in start or '"obj_poses_2d"' in start


def read(path: Path) -> Recording:
    """Read a file. Raises FileError."""
    data = read_json(path)
    try:
        return _read(data, path)
    except PalpateError as error:
        raise FileError(f"{path}: {error}") from error


def _read(data: dict[str, Any], path: Path) -> Recording:
    if missing := [key for key in (*POSES, *FLAGS) if key not in data]:
        raise FileError(f"lacks {', '.join(missing)}")
    nested = _is_nested(data["obj_poses_2d"])
    truth = _rows(data, "obj_poses_2d", nested, 3)
    hand = _rows(data, "ee_poses_2d", nested, 3)
    flag = _rows(data, "contact_flag", nested, 1)[:, 0]
    number = _rows(data, "contact_episode", nested, 1)[:, 0]
    lengths = {"obj_poses_2d": len(truth), "ee_poses_2d": len(hand), "contact_flag": len(flag)}
    if {len(number)} != set(lengths.values()):
        found = ", ".join(f"{key} {length}" for key, length in lengths.items())
        raise FileError(f"lengths differ: {found}, contact_episode {len(number)}")
    for name, rows in (("obj_poses_2d", truth), ("ee_poses_2d", hand)):
        check_rows(name, rows, is_near(rows).all(axis=1), f"three numbers up to {FARTHEST:g}")
    sensor = se2.compose(hand, QUARTER_TURN[None])

    is_new = number[1:] != number[:-1]
    if nested:
        ends = np.cumsum([len(episode) for episode in data["obj_poses_2d"]])
        is_new[ends[ends < len(number)] - 1] = True  # the last one, and empty ones after it, end with the frames
    bounds = [0, *(np.flatnonzero(is_new) + 1).tolist(), len(number)]
    for start, end in pairwise(bounds[1:]):
        move = se2.compose(truth[start - 1], se2.inverse(truth[start]))
        truth[start:end] = se2.compose(move[None], truth[start:end])
        sensor[start:end] = se2.compose(move[None], sensor[start:end])
    episode = np.append(0, np.cumsum(is_new))
    contact = flag > 0.5
    step = np.where(is_new, 1.0, 1.0 / 30.0)  # [s]
    return Recording(
        time=np.append(0.0, np.cumsum(step)),
        sensor_pose=sensor,
        shape=_shape(data.get("params")),
        sensor=POINT,
        object_pose=truth,
        contact=contact,
        episode=np.where(contact, episode, -1),
        source=f"Theseus tactile pushing data, {path.name}; its image features are left out",
        frames={
            "sensor_pose": "motion capture, contact point; episodes moved to where the object was left",
            "object_pose": "motion capture; episodes moved to where the object was left",
            "time": "no time in the file: 30 Hz, 1 s between episodes",
        },
        file=path,
    )


def _is_nested(poses: Any) -> bool:
    """Return true if poses are a list of episodes, which are lists of frames, rather than a list of frames."""
    if not isinstance(poses, list) or not poses or not isinstance(poses[0], list) or not poses[0]:
        raise FileError("obj_poses_2d: found no frames, expected a list of poses or of episodes")
    return isinstance(poses[0][0], list)


def _rows(data: dict[str, Any], name: str, nested: bool, width: int) -> NDArray[np.float64]:
    """Return the field as (N, width), all episodes one after the other."""
    value = data[name]
    if nested:
        if not isinstance(value, list) or not all(isinstance(episode, list) for episode in value):
            raise FileError(f"{name}: expected a list of episodes, as obj_poses_2d is")
        value = [frame for episode in value for frame in episode]
    if width == 1 and isinstance(value, list):
        value = [frame if isinstance(frame, list) else [frame] for frame in value]
    rows = checked_array(name, value, ("fiub", "numbers"), ("N", width))
    return rows.astype(np.float64)


def _shape(params: Any) -> Shape:
    params = params if isinstance(params, dict) else {}
    if "obj_radius" in params:
        return Disc(_size(params, "obj_radius"))
    if "block_size_x" in params and "block_size_y" in params:
        return Rectangle(_size(params, "block_size_x"), _size(params, "block_size_y"))
    raise FileError(
        "params has no shape: expected obj_radius, or block_size_x and block_size_y; "
        f"found {', '.join(params) or 'nothing'}"
    )


def _size(params: dict[str, Any], name: str) -> float:
    return float(checked_array(f"params.{name}", params[name], NUMBERS, ()))
