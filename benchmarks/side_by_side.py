"""A committed build of palpate and the present one side by side, in turns and on the same frames.

Each row is a number of the committed build, that of the checkout, and their ratio:

- one-answer, eight-answers, rest, from-jpeg, graph: processor time of `Tracker.update` [ms], median and 99th percentile
  over frames; of each frame the least of all rounds counts, as other work on the machine only adds to it. The
  recordings are those of `step`.
- first-image: memory of a process after its first estimate from an image [MB].
- start: processor time from the start of a process to that estimate [s], with compiled code at hand.
- first-ever-start: the same where nothing is compiled yet.
- two-threads: speed of two trackers in two threads over that of one, by the wall clock: only of use on an idle machine.
- two-processes: the same of two trackers in two processes.
"""

import json
import os
import pickle
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate import DIGIT, ContactDirection, Frame, Measurement, Recording, Rectangle, Turn
from palpate_lab.simulate.recordings import Simulation

ROOT = Path(__file__).parents[1]
WORKER = Path(__file__).with_name("worker.py")
SHAPE = Rectangle(0.2363, 0.1579)
FRAMES = 450
Row = dict[str, str | float]


class Contact(NamedTuple):
    """A contact without images, for the graph alone."""

    first_pose: NDArray[np.float64]
    """world_T_object at the start, (3,) [m, m, rad]."""
    frames: Sequence[tuple[Frame, tuple[Measurement, ...]]]
    """Frames, each with a direction and a turn."""


class Build:
    """A build of palpate in a folder of sources, in a process that measures it."""

    def __init__(self, source: Path, recordings: Path, cache: Path) -> None:
        self._command = [sys.executable, str(WORKER), str(recordings)]
        self._source = source
        self._cache = cache
        self._process: subprocess.Popen[str] | None = None

    def measure(self, case: str) -> Any:
        """Return the result of a case, from the process that stays."""
        if self._process is None:
            self._process = self._begin()
        return self._ask(self._process, case)

    def measure_anew(self, case: str) -> Any:
        """Return the result of a case from a process of its own."""
        with self._begin() as process:
            return self._ask(process, case)

    def speed_of_two_processes(self) -> float:
        """Return the speed of two trackers in two processes over that of one."""
        with self._begin() as first, self._begin() as second:
            self._ask(first, "run")
            self._ask(second, "run")
            alone = self._ask(first, "run")["s"]
            for process in (first, second):
                self._send(process, "run")
            together = max(self._answer(process)["s"] for process in (first, second))
        return 2.0 * alone / together

    def close(self) -> None:
        """End the process that stays."""
        if self._process is not None:
            self._process.communicate()

    def _begin(self) -> subprocess.Popen[str]:
        one_thread = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        kept = {"NUMBA_CACHE_DIR": str(self._cache), "PALPATE_CACHE": str(self._cache)}
        environment = os.environ | one_thread | kept | {"PYTHONPATH": str(self._source)}
        pipe = subprocess.PIPE
        return subprocess.Popen(self._command, stdin=pipe, stdout=pipe, text=True, env=environment)

    def _ask(self, process: subprocess.Popen[str], case: str) -> Any:
        self._send(process, case)
        return self._answer(process)

    def _send(self, process: subprocess.Popen[str], case: str) -> None:
        assert process.stdin is not None
        process.stdin.write(f"{case}\n")
        process.stdin.flush()

    def _answer(self, process: subprocess.Popen[str]) -> Any:
        assert process.stdout is not None
        return json.loads(process.stdout.readline())


@contextmanager
def builds(commit: str, contact: Contact) -> Iterator[tuple[Build, Build]]:
    """Open a committed build and that of the checkout, both on the same recordings and the same contact."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        packed = subprocess.run(["git", "archive", commit, "src"], cwd=ROOT, capture_output=True)
        if packed.returncode:
            sys.exit(f"{commit}: git has no such build ({packed.stderr.decode().strip()})")
        with tarfile.open(fileobj=BytesIO(packed.stdout)) as archive:
            archive.extractall(folder / "old", filter="data")
        for name, hypotheses in (("one", 1), ("eight", 8)):
            given = Simulation(SHAPE, "rectangle-edges", 2, FRAMES / DIGIT.rate, knocks=hypotheses > 1).run()
            write(folder / name, given, hypotheses)
        write_contact(folder / "graph", contact)
        both = (Build(folder / "old/src", folder, folder / "cache-old"), Build(ROOT / "src", folder, folder / "cache"))
        try:
            yield both
        finally:
            for build in both:
                build.close()


def write(folder: Path, given: Recording, hypotheses: int) -> None:
    """Write a recording as both builds can read it, with NumPy alone."""
    assert given.image is not None
    folder.mkdir()
    np.save(folder / "images.npy", np.array([frame.image for frame in given]))
    case = {
        "hypotheses": hypotheses,
        "size": (SHAPE.size_x, SHAPE.size_y),
        "first_pose": given.first_pose,
        "sigma": given.first_pose_sigma if hypotheses == 1 else (0.02, 0.02, 0.3),  # [m, m, rad]
        "time": given.time,
        "sensor_pose": given.sensor_pose,
        "encoded": list(given.image),
    }
    (folder / "recording.pickle").write_bytes(pickle.dumps(case))


def write_contact(folder: Path, contact: Contact) -> None:
    """Write a contact without images as numbers, which both builds can read."""
    frames: list[tuple[float, Any, tuple[float, float], tuple[float, float]]] = []
    for frame, (direction, turn) in contact.frames:
        assert isinstance(direction, ContactDirection)
        assert isinstance(turn, Turn)
        measured = (direction.angle, direction.variance), (turn.angle, turn.variance)
        frames.append((frame.time, frame.sensor_pose, *measured))
    folder.mkdir()
    case = {"size": (SHAPE.size_x, SHAPE.size_y), "first_pose": contact.first_pose, "frames": frames}
    (folder / "contact.pickle").write_bytes(pickle.dumps(case))


def measured(build: Build) -> dict[str, float]:
    """Return the numbers of a build that need processes of their own, with no compiled code so far."""
    first_ever = build.measure_anew("start")
    again = build.measure_anew("start")
    return {"first-ever-start_s": first_ever["s"], "start_s": again["s"], "first-image_mb": again["mb"]}


def times(pair: tuple[Build, Build], rounds: int) -> Iterator[dict[str, float]]:
    """Yield the times of frames of both builds [ms], measured in turns."""
    cases = ("one", "eight", "jpeg", "graph")
    found: list[dict[str, list[Any]]] = [{case: [] for case in cases} for _ in pair]
    for _ in range(rounds + 1):
        for case in cases:
            for build, results in zip(pair, found, strict=True):
                results[case].append(build.measure(case))
    for results in found:
        yield {
            **percentiles("one-answer", results["one"], lambda one: one["contact"]),
            **percentiles("rest", results["one"], lambda one: ~one["contact"]),
            **percentiles("eight-answers", results["eight"], lambda one: one["contact"] & (one["answers"] > 1)),
            **percentiles("from-jpeg", results["jpeg"], lambda one: one["contact"]),
            **percentiles("graph", results["graph"], lambda one: one["contact"]),
        }


def percentiles(name: str, rounds: list[Any], chosen: Any) -> dict[str, float]:
    """Return median and 99th percentile over the chosen frames; the first round warms up."""
    least = np.min([one["ms"] for one in rounds[1:]], axis=0)
    frames = chosen({"contact": np.array(rounds[0]["contact"], bool), "answers": np.array(rounds[0]["answers"])})
    median, p99 = np.percentile(least[frames], (50, 99)).tolist()
    return {f"{name}_p50_ms": median, f"{name}_p99_ms": p99}


def compared(commit: str, rounds: int, contact: Contact) -> list[Row]:
    """Return the numbers of a committed build and of the checkout, each recording tracked so many times by each."""
    with builds(commit, contact) as pair:
        found = [measured(build) for build in pair]
        for numbers, more in zip(found, times(pair, rounds), strict=True):
            numbers.update(more)
        for numbers, build in zip(found, pair, strict=True):
            numbers["two-threads"] = build.measure("threads")["speed"]
            numbers["two-processes"] = build.speed_of_two_processes()
    old, new = found
    return [
        {"name": name, "old": round(old[name], 3), "new": round(new[name], 3), "ratio": round(new[name] / old[name], 3)}
        for name in old
    ]
