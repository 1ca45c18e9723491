#!/bin/sh
# svgelements 1.9.6: a clip path is found only without quotes and after its definition, and symbols are drawn in place.
#
# A browser clips by url(#c), by url('#c'), and by a clip path that stands later in the file; drawing programs write all
# of these. It draws nothing of a symbol, a mask or a marker where it is defined.
# Seen: the clip of the last two is missing without a word, and shapes inside symbol, mask and marker are among the
# shapes of the page, so that an outline gains sides that nobody sees.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "svgelements==1.9.6"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata
import io

from svgelements import SVG, Shape

PAGE = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100">
<symbol><rect id="in-symbol" width="10" height="10"/></symbol>
<mask id="mask"><rect id="in-mask" width="5" height="5"/></mask>
<marker id="marker"><path id="in-marker" d="M0 0L1 1"/></marker>
<clipPath id="clip"><rect width="5" height="5"/></clipPath>
<rect id="plain" width="20" height="20" clip-path="url(#clip)"/>
<rect id="quoted" width="20" height="20" clip-path="url('#clip')"/>
<rect id="before" width="20" height="20" clip-path="url(#late)"/>
<clipPath id="late"><rect width="5" height="5"/></clipPath>
</svg>"""
shapes = [part for part in SVG.parse(io.StringIO(PAGE)).elements() if isinstance(part, Shape)]
is_clipped = {part.id: getattr(part, "clip_path", None) is not None for part in shapes}
print("svgelements", importlib.metadata.version("svgelements"))
for name, clipped in is_clipped.items():
    print(f"{name}: among the shapes of the page, {'clipped' if clipped else 'not clipped'}")
assert is_clipped["plain"] and not is_clipped["quoted"] and not is_clipped["before"], "clips have changed"
assert {"in-symbol", "in-mask", "in-marker"} <= is_clipped.keys(), "what is defined is no longer among the shapes"
PYTHON
