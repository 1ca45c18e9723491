"""The model of pushing with the outline as a variable; `make kernels` writes `models/generated_outline.py` from it."""

from dataclasses import replace

import numpy as np

from palpate.estimation.variable import Variable
from palpate.geometry.closed_curve import KNOTS
from palpate.models.pushing.contact_geometry import CONTACT_GEOMETRY
from palpate.models.pushing.model import MODEL

OUTLINE = Variable("outline", "object", KNOTS, prior=(0.0, 1.0))
"""Heights across the outline as it was known before, as coefficients of a spline around it [m]. The prior is only a
scale; `hypotheses.unknown_outline` has that of shapes of a size."""
_FIELDS = [(name, CONTACT_GEOMETRY[name]) for name in CONTACT_GEOMETRY.names or ()]
_PLACE = [("knot", "f8"), ("weights", "4f8"), ("slopes", "4f8"), ("gap_by_outline", "2f8")]
_BY_OUTLINE = [(f"{name}_by_outline", "2c16") for name in ("point", "material", "normal")]
OUTLINE_GEOMETRY = np.dtype([*_FIELDS, *_PLACE, *_BY_OUTLINE], align=True)
"""CONTACT_GEOMETRY, and derivatives by height and slope of the outline [m], [m per knot] at the place that is touched.

- knot: the first of the four coefficients that the place depends on.
- weights, slopes: the derivatives of height and slope by these.
"""
OUTLINE_MODEL = replace(MODEL.extended([OUTLINE]), geometry=OUTLINE_GEOMETRY)
"""Variables and factors of pushing, and the outline."""
