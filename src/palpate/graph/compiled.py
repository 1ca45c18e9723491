"""Numba, set up once, and a cache of machine code that replaces files it cannot use.

Functions that Python calls are `compiled`: at their first call, or loaded from Numba's cache. Functions that only these
call are `kernel`s: they are compiled into their callers, without an entry for Python, which takes a third of the time.
"""

import hashlib
import logging
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core import config
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numpy.typing import NDArray

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
Records = Any
"""An array of a structured type, or one element of it, whose fields compiled code reads and sets by name."""
F = TypeVar("F", bound=Callable[..., object])
if not {"NUMBA_CACHE_DIR", "XDG_CACHE_HOME"} & set(os.environ):
    try:
        Path.home()
    except RuntimeError:  # the user has none, and Numba would make a folder "~" where palpate is run
        config.CACHE_DIR = str(Path(tempfile.gettempdir()) / f"palpate-{os.getuid()}")  # pyright: ignore


def kernel(function: F) -> F:
    """Compile a function into the compiled functions that call it; Python cannot call it."""
    return _jit(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def compiled(function: F) -> F:
    """Compile a function with Numba at its first call, or load it from Numba's cache."""
    return _cached(_jit(function))


def compiled_to_sum(function: F) -> F:
    """Compile likewise a function whose sums may be taken in any order, and so several terms at a time."""
    return _cached(_jit(function, fastmath={"reassoc"}))


def folder_of(function: Any) -> Path | None:
    """Return the folder in which code of a compiled function is kept, if it is."""
    return Path(function._cache.cache_path) if isinstance(function._cache, _Cache) else None


def is_cached(function: Any) -> bool:
    """Return True where code of a compiled function is in the cache."""
    return isinstance(function._cache, _Cache) and function._cache.is_filled()


def _jit(function: F, **options: Any) -> F:
    # Division by zero gives inf as in NumPy; a check would cost time in every loop.
    return numba.njit(error_model="numpy", **options)(function)  # pyright: ignore[reportReturnType]


def _cached(function: Any) -> Any:
    try:
        found = _Cache(function.py_func)
    except RuntimeError:  # no folder for a cache can be written
        return function
    if _is_safe(Path(found.cache_path)):
        function._cache = found
    return function


class _Cache(FunctionCache):
    """Numba's cache of a function, which replaces unreadable files and code that was made from other sources."""

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)
        # Numba itself looks only at the function's own file, not at those of the kernels in it.
        stamp = _sources(), self._impl.locator.get_source_stamp()
        self._cache_file = IndexDataCacheFile(self._cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function of a signature; None if there is none, or none that can be read."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:  # whatever a foreign pickle raises
            logger.debug("%s: compiled anew, since its file in %s is damaged: %r", self._name, self._cache_path, error)
            self.flush()
            return None

    def is_filled(self) -> bool:
        """Return True where there is code of these sources."""
        try:
            return bool(self._cache_file._load_index())
        except Exception:  # as above
            return False


@cache
def _sources() -> str:
    """Return a hash of the source of all kernels."""
    every = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in every)).hexdigest()


@cache
def _is_safe(folder: Path) -> bool:
    """Return True unless a folder is in a temporary place and others may write to it, since its code is executed."""
    place, found = Path(tempfile.gettempdir()).resolve(), folder.resolve()
    if os.name != "posix" or place not in found.parents:
        return True
    of_place = [folder.stat() for folder in (found, *found.parents) if place in folder.parents]
    if all(status.st_uid == os.geteuid() and not status.st_mode & 0o022 for status in of_place):
        return True
    logger.warning("compiled code is not kept in %s, since other users can write to it", folder)
    return False
