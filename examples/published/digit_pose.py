"""Reader of facebook/digit-pose-estimation (Sparsh): three DIGITs of a hand on an object that a person moves.

    palpate calibrate --untouched DATASET/bgs/digit_index.png --out index.npz
    python digit_pose.py DATASET/test/sugar/bag_00.pkl index index.npz

A sequence is a pickle of N images of each finger (digit_index, digit_middle, digit_ring), encoded or as arrays, and N
poses of the object by a tag: x, y, z [m] and a quaternion w, x, y, z. The hand stands still; where is not in the file,
and nor are times: images are taken to come at the DIGIT's 30 Hz.

A pickle can run code, so another process reads it, by `allowed_pickle.py`, and that takes nothing but arrays.
"""

import io
import subprocess
import sys
from pathlib import Path

import numpy as np
from touch_data import TouchData, checked

import palpate
from palpate.types.images import encode_image

FINGERS = ("index", "middle", "ring")


def read_sequence(path: Path, finger: str) -> TouchData:
    """Read the images of a finger, and the object's poses. Raises FileError."""
    if finger not in FINGERS:
        raise palpate.SettingError(f"finger is {finger!r}; allowed are {', '.join(FINGERS)}")
    # Isolated (-I): it finds no modules in the working folder, the script's, or the user's.
    reader = Path(__file__).with_name("allowed_pickle.py")
    words = [sys.executable, "-I", str(reader), str(path), f"digit_{finger}"]
    done = subprocess.run(words, capture_output=True, check=False)
    if done.returncode:
        reason = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise palpate.FileError(f"{path}: {reason or 'the process that reads it died'}")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as arrays:
        poses = arrays["poses"][:, [0, 1, 2, 4, 5, 6, 3]]  # w last
        found = [arrays[str(index)] for index in range(len(arrays.files) - 1)]
    images = [each.tobytes() if each.ndim == 1 else encode_image(each, "png") for each in found]
    checked(path, images, poses=poses)
    time, source = np.arange(len(images)) / palpate.DIGIT.rate, f"{path.parent.name} {path.stem}, {finger}"
    return TouchData(time, images, None, poses, palpate.DIGIT, f"digit-pose-estimation, {source}")


if __name__ == "__main__":
    unit = palpate.load_calibration(sys.argv[3]) if sys.argv[3:] else None
    print(read_sequence(Path(sys.argv[1]), sys.argv[2]).about(unit))
