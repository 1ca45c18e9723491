#!/bin/sh
# rosbags-image 0.10.4 and importRosbag 1.0.4: images whose rows are padded come out sheared, and 16 bits as 8.
#
# sensor_msgs/Image states `step`, the "full row length in bytes" (its definition in common_interfaces): drivers that
# align rows to 4, 64 or more bytes write rows longer than the pixels, and cv_bridge of ROS 2 reads by it. Both readers
# ask for the bytes as if there were none but pixels: each row begins farther to the right, colours change places, and
# the last rows are lost. Of a CompressedImage "16UC1; png compressed", a depth or height map of a gel whose encoding of
# 16 bits its format states, rosbags-image returns the upper 8 bits, also if no colour space is asked for.
# Seen: of an image of one colour in 4 rows of 6 pixels, with a step of 20 bytes, one row is right; heights of 4660 in
# 16 bits are returned as 18 in 8 bits.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "rosbags-image==0.10.4" "rosbags==0.11.9" \
    "importRosbag==1.0.4" "opencv-python-headless==5.0.0.93" "numpy==2.4.6"
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata

import cv2
import numpy as np
from importRosbag.importRosbag import importRosbag
from rosbags.image import message_to_cvimage
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

HEIGHT = 4
WIDTH = 6
STEP = 20
store = get_typestore(Stores.ROS1_NOETIC)
types = store.types
header = types["std_msgs/msg/Header"](
    seq=0, stamp=types["builtin_interfaces/msg/Time"](sec=1, nanosec=0), frame_id="gel"
)
gel = np.full((HEIGHT, WIDTH, 3), (200, 100, 50), np.uint8)
rows = np.zeros((HEIGHT, STEP), np.uint8)
rows[:, : 3 * WIDTH] = gel.reshape(HEIGHT, -1)
image = types["sensor_msgs/msg/Image"](
    header=header, height=HEIGHT, width=WIDTH, encoding="rgb8", is_bigendian=0, step=STEP, data=rows.ravel()
)
with Writer("touch.bag") as writer:
    connection = writer.add_connection("/gel", image.__msgtype__, typestore=store)
    writer.write(connection, 10**9, store.serialize_ros1(image, image.__msgtype__))

heights = np.full((HEIGHT, WIDTH), 4660, np.uint16)
png = cv2.imencode(".png", heights)[1].ravel()
compressed = types["sensor_msgs/msg/CompressedImage"](header=header, format="16UC1; png compressed ", data=png)


def right_rows(pixels):
    return int((pixels == gel).all(axis=(1, 2)).sum())


by_rosbags = message_to_cvimage(image)
by_importer = importRosbag("touch.bag", log="ERROR", disable_bar=True)["/gel"]["frames"][0]
by_step = rows[:, : 3 * WIDTH].reshape(gel.shape)
depth = message_to_cvimage(compressed)
print(*(f"{name} {importlib.metadata.version(name)}" for name in ("rosbags-image", "importRosbag")))
print(f"right rows of {HEIGHT}: by step {right_rows(by_step)}, "
      f"rosbags-image {right_rows(by_rosbags)}, importRosbag {right_rows(by_importer)}")
print(f"heights: sent {heights[0, 0]} in {heights.dtype}, rosbags-image {depth[0, 0]} in {depth.dtype}")
assert right_rows(by_step) == HEIGHT, "the reference has changed"
assert right_rows(by_rosbags) == 1, "behaviour has changed: rosbags-image heeds step"
assert right_rows(by_importer) == 1, "behaviour has changed: importRosbag heeds step"
assert depth.dtype == np.uint8 and depth[0, 0] == 4660 >> 8, "behaviour has changed: 16 bits stay 16 bits"
PYTHON
