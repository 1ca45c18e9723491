"""Time per frame of `Tracker.update`, against plain graphs in GTSAM in the same run, on one thread.

    python benchmarks/step.py [--json] [--gate] [--update-baseline]
    python benchmarks/step.py --against COMMIT [--rounds 5] [--json]    # in place of GTSAM a committed build of palpate

- one-answer: image in (decoded), estimate out, one hypothesis, in contact; a simulated push with set-up errors.
- eight-answers: the same object shoved now and then and found from a rough first pose; frames with two to nine answers.
- more-answers: the others of it, with up to forty: until the object is found, and how images lie.
- from-jpeg: one-answer from the encoded image on.
- rest: frames without contact of one-answer.
- graph: a direction and a turn a frame in place of images, one hypothesis, one contact.
- gtsam-native: a window with as many factors, all in C++, see `gtsam_graphs`.
- reference: the paper's graph in iSAM2, all factors in Python, with 30 tactile pairs a frame, see `gtsam_graphs`.

Milliseconds are of the wall clock. `ratio_to_reference` is a case's median over
the reference's, both of processor time, which does not depend on other work on the machine. The gate is on it alone.
"""

import argparse
import gc
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from gtsam_graphs import NativeGraph, PlainGraph
from limit_surface import Steering, push
from numpy.typing import NDArray
from side_by_side import Contact, compared
from threadpoolctl import threadpool_limits

from palpate import DIGIT, ContactDirection, Frame, Measurement, Rectangle, Tracker, TrackerSettings, Turn
from palpate.geometry import se2
from palpate.models.pushing.contact_geometry import contact_model
from palpate_lab.simulate.recordings import Simulation

Array = NDArray[np.float64]
Row = dict[str, float | str]
Given = tuple[Frame, tuple[Measurement, ...]]
BASELINE = Path(__file__).with_name("baseline.json")
REFERENCE = "reference"
SHAPE = Rectangle(0.2363, 0.1579)
MODEL = contact_model(SHAPE, DIGIT)
FRAMES = 450
WARM = 60
SLACK = 1.5  # by which a ratio may exceed the committed one: two shared cores are noisy even in ratios


@dataclass(frozen=True)
class Timing:
    """Times of the calls of one case."""

    name: str
    wall: Array
    """Wall-clock time of each call [ms]."""
    processor: Array
    """Processor time of each call, on all threads [ms]."""

    def row(self, reference_ms: float) -> Row:
        """Return the row of the result, given the reference's median of processor time [ms]."""
        median, p95, p99 = np.percentile(self.wall, (50, 95, 99)).tolist()
        ratio = float(np.median(self.processor)) / reference_ms
        times = {"median_ms": median, "p95_ms": p95, "p99_ms": p99, "max_ms": float(self.wall.max())}
        return {
            "name": self.name,
            **{name: round(ms, 3) for name, ms in times.items()},
            "ratio_to_reference": round(ratio, 4),
        }


def timed(begin: Callable[[], Callable[[Any], Any]], inputs: Sequence[Any]) -> tuple[Array, Array, list[Any]]:
    """Return wall and processor time [ms] of each call of what `begin` returns, and the results; warmed up before."""
    update = begin()
    for each in inputs[:WARM]:
        update(each)
    update = begin()
    results = []
    gc.collect()
    wall = np.empty(len(inputs))
    processor = np.empty(len(inputs))
    for k, each in enumerate(inputs):
        start = time.perf_counter()
        busy = time.process_time()
        results.append(update(each))
        processor[k] = time.process_time() - busy
        wall[k] = time.perf_counter() - start
    return 1e3 * wall, 1e3 * processor, results


def with_images() -> Iterator[Timing]:
    """Time one answer, frames at rest and eight answers, on simulated recordings with set-up errors."""
    for answers in (1, 8):
        given = Simulation(SHAPE, "rectangle-edges", 2, FRAMES / DIGIT.rate, knocks=answers > 1).run()
        settings = replace(TrackerSettings("learnt"), hypotheses=answers)
        sigma = given.first_pose_sigma if answers == 1 else (0.02, 0.02, 0.3)  # [m, m, rad]
        first = given.first_pose

        def update(settings: Any = settings, first: Any = first, sigma: Any = sigma, shape: Any = given.shape) -> Any:
            return Tracker(shape, DIGIT, first, settings, first_pose_sigma=sigma).update

        wall, processor, estimates = timed(update, list(given))
        contact = np.array([estimate.contact for estimate in estimates])
        if answers == 1:
            yield Timing("one-answer", wall[contact], processor[contact])
            yield Timing("rest", wall[~contact], processor[~contact])

            def from_jpeg(recording: Any = given, begin: Any = update) -> Any:
                tracker_update = begin()
                return lambda k: tracker_update(recording[k])

            wall, processor, _ = timed(from_jpeg, range(len(given)))
            yield Timing("from-jpeg", wall[contact], processor[contact])
        else:
            count = np.array([len(estimate.answers) for estimate in estimates])
            for name, some in (("eight-answers", (count > 1) & (count < 10)), ("more-answers", count > 9)):
                yield Timing(name, wall[contact & some], processor[contact & some])


def graphs() -> Iterator[Timing]:
    """Time the graph alone, and those in GTSAM, on one contact drawn from the estimator's model."""
    objects, sensors = contact()
    settings = replace(TrackerSettings("none"), hypotheses=1)

    def tracker() -> Callable[[Given], object]:
        one = Tracker(SHAPE, DIGIT, objects[0], settings)
        return lambda given: one.update(*given)

    yield Timing("graph", *timed(tracker, list(felt(objects, sensors)))[:2])
    steps = list(zip(objects, sensors, strict=True))
    yield Timing("gtsam-native", *timed(lambda: NativeGraph().update, steps)[:2])
    yield Timing(REFERENCE, *timed(lambda: PlainGraph(MODEL, objects[0]).update, steps)[:2])


def contact() -> tuple[Array, Array]:
    """Return the poses (FRAMES, 3) of object and sensor in one contact drawn from the estimator's model."""
    first = np.array([[-0.5 * SHAPE.size_x, 0.01, 0.0]])
    objects, sensors = push(MODEL, np.zeros((1, 3)), first, FRAMES - 1, Steering())
    return objects[:, 0], sensors[:, 0]


def felt(objects: Array, sensors: Array) -> Iterator[Given]:
    """Yield noisy frames of a contact, each with the direction and turn that learnt touch would measure."""
    random = np.random.default_rng(0)
    sigma = 0.01  # [rad]
    g = se2.between(objects, sensors)
    noisy = se2.compose(sensors, se2.exp(random.normal(0.0, (1e-4, 1e-4, 1e-3), sensors.shape)))
    inward = -MODEL.touching(g[None])["normal"][0] * np.exp(-1j * g[:, 2])
    direction = np.angle(inward) + random.normal(0.0, sigma, len(g))
    turn = se2.wrap(g[:, 2] + random.normal(0.0, sigma, len(g)))
    for k in range(len(g)):
        measurements = ContactDirection(float(direction[k]), sigma**2), Turn(float(turn[k]), sigma**2)
        yield Frame(k / DIGIT.rate, noisy[k], contact=True), measurements


def failures(rows: Iterable[Row], baseline: Iterable[Row]) -> list[str]:
    """Return sentences on the ratios that are worse than the committed baseline allows."""
    allowed = {one["name"]: SLACK * float(one["ratio_to_reference"]) for one in baseline if one["name"] != REFERENCE}
    return [
        f"{one['name']}: ratio to the reference is {one['ratio_to_reference']}, allowed {allowed[one['name']]:.4f}"
        for one in rows
        if float(one["ratio_to_reference"]) > allowed.get(one["name"], np.inf)
    ]


def main() -> int:
    """Measure, print and judge."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    parser.add_argument("--gate", action="store_true", help="exit 1 if a ratio is worse than the baseline allows")
    parser.add_argument("--update-baseline", action="store_true", help="write benchmarks/baseline.json")
    parser.add_argument("--against", metavar="COMMIT", help="compare with a committed build, see side_by_side.py")
    parser.add_argument("--rounds", type=int, default=5, help="times that each build tracks each recording")
    arguments = parser.parse_args()
    if arguments.rounds < 1:
        parser.error(f"--rounds is {arguments.rounds}; allowed is 1 or more")
    if arguments.against:
        objects, sensors = contact()
        without_images = Contact(objects[0], list(felt(objects, sensors)))
        show(compared(arguments.against, arguments.rounds, without_images), arguments.json)
        return 0
    with threadpool_limits(1):
        timings = [*with_images(), *graphs()]
    reference_ms = float(np.median(timings[-1].processor))
    rows = [timing.row(reference_ms) for timing in timings]
    worse = failures(rows, json.loads(BASELINE.read_text())["cases"]) if arguments.gate else []
    if arguments.update_baseline:
        BASELINE.write_text(json.dumps({"cases": rows}, indent=2) + "\n")
    show(rows, arguments.json)
    for sentence in worse:
        print(sentence, file=sys.stderr)
    return 1 if worse else 0


def show(rows: Sequence[Row], as_json: bool) -> None:
    """Print the results as a table, or as one JSON object."""
    if as_json:
        print(json.dumps({"cases": rows}))
        return
    print("".join(f"{key:>24}" for key in rows[0]))
    for one in rows:
        print("".join(f"{value!s:>24}" for value in one.values()))


if __name__ == "__main__":
    sys.exit(main())
