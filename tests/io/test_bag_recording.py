"""Bags as recordings: what is read right, what is warned of, and what is refused in one sentence."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from bag_samples import (
    CONTAINERS,
    ROS2,
    START,
    Message,
    build_message,
    compressed_message,
    header,
    image_message,
    image_times,
    pose_content,
    pose_message,
    pose_times,
    push_messages,
    touch_images,
    transform_message,
    true_pose,
    write_bag,
)
from mcap.writer import Writer
from planar import compose, wrap
from scipy.spatial.transform import Rotation

from palpate import (
    DIGIT,
    POINT,
    BagChoices,
    Disc,
    FileError,
    PalpateError,
    gel_pose,
    load_recording,
    read_bag,
    read_poses,
    write_recording,
)

SHAPE = Disc(0.05)


def read(tmp_path: Any, messages: list[Message], container: str = "mcap", **choices: Any) -> Any:
    path = write_bag(tmp_path / "bag", container, sorted(messages, key=lambda message: message.log_time))
    return read_bag(path, SHAPE, BagChoices(**choices)).recording


def few_images(count: int = 6) -> list[Message]:
    return [compressed_message(*each) for each in zip(image_times(count), touch_images(count), strict=True)]


def poses(topic: str = "/ee_pose", **settings: Any) -> list[Message]:
    times = pose_times()
    return [pose_message(time, pose, topic, **settings) for time, pose in zip(times, true_pose(times), strict=True)]


def same_poses(found: Any, wanted: Any, within: float = 1e-9) -> None:
    assert np.abs(found[:, :2] - wanted[:, :2]).max() < within
    assert np.abs(wrap(found[:, 2] - wanted[:, 2])).max() < within


@pytest.mark.parametrize("compressed", [True, False])
@pytest.mark.parametrize("container", CONTAINERS)
def test_a_bag_that_another_program_wrote(tmp_path, container, compressed):
    path = write_bag(tmp_path / "bag", container, push_messages(compressed))
    recording, plane = read_bag(path, SHAPE)
    assert (recording.shape, recording.sensor, recording.file) == (SHAPE, DIGIT, path)
    assert recording.time.tolist() == (image_times() / 1e9).tolist()
    same_poses(recording.sensor_pose, true_pose(image_times()))
    assert (plane.frame, plane.height) == ("world", pytest.approx(0.1)) and (plane.axes == np.eye(3)).all()
    assert {image.startswith(b"\xff\xd8") for image in recording.image or ()} == {compressed}
    for frame, pixels in zip(recording, touch_images(), strict=True):
        assert frame.image is not None
        off = np.abs(frame.image.astype(int) - pixels)
        assert off.mean() < 2.0 if compressed else off.max() == 0
    assert recording.contact is None
    assert recording.object_pose is None


def as_encoding(message: Message, encoding: str, pixels: Any) -> Message:
    """An image message whose bytes are these (height, width, channels)."""
    changes = {"encoding": encoding, "step": pixels[0].size, "data": np.ascontiguousarray(pixels).reshape(-1)}
    return replace(message, content=message.content | changes)


@pytest.mark.parametrize("encoding", ["BGRA8 ", "rgba8", "yuv422", "yuv422_yuy2", "bayer_rggb8", "bayer_gbrg8"])
def test_encodings_that_opencv_converts(tmp_path, encoding):
    """Of a sensor of one colour, which neither a mosaic nor half the colours' resolution changes."""
    red, green, blue = 150, 90, 60
    shape, message = (320, 240), image_message(image_times()[0], touch_images(1)[0])
    if encoding.startswith("bayer"):
        names = np.array(list(encoding[6:10])).reshape(2, 2)
        tile = np.vectorize({"r": red, "g": green, "b": blue}.get)(names)
        pixels = np.tile(tile, (160, 120)).astype(np.uint8)[..., None]
    elif encoding.startswith("yuv"):
        y, u, v = 16 + 0.257 * red + 0.504 * green + 0.098 * blue, 128 - 0.148 * red - 0.291 * green + 0.439 * blue, 0.0
        v = 128 + 0.439 * red - 0.368 * green - 0.071 * blue
        colours = np.broadcast_to(np.where(np.arange(240) % 2 == 0, u, v), shape)
        pair = [colours, np.full(shape, y)]
        pixels = np.rint(np.dstack(pair if encoding == "yuv422" else pair[::-1])).astype(np.uint8)
    else:
        order = (red, green, blue) if encoding == "rgba8" else (blue, green, red)
        pixels = np.broadcast_to(np.array([*order, 255], np.uint8), (*shape, 4))
    found = read(tmp_path, [as_encoding(message, encoding, pixels), *poses()])[0].image
    assert np.abs(found[2:-2, 2:-2].astype(int) - [red, green, blue]).max() <= 3


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "8UC3"])
def test_colours_of_raw_images(tmp_path, encoding):
    pixels = touch_images(3)
    images = [image_message(time, each, encoding, padding=5) for time, each in zip(image_times(3), pixels, strict=True)]
    recording = read(tmp_path, images + poses())
    assert np.array_equal([frame.image for frame in recording], pixels)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"encoding": "mono8"}, "images are encoded as 'mono8', allowed are rgb8, .*8UC3"),
        ({"encoding": "bayer_rggb16"}, "'bayer_rggb16'"),
        ({"step": 10}, "in rows of 10, expected 3 bytes a column"),
        ({"height": 400}, "an image of 400 rows and 240 columns has 230400 bytes"),
    ],
)
def test_raw_images_that_are_refused(tmp_path, changes, message):
    images = [image_message(image_times()[0], touch_images(1)[0], **changes)]
    with pytest.raises(FileError, match=message):
        read(tmp_path, images + poses())


def test_channels_of_another_type_on_a_topic_are_left_alone(tmp_path):
    path = tmp_path / "a.mcap"
    messages = [*few_images(), *poses()]
    strangers = [replace(each, topic="/ee_pose") for each in few_images(2)]
    strangers += [replace(each, topic="/digit/image/compressed") for each in poses()[:2]]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        channels: dict[tuple[str, str], int] = {}
        for each in [*messages, *strangers]:
            if (each.topic, each.type) not in channels:
                schema = writer.register_schema(each.type, "ros2msg", b"")
                channels[each.topic, each.type] = writer.register_channel(each.topic, "cdr", schema)
            data = bytes(ROS2.serialize_cdr(build_message(ROS2, each.type, each.content), each.type))
            writer.add_message(channels[each.topic, each.type], each.log_time, data, each.log_time)
        writer.finish()
    choices = BagChoices(images="/digit/image/compressed", sensor_poses="/ee_pose")
    assert len(read_bag(path, SHAPE, choices).recording) == 6


def test_compressed_images_that_are_refused(tmp_path):
    good = compressed_message(image_times()[0], touch_images(1)[0])
    rubbish = replace(good, content=good.content | {"data": np.arange(30, dtype=np.uint8), "format": "webp"})
    with pytest.raises(FileError, match="images are 'webp', allowed are colour images as JPEG or PNG"):
        read(tmp_path / "a", [rubbish, *poses()])
    grey = replace(good, content=good.content | {"format": "mono8; jpeg compressed "})
    with pytest.raises(FileError, match="allowed are colour images"):
        read(tmp_path / "b", [grey, *poses()])
    small = [compressed_message(image_times()[0], touch_images(1)[0].transpose(1, 0, 2))]
    with pytest.raises(FileError, match=r"found 240 rows and 320 columns, .* lie on their side"):
        read(tmp_path / "d", small + poses())


def test_poses_with_covariance(tmp_path):
    kind, with_covariance = "geometry_msgs/msg/PoseWithCovarianceStamped", []
    for pose in poses():
        content = pose.content | {"pose": {"pose": pose.content["pose"], "covariance": np.zeros(36)}}
        with_covariance.append(replace(pose, type=kind, content=content))
    recording = read(tmp_path, few_images() + with_covariance)
    same_poses(recording.sensor_pose, true_pose(image_times(6)))


def as_odometry(message: Message) -> Message:
    """A pose as mobile robots send it."""
    twist = {"linear": dict.fromkeys("xyz", 9.0), "angular": dict.fromkeys("xyz", 9.0)}
    content = {
        "header": message.content["header"],
        "child_frame_id": "digit",
        "pose": {"pose": message.content["pose"], "covariance": np.zeros(36)},
        "twist": {"twist": twist, "covariance": np.zeros(36)},
    }
    return replace(message, type="nav_msgs/msg/Odometry", content=content)


def as_transform(message: Message) -> Message:
    """A pose as motion capture sends it: a topic of its own for each body."""
    pose = message.content["pose"]
    transform = {"translation": pose["position"], "rotation": pose["orientation"]}
    content = {"header": message.content["header"], "child_frame_id": "digit", "transform": transform}
    return replace(message, type="geometry_msgs/msg/TransformStamped", content=content)


@pytest.mark.parametrize("container", CONTAINERS)
@pytest.mark.parametrize("sent", [as_odometry, as_transform])
def test_poses_of_mobile_robots_and_motion_capture(tmp_path, sent, container):
    given = [sent(each) for each in poses()]
    recording = read(tmp_path, few_images() + given, container)
    assert recording.time.tolist() == (image_times(6) / 1e9).tolist()
    same_poses(recording.sensor_pose, true_pose(image_times(6)))
    truth = [sent(each) for each in poses("/object")]
    both = read(tmp_path / "both", few_images() + poses() + truth, container, object_poses="/object")
    same_poses(both.object_pose, true_pose(image_times(6)))
    beside = [sent(each) for each in poses("/odom")]
    same_poses(read(tmp_path / "beside", few_images() + poses() + beside, container).sensor_pose, recording.sensor_pose)
    other = read(tmp_path / "other", few_images() + given + poses("/object"), container, object_poses="/object")
    same_poses(other.sensor_pose, recording.sensor_pose)
    two = given[:1] + [replace(each, content=each.content | {"child_frame_id": "object"}) for each in given[1:]]
    with pytest.raises(FileError, match="/ee_pose: poses are those of several bodies, child frames 'digit', 'object'"):
        read(tmp_path / "bodies", few_images() + two, container)
    given[:20] = [sent(each) for each in poses(frame="map")[:20]]
    with pytest.raises(FileError, match="/ee_pose: poses are given in several frames, 'map', 'world'"):
        read(tmp_path / "frames", few_images() + given, container)


@pytest.mark.parametrize("container", CONTAINERS)
def test_transforms_along_a_chain(tmp_path, container):
    """The arm moves at 50 Hz; how it holds the sensor, turned about x and moved on, stands in a static transform."""
    held = Rotation.from_euler("x", 0.3)
    apex = np.array([0.05, 0.0, 0.01])
    messages = [transform_message(START, "tool", "digit", apex, held, static=True)]
    messages.append(
        transform_message(START, "world", "base", [1.0, 2.0, 0.0], Rotation.from_euler("z", 0.5), static=True)
    )
    for time, pose in zip(pose_times(), true_pose(pose_times()), strict=True):
        messages.append(transform_message(time, "base", "tool", [*pose[:2], 0.2], Rotation.from_euler("z", pose[2])))
    recording = read(tmp_path, few_images() + messages, container)
    wanted = compose(compose([1.0, 2.0, 0.5], true_pose(image_times(6))), [0.05, 0.0, 0.0])
    same_poses(recording.sensor_pose, wanted)
    named = read(tmp_path / "named", few_images() + messages, container, sensor_poses="base:digit")
    same_poses(named.sensor_pose, compose(true_pose(image_times(6)), [0.05, 0.0, 0.0]))
    both = read(
        tmp_path / "both", few_images() + messages, container, sensor_poses="base:digit", object_poses="base:tool"
    )
    same_poses(both.object_pose, true_pose(image_times(6)))
    with pytest.raises(FileError, match="no chain of transforms leads from 'base' to 'base'"):
        read(tmp_path / "one", few_images() + messages, container, sensor_poses="base:base")


def test_ground_truth_is_named_and_the_sensor_is_what_is_left(tmp_path):
    truth = [message for message in poses("/object", height=0.02) if not 4 <= (message.log_time - START) // 2e7 <= 40]
    recording = read(tmp_path, few_images(20) + poses() + truth, object_poses="/object")
    same_poses(recording.sensor_pose, true_pose(image_times(20)))
    known = ~np.isnan(recording.object_pose[:, 0])
    assert known.tolist() == [time <= 3 * 2e7 for time in image_times(20) - START]
    same_poses(recording.object_pose[known], true_pose(image_times(20))[known])
    other = poses("/object", frame="map")
    with pytest.raises(FileError, match="sensor are given in frame 'world', those of the object in 'map'"):
        read(tmp_path / "map", few_images() + poses() + other, object_poses="/object")


LEVEL = Rotation.identity()


def still(*pairs: str) -> list[Message]:
    """Static transforms from parents to children, "parent child" each."""
    names = [pair.split() for pair in pairs]
    return [transform_message(START, parent, child, [0, 0, 0], LEVEL, static=True) for parent, child in names]


TWO_IMAGES = few_images() + [replace(message, topic="/other") for message in few_images()]
TWO_POSES = few_images() + poses() + poses("/object")
FORKED = few_images() + still("base left", "base right")


@pytest.mark.parametrize(
    ("messages", "choices", "words"),
    [
        (TWO_IMAGES + poses(), {}, "more than one image topic; there are /digit/image/compressed, /other; .* --images"),
        (TWO_POSES, {}, "more than one source of poses; there are /ee_pose, /object; name one by --sensor-poses"),
        (
            TWO_POSES,
            {"sensor_poses": "/object", "object_poses": "/object"},
            "has no source of poses '/object'; there are",
        ),
        (TWO_POSES, {"sensor_poses": "/ee"}, "has no source of poses '/ee'; there are /ee_pose, /object; name one"),
        (TWO_POSES, {"images": "/camera"}, "has no image topic '/camera'; there are /digit/image/compressed; name"),
        (poses(), {}, "has no image topic; there are none of a type that is read"),
        (
            few_images(),
            {},
            "has no source of poses; there are none of a type that is read, which are .* nav_msgs Odometry, foxglove",
        ),
        (FORKED, {}, "more than one source of poses; there are base:left, base:right; .* --sensor-poses .* PARENT:"),
        (FORKED + still("map tag"), {}, "there are base:left, base:right, map:tag; frames of transforms are base"),
        (
            FORKED,
            {"sensor_poses": "base:gel"},
            "no chain .* from 'base' to 'gel'; frames of transforms are base, left, right",
        ),
        (FORKED + still("lost tag"), {"sensor_poses": "left:tag"}, "no chain of transforms leads from 'left' to 'tag'"),
        (few_images() + still("a b", "b a"), {"sensor_poses": "a:b"}, "transforms run in a circle: a < b < a"),
        (few_images() + poses()[20:] + poses(frame="map")[:20], {}, "/ee_pose: .* in several frames, 'map', 'world'"),
        (few_images() + still("a x", "b x"), {"sensor_poses": "a:x"}, "frame x has 2 parents, a and b"),
    ],
)
def test_what_is_ambiguous_is_listed(tmp_path, messages, choices, words):
    with pytest.raises(FileError, match=words):
        read(tmp_path, messages, **choices)


def test_images_without_a_pose_are_left_out_and_counted(tmp_path, caplog):
    late = [message for message in poses() if message.content["header"]["stamp"]["nanosec"] > 90_000_000]
    recording = read(tmp_path, few_images() + late)
    assert recording.time.tolist() == (image_times(6)[3:] / 1e9).tolist()
    assert "3 of 6 images have no sensor pose at their time and are left out" in caplog.text
    far = [pose_message(START - 500_000_000 + time, [0, 0, 0]) for time in (0, 10)]
    with pytest.raises(FileError, match=r"known at the time of 0 of 6 images, 1700000000\.020 to"):
        read(tmp_path / "far", few_images() + far)
    with pytest.raises(FileError, match="known at the time of 1 of 6 images"):
        read(tmp_path / "one", few_images() + poses()[1:2])


def test_time_offset_is_added_to_the_images_that_are_named(tmp_path):
    recording = read(tmp_path, TWO_IMAGES + poses(), images="/other", time_offset=0.015)
    assert recording.time.tolist() == ((image_times(6) + 15_000_000) / 1e9).tolist()
    same_poses(recording.sensor_pose, true_pose(image_times(6) + 15_000_000))


def restamped(messages: list[Message], stamp: Any) -> list[Message]:
    """The messages with stamps that follow from the old ones [ns]."""

    def new(message: Message) -> Message:
        old = message.content["header"]
        time = old["stamp"]["sec"] * 10**9 + old["stamp"]["nanosec"]
        return replace(message, content=message.content | {"header": header(stamp(time), old["frame_id"])})

    return [new(message) for message in messages]


@pytest.mark.parametrize(
    ("stamp", "message"),
    [
        (
            lambda time: 0,
            "6 messages in /digit/image/compressed have only 1 different header stamps; --clock log takes",
        ),
        (lambda time: time - 40 * 10**9, r"-40\.003 s off .* in /digit/image/compressed, -0\.001 s in /ee_pose; --cl"),
        (
            lambda time: time + (time > START + 10**8) * 5 * 10**9,
            r"-0\.003 s off .* in /digit/image/compressed, \+4\.997 s in /dig",
        ),
    ],
)
def test_clocks_that_do_not_go_together(tmp_path, stamp, message):
    messages = restamped(few_images(), stamp) + poses()
    with pytest.raises(FileError, match=message):
        read(tmp_path / "header", messages)
    recording = read(tmp_path / "log", messages, clock="log")
    assert recording.time.tolist() == ((image_times(6) + 3_000_000) / 1e9).tolist()
    same_poses(recording.sensor_pose, true_pose(image_times(6) + 2_000_000))  # poses are logged 1 ms late themselves


def set_clock(messages: list[Message], seconds: float, count: int = 1000) -> list[Message]:
    """The messages with a clock that is set by some time from the 25th on, for so many messages."""
    return [
        restamped([message], lambda time: time + round(seconds * 1e9))[0] if 25 <= index < 25 + count else message
        for index, message in enumerate(messages)
    ]


@pytest.mark.parametrize("seconds", [-0.4, -0.9])
@pytest.mark.parametrize("clock", ["log", "header"])
def test_a_clock_that_goes_back_is_no_order_to_sort(tmp_path, seconds, clock):
    messages = few_images(24) + set_clock(poses(), seconds)
    if clock == "log":
        assert len(read(tmp_path, messages, clock="log")) == 24
        return
    with pytest.raises(FileError, match=r"/ee_pose: header stamps: times go back once .* from 1700000000\.480 s"):
        read(tmp_path / "poses", messages)
    times = image_times(60)
    images = [compressed_message(time, touch_images(1)[0]) for time in times]
    with pytest.raises(FileError, match="/digit/image/compressed: header stamps: times go back once"):
        read(tmp_path / "images", set_clock(images, seconds) + poses())


@pytest.mark.parametrize("seconds", [3600.0, -3600.0, 0.3, -0.3, None])
def test_one_wrong_stamp_costs_itself(tmp_path, caplog, seconds):
    wrong = set_clock(poses(), seconds or 0.0, 1)
    if seconds is None:
        wrong[25] = restamped([wrong[25]], lambda time: 0)[0]
    found = read(tmp_path, few_images(24) + wrong)
    assert len(found) >= 22
    same_poses(found.sensor_pose, true_pose(np.round(found.time * 1e9)), 1e-3)
    assert "/ee_pose" in caplog.text and "left out" in caplog.text


@pytest.mark.parametrize("seconds", [0.4, 0.9])
@pytest.mark.parametrize("stream", ["poses", "images", "both", "put right"])
def test_a_clock_that_is_set_forward_costs_itself(tmp_path, caplog, stream, seconds):
    images = [compressed_message(time, touch_images(1)[0]) for time in image_times(44)]
    moving = poses()
    if stream in ("images", "both"):
        images = set_clock(images, seconds)
    if stream == "put right":  # the clock was late until it was set
        moving = [restamped([message], lambda time: time - round(seconds * 1e9))[0] for message in moving]
    if stream != "images":
        moving = set_clock(moving, seconds)
    found = read(tmp_path, images + moving)
    assert "header stamps step by +" in caplog.text
    assert len(found) >= 20
    same_poses(found.sensor_pose, true_pose(np.round(found.time * 1e9)), 1e-3)


def test_one_transform_of_two_senders_is_refused(tmp_path):
    def sent(late: int, off: float, back: int = 0) -> list[Message]:
        found = []
        for time, pose in zip(pose_times() + late, true_pose(pose_times() + late), strict=True):
            position = [pose[0] + off, pose[1], 0.1]
            message = transform_message(time, "base", "gel", position, Rotation.from_euler("z", pose[2]))
            transform = dict(message.content["transforms"][0], header=header(time - back, "base"))
            found.append(replace(message, content={"transforms": [transform]}))
        return found

    for late, back, words in ((9_000_000, 0, "two senders give it"), (9_000_000, 15_000_000, "two senders write them")):
        both = few_images() + sent(0, 0.0) + sent(late, 0.024, back)
        with pytest.raises(FileError, match=f"transforms of gel: .*{words}"):
            read(tmp_path / words[-4:], both, sensor_poses="base:gel")
    with pytest.raises(FileError, match="transforms of gel are on /tf and /tf_static"):
        read(tmp_path / "still", few_images() + sent(0, 0.0) + still("base gel"), sensor_poses="base:gel")


@pytest.mark.parametrize("position", [(0.0, 0.0, 0.0), (0.15, -0.1, 0.13), (0.2, -0.1, 0.1)])
def test_one_wrong_pose_costs_itself(tmp_path, caplog, position):
    wrong = poses()
    content = wrong[25].content["pose"] | {"position": dict(zip("xyz", position, strict=True))}
    wrong[25] = replace(wrong[25], content=wrong[25].content | {"pose": content})
    found = read(tmp_path, few_images(24) + wrong)
    assert 22 <= len(found) < 24
    same_poses(found.sensor_pose, true_pose(np.round(found.time * 1e9)), 1e-3)
    assert "1 of 68 poses leap" in caplog.text


def test_images_of_one_time_are_counted(tmp_path, caplog):
    messages = restamped(few_images(), lambda time: min(time, int(image_times(6)[3])))
    assert len(read(tmp_path, messages + poses())) == 4
    assert "2 images have the time of another one and are left out" in caplog.text


@pytest.mark.parametrize("container", CONTAINERS)
@pytest.mark.parametrize("clock", ["header", "log"])
def test_what_two_recorders_have_is_there_once(tmp_path, caplog, container, clock):
    messages = few_images() + poses()
    again = [replace(each, log_time=each.log_time + 200_000) for each in messages]
    twice = sorted(messages + again, key=lambda each: each.log_time)
    found = read(tmp_path / "twice", twice, container, clock=clock)
    once = read(tmp_path / "once", messages, container, clock=clock)
    assert found.time.tolist() == once.time.tolist()
    same_poses(found.sensor_pose, once.sensor_pose, 1e-3)
    assert "6 of 12 images are there twice" in caplog.text


def lifted(height: Any, turn: Rotation = LEVEL) -> list[Message]:
    """Poses whose height [m] follows from the seconds since the start, turned in their own frame."""
    found = []
    for time, pose in zip(pose_times(), true_pose(pose_times()), strict=True):
        rotation = Rotation.from_euler("z", pose[2]) * turn
        content = {"header": header(time), "pose": pose_content([*pose[:2], height((time - START) * 1e-9)], rotation)}
        found.append(Message("/ee_pose", int(time), "geometry_msgs/msg/PoseStamped", content))
    return found


def test_poses_off_the_plane_are_refused_unless_they_are_allowed(tmp_path):
    rising = lifted(lambda seconds: 0.1 + 0.05 * max(0.0, seconds - 0.5))
    with pytest.raises(FileError, match=r"/ee_pose is 11\.0 mm off the plane at 17.* 10 mm; .*--off-plane"):
        read(tmp_path / "a", few_images(24) + rising)
    same_poses(read(tmp_path / "b", few_images(24) + rising, off_plane=0.05).sensor_pose, true_pose(image_times()))


def test_a_steep_tilt_is_refused_and_a_sensor_upside_down_told(tmp_path, caplog):
    steeply = lifted(lambda seconds: 0.1, Rotation.from_euler("y", np.pi / 2))
    with pytest.raises(FileError, match=r"has its x axis -90\.0 degrees out of the plane .* allowed are 20"):
        read(tmp_path / "b", few_images() + steeply)
    read(tmp_path / "c", few_images() + lifted(lambda seconds: 0.1, Rotation.from_euler("x", np.pi)))
    assert "the sensor's z axis points against the plane's normal" in caplog.text


def test_choices_that_are_none(tmp_path):
    write_bag(bag := tmp_path / "a.mcap", "mcap", few_images() + lifted(lambda seconds: 0.1))
    wrongs: Any = [{"clock": "mine"}, {"plane": "flat"}, {"plane": (1.0, 2.0)}, {"off_plane": 0.0}]
    wrongs += [{"time_offset": offset} for offset in (np.nan, np.inf, 1e12)]
    for wrong in wrongs:
        with pytest.raises(PalpateError, match="; allowed "):
            read_bag(bag, SHAPE, BagChoices(**wrong))


@pytest.mark.parametrize("orientation", ["", "90", "270,mirrored", "180,gbr"])
def test_images_of_twice_the_size_in_any_orientation(tmp_path, orientation):
    turns = int(orientation[:3].strip(",") or 0) // 90
    sent = [np.kron(image, np.ones((2, 2, 1), np.uint8)) for image in touch_images(6)]
    sent = [image[:, ::-1] if "mirrored" in orientation else image for image in sent]
    sent = [np.rot90(image, -turns)[..., [1, 2, 0] if "gbr" in orientation else [0, 1, 2]] for image in sent]
    times = image_times(6)
    for make in (image_message, compressed_message):
        messages = [make(time, np.ascontiguousarray(image)) for time, image in zip(times, sent, strict=True)]
        found = read(tmp_path / make.__name__, messages + poses(), orientation=orientation)
        images = [frame.image.astype(int) for frame in found]
        assert np.abs(np.array(images) - touch_images(6)).mean() < (0.01 if make is image_message else 4.0)


def test_poses_of_a_flange_that_looks_down(tmp_path):
    flange_T_gel = (0.03, 0.0, 0.12, 1.0, 0.0, 0.0, 0.0)  # half a turn about x
    times, down = pose_times(), Rotation.from_quat(flange_T_gel[3:])
    messages = few_images()
    for time, pose in zip(times, true_pose(times), strict=True):
        turn = Rotation.from_euler("z", pose[2]) * down.inv()
        position = [*pose[:2], 0.1] - turn.apply(flange_T_gel[:3])
        content = {"header": header(time), "pose": pose_content(position, turn)}
        messages.append(Message("/flange", int(time) + 1_000_000, "geometry_msgs/msg/PoseStamped", content))
    recording = read(tmp_path, messages, sensor_T_gel=flange_T_gel)
    same_poses(recording.sensor_pose, true_pose(image_times(6)), 1e-4)  # an arc, taken as straight
    found, rows = read_poses(tmp_path / "bag/bag.mcap", "/flange")
    assert (found == times).all() and rows.shape == (len(times), 7)
    gel = np.array([gel_pose(row, flange_T_gel) for row in rows])
    same_poses(gel, true_pose(times))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(rows[7, 3:]).as_matrix(), rows[7, :3]
    same_poses(gel_pose(matrix, flange_T_gel)[None], gel[7:8])
    with pytest.raises(FileError, match=r"x axis -90.0 degrees out of the plane"):
        gel_pose((0.0, 0.0, 0.1, 0.0, 0.5**0.5, 0.0, 0.5**0.5))


def test_contact_flags_in_place_of_images(tmp_path):
    changes = ((0, False), (21, True), (52, False))  # published when they change
    flags = [
        Message("/touch", int(pose_times()[index]) + 1_000_000, "std_msgs/msg/Bool", {"data": flag})
        for index, flag in changes
    ]
    path = write_bag(tmp_path / "bag", "mcap", sorted([*flags, *poses()], key=lambda message: message.log_time))
    found = read_bag(path, SHAPE, sensor=POINT).recording
    assert found.image is None and found.contact is not None
    assert (read_bag(path, SHAPE).recording.contact == found.contact).all()  # of a DIGIT without images
    assert np.diff(found.time) == pytest.approx(1 / POINT.rate, abs=1e-6)
    since = found.time - START * 1e-9
    assert (found.contact == ((since > 0.42) & (since < 1.04))).all() and len(found) > 30
    same_poses(found.sensor_pose, true_pose(START + since * 1e9), 1e-6)
    with pytest.raises(FileError, match="has no topic of contact flags"):
        read_bag(write_bag(tmp_path / "no", "mcap", poses()), SHAPE, sensor=POINT)


@pytest.mark.parametrize("unit", ["s", "ns"])
def test_images_in_a_folder_and_poses_in_a_bag(tmp_path, unit):
    rows = ["Time;file"]
    for time, message in zip(image_times(6).tolist(), few_images(), strict=True):
        (tmp_path / f"{time}.jpg").write_bytes(bytes(message.content["data"]))
        rows.append(f"{time if unit == 'ns' else f'{time * 1e-9:.6f}'.replace('.', ',')};{time}.jpg")
    table = tmp_path / "times.csv"
    table.write_text("\n".join(rows))
    found = read(tmp_path, poses(), images=tmp_path, image_times=table)
    same_poses(found.sensor_pose, true_pose(image_times(6)), 1e-6)
    assert np.abs(np.array([frame.image for frame in found], int) - touch_images(6)).mean() < 4.0
    for text, words in {
        "file\na": "found the columns file; expected time, file",
        "time,file\nx,a": "time is 'x'",
    }.items():
        table.write_text(text)
        with pytest.raises(FileError, match=words):
            read(tmp_path / words[:4], poses(), images=tmp_path, image_times=table)


def test_a_plane_is_fitted_to_frames_in_contact(tmp_path):
    """The sensor comes down steeply and pushes along a curve in a tilted plane."""
    tilt, frames = Rotation.from_euler("y", 0.2), 60
    times, down = image_times(frames), np.clip(30 - np.arange(frames), 0, None)
    touched = touch_images(1)[0].copy()
    touched[100:200, 60:180] = 255 - touched[100:200, 60:180]
    messages = []
    for index, time in enumerate(times):
        noise = np.random.default_rng(index).integers(0, 3, touched.shape, np.uint8)
        messages.append(compressed_message(time, (touched if index > 32 else touch_images(1)[0]) // 2 + noise))
        along = 0.002 * (index - 30) if index > 30 else 0.0
        place = tilt.apply([along, 30.0 * along**2, 0.0]) + np.array([0.0, -0.001, 0.003]) * down[index]
        content = {"header": header(time), "pose": pose_content(place, tilt)}
        messages.append(Message("/ee_pose", int(time) + 1_000_000, "geometry_msgs/msg/PoseStamped", content))
    path = write_bag(tmp_path / "bag", "mcap", sorted(messages, key=lambda message: message.log_time))
    plane = read_bag(path, SHAPE, BagChoices(plane="fit", off_plane=0.2)).plane
    assert plane.axes[:, 2] == pytest.approx(tilt.apply([0.0, 0.0, 1.0]), abs=2e-3)


def test_a_damaged_image_is_one_frame(tmp_path):
    messages = few_images()
    for index, data in ((0, b""), (3, bytes(messages[3].content["data"])[:900])):
        content = messages[index].content | {"data": np.frombuffer(data, np.uint8)}
        messages[index] = replace(messages[index], content=content)
    recording = read(tmp_path, messages + poses())
    assert len(recording) == 6
    for index in range(6):
        if index in (0, 3):
            with pytest.raises(FileError, match=f"image of frame {index}: .* do not decode"):
                recording[index]
        else:
            assert recording[index].image is not None


LOST = {
    "nan": {"orientation": dict.fromkeys("xyzw", float("nan"))},
    "zero": {"orientation": dict.fromkeys("xyzw", 0.0)},
    "short": {"orientation": {**dict.fromkeys("xyz", 0.0), "w": 0.5}},
    "off the plane": {"position": dict.fromkeys("xyz", 0.0)},
}


@pytest.mark.parametrize("kind", LOST)
def test_poses_that_motion_capture_lost_are_unknown(tmp_path, kind):
    truth = poses("/object")
    for index in range(10, 15):
        content = truth[index].content
        truth[index] = replace(truth[index], content=content | {"pose": content["pose"] | LOST[kind]})
    recording = read(tmp_path, few_images(20) + poses() + truth, object_poses="/object")
    after = (image_times(20) - START) / 2e7  # poses come every 20 ms
    known = ~np.isnan(recording.object_pose[:, 0])
    assert known.tolist() == [not 9 < number < 15 for number in after]
    same_poses(recording.object_pose[known], true_pose(image_times(20))[known])
    if "orientation" in LOST[kind]:
        lost = [replace(each, topic="/ee_pose") for each in truth[10:15]]
        with pytest.raises(FileError, match=r"/ee_pose: (none of 5 poses is known|pose 0 at .* length 1)"):
            read(tmp_path / "all", few_images() + lost)


def test_transforms_that_nobody_uses_may_contradict_each_other(tmp_path):
    unused = still("oak left", "right left")
    assert len(read(tmp_path, few_images() + poses() + unused, sensor_poses="/ee_pose")) == 6
    arm = [transform_message(time, "base", "gel", [0, 0, 0], LEVEL) for time in pose_times()]
    above = still("map base", "odom base")
    assert len(read(tmp_path / "above", few_images() + arm + above, sensor_poses="base:gel")) == 6


@pytest.mark.parametrize("container", CONTAINERS)
def test_times_of_recording_that_are_all_equal(tmp_path, container):
    messages = [replace(message, log_time=0) for message in few_images() + poses()]
    recording = read(tmp_path, messages, container)
    assert recording.time.tolist() == (image_times(6) / 1e9).tolist()
    with pytest.raises(FileError, match=r"6 messages in /digit/image/compressed have only 1 different times of record"):
        read(tmp_path / "log", messages, container, clock="log")
    unstamped = restamped(messages, lambda time: 0)
    with pytest.raises(FileError, match=r"have only 1 different header stamps$"):
        read(tmp_path / "none", unstamped)


@pytest.mark.parametrize(("label", "order"), [("yuv422", "YUYV"), ("yuv422_yuy2", "UYVY")])
def test_images_in_yuv_of_the_other_order_are_told_and_read_as_they_are(tmp_path, caplog, label, order):
    pixels = touch_images(1)[0]
    data = cv2.cvtColor(pixels, getattr(cv2, f"COLOR_RGB2YUV_{order}"))
    images = [as_encoding(image_message(time, pixels), label, data) for time in image_times(3)]
    recording = read(tmp_path, images + poses())
    assert np.median(np.abs(recording[0].image.astype(int) - pixels)) < 5
    assert f"/digit/image_raw: images are labelled '{label}'" in caplog.text
    assert [label in warning for warning in recording.warnings] == [True]


def test_warnings_of_an_import_belong_to_the_recording(tmp_path):
    upside_down = lifted(lambda seconds: 0.1, Rotation.from_euler("x", np.pi))
    recording = read(tmp_path, few_images(24) + set_clock(upside_down, 3600.0, 1))
    write_recording(recording, tmp_path / "kept.mcap")
    kept = load_recording(tmp_path / "kept.mcap").warnings
    assert kept == recording.warnings and len(kept) == 2
    assert "z axis points against" in kept[1] and "header stamps" in kept[0]


@pytest.mark.parametrize("first_bytes", [b"\x28\xb5\x2f\xfd", b"BZh9", b"\xfd7zXZ\x00"])
def test_a_file_that_is_compressed_is_told(tmp_path, first_bytes):
    path = tmp_path / "push_0.mcap.zstd"
    path.write_bytes(first_bytes + bytes(40))
    with pytest.raises(FileError, match=r"push_0\.mcap\.zstd: is compressed by"):
        read_bag(path, SHAPE)
    with pytest.raises(FileError, match="is compressed by"):
        load_recording(path)


STAMPS = pose_times()


def still_at(time: int, x: float) -> Message:
    return transform_message(time, "tool", "digit", [x, 0.0, 0.0], LEVEL, static=True)


def moving() -> list[Message]:
    """The sensor's poses as transforms from base to tool."""
    pairs = zip(STAMPS, true_pose(STAMPS), strict=True)
    return [
        transform_message(time, "base", "tool", [*pose[:2], 0.1], Rotation.from_euler("z", pose[2]))
        for time, pose in pairs
    ]


def test_a_static_transform_that_was_sent_again_with_another_value_is_refused(tmp_path):
    same = [still_at(START, 0.0), still_at(STAMPS[20], 1e-6)]  # rounding is no change
    same_poses(read(tmp_path / "same", few_images() + moving() + same).sensor_pose, true_pose(image_times(6)), 2e-6)
    changed = [still_at(START, 0.0), still_at(STAMPS[20], 0.044)]
    with pytest.raises(FileError, match=r"transforms of digit .* 1700000000\.401 s .* 44\.0 mm .* two recordings"):
        read(tmp_path / "other", few_images() + moving() + changed)


STRANGE = [
    ("odom", "tool", "'odom'"),  # a second parent
    ("", "tool", ""),
    ("base", "", ""),
    ("tool", "tool", ""),
]


@pytest.mark.parametrize(("parent", "child", "words"), STRANGE)
def test_one_transform_that_tf_would_not_take_costs_itself(tmp_path, caplog, parent, child, words):
    stranger = transform_message(STAMPS[8], parent, child, [3.0, 0.0, 0.0], LEVEL)
    recording = read(tmp_path, few_images() + moving() + [stranger])
    same_poses(recording.sensor_pose, true_pose(image_times(6)))
    assert words in caplog.text and bool(caplog.records) == bool(words)


def test_what_keeps_transforms_from_being_a_chain_is_named(tmp_path):
    halves = [message for number, message in enumerate(moving()) if number < 40]
    halves += [transform_message(time, "odom", "tool", [0, 0, 0], LEVEL) for time in STAMPS[40:]]
    with pytest.raises(FileError, match="frame tool has several parents, base and odom"):
        read(tmp_path / "parents", few_images() + halves)
    back = transform_message(START, "tool", "base", [0, 0, 0], LEVEL)
    with pytest.raises(FileError, match="transforms run in a circle"):
        read(tmp_path / "circle", few_images() + moving() + [back])


@pytest.mark.parametrize("frame", ["", "map"])
def test_one_pose_in_another_frame_costs_itself(tmp_path, caplog, frame):
    given = poses()
    given[3] = pose_message(STAMPS[3], [5.0, 5.0, 0.0], frame=frame)
    same_poses(read(tmp_path, few_images() + given).sensor_pose, true_pose(image_times(6)))
    assert f"1 of 68 poses are given in frame {frame!r}" in caplog.text


@pytest.mark.parametrize("number", [np.nan, 0.0])
def test_truth_that_is_never_known_is_missing_and_told(tmp_path, caplog, number):
    nothing = {"position": dict.fromkeys("xyz", number), "orientation": dict.fromkeys("xyzw", number)}
    truth = [replace(each, topic="/object", content=each.content | {"pose": nothing}) for each in poses()]
    recording = read(tmp_path, few_images() + poses() + truth, object_poses="/object")
    assert recording.object_pose is None and len(recording) == 6
    assert sum("there is no ground truth" in record.getMessage() for record in caplog.records) == 1


@pytest.mark.parametrize("container", CONTAINERS)
@pytest.mark.parametrize("pace", [0.01, 2.0])
def test_times_of_recording_that_a_converter_wrote_do_not_count(tmp_path, caplog, container, pace):
    """A script that writes topic by topic, with the time at which it does; and a bag that was played slowly."""
    messages = few_images() + poses()
    if pace > 1.0:
        later = [replace(each, log_time=int(START + 1e15 + pace * (each.log_time - START))) for each in messages]
    else:
        later = [replace(each, log_time=START + 10**15 + 200_000 * k) for k, each in enumerate(messages)]
    recording = read(tmp_path, later, container)
    assert recording.time.tolist() == (image_times(6) / 1e9).tolist()
    same_poses(recording.sensor_pose, true_pose(image_times(6)))
    assert "header stamps count" in caplog.text


def test_poses_that_were_sent_again_are_no_doubt_about_their_stamps(tmp_path):
    again = [replace(each, log_time=each.log_time + 5_000_000 * k) for each in poses() for k in range(3)]
    same_poses(read(tmp_path, few_images() + again).sensor_pose, true_pose(image_times(6)))


def set_back(messages: list[Message]) -> list[Message]:
    """The messages of a machine whose clock was set back by half a second."""
    late = [restamped([each], lambda time: time - 5 * 10**8)[0] for each in messages]
    late = [replace(each, log_time=each.log_time - 5 * 10**8) for each in late]
    limit = START + 6 * 10**8
    return [back if each.log_time > limit else each for each, back in zip(messages, late, strict=True)]


UPTIME = 10**15  # [ns]


@pytest.mark.parametrize(
    ("images", "given", "words"),
    [
        (
            lambda time: int(float(np.float32((time - START + UPTIME) * 1e-9)) * 1e9),
            lambda time: time - START + UPTIME,
            "float32",
        ),
        (lambda time: time // 10**9 * 10**9 + time % 10**9 // 1000, lambda time: time, "another unit"),
        (lambda time: time + 7200 * 10**9, lambda time: time, "time zone"),
        (lambda time: time - START + 10**12, lambda time: time, "start of a machine"),
    ],
)
def test_why_stamps_do_not_go_together_is_named(tmp_path, images, given, words):
    with pytest.raises(FileError, match=f"{words}.*--clock log"):
        read(tmp_path, restamped(few_images(20), images) + restamped(poses(), given))


def test_stamps_that_are_apart_by_less_than_a_second_are_told(tmp_path, caplog):
    read(tmp_path, restamped(few_images(6), lambda time: time + 4 * 10**8) + poses())
    assert "clocks differ: --time-offset" in caplog.text


def test_two_poses_at_many_times_are_two_takes(tmp_path):
    with pytest.raises(FileError, match=r"/ee_pose: .* two takes .* set back"):
        read(tmp_path, few_images(20) + set_back(poses()))
