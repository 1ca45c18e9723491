"""Bags whose headers claim absurd sizes, whose chunks unpack to more than they should, and worse databases."""

import bz2
import re
import sqlite3
import struct
import tracemalloc
from contextlib import closing

import lz4.frame
import pytest
import zstandard
from bag_samples import push_messages, write_bag
from mcap.writer import CompressionType, Writer

from palpate.errors import FileError
from palpate.io.bags.containers import raw_messages
from palpate.io.bags.contents import contents
from palpate.io.bags.mcap_file import leading_attachments
from palpate.io.bags.raw import CutShort
from palpate.io.bags.ros1_file import FIRST_LINE

MAGIC = b"\x89MCAP0\r\n"


def mcap_record(kind, data):
    return struct.pack("<BQ", kind, len(data)) + data


def chunk(compression, data, size, crc=0):
    head = struct.pack("<QQQI", 0, 1, size, crc) + struct.pack("<I", len(compression)) + compression.encode()
    return mcap_record(6, head + struct.pack("<Q", len(data)) + data)


def count_within(path, most_bytes=100_000_000):
    """How many messages there are, counted in no more memory than that."""
    tracemalloc.start()
    count = 0
    try:
        for _ in raw_messages(path):
            count += 1
    except CutShort:
        pass
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < most_bytes
    return count


BOMBS = {
    "zstd": zstandard.ZstdCompressor(1).compress,
    "lz4": lambda data: lz4.frame.compress(data, store_size=True),
}


@pytest.mark.parametrize("compression", BOMBS)
def test_a_chunk_is_unpacked_to_a_limit_only(tmp_path, compression, monkeypatch):
    path = tmp_path / "bomb.mcap"
    monkeypatch.setenv("PALPATE_MAX_CHUNK_MB", "2")
    packed = BOMBS[compression](bytes(50_000_000))
    for said in (50_000_000, 2**60, 100):
        path.write_bytes(MAGIC + chunk(compression, packed, said))
        with pytest.raises(FileError, match=r"bomb\.mcap: holds a chunk of 2 MB, allowed are 2 MB; PALPATE_MAX_CHUNK"):
            count_within(path, 12_000_000)


def test_a_frame_that_says_it_is_enormous_is_not_believed(tmp_path):
    path = tmp_path / "said.mcap"
    # A Zstandard frame whose header says that it holds 2^60 bytes, and a block that is not there.
    frame = b"\x28\xb5\x2f\xfd\xc0\x38" + struct.pack("<Q", 2**60) + b"\x00\x00\x00"
    path.write_bytes(MAGIC + chunk("zstd", frame, 2**60))
    assert count_within(path, 5_000_000) == 0


def test_lengths_within_records_are_not_believed(tmp_path):
    path = tmp_path / "said.mcap"
    for content in (struct.pack("<QQI", 0, 0, 2**31), struct.pack("<QQII", 0, 0, 0, 0) + struct.pack("<Q", 2**40)):
        path.write_bytes(MAGIC + mcap_record(9, content))
        tracemalloc.start()
        assert leading_attachments(path) == {}
        assert tracemalloc.get_traced_memory()[1] < 2_000_000
        tracemalloc.stop()


def test_many_small_records_do_not_fill_the_memory(tmp_path):
    path = tmp_path / "small.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=2**24, compression=CompressionType.ZSTD)
        writer.start()
        schema = writer.register_schema("a", "", b"")
        channel = writer.register_channel("/a", "x", schema)
        for _ in range(30_000):
            writer.add_message(channel, 1, b"", 1)
        writer.finish()
    assert count_within(path, 15_000_000) == 30_000


def test_messages_are_counted(tmp_path, monkeypatch):
    path = write_bag(tmp_path / "bag", "mcap", push_messages())
    monkeypatch.setenv("PALPATE_MAX_MESSAGES", "50")
    with pytest.raises(FileError, match="holds more than 50 messages, allowed are 50; PALPATE_MAX_MESSAGES allows"):
        contents(path)


def ros1_record(data, **fields):
    head = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value for name, value in fields.items()
    )
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def ros1_chunk(data, compression=b"none"):
    return ros1_record(data, op=b"\x05", compression=compression, size=struct.pack("<I", len(data)))


def test_a_ros1_chunk_is_unpacked_to_a_limit_only(tmp_path, monkeypatch):
    path = tmp_path / "a.bag"
    monkeypatch.setenv("PALPATE_MAX_CHUNK_MB", "2")
    path.write_bytes(FIRST_LINE + b"\n" + ros1_chunk(bz2.compress(bytes(50_000_000)), b"bz2"))
    with pytest.raises(FileError, match=r"a\.bag: holds a chunk of 2 MB"):
        count_within(path, 20_000_000)


def test_chunks_in_chunks_are_left_alone(tmp_path):
    path = tmp_path / "a.bag"
    data = b""
    for _ in range(3000):
        data = ros1_chunk(data)
        if len(data) > 20_000:
            break
    path.write_bytes(FIRST_LINE + b"\n" + data)
    assert count_within(path) == 0


def test_a_header_of_many_fields_takes_no_time(tmp_path):
    path = tmp_path / "a.bag"
    head = struct.pack("<I", 2) + b"a=" + struct.pack("<I", 0) * 100_000
    path.write_bytes(FIRST_LINE + b"\n" + struct.pack("<I", len(head)) + head + bytes(4))
    assert count_within(path) == 0  # a minute and more, where each field copies all that follow


def test_a_time_past_any_clock_is_refused(tmp_path):
    path = tmp_path / "a.bag"
    connection = ros1_record(
        ros1_record(b"", topic=b"/a", type=b"std_msgs/String")[4:-4], op=b"\x07", conn=bytes(4), topic=b"/a"
    )
    message = ros1_record(b"x", op=b"\x02", conn=bytes(4), time=b"\xff" * 4 + b"\xff" * 60)
    path.write_bytes(FIRST_LINE + b"\n" + connection + message)
    assert count_within(path) == 1  # the field has eight bytes, whatever follows
    path.write_bytes(MAGIC)


@pytest.fixture
def database(tmp_path):
    folder = write_bag(tmp_path / "bag", "ros2", push_messages())
    return next(folder.glob("*.db3"))


def edited(database, *statements):
    with closing(sqlite3.connect(database)) as opened:
        for statement in statements:
            opened.execute(statement)
        opened.commit()


def test_the_database_itself_is_read(database):
    assert count_within(database) > 50


@pytest.mark.parametrize(
    "statements",
    [
        ("alter table messages rename to m", "create view messages as select * from m, m as n, m as o, m as p"),
        (
            "alter table messages rename to m",
            "create table messages(id, topic_id, timestamp, n, data as (zeroblob(1000000000)))",
            "insert into messages select id, topic_id, timestamp, 0 from m",
        ),
        ("create virtual table t using fts5(x)",),
    ],
    ids=["view", "computed", "virtual"],
)
def test_a_database_that_computes_is_refused(database, statements):
    edited(database, *statements)
    with pytest.raises(FileError, match="has a table that is none of a bag's"):
        contents(database)


ENDLESS = (
    "drop table schema",
    "create view schema(schema_version) as with recursive n(i) as (select 1 union all select i + 1 from n) "
    "select i from n where i < 0",
)


@pytest.mark.parametrize("packed", [False, True])
def test_no_database_of_a_folder_computes_whatever_its_name(database, packed):
    edited(database, *ENDLESS)
    folder, metadata = database.parent, database.parent / "metadata.yaml"
    name = "bag.db3.zstd" if packed else "bag.sqlite"
    data = database.read_bytes()
    (folder / name).write_bytes(zstandard.ZstdCompressor().compress(data) if packed else data)
    database.unlink()
    mode = "compression_mode: FILE\n  compression_format: zstd\n" if packed else ""
    metadata.write_text(re.sub(r"  compression_\w+:.*\n", "", metadata.read_text()).replace("bag.db3", name) + mode)
    with pytest.raises(FileError, match="has a table that is none of a bag's" if packed else "no .mcap or .db3 file"):
        contents(folder)


def test_chunks_are_bounded_in_folders_too(tmp_path, monkeypatch):
    folder = write_bag(tmp_path / "bag", "mcap", push_messages()).parent
    (file,) = folder.glob("*.mcap")
    file.write_bytes(MAGIC + chunk("zstd", BOMBS["zstd"](bytes(50_000_000)), 50_000_000))
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(re.sub("compression_mode:.*", "compression_mode: MESSAGE", text))
    monkeypatch.setenv("PALPATE_MAX_CHUNK_MB", "2")
    with pytest.raises(FileError, match=r"bag\.mcap: holds a chunk of 2 MB"):
        count_within(folder, 12_000_000)


@pytest.mark.parametrize("change", ["data = 3000000000", "data = 'words'", "timestamp = '9now'"])
def test_values_of_other_types_end_the_bag(database, change):
    edited(database, f"update messages set {change} where id = 40")
    assert count_within(database) < 93


def test_packed_messages_are_unpacked_to_a_limit_only(tmp_path, monkeypatch):
    from rosbags import rosbag2

    setting = (rosbag2.CompressionMode.MESSAGE, rosbag2.CompressionFormat.ZSTD)
    folder = write_bag(tmp_path / "bag", "ros2", push_messages(), set_compression=setting)
    assert len(list(raw_messages(folder))) > 50
    bomb = zstandard.ZstdCompressor(1).compress(bytes(50_000_000))
    with closing(sqlite3.connect(next(folder.glob("*.db3")))) as opened:
        opened.execute("update messages set data = ?", (bomb,))
        opened.commit()
    monkeypatch.setenv("PALPATE_MAX_CHUNK_MB", "2")
    with pytest.raises(FileError, match="holds a chunk of 2 MB"):
        count_within(folder, 20_000_000)


def test_packed_files_are_unpacked_to_a_limit_only(tmp_path, monkeypatch):
    from rosbags import rosbag2

    setting = (rosbag2.CompressionMode.FILE, rosbag2.CompressionFormat.ZSTD)
    folder = write_bag(tmp_path / "bag", "ros2", push_messages(), set_compression=setting)
    assert len(list(raw_messages(folder))) > 50
    monkeypatch.setenv("PALPATE_MAX_BAG_MB", "0.1")
    with pytest.raises(FileError, match=r"\.zstd: holds messages of .*PALPATE_MAX_BAG_MB allows more"):
        count_within(folder)


def test_large_metadata_is_refused(tmp_path):
    folder = write_bag(tmp_path / "bag", "ros2", push_messages())
    (folder / "metadata.yaml").write_text("a: " + "[" * 2_000_000)
    with pytest.raises(FileError, match=r"metadata\.yaml: has 2000003 bytes, allowed are 1000000"):
        contents(folder)
