"""Libraries of machine code, where they are kept, and how they are found.

A library holds one compiled function. Its name has a hash of its own file, of all of palpate that it may be made from,
of the types of its arguments and the level of processors, so that other code is never taken. Its last bytes are a hash
of the rest, so that a damaged file is made anew. It comes with palpate (`hatch_build.py`), or is made at first use and
kept in the user's cache: `PALPATE_CACHE`, or a folder `palpate` in `XDG_CACHE_HOME` or `~/.cache`.
"""

import ctypes
import hashlib
import os
import platform
import re
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.errors import FileError
from palpate.files import whole_file

if TYPE_CHECKING:
    from palpate.compiled import Compiled

PACKAGE = Path(__file__).parents[1]
WITH_PALPATE = PACKAGE / "compiled" / "libraries"
"""Folder of libraries that come with palpate."""
LEVELS = {"x86-64-v4": ({"X86_V4"}, {"AVX512_SKX"}), "x86-64-v3": ({"X86_V3"}, {"AVX2", "FMA3"}), "generic": (set(),)}
"""Levels of processors that there is code for, as LLVM names them, the best first, each with sets of features of which
one is enough, as NumPy names them. Code for the last one runs on all of a kind; its loops over images take two to
three times as long as with AVX2."""
_KEPT_DAYS = 30  # for which code of other versions of palpate is kept
_IMPORT = re.compile(r"^(?:from|import) (palpate[\w.]*)", re.MULTILINE)
_DIGEST = 32  # bytes of a hash


def code_of(compiled: "Compiled") -> Callable[[bytes], int]:
    """Return the code of a function, which takes its packed numbers; it is made if there is none."""
    path = path_of(compiled)
    address = _loaded(path, compiled.name) if path else None
    if address is None:
        address = _loaded(make(compiled, cache_folder(), level()), compiled.name)
    assert address is not None, f"the library of {compiled.name} was made and cannot be loaded"
    return ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_char_p)(address)


def path_of(compiled: "Compiled") -> Path | None:
    """Return the file with the code of a function, None if there is none."""
    stem = _stem(compiled, level())
    for folder in (WITH_PALPATE, cache_folder()):
        for suffix in (".so", ".o"):
            path = folder / f"{stem}{suffix}"
            with suppress(OSError):
                whole = path.read_bytes()
                if hashlib.sha256(whole[:-_DIGEST]).digest() == whole[-_DIGEST:]:
                    return path
    return None


def make(compiled: "Compiled", folder: Path, level: str) -> Path:
    """Make the library of a function for a level of processors in a folder, and return its path.

    Raises FileError where it cannot be written.
    """
    from palpate.compiled.build import library

    made, suffix = library(compiled, level)
    path = folder / f"{_stem(compiled, level)}{suffix}"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for other in folder.glob(f"{compiled.name}-{level}-*"):
            if time.time() - other.stat().st_mtime > _KEPT_DAYS * 24 * 3600:
                other.unlink(missing_ok=True)
        with whole_file(path, overwrite=True) as part:
            part.write_bytes(made + hashlib.sha256(made).digest())
    except OSError as error:
        raise FileError(
            f"{folder}: compiled code cannot be kept ({error.strerror}); set PALPATE_CACHE to a folder that only you "
            "can write to"
        ) from error
    return path


@cache
def level() -> str:
    """Return the level of this machine's processor."""
    known: Any = np.show_config(mode="dicts")
    features = {feature for some in known["SIMD Extensions"].values() for feature in some}
    return next(name for name, sets in LEVELS.items() if any(needed <= features for needed in sets))


@cache
def cache_folder() -> Path:
    """Return the user's folder for code; one that only this process knows where none can be written."""
    named = os.environ.get("PALPATE_CACHE")
    if named:
        return Path(named)
    with suppress(OSError, RuntimeError):  # no home, or one that cannot be written
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "palpate"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    import tempfile

    folder = Path(tempfile.gettempdir()) / f"palpate-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.lstat().st_uid != os.getuid():  # somebody else's code is not run
        folder = Path(tempfile.mkdtemp(prefix="palpate-"))
    return folder


def hash_of(path: Path) -> str:
    """Return a short hash of a file of generated code, for the names of functions that it is compiled into."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12]


def _loaded(path: Path, name: str) -> int | None:
    """Return the address of a function of a library; None where it cannot be loaded."""
    if path.suffix == ".o":
        from palpate.compiled.build import linked_in_memory

        return linked_in_memory(path.read_bytes()[:-_DIGEST], name)
    with suppress(OSError, AttributeError):
        return ctypes.cast(getattr(ctypes.CDLL(str(path)), name), ctypes.c_void_p).value
    return None


def _stem(compiled: "Compiled", level: str) -> str:
    """Return the name of a library for a level of processors, without its suffix."""
    own = hash_of(Path(compiled.function.__code__.co_filename))  # which may be a file of the laboratory, or a user's
    kind = f"{_sources()} {own} {platform.machine()} {_types(compiled.example)} {sorted(compiled.options.items())}"
    return f"{compiled.name}-{level}-{hashlib.sha256(kind.encode()).hexdigest()[:16]}"


def _types(example: Any) -> str:
    """Return the types of arguments in words."""
    if isinstance(example, tuple):
        return f"{type(example).__name__}({', '.join(_types(part) for part in example)})"
    if hasattr(example, "dtype"):
        return f"{example.dtype.descr}[{example.ndim}]"
    return type(example).__name__


@cache
def _sources() -> str:
    """Return a hash of the source of all kernels, and of all files of palpate that these import constants from."""
    text = {path: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    used = {path for path, source in text.items() if "palpate.compiled import" in source}
    waiting = list(used)
    while waiting:
        for module in _IMPORT.findall(text[waiting.pop()]):
            stem = PACKAGE.joinpath(*module.split(".")[1:])
            for path in (stem.with_suffix(".py"), stem / "__init__.py"):
                if path in text and path not in used:
                    used.add(path)
                    waiting.append(path)
    digest = hashlib.sha256()
    for path in sorted(used):
        digest.update(f"{path.relative_to(PACKAGE)}\0{text[path]}".encode())
    return digest.hexdigest()
