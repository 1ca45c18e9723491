"""Containers of bags: what is in them, what is left of them when their recorder was killed, and what is no bag."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from bag_samples import (
    CONTAINERS,
    ROS1,
    ROS2,
    START,
    Message,
    build_message,
    pose_message,
    pose_times,
    push_messages,
    true_pose,
    write_bag,
)
from mcap.writer import CompressionType, Writer
from rosbags import rosbag1, rosbag2

from palpate.errors import FileError, SettingError
from palpate.io.bags.containers import existing_bag, raw_messages
from palpate.io.bags.contents import contents
from palpate.io.bags.raw import CutShort

KINDS = {
    "zstd": {"compression": CompressionType.ZSTD, "chunk_size": 2000},
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": 2000},
    "plain": {"compression": CompressionType.NONE, "chunk_size": 2000},
    "unchunked": {"use_chunking": False},
}


def write_mcap(path: Path, count: int = 60, encoding: str = "cdr", **settings: Any) -> list[bytes]:
    """Write an MCAP of poses and return their bytes, no two of which are alike."""
    messages = []
    with path.open("wb") as file:
        writer = Writer(file, **settings)
        writer.start("ros2")
        text = ROS2.generate_msgdef("geometry_msgs/msg/PoseStamped", ros_version=2)[0].encode()
        schema = writer.register_schema("geometry_msgs/msg/PoseStamped", "ros2msg", text)
        channel = writer.register_channel("/ee_pose", encoding, schema)
        for index, time in enumerate(pose_times(count).tolist()):
            found = pose_message(time, true_pose([time])[0], height=0.1 + 1e-6 * index)
            messages.append(serialized(found))
            writer.add_message(channel, time, messages[-1], time)
        writer.finish()
    return messages


def serialized(message: Message) -> bytes:
    return bytes(ROS2.serialize_cdr(build_message(ROS2, message.type, message.content), message.type))


def read_all(path: Path) -> tuple[list[bytes], bool]:
    """The messages that can be read, and whether the bag ended too early."""
    found: list[bytes] = []
    try:
        for raw in raw_messages(path):
            found.append(raw.data)
    except CutShort:
        return found, True
    return found, False


@pytest.mark.parametrize("container", CONTAINERS)
def test_topics_of_a_bag_that_another_program_wrote(tmp_path, container):
    path = write_bag(tmp_path / "bag", container, push_messages())
    found = contents(path)
    assert not found.cut
    assert [(topic.channel.topic, topic.channel.type, topic.count) for topic in found.topics] == [
        ("/chatter", "std_msgs/msg/String", 1),
        ("/digit/image/compressed", "sensor_msgs/msg/CompressedImage", 24),
        ("/ee_pose", "geometry_msgs/msg/PoseStamped", 68),
    ]
    chatter, images, poses = found.topics
    assert (chatter.rate, chatter.longest_gap, chatter.clock_offset) == (None, None, None)
    assert (images.rate, poses.rate) == (pytest.approx(30.0), pytest.approx(50.0))
    assert (images.clock_offset, images.clock_spread) == (pytest.approx(-0.003), pytest.approx(0.0, abs=1e-9))
    assert (images.gaps, images.unstamped) == (0, 0)


def test_gaps_late_stamps_and_missing_stamps_are_counted(tmp_path):
    times = np.delete(pose_times(40), [10, 11, 12, 30, 31, 32, 33])
    messages = [pose_message(time, [0.0, 0.0, 0.0]) for time in times]
    messages[3] = Message("/ee_pose", messages[3].log_time, messages[3].type, pose_message(0, [0, 0, 0]).content)
    (topic,) = contents(write_bag(tmp_path / "bag", "mcap", messages)).topics
    assert (topic.gaps, topic.longest_gap, topic.unstamped) == (2, pytest.approx(0.1), 1)
    assert topic.clock_spread is not None and topic.clock_spread > 1e9


@pytest.mark.parametrize(
    ("container", "mode"),
    [("mcap", "STORAGE"), ("mcap", "MESSAGE"), ("mcap", "FILE"), ("ros2", "MESSAGE"), ("ros2", "FILE")],
)
def test_compressed_folders(tmp_path, container, mode):
    compression = rosbag2.CompressionMode[mode], rosbag2.CompressionFormat.ZSTD
    write_bag(tmp_path / "bag", container, push_messages(), set_compression=compression)
    assert [topic.count for topic in contents(tmp_path / "bag").topics] == [1, 24, 68]


def test_a_database_without_its_folder(tmp_path):
    folder = write_bag(tmp_path / "bag", "ros2", push_messages())
    (database,) = folder.glob("*.db3")
    assert [topic.count for topic in contents(database).topics] == [1, 24, 68]
    (folder / "metadata.yaml").unlink()
    with pytest.raises(FileError, match=r"folder without metadata.yaml, .*; give .*bag\.db3"):
        existing_bag(folder)


def test_a_bag_in_several_files(tmp_path):
    """Twelve of them: the tenth comes after the second."""
    (tmp_path / "metadata.yaml").write_text("")
    sent = []
    for index in range(12):
        sent += write_mcap(tmp_path / f"bag_{index}.mcap", count=index + 1)
    assert read_all(tmp_path) == (sent, False)
    last = tmp_path / "bag_3.mcap"
    last.write_bytes(last.read_bytes()[:-40])
    assert read_all(tmp_path) == (sent, True)


@pytest.mark.parametrize("kind", KINDS)
def test_mcap_cut_anywhere_is_read_as_far_as_it_goes(tmp_path, kind):
    """All messages whose last byte is there are read, of compressed chunks all of those that are whole."""
    path, whole = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    sent = write_mcap(whole, **KINDS[kind])
    content = whole.read_bytes()
    assert read_all(whole) == (sent, False)
    ends = chunk_ends(whole, sent) if kind in ("zstd", "lz4") else [content.index(each) + len(each) for each in sent]
    rng = np.random.default_rng(4)
    for cut in sorted(rng.integers(8, len(content), 50).tolist()):
        path.write_bytes(content[:cut])
        found, is_cut = read_all(path)
        assert is_cut
        assert found == sent[: len(found)]
        least = sum(end <= cut for end in ends)
        if kind in ("plain", "unchunked"):
            assert len(found) == least
        else:
            assert len(found) >= least


def chunk_ends(path: Path, sent: list[bytes]) -> list[int]:
    """Where in the file the chunk of each message ends."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
    times = pose_times(len(sent))
    return [
        next(chunk.chunk_start_offset + chunk.chunk_length for chunk in chunks if time <= chunk.message_end_time)
        for time in times
    ]


def test_a_cut_bag_is_told_in_one_sentence(tmp_path, caplog):
    path = tmp_path / "cut.mcap"
    sent = write_mcap(path, **KINDS["plain"])
    path.write_bytes(path.read_bytes()[:6000])
    found = contents(path)
    assert found.cut
    assert 0 < found.topics[0].count < len(sent)
    (line,) = [record.getMessage() for record in caplog.records]
    assert line.startswith(f"{path}: is cut off or damaged after ")
    assert line.endswith(f"as when its recorder was killed; the {found.topics[0].count} messages before it are read")
    path.write_bytes(path.read_bytes()[:30])
    caplog.clear()
    with pytest.raises(FileError, match=r"cut.mcap: is cut off or damaged after \d+ bytes; there is no message before"):
        contents(path)
    assert not caplog.records


def test_a_damaged_chunk_ends_a_bag(tmp_path):
    path = tmp_path / "bag.mcap"
    sent = write_mcap(path, **KINDS["plain"])
    content = bytearray(path.read_bytes())
    content[content.index(sent[30]) + 60] ^= 255
    path.write_bytes(content)
    found, is_cut = read_all(path)
    assert is_cut
    assert 10 < len(found) <= 30
    assert found == sent[: len(found)]


@pytest.mark.parametrize("at", ["record", "chunk", "data"])
def test_absurd_sizes_are_not_believed(tmp_path, at):
    path = tmp_path / "bag.mcap"
    sent = write_mcap(path, **KINDS["zstd"])
    content = bytearray(path.read_bytes())
    start = content.index(b"zstd") - 4 - 4 - 8 - 8 - 8 - 9
    place = {"record": start + 1, "chunk": start + 9 + 16, "data": start + 9 + 28 + 4 + 4}[at]
    content[place : place + 8] = (2**61).to_bytes(8, "little")
    path.write_bytes(content)
    found, is_cut = read_all(path)
    assert is_cut
    assert found == sent[: len(found)]


def test_channels_that_are_no_ros_messages_are_ignored_and_named(tmp_path, caplog):
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        log = writer.register_schema("foxglove.Log", "protobuf", b"\x0a\x00")
        channels = [
            writer.register_channel("/log", "protobuf", log),
            writer.register_channel("/notes", "json", 0),
        ]
        for channel in channels:
            writer.add_message(channel, START, b"{}", START)
        writer.finish()
    found = contents(path)
    assert [(topic.channel.topic, topic.count) for topic in found.topics] == [("/log", 1), ("/notes", 1)]
    (line,) = [record.getMessage() for record in caplog.records]
    assert line == f"{path}: topics that are no ROS messages are ignored: /log (protobuf), /notes (json)"


def test_messages_that_do_not_decode_are_named(tmp_path):
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/Image", "ros2msg", b"")
        channel = writer.register_channel("/image", "cdr", schema)
        writer.add_message(channel, START, b"\x00\x01\x00\x00rubbish", START)
        writer.finish()
    with pytest.raises(FileError, match=r"bag.mcap: /image: the message recorded at 1700000000\.0+ s does not decode"):
        contents(path)


@pytest.mark.parametrize("compression", ["NONE", "BZ2", "LZ4"])
def test_ros1_bag_cut_anywhere_is_read_as_far_as_it_goes(tmp_path, compression):
    path, whole = tmp_path / "cut.bag", tmp_path / "whole.bag"
    poses = [pose_message(time, pose) for time, pose in zip(pose_times(), true_pose(pose_times()), strict=True)]
    writer = rosbag1.Writer(whole)
    writer.chunk_threshold = 1500
    if compression != "NONE":
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
    with writer:
        topic = writer.add_connection("/ee_pose", poses[0].type, typestore=ROS1)
        for pose in poses:
            data = ROS1.serialize_ros1(build_message(ROS1, pose.type, pose.content), pose.type)
            writer.write(topic, pose.log_time, data)
    content = whole.read_bytes()
    sent, is_cut = read_all(whole)
    assert not is_cut
    assert len(sent) == len(set(sent)) == len(poses)
    for cut in np.random.default_rng(3).integers(12, len(content), 50).tolist():
        path.write_bytes(content[:cut])
        found, is_cut = read_all(path)
        assert is_cut == (cut < len(content))
        assert found == sent[: len(found)]
        if compression == "NONE":
            assert len(found) == sum(content.index(each) + len(each) <= cut for each in sent)
    path.write_bytes(content[:-30])
    assert read_all(path) == (sent, True)


def number_at(content: bytearray, place: int) -> int:
    return int.from_bytes(content[place : place + 4], "little")


def after_header(content: bytearray, record: int) -> int:
    """Where a record's data begin, with their length."""
    return record + 4 + number_at(content, record)


def test_a_ros1_bag_that_a_killed_recorder_left(tmp_path):
    """The recorder had neither told the index nor how long its last chunk would be."""
    path = write_bag(tmp_path / "bag", "ros1", push_messages())
    sent, _ = read_all(path)
    content = bytearray(path.read_bytes())
    index = content.index(b"index_pos=") + len(b"index_pos=")
    content[index : index + 8] = bytes(8)
    size = after_header(content, len("#ROSBAG V2.0\n"))
    chunk = size + 4 + number_at(content, size)
    size = after_header(content, chunk)
    content[size : size + 4] = bytes(4)
    killed = bytes(content)
    (tmp_path / "killed.bag.active").write_bytes(killed[: int(0.8 * len(killed))])
    found, is_cut = read_all(tmp_path / "killed.bag.active")
    assert is_cut
    assert len(sent) // 2 < len(found) < len(sent)
    assert found == sent[: len(found)]


@pytest.mark.parametrize("mode", ["NONE", "FILE"])
def test_a_database_that_is_cut(tmp_path, caplog, mode):
    compression = rosbag2.CompressionMode[mode], rosbag2.CompressionFormat.ZSTD
    folder = write_bag(tmp_path / "bag", "ros2", push_messages(), set_compression=compression)
    (file,) = folder.glob("*.db3*")
    if mode == "FILE":
        database = zstandard.ZstdDecompressor().stream_reader(file.read_bytes()).read()
        file.write_bytes(zstandard.ZstdCompressor().compress(database[: len(database) // 2]))
    else:
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert contents(folder).cut
    assert f"{file}: is cut off or damaged after" in caplog.text
    file.write_bytes(b"")
    with pytest.raises(FileError, match=r"bag\.db3.*: is empty"):
        contents(folder)
    file.unlink()
    with pytest.raises(FileError, match=r"bag: has a metadata\.yaml and no \.mcap or \.db3 file"):
        contents(folder)


def test_what_is_no_bag(tmp_path, monkeypatch):
    other = tmp_path / "a.bag"
    other.write_bytes(b"something else")
    with pytest.raises(FileError, match="is no bag; known are MCAP"):
        next(raw_messages(other))
    monkeypatch.setattr("palpate.io.bags.containers.find_spec", lambda name: None)
    with pytest.raises(SettingError, match=r"needs mcap, which is not installed: pip install palpate\[ros\]"):
        next(raw_messages(other))


@pytest.mark.parametrize(("share", "least"), [(0.3, 10), (0.5, 25), (0.9, 50), (0.1, 0)])
def test_a_db3_that_is_cut_off_is_read_as_far_as_sqlite_can(tmp_path, share, least):
    write_bag(tmp_path / "bag", "ros2", push_messages())
    whole = list(raw_messages(tmp_path / "bag"))
    (file,) = (tmp_path / "bag").glob("*.db3")
    cut, found = tmp_path / "cut.db3", []
    cut.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    with pytest.raises(CutShort if least else FileError, match=r"cut off (or damaged after \d+|before its)"):
        for each in raw_messages(cut):
            found.append(each)
    assert len(found) >= least and all(each in whole for each in found)
