#!/bin/sh
# rosbags 0.11.9 and mcap-ros2-support 0.6.0: bytes of a ROS 2 message above 127 come out negative, of each other kind.
#
# Taxels of a skin and frames of a serial sensor are recorded as `byte[]` or `char[]`. ROS 2 maps `byte` to octet and
# `char` to uint8 (its article "Interface definition using .msg / .srv / .action files"): both are 0..255. In ROS 1
# `byte` was int8, and rosbags reads it so in bags of ROS 2 too, where it refuses to write a `byte` of 200.
# mcap-ros2-support reads `byte` rightly and `char` as int8. foxglove/rosmsg#49 mended the former in another reader.
# Seen: of taxels 200 and 1, as octets of one message in an MCAP file, rosbags reads -56 of `byte` and 200 of `char`,
# mcap-ros2-support 200 of `byte` and -56 of `char`.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    "rosbags==0.11.9" "mcap==1.6.0" "mcap-ros2-support==0.6.0" "numpy==2.4.6"
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

TYPE = "skin_msgs/msg/Taxels"
OCTETS = bytes([200, 1])
store = get_typestore(Stores.ROS2_JAZZY)
store.register(get_types_from_msg("byte[] as_byte\nchar[] as_char\n", TYPE))
sequence = len(OCTETS).to_bytes(4, "little") + OCTETS
message = b"\x00\x01\x00\x00" + sequence + b"\x00\x00" + sequence  # CDR, little-endian, aligned to four bytes
with Writer("touch", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
    connection = writer.add_connection("/skin", TYPE, typestore=store)
    writer.write(connection, 10**9, message)

with AnyReader([Path("touch")]) as reader:
    connection, _, raw = next(reader.messages())
    by_rosbags = reader.deserialize(raw, connection.msgtype)
with next(Path("touch").glob("*.mcap")).open("rb") as file:
    by_mcap = next(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()).decoded_message
found = {
    "rosbags": (list(map(int, by_rosbags.as_byte)), list(map(int, by_rosbags.as_char))),
    "mcap-ros2-support": (list(by_mcap.as_byte), list(by_mcap.as_char)),
}
for name, (as_byte, as_char) in found.items():
    print(f"{name} {importlib.metadata.version(name)}: byte {as_byte}, char {as_char}, of octets {list(OCTETS)}")
assert found["rosbags"] == ([-56, 1], [200, 1]), "behaviour has changed: rosbags"
assert found["mcap-ros2-support"] == ([200, 1], [-56, 1]), "behaviour has changed: mcap-ros2-support"
PYTHON
