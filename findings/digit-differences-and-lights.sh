#!/bin/sh
# digit-interface 0.2.1: a gel that grows darker by one level differs by 255, and an older DIGIT is left in the dark.
#
# `Digit.get_diff(ref_frame)`, "the difference between two frames", and the live view `show_view(ref_frame)` subtract
# images of 8 bits from each other: what is darker than the reference wraps around. Where an object touches the gel one
# side of each slope grows darker, so half of a touch is a full white, and so is the noise of a camera at rest.
# `connect()` says that it sets the "maximum LED intensity" and asks for 15. For firmware before revision 200
# `set_intensity` divides by 17, as its argument went up to 255 there: 15 becomes 0, which by the documentation is "all
# LEDs off". And the README promises VGA at 30 frames per second after connecting: it is QVGA at 60.
# The camera is a video here; the class opens both by the same call.
# Seen: of a gel of 100 levels that falls to 99 the difference is 255; the three LEDs are sent 15 of 15 at revision 200
# and 0 at 101; 320 x 240 at 60 frames per second.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check \
    "opencv-python-headless==5.0.0.93" "numpy==2.4.6" "pyudev==0.24.5"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check --no-deps "digit-interface==0.2.1"
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata
import logging

import cv2
import numpy as np
from digit_interface import Digit

logging.disable(logging.CRITICAL)
gel = np.full((240, 320, 3), 100, np.uint8)
writer = cv2.VideoWriter("gel.avi", cv2.VideoWriter_fourcc(*"HFYU"), 60, (320, 240))  # without loss
writer.write(gel)
writer.write(gel - 1)
writer.release()


def connected(revision):
    digit = Digit()
    digit.dev_name = "gel.avi"
    digit.revision = revision
    digit.connect()
    return digit


digit = connected(200)
untouched = digit.get_frame()
difference = digit.get_diff(untouched)
older = connected(101)
print("digit-interface", importlib.metadata.version("digit-interface"))
print(f"untouched {untouched[0, 0]}, one level darker: difference {difference[0, 0]} in {difference.dtype}")
print(f"LED intensities: {digit.intensity:#x} at revision 200, {older.intensity:#x} at revision 101")
print(f"after connecting: {digit.resolution} at {digit.fps}")
assert (untouched == 100).all(), "the reference has changed"
assert (difference == 255).all(), "behaviour has changed: differences have a sign"
assert digit.intensity == 0xFFF and older.intensity == 0, "behaviour has changed: intensity of older firmware"
assert digit.resolution["width"] == 320 and digit.fps == 60, "behaviour has changed: stream after connecting"
PYTHON
