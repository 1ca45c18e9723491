"""Compiled functions: their arguments, damaged libraries, changed sources, machines without a linker, and no home."""

import importlib
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from palpate.compiled import Compiled, compiled, kernel, library


class Line(NamedTuple):
    offset: complex
    slopes: Any


@kernel
def along(line, x: float) -> complex:
    return line.offset + complex(line.slopes[0], line.slopes[1]) * x


def put(points, line, count):
    for k in range(count):
        points[k].at = along(line, points[k].x)


POINTS = np.dtype([("x", "f8"), ("at", "c16")])


def function() -> Any:
    """The function as a new process finds it."""
    return compiled(np.zeros(1, POINTS), Line(0j, np.zeros(2)), 0, name="put_test")(put)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(library, "cache_folder", lambda: tmp_path)
    return tmp_path


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of functions that are compiled."""
    names: list[str] = []
    build = importlib.import_module("palpate.compiled.build")
    make = build.library

    def noted(one: Compiled, level: str) -> tuple[bytes, str]:
        names.append(one.name)
        return make(one, level)

    monkeypatch.setattr(build, "library", noted)
    return names


def check(put_points: Any) -> None:
    points = np.zeros(3, POINTS)
    points["x"] = (1.0, 2.0, 3.0)
    put_points(points, Line(1j, np.array([2.0, 3.0])), 2)
    assert points["at"].tolist() == [2 + 4j, 4 + 7j, 0]


def test_a_library_is_made_once(folder, made):
    for _ in range(2):
        check(function())
    assert made == ["put_test"]


def test_the_code_is_the_same_without_a_linker(folder, made, monkeypatch):
    monkeypatch.setenv("PATH", "")
    for _ in range(2):
        check(function())
    assert made == ["put_test"] and [path.suffix for path in folder.iterdir()] == [".o"]


@pytest.mark.parametrize("damage", ["empty", "cut off", "foreign"])
def test_a_damaged_library_is_made_anew(folder, made, damage):
    check(function())
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.unlink()  # this process still runs code of the whole file
    path.write_bytes({"empty": b"", "cut off": whole[: len(whole) // 2], "foreign": b"a list" * 99}[damage])
    for _ in range(2):
        check(function())
    assert made == ["put_test"] * 2


def test_code_of_other_sources_or_types_is_not_taken(folder, made, monkeypatch):
    check(function())
    other = compiled(np.zeros(1, POINTS), Line(0j, np.zeros(2)), 0.0, name="put_test")
    assert library.path_of(function()) and library.path_of(other(put)) is None
    monkeypatch.setattr(library, "_sources", lambda: "a kernel in another file has changed")
    assert library.path_of(function()) is None
    check(function())
    assert made == ["put_test"] * 2 and len(list(folder.iterdir())) == 2  # another checkout may use the first


def test_code_that_is_long_out_of_use_is_removed(folder):
    old = folder / f"put_test-{library.level()}-0123456789abcdef.so"
    old.write_bytes(b"")
    os.utime(old, (0.0, 0.0))
    check(function())
    assert not old.exists()


@pytest.mark.parametrize(
    "points", [np.zeros(6, POINTS)[::2], np.zeros((1, 3), POINTS), np.zeros(3)], ids=["strided", "axes", "type"]
)
def test_arrays_unlike_the_example_are_refused(folder, points):
    with pytest.raises(TypeError):
        function()(points, Line(1j, np.zeros(2)), 2)


def test_other_threads_run_meanwhile(folder):
    def busy(numbers, stop, rounds):
        for k in range(rounds):
            numbers[0] += 1.0
            if stop[0] > 0.0:
                numbers[1] = k
                break

    numbers = np.zeros(2)
    stop = np.zeros(1)
    timer = threading.Timer(0.05, stop.fill, (1.0,))
    run = compiled(np.zeros(1), np.zeros(1), 0, name="busy_test")(busy)
    run.load()
    timer.start()
    run(numbers, stop, 10**12)
    assert numbers[1] > 0.0


def test_code_of_a_user_without_a_home_is_kept_in_a_temporary_place_of_their_own(tmp_path):
    code = """
import pwd, sys
def nobody(*_): raise KeyError
pwd.getpwuid = nobody
from palpate.compiled.library import cache_folder
sys.exit(str(cache_folder()))
"""
    environment = {"TMPDIR": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    found = Path(done.stderr.strip())
    assert found.parent == tmp_path and found.stat().st_mode & 0o777 == 0o700 and not (tmp_path / "~").exists()
