#!/bin/sh
# haptix 0.2.0: heights of a gel in 16 bits keep their lower 8 bits, and the check sum says that the data are whole.
#
# The GelSight reader takes PNG and TIFF, in which a height or depth map of a gel has 16 bits, and lays the images into
# an array of 8 bits: 300 becomes 44. By the README raw data are "preserved verbatim, never transcoded", "lossless by
# construction"; the check sum is of the array after that. The reader of DIGIT images has the same lines.
# Right would be 16 bits, which the format has room for, or an error.
# Seen: of heights 255, 256 and 300 the data are 255, 0 and 44 in uint8, and `verify()` is true after a round trip.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "haptix==0.2.0" "numpy==2.4.6" "pillow==13.0.0" \
    "pandas==3.1.1"
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata
from pathlib import Path

import haptix
import numpy as np
from haptix.core import InteractionMeta, Labels
from haptix.sensors import get_sensor
from PIL import Image

heights = np.array([[255, 256, 300]], np.uint16)
found = {}
for suffix in ("png", "tiff"):
    frames = Path(suffix)
    frames.mkdir()
    Image.fromarray(heights).save(frames / f"gel.{suffix}")
    peer = np.asarray(Image.open(frames / f"gel.{suffix}"))
    data = get_sensor("GelSight").load(frames, InteractionMeta(type="pressing"), Labels())
    haptix.save(data, f"{suffix}.hapt")
    raw = haptix.load(f"{suffix}.hapt").raw
    found[suffix] = raw.numpy().ravel().tolist(), str(raw.dtype), raw.verify()
    assert (peer == heights).all(), "the reference has changed"
print("haptix", importlib.metadata.version("haptix"))
for suffix, (values, kind, whole) in found.items():
    print(f"{suffix}: heights {heights.ravel().tolist()} come as {values} in {kind}, verified: {whole}")
assert all(parts == ([255, 0, 44], "uint8", True) for parts in found.values()), "behaviour has changed: 16 bits"
PYTHON
