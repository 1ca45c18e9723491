"""Runs all tests with the lowest and the highest versions that pyproject.toml allows, on each Python there is.

    python scripts/test_matrix.py [--python 3.11 3.12 3.13] [--tests tests/formats ...]

Every combination gets an environment of its own, which goes when it is done; before the tests the wheel alone, without
extras, tracks a recording. Needs uv, which knows how to resolve to lowest versions.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import tyro

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
LOWEST = PYTHONS[0]
"""Lowest versions are of this Python: later ones need later versions."""
ALONE = """
import sys
from recording_samples import pushed
from palpate.formats.palpate_h5 import write_recording
write_recording(pushed(), sys.argv[1])
"""


def run(*words: str | Path, **environment: str) -> None:
    """Run a program in the repository; an error where it fails."""
    subprocess.run([str(word) for word in words], cwd=ROOT, check=True, env=os.environ | environment)


def try_out(python: str, resolution: str, tests: tuple[str, ...], folder: Path) -> None:
    """Make an environment and run the tests in it; an error where they fail."""
    environment = folder / "environment"
    bin = environment / "bin"
    run("uv", "venv", "--quiet", "--python", python, "--no-python-downloads", environment)
    install = ("uv", "pip", "install", "--quiet", "--python", bin / "python", "--resolution", resolution)
    run("uv", "build", "--quiet", "--wheel", "--out-dir", folder)
    (wheel,) = folder.glob("*.whl")
    run(*install, wheel)
    run(bin / "python", "-c", ALONE, folder / "push.h5", PYTHONPATH=str(ROOT / "tests"))
    run(bin / "palpate", "track", folder / "push.h5", "--tactile", "oracle", "--out", folder / "run")
    run(*install, f"{wheel}[dev]")
    # Old libraries warn of new ones that they bring; that is no fault of ours.
    warnings = ("-o", "filterwarnings=default") if resolution == "lowest-direct" else ()
    run(bin / "python", "-m", "pytest", "-n", "2", "-p", "no:cacheprovider", *warnings, *tests)


def test_matrix(python: tuple[str, ...] = PYTHONS, tests: tuple[str, ...] = ("tests",)) -> int:
    """Try out every combination and print a line for each; the exit code is 1 where one failed."""
    if shutil.which("uv") is None:
        sys.exit("uv is not installed: pip install uv")
    lines, failed = [], False
    for version in python:
        find = ["uv", "python", "find", "--no-python-downloads", version]
        if subprocess.run(find, capture_output=True, check=False).returncode:
            lines.append(f"{version}: skipped, there is no such Python on this machine")
            continue
        for resolution in ("lowest-direct", "highest") if version == LOWEST else ("highest",):
            with tempfile.TemporaryDirectory() as folder:
                try:
                    try_out(version, resolution, tests, Path(folder))
                    lines.append(f"{version}, {resolution}: passed")
                except subprocess.CalledProcessError as error:
                    lines.append(f"{version}, {resolution}: FAILED at {' '.join(error.cmd[:4])} ...")
                    failed = True
    print("\n".join(lines))
    return int(failed)


if __name__ == "__main__":
    sys.exit(tyro.cli(test_matrix))
