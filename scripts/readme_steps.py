"""Runs the commands and the Python of a README, from its first section on use to the end of that on own data.

    python scripts/readme_steps.py README.md            # with --short, of a simulation of three seconds

They run in the current folder, one after the other, as a reader would; what a reader brings is put there: `push.mcap`
from the recording that was simulated, and arrays as `Recording.from_arrays` takes them. How to install is left out.
"""

import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import palpate

FIRST, LAST = "## Install", "## Your own data"
INSTALLS = ("make ", "python -m pip ", "pip ")


def steps(readme: str) -> list[tuple[str, str]]:
    """Return the blocks of code between the two headings, each as "shell" or "python" and its text.

    Shell is what stands indented, Python what stands between fences.
    """
    for heading in (FIRST, LAST):
        if f"\n{heading}\n" not in readme:
            raise SystemExit(f"the README has no heading {heading!r}")
    begin = readme.index(f"\n{FIRST}\n")
    end = readme.find("\n## ", readme.index(f"\n{LAST}\n") + 1)
    blocks = re.finditer(r"^```python\n(.*?)^```$|((?:^ {4}[^\n]*\n)+)", readme[begin:end], re.MULTILINE | re.DOTALL)
    found = [
        ("python", block[1]) if block[1] else ("shell", re.sub("^ {4}", "", block[2], flags=re.M)) for block in blocks
    ]
    return [(kind, text) for kind, text in ((kind, used(kind, text)) for kind, text in found) if text.strip()]


def used(kind: str, text: str) -> str:
    """Return a block without the lines that install."""
    lines = text.splitlines(keepends=True)
    return "".join(line for line in lines if kind == "python" or not line.startswith(INSTALLS))


def prepare(text: str) -> None:
    """Put there what a step takes: a recording `push.mcap`, or arrays; a recording that it writes must not be there."""
    recorded = sorted(Path("recordings").glob("*.mcap"))
    if 'load_recording("push.mcap")' in text:
        Path("push.mcap").write_bytes(recorded[0].read_bytes())
    if "from_arrays" in text:
        Path("push.mcap").unlink(missing_ok=True)
        recording = palpate.load_recording(recorded[0])
        np.save("image_time.npy", recording.time)
        np.save("images.npy", np.stack([frame.image for frame in recording if frame.image is not None]))
        np.save("pose_time.npy", recording.time)
        np.save("poses.npy", recording.sensor_pose)


def run(kind: str, text: str) -> None:
    """Run a step and say how long it took; SystemExit where it fails."""
    begin = time.monotonic()
    command = ["sh", "-ec", text] if kind == "shell" else [sys.executable, "-c", text]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    title = next(line for line in text.splitlines() if line.strip() and not line.startswith("import"))
    print(f"{time.monotonic() - begin:5.1f} s  {title.split('#')[0].strip()}", flush=True)
    if done.returncode:
        raise SystemExit(f"{text}\n{done.stdout}\nexit code {done.returncode}")


def main(words: list[str], run: Callable[[str, str], None] = run) -> None:
    """Do all that the README named first does; SystemExit where it leaves no picture."""
    for kind, text in steps(Path(words[0]).read_text(encoding="utf-8")):
        prepare(text)
        run(kind, text.replace("palpate simulate ", "palpate simulate --seconds 3 ") if "--short" in words else text)
    pictures = sorted(Path("runs").glob("*/figure.png"), key=lambda path: path.stat().st_mtime)
    if not pictures:
        raise SystemExit("no step left a figure in runs/")
    print(f"picture of one's own data: {pictures[-1]}")


if __name__ == "__main__":
    main(sys.argv[1:])
