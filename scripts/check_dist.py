"""Checks wheels and sdists in an empty environment: `make dist`, which builds them first.

    python scripts/check_dist.py dist            # install, run, and check the metadata
    python scripts/check_dist.py dist --write    # also write the sizes of what palpate installs to docs/study

The environment is in a temporary folder, and is removed. Exit code 1 names what failed.
"""

import json
import re
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
SIZES = ROOT / "docs/study/install.json"
PURPOSES = {
    "llvmlite, numba": "compile the solver where palpate came without machine code",
    "scipy": "rotations in space, and the fits of calibrations",
    "onnxruntime, flatbuffers, protobuf, packaging": "the touch models; Protobuf also reads recordings of Foxglove",
    "matplotlib, fonttools, kiwisolver, contourpy, pyparsing, cycler, python-dateutil, six": "the figure of a run",
    "numpy": "arrays",
    "rosbags, apsw, ruamel.yaml, ruamel.yaml.clib, backports.zstd, typing-extensions": "bags of ROS 1 and 2",
    "mcap, zstandard, lz4": "recordings, and bags in MCAP",
    "pillow": "JPEG and PNG images, byte by byte as they are",
    "shapely": "outlines that are read, checked and mended",
    "rich, pygments, markdown-it-py, mdurl, tyro, docstring-parser, typeguard": "the command line",
    "palpate": "palpate with its two touch models",
    "filelock, lazy-loader, tzdata": "small ones",
}
"""Packages that `pip install palpate` brings, and what each is for."""
OF_SIZES = """
import importlib.metadata, json
sizes = {}
for one in importlib.metadata.distributions():
    files = {file.locate() for file in one.files or ()}
    sizes[one.metadata["Name"].lower().replace("_", "-")] = sum(file.stat().st_size for file in files if file.is_file())
print(json.dumps(sizes))
"""


def main() -> int:
    """Check the distributions in a folder; return 1 if one fails."""
    folder = Path(sys.argv[1]).resolve()
    wheels = sorted(folder.glob("*.whl"))
    sdists = sorted(folder.glob("*.tar.gz"))
    if len(wheels) != 2 or len(sdists) != 2:
        print(f"{folder}: expected wheel and sdist of palpate and of palpate-lab, as `make dist` builds them")
        return 1
    core, lab = sorted(wheels, key=lambda wheel: "lab" in wheel.name)
    version = core.name.split("-")[1]
    (folder / "RELEASE_NOTES.md").write_text(release_notes(version), encoding="utf-8")
    with tempfile.TemporaryDirectory() as temporary:
        empty = Path(temporary)
        venv.create(empty / "venv", with_pip=True)
        before = set(installed(empty))
        install(empty, str(core))
        sizes = {name: size for name, size in installed(empty).items() if name not in before}
        print(f"pip install palpate: {sum(sizes.values()) / 1e6:.0f} MB in {len(sizes)} packages")
        if "--write" in sys.argv:
            SIZES.write_text(json.dumps(rows(sizes), indent=1) + "\n", encoding="utf-8")
        print(run(empty, "palpate", "--version"))
        install(empty, f"palpate-lab[sim] @ {lab.as_uri()}", "twine")
        run(empty, "palpate", "simulate", "pushes", "--shape", "rectangle", "--count", "1", "--seconds", "3")
        recording = next((empty / "pushes").glob("*.mcap"))
        summary = json.loads(run(empty, "palpate", "track", str(recording), "--out", "run", "--json"))
        print(f"a simulated push of {summary['frames']} frames is tracked: {summary['final_status']}")
        print(run(empty, "twine", "check", "--strict", *map(str, sorted([*wheels, *sdists]))))
    return 0


def release_notes(version: str) -> str:
    """Return the section of a version in CHANGELOG.md. Exits if there is none."""
    _, *sections = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    notes = next((section for section in sections if section.startswith(version)), None)
    if notes is None:
        sys.exit(f"CHANGELOG.md: there is no section ## {version}")
    return f"# palpate {notes.strip()}\n"


def installed(empty: Path) -> dict[str, int]:
    """Return the bytes of each package that is installed in an environment, with its compiled Python."""
    return json.loads(run(empty, "python", "-c", OF_SIZES))


def install(empty: Path, *requirements: str) -> None:
    """Install packages into an environment."""
    run(empty, "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *requirements)


def run(empty: Path, program: str, *words: str) -> str:
    """Run a program of an environment in its folder; return what it prints. Exits where it fails."""
    done = subprocess.run(
        [empty / "venv/bin" / program, *words], cwd=empty, capture_output=True, text=True, env={"PATH": "/usr/bin:/bin"}
    )
    if done.returncode:
        sys.exit(f"{program} {' '.join(words)}\n{done.stdout}{done.stderr}")
    return done.stdout.strip()


def rows(sizes: dict[str, int]) -> list[dict[str, Any]]:
    """Return groups of packages with their size [MB] and purpose, the largest first, and their sum."""
    groups = {names: [name.lower() for name in names.split(", ")] for names in PURPOSES}
    unknown = sizes.keys() - {name for group in groups.values() for name in group}
    if unknown:
        sys.exit(f"scripts/check_dist.py: PURPOSES does not say what {', '.join(sorted(unknown))} is for")
    found = [
        {"packages": names, "megabytes": megabytes(sizes.get(name, 0) for name in group), "purpose": PURPOSES[names]}
        for names, group in groups.items()
    ]
    found.sort(key=lambda row: -row["megabytes"])
    return [*found, {"packages": "all", "megabytes": megabytes(sizes.values()), "purpose": ""}]


def megabytes(sizes: Iterable[int]) -> float:
    """Return the sum of sizes [bytes] in MB, to a tenth."""
    return round(sum(sizes) / 1e6, 1)


if __name__ == "__main__":
    sys.exit(main())
