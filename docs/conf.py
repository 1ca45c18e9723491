"""The site of the documentation: `make docs` builds it into docs/_build/html."""

import re
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike
from sphinx.util.typing import stringify_annotation

import palpate

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project, author, copyright = "palpate", "The palpate authors", "The palpate authors"
version = release = palpate.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_copybutton", "mathml"]
exclude_patterns = ["_build", "study"]

myst_enable_extensions = ["colon_fence", "dollarmath", "deflist"]
myst_heading_anchors = 3
html_math_renderer = "mathml"

html_theme = "furo"
html_title = f"palpate {release}"
html_static_path = ["_static"]
html_css_files = ["palpate.css"]
html_show_sphinx = False

default_role = "literal"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints = "signature"
autodoc_class_signature = "separated"

ARRAY_LIKE = stringify_annotation(ArrayLike, "smart")
ARRAY = re.compile(r"~numpy\.ndarray\[.*?~numpy\.dtype\[[^]]*\]+")


def _tidy(app: Any, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """Make headings in docstrings rubrics."""
    for k, (line, below) in enumerate(pairwise(tuple(lines))):
        if line and below == "-" * len(line):
            lines[k : k + 2] = [f".. rubric:: {line}", ""]


def _as_written(app: Any, what: str, name: str, found: Any, options: Any, arguments: str, result: str) -> Any:
    """Call what NumPy's types stand for by their names."""
    return tuple(text and ARRAY.sub("NDArray", text.replace(ARRAY_LIKE, "ArrayLike")) for text in (arguments, result))


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", _tidy)
    app.connect("autodoc-process-signature", _as_written)
