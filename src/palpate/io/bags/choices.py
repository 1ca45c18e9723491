"""What a user may say of a bag, and which of its topics become what."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from palpate.errors import FileError, SettingError
from palpate.io.bags.contents import Contents, Topic
from palpate.io.bags.frames import single_chain
from palpate.io.bags.messages import IMAGE_TYPES, POSE_TYPES, TRANSFORM_TYPES
from palpate.types.plane import Normal, checked_choices

PoseSource = str | tuple[str, str]
"""A topic of poses, or the parent and the child frame that transforms lead from and to."""


@dataclass(frozen=True)
class BagChoices:
    """How to read a bag; what is None is found where there is only one."""

    images: str | None = None
    """Topic of the touch images."""
    sensor_poses: str | None = None
    """Topic of the sensor's poses, or its frames in the transforms, PARENT:CHILD."""
    object_poses: str | None = None
    """Topic or frames, likewise, of the object's poses, which are ground truth."""
    clock: Literal["header", "log"] = "header"
    """Which time counts: that in the messages' headers, or when they were recorded."""
    time_offset: float = 0.0
    """Added to the times of the images [s]: negative where they are stamped late."""
    plane: Normal = (0.0, 0.0, 1.0)
    """Normal of the plane of the push in the frame of the poses, or "fit" for the plane through the sensor's way."""
    off_plane: float = 0.01
    """How far poses may be off the plane [m]."""

    def __post_init__(self) -> None:
        if self.clock not in ("header", "log"):
            raise SettingError(f"clock is {self.clock!r}; allowed are header, log")
        plane = checked_choices(self.plane, self.off_plane, self.time_offset)
        object.__setattr__(self, "plane", plane)


@dataclass(frozen=True)
class Mapping:
    """Which parts of a bag become what."""

    images: str
    """Topic of the touch images."""
    sensor: PoseSource
    """Where the sensor's poses come from."""
    object: PoseSource | None
    """Where the object's poses come from, which are ground truth."""
    unused: tuple[str, ...]
    """Topics that nothing is read from."""


def mapping(contents: Contents, choices: BagChoices) -> Mapping:
    """What to read from where. Raises FileError that lists the candidates where there are several, and none named."""
    image_topics = [topic.channel.topic for topic in contents.of(IMAGE_TYPES)]
    images = choices.images or _only(contents.path, "image topic", image_topics, "--images TOPIC")
    if images not in image_topics:
        raise FileError(f"{contents.path}: has no images in {images}; {_listed('image topics', image_topics)}")
    truth = None if choices.object_poses is None else _source(contents, choices.object_poses)
    if choices.sensor_poses is not None:
        sensor = _source(contents, choices.sensor_poses)
    else:
        sensor = _only_source(contents, leave_out=truth)
    used = {images}
    for source in (sensor, truth):
        if isinstance(source, str):
            used.add(source)
        elif source is not None:
            used |= {topic.channel.topic for topic in contents.of(TRANSFORM_TYPES)}
    unused = tuple(topic.channel.topic for topic in contents.topics if topic.channel.topic not in used)
    return Mapping(images, sensor, truth, unused)


def written(source: PoseSource) -> str:
    """A source as an option takes it: TOPIC or PARENT:CHILD."""
    return source if isinstance(source, str) else ":".join(source)


def topics_of(contents: Contents, found: Mapping) -> list[Topic]:
    """The topics that a mapping reads."""
    return [topic for topic in contents.topics if topic.channel.topic not in found.unused]


def _source(contents: Contents, said: str) -> PoseSource:
    """What a user calls a source of poses."""
    parent, colon, child = said.partition(":")
    if colon:
        return parent, child
    topics = [topic.channel.topic for topic in contents.of(POSE_TYPES)]
    if said not in topics:
        raise FileError(
            f"{contents.path}: has no poses in {said}; {_listed('pose topics', topics)}; {_frames(contents)}"
        )
    return said


def _only_source(contents: Contents, leave_out: PoseSource | None) -> PoseSource:
    topics: list[PoseSource] = [topic.channel.topic for topic in contents.of(POSE_TYPES)]
    frames = single_chain(contents.parents)
    found = [source for source in (*topics, *([frames] if frames else [])) if source != leave_out]
    if not found and contents.parents:
        raise FileError(
            f"{contents.path}: {_frames(contents)}; say which are the sensor's: --sensor-poses PARENT:CHILD"
        )
    names = [written(source) for source in found]
    only = _only(contents.path, "source of poses", names, "--sensor-poses, and --object-poses if one is ground truth")
    return found[names.index(only)]


def _only(path: Path, what: str, found: list[str], option: str) -> str:
    if len(found) == 1:
        return found[0]
    if not found:
        raise FileError(f"{path}: has no {what} of a type that is read; palpate info lists what it holds")
    raise FileError(f"{path}: has more than one {what}: {', '.join(found)}; name one by {option}")


def _listed(what: str, names: list[str]) -> str:
    return f"{what} are {', '.join(names)}" if names else f"there are no {what}"


def _frames(contents: Contents) -> str:
    names = sorted({*contents.parents, *contents.parents.values()})
    return _listed("frames of transforms", names)
