#!/bin/sh
# svgelements 1.9.6: parts of an SVG lie elsewhere or have another size: in nested pages, of symbols, about an origin.
#
# By SVG 2 (chapters Document Structure, Coordinate Systems) and CSS Transforms 1, as every browser draws it:
# - a rectangle without x and y lies at 0, 0 of its own page; here it inherits x and y of the page around it, which has
#   already moved, so that it moves twice;
# - a symbol with a viewBox is scaled to width and height of its use; here it keeps its own numbers;
# - transform-origin is the point that a transform turns or scales about; here it is always 0, 0.
# Seen: the first is drawn at 30..50 and not at 10..30, the second is 5 units wide and not 20, the third lies at
# -10..0 and not at 90..100, off the page.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "svgelements==1.9.6"
"$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata
import io

from svgelements import SVG, Path, Shape

PAGE = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100" width="100" height="100">%s</svg>'
NESTED = '<svg x="10" y="10" width="20" height="20" viewBox="0 0 10 10">%s</svg>'
SYMBOL = '<symbol id="plate" viewBox="0 0 5 5"><path d="M0 0h5v5h-5z"/></symbol>'
USE = '<use href="#plate" x="10" y="10" width="20" height="20"/>'
TURNED = '<path d="M0 0h5v10h-5z" transform="rotate(90)" transform-origin="50 50"/>'


def span_of_last(content):
    """Return left and right of the last shape of a page."""
    shapes = [part for part in SVG.parse(io.StringIO(PAGE % content)).elements() if isinstance(part, Shape)]
    left, _, right, _ = Path(shapes[-1]).bbox()
    return round(left, 6), round(right, 6)


stated = span_of_last(NESTED % '<rect x="0" y="0" width="10" height="10"/>')
nested = span_of_last(NESTED % '<rect width="10" height="10"/>')
symbol = span_of_last(SYMBOL + USE)
turned = span_of_last(TURNED)
about = span_of_last('<path d="M0 0h5v10h-5z" transform="rotate(90 50 50)"/>')
print("svgelements", importlib.metadata.version("svgelements"))
print("rectangle in a nested page, x and y stated %s, left out %s; both should be (10, 30)" % (stated, nested))
print("use of a symbol with a viewBox: %s, should be (10, 30)" % (symbol,))
print("rotate(90 50 50): %s, rotate(90) about the origin 50 50: %s; both should be (90, 100)" % (about, turned))
assert stated == (10.0, 30.0) and about == (90.0, 100.0), "the reference has changed"
assert nested == (30.0, 50.0), "behaviour has changed: x and y of a nested page"
assert symbol == (10.0, 15.0), "behaviour has changed: size of a symbol"
assert turned == (-10.0, 0.0), "behaviour has changed: transform-origin"
PYTHON
