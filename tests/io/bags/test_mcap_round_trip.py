"""What palpate writes as MCAP comes back to the last bit, and other programs read it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from recording_samples import TINY_CAMERA, pushed, tiny_images, tiny_recording, trajectory
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from palpate import io as formats
from palpate.errors import FileError
from palpate.geometry import se2
from palpate.io.bags import live_mcap
from palpate.io.bags.bag_recording import read_bag
from palpate.io.bags.choices import BagChoices
from palpate.io.bags.estimates_mcap import write_estimates_mcap
from palpate.io.bags.mcap_writer import new_mcap
from palpate.io.palpate_h5 import recording_to_bytes, write_recording
from palpate.types.answer import Answer
from palpate.types.images import encode_image
from palpate.types.plane import flat, out_of_plane, plane_across, spatial_covariance
from palpate.types.sensor import DIGIT
from palpate.types.trajectory import Trajectory

ARRAYS = ("time", "sensor_pose", "object_pose", "contact", "episode")


def odd_recording(n: int = 12, **changes: Any) -> Any:
    """Times and poses that no stamp and no quaternion holds."""
    rng = np.random.default_rng(8)
    truth = rng.normal(size=(n, 3)) * [1, 1, 4]
    truth[3] = np.nan
    fields: dict[str, Any] = {
        "time": 1.7e9 + np.cumsum(rng.uniform(0.01, 0.05, n)),
        "sensor_pose": rng.normal(size=(n, 3)) * [1, 1, 7],
        "object_pose": truth,
        "extra": {"force": rng.normal(size=(n, 2)), "knocked": np.arange(n) == 4},
    }
    return tiny_recording(n, **(fields | changes))


def same(found: Any, wanted: Any, count: int | None = None) -> None:
    """Whether the first frames of two recordings are the same to the last bit."""
    for name in ARRAYS:
        one, other = getattr(found, name), getattr(wanted, name)
        assert (one is None) == (other is None), name
        assert one is None or one.tobytes() == other[:count].tobytes(), name
    assert found.image == (None if wanted.image is None else wanted.image[:count])
    for name in ("shape", "sensor", "codec", "contact_derived", "source", "frames"):
        assert getattr(found, name) == getattr(wanted, name), name
    assert found.extra.keys() == wanted.extra.keys()
    assert all(found.extra[name].tobytes() == wanted.extra[name][:count].tobytes() for name in wanted.extra)


JPEG = {"codec": "jpeg", "image": tuple(encode_image(image) for image in tiny_images(12))}


@pytest.mark.parametrize(
    "changes",
    [
        {},
        JPEG,
        {"image": None, "codec": "jpeg"},
        {"object_pose": None, "contact": None, "episode": None, "extra": {}, "contact_derived": False},
    ],
)
def test_recording_to_mcap_and_back(tmp_path, changes):
    recording = odd_recording(**changes)
    write_recording(recording, tmp_path / "a.h5")
    formats.write(formats.read(tmp_path / "a.h5"), tmp_path / "b.mcap")
    assert formats.detect_format(tmp_path / "b.mcap") == "bag"
    back: Any = formats.read(tmp_path / "b.mcap")
    same(back, recording)
    formats.write(back, tmp_path / "c.h5")
    assert (tmp_path / "c.h5").read_bytes() == (tmp_path / "a.h5").read_bytes()


def test_estimates_to_mcap_and_back(tmp_path):
    root = trajectory()
    for name, made in {
        "all": root,
        "bare": Trajectory(root.time, root.pose),
        "status": Trajectory(root.time, root.pose, status=root.status),
    }.items():
        path = tmp_path / f"{name}.mcap"
        formats.write(made, path)
        found: Any = formats.read(path)
        assert found.time.tobytes() == made.time.tobytes()
        assert found.pose.tobytes() == made.pose.tobytes()
        assert found.status == made.status
        if made.covariance is None:
            assert found.covariance is None
        else:
            assert np.array_equal(found.covariance, made.covariance)
            assert np.array_equal(found.contact, made.contact)
    with pytest.raises(FileError, match="holds a trajectory, not a recording"):
        formats.load_recording(tmp_path / "all.mcap")


def decoded_by_others(path: Any) -> list[dict[str, list[Any]]]:
    """All messages by topic as `rosbags` and as `mcap-ros2-support` decode them."""
    by_rosbags: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            by_rosbags.setdefault(connection.topic, []).append((time, message))
    by_mcap: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        for _, channel, raw, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            by_mcap.setdefault(channel.topic, []).append((raw.log_time, message))
    return [by_rosbags, by_mcap]


def planar(pose: Any) -> list[float]:
    q = pose.orientation
    return [pose.position.x, pose.position.y, float(Rotation.from_quat([q.x, q.y, q.z, q.w]).as_euler("zyx")[0])]


def stamp(message: Any) -> float:
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def test_others_read_our_recordings(tmp_path):
    recording = odd_recording()
    formats.write(recording, tmp_path / "a.mcap")
    for found in decoded_by_others(tmp_path / "a.mcap"):
        assert set(found) == {"/sensor/pose", "/object/pose", "/sensor/image/compressed"}
        for (time, message), wanted, image in zip(
            found["/sensor/pose"], recording.sensor_pose, found["/sensor/image/compressed"], strict=True
        ):
            assert message.header.frame_id == "world"
            assert planar(message.pose) == pytest.approx([*wanted[:2], se2.wrap(wanted[2])], abs=1e-12)
            assert image[0] == time
        sent = [stamp(message) for _, message in found["/sensor/pose"]]
        assert sent == pytest.approx(recording.time.tolist(), abs=5e-7)  # a double at 1.7e9 s has steps of 2.4e-7
        assert len(found["/object/pose"]) == len(recording) - 1
        for (_, message), data in zip(found["/sensor/image/compressed"], recording.image, strict=True):
            assert (bytes(message.data), message.format) == (data, "png")


def test_our_messages_say_what_our_attachment_says(tmp_path):
    recording = odd_recording(time=np.arange(12) / 30)
    formats.write(recording, tmp_path / "a.mcap")
    choices = BagChoices(sensor_poses="/sensor/pose", object_poses="/object/pose")
    found = read_bag(tmp_path / "a.mcap", recording.shape, choices, TINY_CAMERA).recording
    assert found.time == pytest.approx(recording.time, abs=1e-9)
    assert found.image == recording.image
    off = se2.between(found.sensor_pose, recording.sensor_pose)
    assert off == pytest.approx(0.0, abs=1e-9)
    assert found.object_pose is not None
    assert np.isnan(found.object_pose[:, 0]).tolist() == [False] * 12  # between two known ones nothing is missing here
    known = np.arange(12) != 3
    assert se2.between(found.object_pose[known], recording.object_pose[known]) == pytest.approx(0.0, abs=1e-9)


def test_others_read_our_estimates(tmp_path):
    made = trajectory(status=("tracking", "ambiguous", "indeterminate", *["resting"] * 47))
    plane = plane_across("table", np.array([0.1, -0.2, 1.0]), np.array([[0.0, 0.0, 0.3]]))
    write_estimates_mcap(made, tmp_path / "a.mcap", plane=plane)
    position, rotation = out_of_plane(plane, made.pose)
    for found in decoded_by_others(tmp_path / "a.mcap"):
        poses = found["/palpate/object_pose"]
        both = found["/palpate/object_pose_with_covariance"]
        diagnostics = found["/palpate/diagnostics"]
        wanted = spatial_covariance(plane, made.pose, made.covariance)
        for index in range(len(made)):
            (_, message), (_, with_covariance) = poses[index], both[index]
            assert message.header.frame_id == with_covariance.header.frame_id == "table"
            for pose in (message.pose, with_covariance.pose.pose):
                point, turn = pose.position, pose.orientation
                assert [point.x, point.y, point.z] == pytest.approx(position[index].tolist())
                assert abs(np.dot([turn.x, turn.y, turn.z, turn.w], rotation[index])) == pytest.approx(1.0)
            assert np.array_equal(np.reshape(with_covariance.pose.covariance, (6, 6)), wanted[index])
        levels = [message.status[0].level for _, message in diagnostics]
        assert [int.from_bytes(level, "little") if isinstance(level, bytes) else level for level in levels[:4]] == [
            0,
            1,
            2,
            0,
        ]
        assert diagnostics[1][1].status[0].message == "ambiguous"
        values = {value.key: value.value for value in diagnostics[0][1].status[0].values}
        assert values["contact"] == str(bool(made.contact[0])).lower()
        assert values["sigma yaw [deg]"] == f"{np.degrees(np.sqrt(made.covariance[0, 2, 2])):.2f}"


def test_others_read_all_answers(tmp_path):
    """In a slanting plane: three at the second time; at the others the estimate is the only one."""
    made = trajectory(3, status=("tracking", "ambiguous", "resting"))
    rng = np.random.default_rng(2)
    poses, roots = rng.normal(size=(2, 3)), rng.normal(size=(2, 3, 3)) / 100.0
    others = [Answer(pose, root @ root.T, weight) for pose, root, weight in zip(poses, roots, (0.3, 0.1), strict=True)]
    several = (Answer(made.pose[1], made.covariance[1], 0.6), *others)
    plane = plane_across("table", np.array([0.1, -0.2, 1.0]), np.array([[0.0, 0.0, 0.3]]))
    write_estimates_mcap(made, tmp_path / "a.mcap", plane=plane, answers=((), several, ()))
    wanted = [made.pose[:1], np.array([one.pose for one in several]), made.pose[2:]]
    for found in decoded_by_others(tmp_path / "a.mcap"):
        for index, ((_, array), (_, diagnosis)) in enumerate(
            zip(found["/palpate/object_pose_answers"], found["/palpate/diagnostics"], strict=True)
        ):
            assert stamp(array) == stamp(diagnosis) == pytest.approx(made.time[index], abs=1e-9)
            assert array.header.frame_id == "table"
            position, rotation = out_of_plane(plane, wanted[index])
            for n, pose in enumerate(array.poses):
                point, turn = pose.position, pose.orientation
                assert [point.x, point.y, point.z] == pytest.approx(position[n].tolist())
                assert abs(np.dot([turn.x, turn.y, turn.z, turn.w], rotation[n])) == pytest.approx(1.0)
            values = {value.key: value.value for value in diagnosis.status[0].values}
            weights = [float(word) for word in values["answer weights"].split()]
            assert weights == ([0.6, 0.3, 0.1] if index == 1 else [1.0])
            assert len(array.poses) == len(weights)
            sigmas = [float(word) for word in values["answer sigmas x [mm]"].split()]
            stated = [one.covariance for one in several] if index == 1 else made.covariance[index : index + 1]
            assert sigmas == pytest.approx([1e3 * np.sqrt(one[0, 0]) for one in stated], abs=5e-3)
    back: Any = formats.read(tmp_path / "a.mcap")
    assert back.pose.tobytes() == made.pose.tobytes() and back.status == made.status


def test_where_answers_are_not_known_none_are_told(tmp_path):
    """So are files of versions before."""
    formats.write(trajectory(2), tmp_path / "a.mcap")
    found, _ = decoded_by_others(tmp_path / "a.mcap")
    assert "/palpate/object_pose_answers" not in found
    values = [value.key for value in found["/palpate/diagnostics"][0][1].status[0].values]
    assert values == ["contact", "sigma x [mm]", "sigma y [mm]", "sigma yaw [deg]"]
    formats.read(tmp_path / "a.mcap")


def test_covariance_is_turned_to_the_axes_of_the_header():
    """Against the poses themselves, each moved a little along each axis of the object."""
    made = trajectory(6)
    for plane in (flat(), plane_across("map", np.array([1.0, 0.4, -0.5]), np.zeros((1, 3)))):
        position, rotation = out_of_plane(plane, made.pose)
        step = 1e-6
        derivative = np.empty((6, 6, 3))
        for axis in range(3):
            moved, turned = out_of_plane(plane, se2.compose(made.pose, se2.exp(step * np.eye(3)[axis])[None]))
            derivative[:, :3, axis] = (moved - position) / step
            turn = Rotation.from_quat(turned) * Rotation.from_quat(rotation).inv()
            derivative[:, 3:, axis] = turn.as_rotvec() / step
        wanted = derivative @ made.covariance @ derivative.transpose(0, 2, 1)
        assert spatial_covariance(plane, made.pose, made.covariance) == pytest.approx(wanted, abs=1e-4)
    level = spatial_covariance(flat(), np.array([[0.0, 0.0, np.pi / 2]]), np.diag([1.0, 4.0, 9.0])[None])
    assert level[0] == pytest.approx(np.diag([4.0, 1.0, 0.0, 0.0, 0.0, 9.0]))


def test_a_recording_whose_writing_was_cut_off(tmp_path, caplog):
    """Its frames up to the cut are there; images are random, so chunks hold few of them."""
    rng = np.random.default_rng(0)
    images = tuple(rng.integers(0, 256, 30_000, np.uint8).tobytes() for _ in range(120))
    recording = odd_recording(120, image=images)
    formats.write(recording, tmp_path / "a.mcap")
    content = (tmp_path / "a.mcap").read_bytes()
    path = tmp_path / "cut.mcap"
    lengths = []
    for cut in (0.4, 0.7, 0.95):
        path.write_bytes(content[: int(cut * len(content))])
        found: Any = formats.read(path)
        lengths.append(len(found))
        same(found, recording, len(found))
    assert 30 < lengths[0] < lengths[1] < lengths[2] < 120
    assert f"the {lengths[2]} frames before it are read" in caplog.text


IMAGE_TOPIC, IMAGE_TYPE = "/sensor/image/compressed", "sensor_msgs/msg/CompressedImage"
POSE_TYPE = "geometry_msgs/msg/PoseStamped"
COVARIANCE_TYPE = "geometry_msgs/msg/PoseWithCovarianceStamped"


def own_mcap(path: Any, attachment: tuple[str, str, bytes], truth: Any = None, image_type: str = IMAGE_TYPE) -> Any:
    """An MCAP as palpate's own of three frames, with messages that are none of its own."""
    image = np.frombuffer(encode_image(np.zeros((320, 240, 3), np.uint8)), np.uint8)
    with new_mcap(path) as file:
        file.attach(*attachment)
        for stamp in (10**9, 2 * 10**9, 3 * 10**9):
            header, pose = file.header(stamp, "world"), file.pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
            if image_type == IMAGE_TYPE:
                file.add(IMAGE_TOPIC, IMAGE_TYPE, stamp, header=header, format="jpeg", data=image)
            else:
                file.add(IMAGE_TOPIC, image_type, stamp, header=header, pose=pose)
            file.add("/sensor/pose", POSE_TYPE, stamp, header=header, pose=pose)
            if truth is not None:
                truth(file, stamp, header)
    return path


def test_messages_of_an_unexpected_type_are_named_in_our_own_files(tmp_path):
    bare = tiny_recording(3, image=None, codec="jpeg")
    attachment = ("palpate-recording.h5", "application/x-hdf5", recording_to_bytes(bare))
    with pytest.raises(FileError, match=rf"a\.mcap: {IMAGE_TOPIC} holds {POSE_TYPE}, expected {IMAGE_TYPE}"):
        formats.read(own_mcap(tmp_path / "a.mcap", attachment, image_type=POSE_TYPE))
    attachment = (live_mcap.ATTACHMENT, "application/json", live_mcap.live_attachment(bare.shape, DIGIT))

    def other(file: Any, stamp: int, header: Any) -> None:
        pose = file.pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
        file.add("/object/pose", POSE_TYPE, stamp, header=header, pose=pose)

    with pytest.raises(FileError, match=rf"b\.mcap: /object/pose holds {POSE_TYPE}, expected {COVARIANCE_TYPE}"):
        formats.read(own_mcap(tmp_path / "b.mcap", attachment, other))

    def zero(file: Any, stamp: int, header: Any) -> None:
        pose = file.pose(np.zeros(3), np.zeros(4))
        told = file.make(COVARIANCE_TYPE.replace("Stamped", ""), pose=pose, covariance=np.eye(6).ravel())
        file.add("/object/pose", COVARIANCE_TYPE, stamp, header=header, pose=told)

    with pytest.raises(FileError, match=r"c\.mcap: /object/pose: pose 0 at 1\.0+ s is .*a quaternion of length 1"):
        formats.read(own_mcap(tmp_path / "c.mcap", attachment, zero))


def test_times_that_are_no_stamps(tmp_path):
    for time, words in ((-0.5, r"frame 0 is at -0\.5 s"), (3e9, r"frame 0 is at 3e\+09 s")):
        with pytest.raises(FileError, match=rf"a\.mcap: {words}, stamps of ROS messages go from 0"):
            formats.write(replace(pushed(), time=time + np.arange(40)), tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []
    formats.write(pushed(), tmp_path / "a.mcap")
    with pytest.raises(FileError, match="already exists"):
        formats.write(pushed(), tmp_path / "a.mcap")


def test_what_formats_cannot_hold_is_named(tmp_path):
    recording = odd_recording()
    for name in ("a.h5", "a.mcap"):
        assert formats.lost(recording, tmp_path / name) == []
        assert formats.lost(trajectory(), tmp_path / "a.mcap") == []
    assert formats.lost(trajectory(), tmp_path / "a.csv") == []
    assert formats.lost(trajectory(), tmp_path / "a.tum") == ["covariances", "contact flags", "statuses"]
    assert formats.lost(Trajectory(np.arange(3.0), np.zeros((3, 3))), tmp_path / "a.tum") == []
    lost = formats.lost(recording, tmp_path / "a.tum")
    assert lost[1:4] == ["sensor poses", "outline and sensor", "images"]
    assert "images" in formats.lost(recording, tmp_path / "a.json")
