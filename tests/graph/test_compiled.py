"""Where compiled functions are kept, and that the package runs where it may write nothing of its own."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import palpate
from palpate.graph.compiled import all_is_compiled, cache_folder, compiled, is_cached

PACKAGE = Path(palpate.__file__).parent
RUN = """
from palpate.graph.compiled import all_is_compiled, cache_folder, is_cached
from palpate.graph.se2_kernels import wrap
before = is_cached()
assert abs(wrap(4.0) - (4.0 - 6.283185307179586)) < 1e-15
all_is_compiled()
print(cache_folder(), before, is_cached(), sep="\\n")
"""


def chosen() -> Path:
    """The folder that is chosen where nothing was chosen yet."""
    return cache_folder.__wrapped__()


def run(environment: dict[str, str], temporary: Path, package: Path = PACKAGE) -> tuple[Path, bool, bool]:
    """The cache's folder, and whether anything was in it before and after, of another process.

    The environment says nothing of caches but what is given.
    """
    rest = {name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    paths = {"PYTHONPATH": str(package.parent), "TMPDIR": str(temporary), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", RUN], env=rest | paths | environment, check=True, capture_output=True, text=True
    )
    folder, before, after = done.stdout.splitlines()
    return Path(folder), before == "True", after == "True"


def test_the_folder_that_is_asked_for_comes_first(tmp_path, monkeypatch):
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert chosen().parent == tmp_path / "home" / ".cache" / "palpate"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert chosen().parent == tmp_path / "xdg" / "palpate"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    assert chosen().parent == tmp_path / "numba"


def test_a_folder_that_cannot_be_written_is_passed_over(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.setenv(name, str(blocked))
    folder = chosen()
    assert folder.parent.parent == tmp_path / "temporary" and folder.parent.name.startswith("palpate-")
    # Not even that, as of another user: a folder that nobody has yet.
    shutil.rmtree(folder.parent)
    folder.parent.write_text("not a folder")
    assert chosen().parent == tmp_path / "temporary" and chosen() != folder.parent


def test_without_a_home_the_package_runs_and_keeps_what_it_compiled(tmp_path):
    nowhere = {"HOME": "/dev/null"}
    folder, before, after = run(nowhere, tmp_path)
    assert folder.is_relative_to(tmp_path)
    assert (before, after) == (False, True)
    assert run(nowhere, tmp_path) == (folder, True, True)


def test_a_package_that_is_installed_read_only_is_left_as_it_is(tmp_path):
    installed = tmp_path / "site" / "palpate"
    shutil.copytree(PACKAGE, installed, ignore=shutil.ignore_patterns("*.onnx", "__pycache__"))
    listed = sorted(installed.rglob("*"))
    for path in [*listed, installed]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    try:
        folder, _, after = run({"XDG_CACHE_HOME": str(tmp_path / "cache")}, tmp_path, installed)
    finally:
        for path in [installed, *listed]:
            path.chmod(0o755 if path.is_dir() else 0o644)
    assert folder.is_relative_to(tmp_path / "cache") and after
    assert sorted(installed.rglob("*")) == listed
    # Other sources have another folder: old machine code is never run.
    source = installed / "estimation" / "planar.py"
    source.write_text(source.read_text() + "\n# changed\n")
    changed, before, _ = run({"XDG_CACHE_HOME": str(tmp_path / "cache")}, tmp_path, installed)
    assert changed.parent == folder.parent and changed != folder and not before


def test_what_is_compiled_divides_as_numpy_does():
    @compiled
    def divided(a: float, b: float) -> float:
        return a / b

    assert divided(1.0, 0.0) == float("inf")
    assert divided(1.0, 4.0) == 0.25


def test_a_first_run_is_told(monkeypatch, tmp_path):
    assert is_cached()  # by the tests before this one
    monkeypatch.setattr("palpate.graph.compiled.cache_folder", lambda: tmp_path)
    assert not is_cached()
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "some.nbc").touch()  # as of a command that needs one function
    assert not is_cached()
    all_is_compiled()
    assert is_cached()


def test_all_that_is_compiled_is_in_rooms_that_the_folder_is_named_after():
    users = [path for path in PACKAGE.rglob("*.py") if "@compiled" in path.read_text()]
    rooms = {path.relative_to(PACKAGE).parts[0] for path in users}
    assert rooms <= {"estimation", "touch"}
