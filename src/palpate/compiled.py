"""Numba, set up once, and a cache of machine code that replaces files it cannot use.

Functions that Python calls are `compiled`: at their first call, or loaded from Numba's cache. Functions that only these
call are `kernel`s: machine code in their callers alone, without an entry for Python, in a quarter of the time.
"""

import hashlib
import os
import re
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numba
from numba.core import config
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

_IMPORT = re.compile(r"^(?:from|import) (palpate[\w.]*)", re.MULTILINE)
F = TypeVar("F", bound=Callable[..., object])
if not {"NUMBA_CACHE_DIR", "XDG_CACHE_HOME"} & set(os.environ):
    try:
        Path.home()
    except RuntimeError:  # the user has none, and Numba would make a folder "~" where palpate is run
        folder = Path(tempfile.gettempdir()) / f"palpate-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        if folder.lstat().st_uid != os.getuid():  # somebody else's code is not run
            folder = Path(tempfile.mkdtemp(prefix="palpate-"))
        config.CACHE_DIR = str(folder)  # pyright: ignore

# Numba looks if SciPy's linear algebra is there, which takes 0.1 s and 15 MB, and imports it again where it is used.
if "scipy.linalg" not in sys.modules:
    for name in ("scipy.linalg", "scipy.linalg.cython_blas"):
        sys.modules[name] = ModuleType(name)
    import numba.np.arraymath

    del sys.modules["scipy.linalg"], sys.modules["scipy.linalg.cython_blas"]


def kernel(function: F, **options: Any) -> F:
    """Compile a function into the compiled functions that call it; Python cannot call it."""
    return _jit(
        function,
        no_cpython_wrapper=True,
        no_cfunc_wrapper=True,
        _nrt=False,  # nothing is made, so nothing is counted: that took a fifth of the time
        pipeline_class=_KernelCompiler,
        **options,
    )


def compiled(function: F, **options: Any) -> F:
    """Compile a function with Numba at its first call, or load it from Numba's cache.

    It runs without the interpreter's lock, so that trackers in several threads share the cores.
    """
    made: Any = _jit(function, nogil=True, **options)
    with suppress(RuntimeError):  # no folder for a cache can be written
        made._cache = _Cache(function)
    return made


def is_cached(function: Any) -> bool:
    """Return True where code of a compiled function is in the cache."""
    try:
        return bool(function._cache._cache_file._load_index())
    except Exception:  # whatever a foreign pickle raises, or no cache
        return False


def cache_folder(function: Any) -> str:
    """Return the folder in which code of a compiled function is kept; empty where it cannot be."""
    return getattr(function._cache, "cache_path", None) or ""


def hash_of(path: Path) -> str:
    """Return a short hash of a file of generated code, for the names of functions that it is compiled into."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12]


def _jit(function: F, **options: Any) -> F:
    # Division by zero gives inf as in NumPy; a check would cost time in every loop.
    return numba.njit(error_model="numpy", **options)(function)  # pyright: ignore[reportReturnType]


class _KernelLibrary(JITCodeLibrary):
    """Code of a kernel, which is neither optimised nor made machine code before it is part of a caller."""

    @property
    def codegen(self) -> Any:
        """Itself, as it has no place in the engine: Numba asks that for the next only."""
        return self

    def set_env(self, *_: object) -> None:
        """Keep no objects: kernels use none."""

    def finalize(self) -> None:
        """Add what the kernel calls."""
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


class _KernelCompiler(Compiler):
    def __init__(self, typing: Any, target: Any, _library: None, *given: Any) -> None:
        super().__init__(typing, target, _KernelLibrary(target.codegen(), "kernel"), *given)


class _Cache(FunctionCache):
    """Numba's cache of a function, which replaces unreadable files and code that was made from other sources."""

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)
        # Numba itself looks only at the function's own file, not at those of the kernels in it.
        self._cache_file._source_stamp = _sources(), self._cache_file._source_stamp

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return what tells compiled functions of one file apart: signature, processor and bytecode.

        Kernels that a function closes over are in the stamp of all sources. Numba's own key holds what they are in this
        process, so that no other one finds the code (numba#6264).
        """
        code = hashlib.sha256(self._py_func.__code__.co_code).hexdigest()
        return sig, codegen.magic_tuple(), code

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function of a signature; None if there is none, or none that can be read."""
        try:
            found = super().load_overload(sig, target_context)
            if found:  # what other functions would be compiled from takes megabytes
                found.library._shared_module = None
            return found
        except Exception:  # whatever a foreign pickle raises
            self.flush()
            return None


@cache
def _sources() -> str:
    """Return a hash of the source of all kernels, and of all files of palpate that these import constants from."""
    package = Path(__file__).parent
    text = {path: path.read_text(encoding="utf-8") for path in package.rglob("*.py")}
    used = {path for path, source in text.items() if "palpate.compiled import" in source}
    waiting = list(used)
    while waiting:
        for module in _IMPORT.findall(text[waiting.pop()]):
            stem = package.joinpath(*module.split(".")[1:])
            for path in (stem.with_suffix(".py"), stem / "__init__.py"):
                if path in text and path not in used:
                    used.add(path)
                    waiting.append(path)
    digest = hashlib.sha256()
    for path in sorted(used):
        digest.update(f"{path.relative_to(package)}\0{text[path]}".encode())
    return digest.hexdigest()
