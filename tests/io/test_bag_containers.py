"""Containers of bags: what is in them, what is left of them when their recorder was killed, and what is no bag."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bag_samples import CONTAINERS, ROS2, Message, build_message, pose_message, pose_times, push_messages, write_bag
from mcap.writer import CompressionType, Writer
from rosbags import rosbag2

from palpate import Disc, FileError, load_recording, read_bag


@pytest.fixture
def topics(run_palpate):
    """Return the topics of a bag by name as `palpate info` shows them."""

    def found(path: Path) -> dict[str, dict[str, Any]]:
        code, out, err = run_palpate("info", path, "--json")
        assert code == 0, err
        return {topic["topic"]: topic for topic in json.loads(out)["topics"]}

    return found


COUNTS = {"/chatter": 1, "/digit/image/compressed": 24, "/ee_pose": 68}


def counts(found: dict[str, dict[str, Any]]) -> dict[str, int]:
    return {name: topic["messages"] for name, topic in found.items()}


@pytest.mark.parametrize("container", CONTAINERS)
def test_topics_of_a_bag_that_another_program_wrote(tmp_path, container, topics):
    found = topics(write_bag(tmp_path / "bag", container, push_messages()))
    assert counts(found) == COUNTS
    chatter, images, poses = found.values()
    assert images["type"] == "sensor_msgs/msg/CompressedImage" and poses["type"] == "geometry_msgs/msg/PoseStamped"
    assert (chatter["rate_hz"], chatter["longest_gap_s"], chatter["clock_offset_s"]) == (None, None, None)
    assert (images["rate_hz"], poses["rate_hz"]) == (pytest.approx(30.0), pytest.approx(50.0))
    assert images["clock_offset_s"] == pytest.approx(-0.003) and images["unstamped"] == 0
    assert images["clock_spread_s"] == pytest.approx(0.0, abs=1e-9)


def test_the_longest_gap_late_stamps_and_missing_stamps_are_shown(tmp_path, topics):
    times = np.delete(pose_times(40), [10, 11, 12, 30, 31, 32, 33])
    messages = [pose_message(time, [0.0, 0.0, 0.0]) for time in times]
    messages[3] = Message("/ee_pose", messages[3].log_time, messages[3].type, pose_message(0, [0, 0, 0]).content)
    topic = topics(write_bag(tmp_path / "bag", "mcap", messages))["/ee_pose"]
    assert (topic["longest_gap_s"], topic["unstamped"]) == (pytest.approx(0.1), 1)
    assert topic["clock_spread_s"] < 1.0  # a stamp of 0 is none, and costs that message alone


@pytest.mark.parametrize(
    ("container", "mode"),
    [("mcap", "STORAGE"), ("mcap", "MESSAGE"), ("mcap", "FILE"), ("ros2", "MESSAGE"), ("ros2", "FILE")],
)
def test_compressed_folders(tmp_path, container, mode, topics):
    compression = rosbag2.CompressionMode[mode], rosbag2.CompressionFormat.ZSTD
    write_bag(tmp_path / "bag", container, push_messages(), set_compression=compression)
    assert counts(topics(tmp_path / "bag")) == COUNTS
    if mode == "MESSAGE":
        (alone,) = {*(tmp_path / "bag").iterdir()} - {tmp_path / "bag" / "metadata.yaml"}
        with pytest.raises(FileError, match=r"compressed .* give the folder"):
            read_bag(alone, Disc(0.05))


def test_a_database_without_its_folder(tmp_path, topics):
    folder = write_bag(tmp_path / "bag", "ros2", push_messages())
    (database,) = folder.glob("*.db3")
    assert counts(topics(database)) == COUNTS
    (folder / "metadata.yaml").unlink()
    with pytest.raises(
        FileError, match=r"without metadata.yaml; give recordings themselves, as .*bag\.db3, or run `ros2 bag reindex`"
    ):
        read_bag(folder, Disc(0.05))


def write_poses(path: Path, encoding: str = "cdr", count: int = 60, data: bytes | None = None, **settings: Any) -> None:
    type_ = "geometry_msgs/msg/PoseStamped"
    with path.open("wb") as file:
        writer = Writer(file, **settings)
        writer.start("ros2")
        schema = writer.register_schema(type_, "ros2msg", ROS2.generate_msgdef(type_, ros_version=2)[0].encode())
        channel = writer.register_channel("/ee_pose", encoding, schema)
        for time in pose_times(count).tolist():
            message = pose_message(time, [0.1, 0.2, 0.3])
            packed = bytes(ROS2.serialize_cdr(build_message(ROS2, type_, message.content), type_))
            writer.add_message(channel, time, data or packed, time)
        writer.finish()


@pytest.mark.parametrize(
    "settings",
    [{"compression": kind, "chunk_size": 500} for kind in CompressionType] + [{"use_chunking": False}],
)
def test_an_mcap_that_is_cut_off_is_read_to_its_last_whole_chunk(tmp_path, caplog, topics, settings):
    path, whole = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    write_poses(whole, **settings)
    content, seen = whole.read_bytes(), []
    for share in (0.3, 0.5, 0.7):
        path.write_bytes(content[: int(share * len(content))])
        caplog.clear()
        seen.append(counts(topics(path))["/ee_pose"])
        (line,) = [record.getMessage() for record in caplog.records]
        assert line.startswith(f"{path}: is cut off or damaged after ")
        assert line.endswith(
            f"as when its recorder was killed or still writes it; the {seen[-1]} messages before that are read"
        )
    assert 0 < seen[0] < seen[1] < seen[2] <= 60
    path.write_bytes(content[:50])
    with pytest.raises(
        FileError, match=r"cut.mcap: is cut off or damaged after \d+ bytes, .*; there is no message before"
    ):
        read_bag(path, Disc(0.05))


def test_a_damaged_chunk_ends_a_bag(tmp_path, topics):
    path = tmp_path / "bag.mcap"
    write_poses(path, chunk_size=500, compression=CompressionType.NONE)
    content = bytearray(path.read_bytes())
    content[[found.start() for found in re.finditer(b"world", content)][20]] ^= 255
    path.write_bytes(content)
    assert 0 < counts(topics(path))["/ee_pose"] < 60


def test_a_bag_that_lacks_its_index_is_named_with_the_tool(tmp_path):
    path = write_bag(tmp_path / "bag", "ros1", push_messages())
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(FileError, match=r"cannot be read \(.*\); `rosbag reindex` may repair it"):
        read_bag(path, Disc(0.05))


def test_channels_that_are_no_ros_messages_are_listed_with_their_encoding(tmp_path, topics):
    path = tmp_path / "bag.mcap"
    write_poses(path, encoding="protobuf", count=1)
    assert topics(path)["/ee_pose"]["encoding"] == "protobuf"
    with pytest.raises(FileError, match="has no image topic; there are none of a type that is read"):
        read_bag(path, Disc(0.05))


def test_messages_that_do_not_decode_are_counted(tmp_path, topics):
    write_poses(tmp_path / "bag.mcap", data=b"\x00\x01\x00\x00rubbish")
    found = topics(tmp_path / "bag.mcap")["/ee_pose"]
    assert found["damaged"] == found["messages"] == 60


def test_what_is_no_bag(tmp_path):
    (tmp_path / "a.bag").write_bytes(b"something else")
    with pytest.raises(FileError, match="is no bag; known are MCAP"):
        read_bag(tmp_path / "a.bag", Disc(0.05))


@pytest.mark.parametrize(("suffix", "first"), [("wal", b"1"), ("journal", bytes.fromhex("d9d505f920a163d7"))])
def test_what_a_database_has_beside_it_is_named(tmp_path, suffix, first):
    folder = write_bag(tmp_path / "bag", "ros2", push_messages())
    (database,) = folder.glob("*.db3")
    database.with_name(f"{database.name}-journal").write_bytes(bytes(8))  # of a write that was completed
    assert len(read_bag(folder, Disc(0.05)).recording) == 24
    database.with_name(f"{database.name}-{suffix}").write_bytes(first)
    for path in (folder, database):
        with pytest.raises(FileError, match=rf"bag\.db3: bag\.db3-{suffix} beside it holds .* journal_mode"):
            read_bag(path, Disc(0.05))


def test_a_database_under_another_name(tmp_path):
    folder = write_bag(tmp_path / "bag", "ros2", push_messages())
    (database,) = folder.glob("*.db3")
    link = tmp_path / "link.db3"
    link.symlink_to(database)
    (tmp_path / "link.db3-wal").write_bytes(b"1")  # is beside the link, not the database
    assert len(read_bag(link, Disc(0.05)).recording) == 24
    database.with_name("bag.db3-wal").write_bytes(b"1")
    with pytest.raises(FileError, match="db3-wal beside it holds"):
        read_bag(link, Disc(0.05))
    other = (tmp_path / "push.sqlite3").resolve()
    other.write_bytes(database.read_bytes())
    with pytest.raises(FileError, match=r"suffix '\.sqlite3', allowed is \.db3"):
        read_bag(other, Disc(0.05))


def test_folders_that_are_no_bags(tmp_path):
    (tmp_path / "frame_1.png").write_bytes(b"png")
    with pytest.raises(FileError, match=r"is a folder without .*palpate info"):
        load_recording(tmp_path)
    (tmp_path / "a.mcap").write_bytes(b"mcap")
    with pytest.raises(FileError, match=r"give recordings themselves, as .*a\.mcap"):
        load_recording(tmp_path)


def test_files_that_metadata_do_not_list_are_named(tmp_path):
    folder = write_bag(tmp_path / "bag", "ros2", push_messages())
    (database,) = folder.glob("*.db3")
    (folder / "bag.db3-shm").write_bytes(b"")
    (folder / "._bag.db3").write_bytes(b"of another file system")
    assert len(read_bag(folder, Disc(0.05)).recording) == 24
    (folder / "bag_1.db3").write_bytes(database.read_bytes())
    with pytest.raises(FileError, match=r"bag_1\.db3 is not in its metadata.yaml, .*`ros2 bag reindex`"):
        read_bag(folder, Disc(0.05))
    (folder / "bag_1.db3").unlink()
    database.unlink()
    (folder / "bag.db3-shm").unlink()
    with pytest.raises(FileError, match=r"is a folder without .db3 or .mcap; were they moved\?"):
        read_bag(folder, Disc(0.05))


def test_a_git_lfs_pointer_is_named(tmp_path):
    pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:0123\nsize 1627389\n"
    folder = write_bag(tmp_path / "bag", "ros2", push_messages())
    next(folder.glob("*.db3")).write_text(pointer)
    (tmp_path / "push.mcap").write_text(pointer)
    for path in (folder, tmp_path / "push.mcap"):
        with pytest.raises(FileError, match="is a Git LFS pointer in place of the file; `git lfs pull` gets the file"):
            load_recording(path)


AT_ONCE = {"sec": 0, "nsec": 0}
BEST_EFFORT = {
    "history": "keep_last",
    "depth": 10,
    "reliability": "best_effort",
    "durability": "volatile",
    "deadline": AT_ONCE,
    "lifespan": AT_ONCE,
    "liveliness": "automatic",
    "liveliness_lease_duration": AT_ONCE,
    "avoid_ros_namespace_conventions": False,
}


@pytest.mark.parametrize("qos", ["- history: 99", "garbage: [", "best effort"])
def test_qos_that_the_library_does_not_take_leaves_the_file_itself(tmp_path, topics, qos):
    """Also where metadata.yaml was edited, so that it differs from its file: the library then gives no messages."""
    file = write_bag(tmp_path / "bag", "mcap", push_messages())
    path = file.with_name("metadata.yaml")
    content = yaml.safe_load(path.read_text())
    edited = yaml.safe_dump([BEST_EFFORT]) if qos == "best effort" else qos
    for topic in content["rosbag2_bagfile_information"]["topics_with_message_count"]:
        topic["topic_metadata"]["offered_qos_profiles"] = edited
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(FileError, match=re.escape(f"give its file itself, as {file}")):
        read_bag(path.parent, Disc(0.05))
    assert counts(topics(file)) == COUNTS


def test_a_database_that_was_cut_off_is_named_with_the_tool(tmp_path):
    folder = write_bag(tmp_path / "bag", "ros2", push_messages())
    (database,) = folder.glob("*.db3")
    database.write_bytes(database.read_bytes()[: database.stat().st_size // 2])
    for path in (folder, database):
        with pytest.raises(FileError, match=re.escape(f"`sqlite3 {database} .recover | sqlite3 ")):
            read_bag(path, Disc(0.05))
