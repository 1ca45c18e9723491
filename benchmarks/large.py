"""Memory of tracking a recording that is larger than memory should be.

    python benchmarks/large.py --gigabytes 5 --folder /tmp

A simulated push is so long that its images, as PNG that are not compressed, make such a file; 5 GB are nine minutes. It
is tracked by a process of its own, whose memory is looked at several times a second together with that of all processes
that it starts. What is printed as JSON is the most that there was: `rss_mb`, in which pages that processes share count
for each of them, and `pss_mb`, in which they count once. The file is removed.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import psutil
import tyro

from palpate.geometry.objects import SHAPES
from palpate.io.palpate_h5 import write_recording
from palpate.lab.simulate.recordings import simulate_recording
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT
from palpate.types.stored_images import StoredImages

BYTES = 300_000
"""Of an image."""
LOOK = 0.2
"""[s] between looks at the memory."""
MB = 1e6


class Enlarged(StoredImages):
    """Images as PNG that are not compressed, with zeros after their end up to BYTES; each is made when it is read."""

    def __init__(self, push: Recording) -> None:
        self._push = push

    def __len__(self) -> int:
        return len(self._push)

    def read(self, index: int) -> bytes:
        """The bytes of one image."""
        image = self._push[index].image
        assert image is not None
        done, data = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 0])
        assert done
        return data.tobytes().ljust(BYTES, b"\0")


def long_recording(size: float) -> Recording:
    """A push whose images have so many bytes together."""
    push = simulate_recording(SHAPES["rectangle"], "rectangle-edges", 1, size / BYTES / DIGIT.rate)
    return replace(push, image=Enlarged(push), codec="png", contact=None, episode=None, extra={})


def most_memory(words: Sequence[str]) -> dict[str, float]:
    """Run a command and return the most memory that it and what it starts have at once [MB], and how long it takes."""
    begin = time.monotonic()
    process = psutil.Popen(words, stdout=subprocess.DEVNULL)
    most = {"rss_mb": 0.0, "pss_mb": 0.0}
    while process.poll() is None:
        now = {"rss_mb": 0.0, "pss_mb": 0.0}
        for each in (process, *process.children(recursive=True)):
            try:
                memory = each.memory_full_info()
            except psutil.Error:  # it has ended meanwhile
                continue
            now["rss_mb"] += memory.rss / MB
            now["pss_mb"] += memory.pss / MB
        most = {name: max(value, now[name]) for name, value in most.items()}
        time.sleep(LOOK)
    if process.returncode:
        raise SystemExit(f"{' '.join(words)} ended with {process.returncode}")
    return {**most, "seconds": time.monotonic() - begin}


def main(gigabytes: float = 5.0, folder: Path = Path()) -> None:
    """Make the file, track it and print what was found."""
    with tempfile.TemporaryDirectory(dir=folder) as made:
        path, run = Path(made) / "large.h5", Path(made) / "run"
        recording = long_recording(gigabytes * 1e9)
        write_recording(recording, path)
        words = [sys.executable, "-m", "palpate", "track", str(path), "--out", str(run)]
        found = most_memory(words)
        said = {"frames": len(recording), "gigabytes": path.stat().st_size * 1e-9, **found}
        print(json.dumps({name: round(value, 2) for name, value in said.items()}))


if __name__ == "__main__":
    tyro.cli(main)
