#!/bin/sh
# rosbags 0.11.9: a ROS 2 bag whose metadata.yaml was edited in its QoS is read as if it had no messages.
#
# metadata.yaml states the QoS with which topics are offered, and the file of the bag states it again. Who plays a bag
# with another QoS edits metadata.yaml, as ROS 2 plays by it. Where both differ
# `messages()` of rosbags yields none, without an error or a warning, while `message_count` is that of metadata.yaml.
# Seen: of 5 messages none is read after `offered_qos_profiles` of metadata.yaml states a reliability; 5 before.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "rosbags==0.11.9" "numpy==2.4.6" "PyYAML==6.0.3"
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata
from pathlib import Path

import yaml
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
text = store.types["std_msgs/msg/String"](data="touch")
bag = Path("bag")
with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
    connection = writer.add_connection("/words", text.__msgtype__, typestore=store)
    for time in range(1, 6):
        writer.write(connection, time * 10**9, store.serialize_cdr(text, text.__msgtype__))


def read():
    with Reader(bag) as reader:
        return reader.message_count, len(list(reader.messages()))


before = read()
at_once = {"sec": 0, "nsec": 0}
profile = {
    "history": "keep_last",
    "depth": 10,
    "reliability": "best_effort",
    "durability": "volatile",
    "deadline": at_once,
    "lifespan": at_once,
    "liveliness": "automatic",
    "liveliness_lease_duration": at_once,
    "avoid_ros_namespace_conventions": False,
}
path = bag / "metadata.yaml"
content = yaml.safe_load(path.read_text())
(topic,) = content["rosbag2_bagfile_information"]["topics_with_message_count"]
topic["topic_metadata"]["offered_qos_profiles"] = [profile]
path.write_text(yaml.safe_dump(content))
after = read()
print(f"rosbags {importlib.metadata.version('rosbags')}")
print(f"messages counted and read: before {before}, after metadata.yaml was edited {after}")
assert before == (5, 5), "not as seen: the bag is not read before"
assert after == (5, 0), "not as seen: the edited bag is read"
PYTHON
