"""Finds the pose of an object by touch: tactile images and sensor poses in, object pose with covariance out.

The public names are listed in `__init__.pyi` and imported when first used, so that `import palpate` is quick.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
