"""Runs all tests with the lowest and the highest versions that pyproject.toml allows, on each Python there is.

    python scripts/test_matrix.py [--python 3.11 3.12 3.13] [--tests tests/formats ...] [--into FILE.json]

Every combination gets an environment of its own, which goes when it is done; before the tests the wheel alone, without
extras, tracks a recording. Needs uv, which knows how to resolve to lowest versions. Packages that UV_EXCLUDE names are
left out, and pyenv shows uv the Pythons that PYENV_VERSION names. What was found is kept in FILE.json, with versions.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import tyro

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
LOWEST = PYTHONS[0]
"""Lowest versions are of this Python: later ones need later versions."""
ALONE = """
import sys
from recording_samples import pushed
from palpate.io.palpate_h5 import write_recording
write_recording(pushed(), sys.argv[1])
"""


def run(*words: str | Path, **environment: str) -> None:
    """Run a program in the repository; an error where it fails."""
    subprocess.run([str(word) for word in words], cwd=ROOT, check=True, env=os.environ | environment)


def try_out(python: str, resolution: str, tests: tuple[str, ...], folder: Path, found: dict[str, Any]) -> None:
    """Make an environment, run the tests in it and note versions and counts; an error where they fail."""
    environment = folder / "environment"
    bin = environment / "bin"
    run("uv", "venv", "--quiet", "--seed", "--python", python, "--no-python-downloads", environment)
    install = ("uv", "pip", "install", "--quiet", "--python", bin / "python", "--resolution", resolution)
    run("uv", "build", "--quiet", "--wheel", "--out-dir", folder)
    (wheel,) = folder.glob("*.whl")
    # Of a wheel, lowest-direct is the wheel alone: what it needs is named here.
    needs = (*install, "--requirements", ROOT / "pyproject.toml")
    run(*needs)
    run(*install, "--no-deps", wheel)
    run(bin / "python", "-c", ALONE, folder / "push.h5", PYTHONPATH=str(ROOT / "tests"))
    run(bin / "palpate", "track", folder / "push.h5", "--tactile", "oracle", "--out", folder / "run")
    run(*needs, "--extra", "dev")
    listed = ("uv", "pip", "list", "--quiet", "--format", "json", "--python", str(bin / "python"))
    said = subprocess.run(listed, capture_output=True, check=True).stdout
    found["versions"] = {each["name"]: each["version"] for each in json.loads(said)}
    # Old libraries warn of new ones that they bring; that is no fault of ours.
    warnings = ("-o", "filterwarnings=default") if resolution == "lowest-direct" else ()
    counted = folder / "tests.xml"
    pytest = bin / "python", "-m", "pytest", "-n", "2", "-p", "no:cacheprovider", f"--junitxml={counted}"
    try:
        run(*pytest, *warnings, *tests)
    finally:
        if counted.exists():
            suite = ElementTree.parse(counted).find("testsuite")
            assert suite is not None
            found |= {name: int(suite.attrib[name]) for name in ("tests", "failures", "errors", "skipped")}


def test_matrix(
    python: tuple[str, ...] = PYTHONS, tests: tuple[str, ...] = ("tests",), into: Path | None = None
) -> int:
    """Try out every combination and print a line for each; the exit code is 1 where one failed."""
    if shutil.which("uv") is None:
        sys.exit("uv is not installed: pip install uv")
    cells, failed = dict[str, dict[str, Any]](), False
    for version in python:
        find = ["uv", "python", "find", "--no-python-downloads", version]
        there = subprocess.run(find, capture_output=True, check=False).returncode == 0
        for resolution in ("lowest-direct", "highest") if version == LOWEST else ("highest",):
            found = cells[f"{version}, {resolution}"] = dict[str, Any](outcome="skipped: uv finds no such Python")
            if there:
                with tempfile.TemporaryDirectory() as folder:
                    try:
                        try_out(version, resolution, tests, Path(folder), found)
                        found["outcome"] = "passed"
                    except subprocess.CalledProcessError as error:
                        found["outcome"] = f"FAILED at {' '.join(error.cmd[:4])} ..."
                        failed = True
            if into is not None:
                into.write_text(json.dumps(cells, indent=1) + "\n", encoding="utf-8")
    lines = [f"{name}: {found['outcome']}" for name, found in cells.items()]
    print("\n".join(lines))
    return int(failed)


if __name__ == "__main__":
    sys.exit(tyro.cli(test_matrix))
