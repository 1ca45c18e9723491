"""A hand: several fingers, each a touch sensor of its own, and where each is mounted.

The hand's frame is any frame that is fixed to the hand, such as that of a gripper's flange, in the plane of the push. A
frame of a hand (`palpate.Frame`) has the hand's pose as `sensor_pose`.
"""

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from palpate.arrays import Array
from palpate.checks import SPAN, TURNS, other_unit
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.types.measurements import finite_numbers
from palpate.types.sensor import SensorProfile, sensor_from_dict
from palpate.types.sensor_file import known_sensor

Mount = tuple[float, float, float]
"""Pose of a finger's sensor in the hand's frame: x [m], y [m], yaw [rad]."""
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


@dataclass(frozen=True)
class Hand:
    """Fingers by name, in the order in which they are given; raises SettingError on values that are not allowed."""

    fingers: Mapping[str, SensorProfile]
    """Profile of each finger, with one tip; it may be given by a name or a file, too. A name of a finger is one word of
    letters, digits and _."""
    mounts: Mapping[str, Mount]
    """hand_T_finger of each finger, (x, y, yaw) [m, m, rad]: the frame of its sensor, whose x points out of the gel."""

    def __post_init__(self) -> None:
        for field in ("fingers", "mounts"):
            found = getattr(self, field)
            if not isinstance(found, Mapping):
                raise SettingError(
                    f"hand has {field} of type {type(found).__name__}; they must be a dictionary by name"
                )
        if not self.fingers:
            raise SettingError("hand has no fingers; allowed are one or more, by name")
        object.__setattr__(self, "fingers", {name: _checked(name, each) for name, each in self.fingers.items()})
        check_names("mounts", self.mounts, self.fingers)
        for name in self.fingers:
            if name not in self.mounts:
                raise SettingError(
                    f"hand has no mount of finger {name!r}; each finger needs one, (x, y, yaw) [m, m, rad]"
                )
        object.__setattr__(self, "mounts", {name: _checked_mount(name, self.mounts[name]) for name in self.fingers})
        self._check_apart()

    def _check_apart(self) -> None:
        """Raise SettingError if two fingers have one mount."""
        places = list(self.mounts.items())
        for index, (name, mount) in enumerate(places):
            for other, pose in places[:index]:
                if np.hypot(mount[0] - pose[0], mount[1] - pose[1]) < 1e-3:  # [m]: one mount, written twice
                    raise SettingError(
                        f"hand has fingers {other!r} and {name!r} at one mount, {mount}; allowed are two"
                    )

    @property
    def rate(self) -> float:
        """Frames per second of the fastest finger [Hz]."""
        return max(finger.rate for finger in self.fingers.values())

    @property
    def whole(self) -> SensorProfile:
        """The hand as one sensor of several tips without images, which tells the places of its fingers alone.

        It is exact for fingers of one radius; others count as round tips of the largest one.
        """
        first = next(iter(self.fingers.values()))
        names = dict.fromkeys(finger.name for finger in self.fingers.values())
        radius = max(finger.radius for finger in self.fingers.values())
        tips = []
        for name, finger in self.fingers.items():
            x, y = se2.transform(np.array(self.mounts[name]), np.array((-finger.radius, 0.0)))
            tips.append((float(x) + radius, float(y)))
        flat_width = first.flat_width if len(set(self.fingers.values())) == 1 and not self._turned else 0.0
        name = f"{len(self.fingers)} fingers ({', '.join(names)})"
        return SensorProfile(name, radius, tuple(tips), rate=self.rate, flat_width=flat_width)

    @property
    def _turned(self) -> bool:
        """True if a finger points elsewhere than along the hand's x."""
        return any(abs(se2.wrap(yaw)) > 1e-6 for _, _, yaw in self.mounts.values())

    def poses(self, hand_pose: Array, finger_poses: Mapping[str, Array] | None = None) -> dict[str, Array]:
        """Return world_T_finger of each finger (..., 3) [m, m, rad] from world_T_hand (..., 3).

        `finger_poses` take the place of mounts.
        """
        given = finger_poses or {}
        mounted = {name: se2.compose(hand_pose, np.array(self.mounts[name])) for name in self.fingers}
        return {name: given.get(name, pose) for name, pose in mounted.items()}

    def gaps(
        self, hand_pose: Array, object_pose: Array, shape: Shape, finger_poses: Mapping[str, Array] | None = None
    ) -> dict[str, Array]:
        """Return the distance of each finger's surface from an outline (N,) [m]; see `SensorProfile.gaps`."""
        poses = self.poses(hand_pose, finger_poses)
        return {name: finger.gaps(poses[name], object_pose, shape) for name, finger in self.fingers.items()}


def check_names(what: str, given: Mapping[str, Any], fingers: Mapping[str, Any]) -> None:
    """Raise SettingError if values by finger, which `what` names, have one of a finger that is not there."""
    for name in given:
        if name not in fingers:
            raise SettingError(f"{what}: found a finger {name!r}; the fingers of the hand are {', '.join(fingers)}")


def by_finger(what: str, words: str) -> dict[str, str]:
    """Return values by finger as words have them, left=VALUE,right=VALUE, each of its own; `what` names them in errors.

    Raises SettingError on other words, on a finger that comes twice, and on one value for two fingers.
    """
    found: dict[str, str] = {}
    for part in words.split(","):
        name, _, value = (each.strip() for each in part.partition("="))
        if not name or not value:
            raise SettingError(f"{what} is {words!r}; allowed is, for each finger of a hand, NAME=VALUE with commas")
        for other, its_value in found.items():
            if name == other:
                raise SettingError(f"{what} is {words!r}, in which finger {name!r} comes twice; allowed is once")
            if value == its_value and what != "sensor":
                raise SettingError(f"{what}: fingers {other!r} and {name!r} have one, {value}; allowed is one for each")
        found[name] = value
    return found


def _checked(name: Any, finger: Any) -> SensorProfile:
    """Return the profile of a finger."""
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise SettingError(f"hand has a finger {name!r}; its name must be one word of letters, digits and _")
    profile = known_sensor(finger)
    if profile.tips != ((0.0, 0.0),):
        raise SettingError(
            f"finger {name!r} is a sensor with tips {profile.tips}; a finger has one at (0, 0), its mount says where"
        )
    return profile


def _checked_mount(name: str, mount: Any) -> Mount:
    """Return the pose of a finger in the hand's frame."""
    numbers = finite_numbers(mount, (3,))
    allowed = "x, y up to 1 m, yaw [rad]"
    if numbers is None:
        raise SettingError(f"mount of finger {name!r} is {mount!r}; it must be three finite numbers, {allowed}")
    x, y, yaw = numbers.tolist()
    farthest = max(abs(x), abs(y))
    if farthest > 1.0:
        hint = other_unit(farthest, 1e-3, SPAN)
        raise SettingError(f"mount of finger {name!r} is {mount!r}; it must be {allowed}{hint}")
    if abs(yaw) > TURNS:
        raise SettingError(f"mount of finger {name!r} is {mount!r}; it must be {allowed}: are these degrees?")
    return x, y, yaw


def hand_to_dict(hand: Hand) -> dict[str, Any]:
    """Return a hand as files hold it."""
    return {"fingers": {name: asdict(each) for name, each in hand.fingers.items()}, "mounts": dict(hand.mounts)}


def hand_from_dict(data: Mapping[str, Any]) -> Hand:
    """Return the hand that was written; raises SettingError on fields that are missing or unknown."""
    is_hand = isinstance(data, Mapping) and data.keys() == {"fingers", "mounts"}
    if not is_hand or not isinstance(data["fingers"], Mapping):
        raise SettingError("a hand must be an object with fingers and mounts, by name")
    return Hand({name: sensor_from_dict(each) for name, each in data["fingers"].items()}, data["mounts"])
