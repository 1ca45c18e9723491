"""Finds the pose of an object by touch: tactile images and sensor poses in, object pose with covariance out.

The public names stand in `__init__.pyi` and are imported when they are first used, so that `import palpate` is quick.
"""

from typing import Any

import lazy_loader

__version__ = "0.1.0"

_imported, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    from palpate.field_docs import with_field_docs

    return with_field_docs(_imported(name))
