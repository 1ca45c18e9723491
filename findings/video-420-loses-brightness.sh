#!/bin/sh
# PyAV 18.1.0 (FFmpeg's swscale 9.5): each decoded frame of a yuv420p video is darker than what was recorded.
#
# Data sets of touch images are videos in yuv420p (LeRobot's default), and what counts in them is the difference of an
# image from the untouched gel, of a few grey levels. `to_ndarray(format="rgb24")`, also of other formats of RGB and by
# every `Interpolation` that PyAV names, takes a path of the library that rounds downwards: a loss that is the same in
# all frames, and that an image which was kept as PNG, such as the untouched gel's, does not have.
# ITU-R BT.601 defines Y, Cb and Cr so that rounding has no mean: the planes are right, and computed back from them as
# the standard says, the image is as bright as before. By way of yuv444p the library does so too.
# Seen: red, green and blue are darker by 1.1, 1.4 and 1.1 of 255 levels on average; by way of yuv444p by less than 0.3,
# and by the formula of the standard by less than 0.2.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "av==18.1.0" "numpy==2.4.6"
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import av
import numpy as np

rows, columns = np.mgrid[:320, :240]
waves = (
    120.0 + 40.0 * np.sin(columns / 30.0),
    100.0 + 30.0 * np.cos(rows / 40.0),
    90.0 + 50.0 * np.sin((rows + columns) / 50.0),
)
gel = np.stack(waves, axis=-1).round().astype(np.uint8)
with av.open("gel.mp4", "w") as container:
    stream = container.add_stream("libx264", rate=30, options={"crf": "0"})  # without loss
    stream.width = 240
    stream.height = 320
    stream.pix_fmt = "yuv420p"
    for _ in range(3):
        container.mux(stream.encode(av.VideoFrame.from_ndarray(gel, format="rgb24")))
    container.mux(stream.encode())
with av.open("gel.mp4") as container:
    frame = list(container.decode(video=0))[1]


def plane(number):
    values = frame.planes[number]
    return np.frombuffer(bytes(values), np.uint8).reshape(values.height, values.line_size)[:, : values.width] * 1.0


luma = (plane(0) - 16.0) * 255.0 / 219.0
blue, red = (np.kron(plane(number) - 128.0, np.ones((2, 2))) * 255.0 / 224.0 for number in (1, 2))
standard = np.stack((luma + 1.402 * red, luma - 0.344136 * blue - 0.714136 * red, luma + 1.772 * blue), axis=-1)


def mean_error(pixels):
    return (pixels - gel.astype(float)).mean(axis=(0, 1))


direct = mean_error(frame.to_ndarray(format="rgb24"))
through_444 = mean_error(frame.reformat(format="yuv444p").to_ndarray(format="rgb24"))
by_formula = mean_error(standard)
print("PyAV", av.__version__, "swscale", ".".join(map(str, av.library_versions["libswscale"])))
print("to_ndarray: red %+.2f, green %+.2f, blue %+.2f levels" % tuple(direct))
print("by way of yuv444p: red %+.2f, green %+.2f, blue %+.2f levels" % tuple(through_444))
print("by BT.601: red %+.2f, green %+.2f, blue %+.2f levels" % tuple(by_formula))
assert np.abs(by_formula).max() < 0.25, "the planes have changed"
assert np.abs(through_444).max() < 0.4, "behaviour has changed: yuv444p"
assert direct.max() < -0.8, "behaviour has changed: frames are as bright as recorded"
PYTHON
