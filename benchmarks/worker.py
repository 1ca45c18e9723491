"""Measurements of one build of palpate, the one on PYTHONPATH, for `side_by_side`: python benchmarks/worker.py FOLDER.

Reads the name of a case a line and writes its result as JSON a line. Only what old builds have as well is used.

- one, eight, jpeg, graph: processor time [ms] of each `Tracker.update`, with contact and the number of answers.
- start: processor time [s] from the start of this process to its first estimate, and its memory then [MB].
- threads: frames a second of two trackers in two threads over those of one.
- run: wall time of one tracker over as many frames [s]; the first in a process warms up.
"""

import json
import pickle
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

FRAMES_OF_THREADS = 200


def frames(folder: Path, encoded: bool = False, count: int | None = None) -> Iterator[Callable[[], Any]]:
    """Yield functions that make the frames of a recording, from decoded images or from encoded ones."""
    import numpy as np

    from palpate import Frame
    from palpate.types.images import decode_image

    given = pickle.loads((folder / "recording.pickle").read_bytes())
    images = np.load(folder / "images.npy", mmap_mode="r")
    for k in range(len(images) if count is None else count):
        time_and_pose = given["time"][k], given["sensor_pose"][k]
        data = given["encoded"][k]
        image = np.array(images[k])
        decoded = partial(decode_image, data) if encoded else partial(np.asarray, image)
        yield lambda given=time_and_pose, decoded=decoded: Frame(*given, image=decoded())


def tracker(folder: Path) -> Any:
    """Return a tracker of a recording's object, with as many hypotheses as its case has."""
    from palpate import DIGIT, Rectangle, Tracker, TrackerSettings

    given = pickle.loads((folder / "recording.pickle").read_bytes())
    settings = TrackerSettings("learnt", hypotheses=given["hypotheses"])
    return Tracker(Rectangle(*given["size"]), DIGIT, given["first_pose"], settings, first_pose_sigma=given["sigma"])


def steps(folder: Path, encoded: bool = False) -> dict[str, list[float]]:
    """Return the processor time of each frame [ms], and what was estimated in it."""
    one = tracker(folder)
    found: dict[str, list[float]] = {"ms": [], "contact": [], "answers": []}
    for frame in frames(folder, encoded):
        start = time.process_time()
        estimate = one.update(frame())
        found["ms"].append(1e3 * (time.process_time() - start))
        found["contact"].append(estimate.contact)
        found["answers"].append(len(estimate.answers))
    return found


def graph(folder: Path) -> dict[str, list[float]]:
    """Return the same as `steps` of a contact without images, of which direction and turn are given."""
    from palpate import DIGIT, ContactDirection, Frame, Rectangle, Tracker, TrackerSettings, Turn

    given = pickle.loads((folder / "contact.pickle").read_bytes())
    one = Tracker(Rectangle(*given["size"]), DIGIT, given["first_pose"], TrackerSettings("none", hypotheses=1))
    count = len(given["frames"])
    found: dict[str, list[float]] = {"ms": [], "contact": count * [1.0], "answers": count * [1.0]}
    for when, pose, direction, turn in given["frames"]:
        frame = Frame(when, pose, contact=True)
        measured = (ContactDirection(*direction), Turn(*turn))
        begin = time.process_time()
        one.update(frame, measured)
        found["ms"].append(1e3 * (time.process_time() - begin))
    return found


def start(folder: Path) -> dict[str, float]:
    """Return what this process has taken up to its first estimate."""
    one = tracker(folder)
    (first,) = frames(folder, count=1)
    one.update(first())
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return {"s": time.process_time(), "mb": pages * 4096 / 2**20}


def threads(folder: Path) -> dict[str, float]:
    """Return the speed of two threads, each with its tracker, over that of one, by the wall clock."""
    given = [make() for make in frames(folder, count=FRAMES_OF_THREADS)]

    def run() -> None:
        one = tracker(folder)
        for frame in given:
            one.update(frame)

    run()
    took = []
    for count in (1, 2):
        workers = [Thread(target=run) for _ in range(count)]
        begin = time.perf_counter()
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        took.append(time.perf_counter() - begin)
    return {"speed": 2.0 * took[0] / took[1]}


def run(folder: Path) -> dict[str, float]:
    """Return the wall time of a tracker over the frames of a thread [s]."""
    one = tracker(folder)
    given = [make() for make in frames(folder, count=FRAMES_OF_THREADS)]
    begin = time.perf_counter()
    for frame in given:
        one.update(frame)
    return {"s": time.perf_counter() - begin}


def main() -> None:
    """Answer the cases on standard input."""
    folder = Path(sys.argv[1])
    cases: dict[str, Callable[[], Any]] = {
        "one": lambda: steps(folder / "one"),
        "eight": lambda: steps(folder / "eight"),
        "jpeg": lambda: steps(folder / "one", encoded=True),
        "graph": lambda: graph(folder / "graph"),
        "start": lambda: start(folder / "one"),
        "threads": lambda: threads(folder / "one"),
        "run": lambda: run(folder / "one"),
    }
    for line in sys.stdin:
        print(json.dumps(cases[line.strip()]()), flush=True)


if __name__ == "__main__":
    main()
