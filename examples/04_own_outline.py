"""Your own outline: from a drawing, from a table of corners, or from a scan, for whatever tracks it.

Here all three are made up of one bracket, 90 mm by 60 mm: a drawing as SVG, its corners in millimetres, and 600 points
round it with a noise of 0.3 mm, which are smoothed.
"""

import sys
from pathlib import Path
from tempfile import mkdtemp

import matplotlib
import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d

import palpate

matplotlib.use("Agg")
import matplotlib.pyplot as plt

CORNERS = np.array([(0, 0), (90, 0), (90, 25), (35, 25), (35, 60), (0, 60)])  # [mm], as drawn
folder = Path(sys.argv[1] if len(sys.argv) > 1 else mkdtemp())

points = " ".join(f"{x},{60 - y}" for x, y in CORNERS)  # y of an SVG points down
page = '<svg xmlns="http://www.w3.org/2000/svg" width="90mm" height="60mm" viewBox="0 0 90 60">'
(folder / "bracket.svg").write_text(f'{page}<polygon points="{points}"/></svg>')
np.savetxt(folder / "bracket.csv", CORNERS, header="x y [mm]")
along = np.linspace(0.0, 1.0, 600, endpoint=False)
scan = shapely.get_coordinates(shapely.Polygon(CORNERS).exterior.interpolate(along, normalized=True))
scan += np.random.default_rng(0).normal(scale=0.3, size=scan.shape)
smooth = gaussian_filter1d(scan, 2.0, axis=0, mode="wrap")  # or the outline would cross itself
np.savetxt(folder / "scan.csv", smooth[::4])

drawn = palpate.load_shape(folder / "bracket.svg")  # its page says how large it is
typed = palpate.load_shape(folder / "bracket.csv", unit="mm")
found = palpate.load_shape(folder / "scan.csv", unit="mm")
box = palpate.load_shape("0.09x0.06")  # [m]
for name, shape in (("drawn", drawn), ("typed", typed), ("scanned", found), ("box", box)):
    middle = 1e3 * shape.centroid
    print(f"{name}: {1e4 * shape.area:.2f} cm2, centroid at x {middle[0]:.1f} mm, y {middle[1]:.1f} mm")

# Look at it before you track with it: the first pose is that of this frame's origin.
figure, axes = plt.subplots()
for name, shape, colour in (("drawn", drawn, "C0"), ("typed", typed, "C1"), ("scanned", found, "C2")):
    axes.fill(*(1e3 * shape.outline()).T, fill=False, edgecolor=colour, label=name)
axes.plot(0.0, 0.0, "k+", markersize=12)
axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
axes.legend()
figure.savefig(folder / "outlines.png")
