"""The site of the documentation: `make docs` builds it into docs/_build/html."""

import sys
from pathlib import Path
from typing import Any

import palpate
from palpate.field_docs import HEADING

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project, author, copyright = "palpate", "The palpate authors", "The palpate authors"
version = release = palpate.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml"]
exclude_patterns = ["_build", "study"]

myst_enable_extensions = ["colon_fence", "dollarmath", "deflist"]
myst_heading_anchors = 3
html_math_renderer = "mathml"

html_theme = "furo"
html_title = f"palpate {release}"
html_static_path = ["_static"]
html_css_files = ["palpate.css"]
html_show_sphinx = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "separated"


def _without_fields(app: Any, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """Leave out the fields that `help()` tells of a class: here each has an entry of its own."""
    if what == "class" and HEADING in lines:
        del lines[lines.index(HEADING) :]


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", _without_fields, priority=400)
