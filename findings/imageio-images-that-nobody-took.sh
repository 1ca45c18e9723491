#!/bin/sh
# imageio 2.38.1 with imageio-ffmpeg 0.8.1: images of a video with a variable frame rate are read several times.
#
# Cameras drop images and slow down in dim light, and recorders write such a video with the time of each image, often
# with a table of times beside it: image k was taken at time k. The reader passes the video through a process of FFmpeg
# that fills pauses with copies of the last image, to a constant rate, so that image k of the reader is another image.
# `count_frames` of the same reader counts those of the file, and nothing warns.
# Seen: of 60 images, two in three 33 ms after the one before and one in three 100 ms, 100 are read, the first three
# times; the 60th is image 35 by its brightness. PyAV 18.1.0 reads the 60, with their times.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    "imageio==2.38.1" "imageio-ffmpeg==0.8.1" "av==18.1.0" "numpy==2.4.6"
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata
from fractions import Fraction

import av
import imageio.v2 as imageio
import numpy as np

COUNT = 60
MILLISECOND = Fraction(1, 1000)
times = np.cumsum([0, *(100 if number % 3 == 0 else 33 for number in range(COUNT - 1))])  # [ms]
with av.open("touch.mp4", "w") as container:
    stream = container.add_stream("libx264", rate=1000, options={"crf": "5"})
    stream.width = stream.height = 64
    stream.pix_fmt = "yuv420p"
    stream.codec_context.time_base = MILLISECOND
    for number, time in enumerate(times.tolist()):
        frame = av.VideoFrame.from_ndarray(np.full((64, 64, 3), 8 + 4 * number, np.uint8), format="rgb24")
        frame.pts = time
        frame.time_base = MILLISECOND
        container.mux(stream.encode(frame))
    container.mux(stream.encode())


def numbers_of(images):
    """Return the number of each image, by its brightness."""
    return [round((float(np.mean(image)) - 8.0) / 4.0) for image in images]


with av.open("touch.mp4") as container:
    frames = list(container.decode(video=0))
peer_times = [float(frame.pts * frame.time_base) * 1e3 for frame in frames]
peer = numbers_of(frame.to_ndarray(format="rgb24") for frame in frames)
with imageio.get_reader("touch.mp4", format="ffmpeg") as reader:
    counted = reader.count_frames()
    found = numbers_of(reader)
for name in ("imageio", "imageio-ffmpeg", "av"):
    print(name, importlib.metadata.version(name))
print(f"PyAV: {len(peer)} images, times within {np.abs(np.array(peer_times) - times).max():.3f} ms of those recorded")
print(f"imageio: count_frames {counted}, read {len(found)}: {found[:16]} ...; the 60th is image {found[59]}")
assert peer == [*range(COUNT)] and np.abs(np.array(peer_times) - times).max() < 1.0, "the reference has changed"
assert counted == COUNT, "behaviour has changed: the count"
assert len(found) > 1.5 * COUNT and found[:3] == [0, 0, 0], "behaviour has changed: no image is repeated"
PYTHON
