"""The cache of compiled code: damaged files, changed sources, and users without a home."""

import importlib.util
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import config

from palpate import compiled
from palpate.compiled import is_cached

SOURCE = """
from palpate.compiled import compiled

@compiled
def twice(number):
    return 2 * number
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The cache's folder for a module in tmp_path."""
    (tmp_path / "module.py").write_text(SOURCE)
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    found = Path(loaded(tmp_path)._cache.cache_path)
    assert found.is_relative_to(tmp_path / "cache")
    return found


def test_code_of_a_user_without_a_home_is_kept_in_a_temporary_place_and_linear_algebra_is_there(tmp_path):
    code = """
import numba, numpy, pwd, sys
def nobody(*_): raise KeyError
pwd.getpwuid = nobody
import palpate.compiled
assert (numba.njit(lambda a: numpy.linalg.inv(a))(numpy.eye(2)) == sys.modules["scipy.linalg"].inv(numpy.eye(2))).all()
sys.exit(numba.config.CACHE_DIR)
"""
    words = [sys.executable, "-c", code]
    environment = {"TMPDIR": str(tmp_path), "PYTHONPATH": ":".join(sys.path)}
    done = subprocess.run(words, env=environment, cwd=tmp_path, capture_output=True, text=True)
    folder = Path(done.stderr.strip())
    assert folder.parent == tmp_path and folder.stat().st_mode & 0o777 == 0o700 and not (tmp_path / "~").exists()


def loaded(folder: Path):
    """The function as a new process finds it."""
    spec = importlib.util.spec_from_file_location("module", folder / "module.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["module"] = module
    spec.loader.exec_module(module)
    return module.twice


def hits(function) -> int:
    assert function(21) == 42
    return sum(function.stats.cache_hits.values())


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["empty", "cut off", "foreign"])
def test_a_damaged_file_is_replaced(folder, tmp_path, kind, damage):
    assert hits(loaded(tmp_path)) == 0
    assert is_cached(loaded(tmp_path)) and hits(loaded(tmp_path)) == 1
    (path,) = folder.glob(f"*.{kind}")
    whole = path.read_bytes()
    path.write_bytes({"empty": b"", "cut off": whole[: len(whole) // 2], "foreign": pickle.dumps(["a list"])}[damage])
    assert hits(loaded(tmp_path)) == 0
    assert hits(loaded(tmp_path)) == 1


def test_code_of_other_sources_is_compiled_anew(folder, tmp_path, monkeypatch):
    assert hits(loaded(tmp_path)) == 0
    monkeypatch.setattr(compiled, "_sources", lambda: "a kernel in another file has changed")
    assert not is_cached(loaded(tmp_path)) and hits(loaded(tmp_path)) == 0
    assert hits(loaded(tmp_path)) == 1


def test_numba_has_the_private_parts_that_compiled_py_uses():
    import numba
    from numba.core.caching import FunctionCache
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import Compiler

    used = {
        FunctionCache: ("_index_key", "load_overload", "flush"),
        JITCodeLibrary: ("finalize", "_get_module_for_linking"),
        Compiler: ("define_pipelines",),
    }
    lacking = [
        f"{owner.__name__}.{name}" for owner, names in used.items() for name in names if not hasattr(owner, name)
    ]
    assert not lacking, f"numba {numba.__version__} lacks {lacking}: mend compiled.py, then raise the ceiling of numba"
