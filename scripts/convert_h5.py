"""Make an MCAP of a recording that an earlier palpate wrote as HDF5; needs h5py.

python scripts/convert_h5.py push.h5 ...: writes push.mcap beside each.
"""

import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import palpate
from palpate.geometry.shapes import shape_from_dict
from palpate.types.sensor import sensor_from_dict

ARRAYS = ("object_pose", "first_pose", "first_pose_sigma", "contact", "episode")


def converted(file: Any) -> palpate.Recording:
    """Return the recording in an open HDF5 file."""
    about, images = file.attrs, file.get("image")
    return palpate.Recording(
        time=file["time"][()],
        sensor_pose=file["sensor_pose"][()],
        shape=shape_from_dict(json.loads(about["shape"])),
        sensor=sensor_from_dict(json.loads(about["sensor"])),
        image=None if images is None else tuple(row.tobytes() for row in images),
        codec="jpeg" if images is None else images.attrs["codec"],
        contact_derived=bool(about["contact_derived"]),
        source=about["source"],
        frames=json.loads(about["frames"]),
        extra={name: value[()] for name, value in file.get("extra", {}).items()},
        **{name: file[name][()] for name in ARRAYS if name in file},
    )


if __name__ == "__main__":
    for name in sys.argv[1:]:
        with import_module("h5py").File(name) as opened:
            palpate.write_recording(converted(opened), Path(name).with_suffix(".mcap"))
