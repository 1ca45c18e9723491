"""Compiling numerical functions with Numba, once for each version of the code and each machine's cache.

`compiled` is what compiled functions are decorated with. What it makes is kept in a folder of the
user's cache that is named after the sources, so that a new version never runs old machine code and a package that is
installed read-only works like any other.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core import config as numba_config
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Places = NDArray[np.int64]
Records = Any
"""An array of a structured type, or one element of it, whose fields compiled code reads and sets by name."""
Given = tuple[Any, ...]
"""Settings of a factor as its kernel takes them."""
_COMPILED = ("graph", "filter", "lab/paper", "touch")  # rooms with compiled functions
F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a function with Numba at its first call, or load what was compiled before."""
    return _compiled(function)


def compiled_to_sum(function: F) -> F:
    """Compile likewise a function whose sums may be taken in any order, and so several terms at a time."""
    return _compiled(function, fastmath={"reassoc"})


def _compiled(function: F, **options: Any) -> F:
    with _numba_keeps_its_files_in(cache_folder()):
        # Division by zero gives inf as in NumPy; a check would cost time in every loop.
        return numba.njit(cache=True, error_model="numpy", **options)(function)  # pyright: ignore[reportReturnType]


@cache
def cache_folder() -> Path:
    """Return the folder of compiled functions: in NUMBA_CACHE_DIR, the user's cache or, at worst, a temporary one."""
    given, cache_home = os.environ.get("NUMBA_CACHE_DIR"), os.environ.get("XDG_CACHE_HOME")
    candidates = [
        Path(given) if given else None,
        Path(cache_home) / "palpate" if cache_home else None,
        Path("~/.cache/palpate").expanduser(),
        Path(tempfile.gettempdir()) / f"palpate-{os.getuid() if hasattr(os, 'getuid') else 'cache'}",
    ]
    for candidate in candidates:
        if candidate is not None and _writable(folder := candidate / _fingerprint()):
            return folder
    return Path(tempfile.mkdtemp(prefix="palpate-"))


def is_cached() -> bool:
    """Return whether all was compiled for this version before: if not, a first run takes a while."""
    return _mark().exists()


def all_is_compiled() -> None:
    """Mark this version as compiled; call it only after everything was."""
    with suppress(OSError):  # a cache that is full, or someone else's
        _mark().touch()


def _mark() -> Path:
    return cache_folder() / "all-is-compiled"


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _fingerprint() -> str:
    """Hash of all sources: a change in one file can change machine code compiled from another."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(source for room in _COMPILED for source in (Path(__file__).parents[1] / room).rglob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


@contextmanager
def _numba_keeps_its_files_in(folder: Path) -> Iterator[None]:
    config: Any = numba_config
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder)
    try:
        yield
    finally:
        config.CACHE_DIR = before
