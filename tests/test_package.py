"""The package from outside: what `import palpate` brings."""

import ast
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import palpate


def test_importing_palpate_imports_nothing_that_is_slow():
    words = [sys.executable, "-c", "import sys, palpate; print(*sys.modules)"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    loaded = done.stdout.split()
    assert "palpate" in loaded
    assert {"numba", "scipy", "gtsam", "numpy", "palpate.tracker"}.isdisjoint(loaded)


CHANGED_DEFAULTS = """
from dataclasses import dataclass
from palpate.types import choices

@dataclass(frozen=True)
class Changed(choices.TrackerChoices):
    tactile: str = "none"
    smoother: str = "batch"
    hypotheses: int = 3

@dataclass(frozen=True)
class Moved(choices.Placement):
    time_offset: float = 0.25
    off_plane: float = 0.5

choices.TrackerChoices = Changed
choices.Placement = Moved

from inspect import signature
import palpate
from palpate.cli.options import Estimator, Touch

settings = palpate.TrackerSettings()
assert (settings.tactile, settings.smoother, settings.hypotheses) == ("none", "batch", 3), settings
assert Estimator().settings(Touch().tactile) == settings, "the command line has other defaults"
arguments = signature(palpate.Recording.from_arrays).parameters
assert (arguments["time_offset"].default, arguments["off_plane"].default) == (0.25, 0.5), arguments
"""


def test_python_and_the_command_line_have_one_source_of_defaults():
    done = subprocess.run([sys.executable, "-c", CHANGED_DEFAULTS], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")


def test_palpate_imports_nothing_of_its_laboratory():
    package = Path(palpate.__file__).parent
    for path in package.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            words = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            words += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            words += [node.value] if isinstance(node, ast.Constant) and isinstance(node.value, str) else []
            assert not any(word.startswith("palpate_lab") for word in words), f"{path}:{getattr(node, 'lineno', 0)}"


def test_every_public_name_is_there():
    package: Any = palpate
    assert {"Tracker", "TrackerSettings", "NoiseSettings", "Frame", "ObjectPose", "OwnMeasurement"} <= set(dir(package))
    assert set(package.__all__) <= set(dir(package))
    assert all(getattr(package, name) is not None for name in package.__all__)
    with pytest.raises(AttributeError, match="Feeling"):
        assert package.Feeling
