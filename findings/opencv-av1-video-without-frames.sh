#!/bin/sh
# opencv-python-headless 5.0.0.93: a video in AV1, LeRobot's default, opens as usual and holds no frames.
#
# LeRobot writes its cameras by `libsvtav1` unless told otherwise (its page on video encoding, version 0.5.1). The
# wheel's FFmpeg has only the decoder of AV1 that needs hardware, none in software. `isOpened()` is true, and size, rate
# and number of frames are those of the file; the first `read()` is False, which by the documentation of `VideoCapture`
# means that there are no more frames. So a loop over the video ends at once as if it were empty, and only FFmpeg's
# lines on the error output tell. An exception comes with `setExceptionMode(True)` alone, and does not say why.
# Right would be what happens to other files that cannot be decoded: `isOpened()` is false. PyAV reads the file by
# dav1d. Known to the project as opencv/opencv#24430. Seen: opened, 20 frames announced, none read; PyAV 18.1.0 reads
# 20.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    "opencv-python-headless==5.0.0.93" "av==18.1.0" "numpy==2.4.6"
cd "$folder"
# SVT-AV1 and FFmpeg talk on the error output; of a fault its end is shown.
"$folder/venv/bin/python" - 2>messages <<'PYTHON' || { tail -n 5 messages >&2; exit 1; }
import av
import cv2
import numpy as np

with av.open("touch.mp4", "w") as container:
    stream = container.add_stream("libsvtav1", rate=30, options={"crf": "30"})
    stream.width = 240
    stream.height = 320
    stream.pix_fmt = "yuv420p"
    for level in range(20):
        image = np.full((320, 240, 3), 10 * level, np.uint8)
        container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
    container.mux(stream.encode())
with av.open("touch.mp4") as container:
    decoder = container.streams.video[0].codec_context.codec.name
    peer = sum(1 for _ in container.decode(video=0))
video = cv2.VideoCapture("touch.mp4")
opened = video.isOpened()
announced = int(video.get(cv2.CAP_PROP_FRAME_COUNT))
read = 0
while video.read()[0]:
    read += 1
print("opencv-python-headless", cv2.__version__, "PyAV", av.__version__)
print(f"OpenCV: opened {opened}, {announced} frames announced, {read} read")
print(f"PyAV: {peer} frames read by {decoder}")
assert peer == 20, "PyAV has changed"
assert opened and announced == 20, "behaviour has changed: OpenCV does not open the file"
assert read == 0, "behaviour has changed: OpenCV reads AV1"
PYTHON
