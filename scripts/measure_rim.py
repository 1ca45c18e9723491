"""Measure what it costs that no image shows a contact at the pad's rim: docs/study/rim.json.

    python scripts/measure_rim.py [PUSHES] [SEED]

Pushes without errors of a set-up are drawn until so many of them have a contact that ends at the rim. Each is tracked
from its images, and once more with the true contact told in each frame; touch measures the same. A push takes five
seconds to make and to track.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np
from _common import clipped_rmse, for_each, paired, pooled_rmse, write

from palpate import Frame, NoiseSettings, Recording, Run, Tracker, TrackerSettings
from palpate.geometry.named_shapes import SHAPES
from palpate.pipeline.metrics import flag_runs, translation_errors
from palpate.pipeline.track import gathered, track
from palpate.touch.contact_detector import ContactDetector
from palpate.touch.reader import TouchReader
from palpate.tracker_arguments import Unit, noise_of_unit
from palpate.types.measurements import Measurement
from palpate_lab.simulate.recordings import COUNT, Simulation, plan

AT_RIM = np.radians(20.0)
"""Angle on the pad [rad] beyond which images lose a contact."""
LEAST_FRAMES = 10
"""Frames at the end of a contact that are at the rim."""


def main(pushes: int, seed: int) -> None:
    """Make and track pushes and write the scores of both ways."""
    found = for_each(scores_both_ways, list(islice(ending_at_rim(seed), pushes)))
    seen = [seen for seen, _ in found]
    told = [told for _, told in found]
    more_mm = paired((each["rmse_mm"] for each in told), (each["rmse_mm"] for each in seen))
    rows = {"contact told": pooled(told), "contact seen": pooled(seen), "more_rmse_mm": more_mm}
    write("rim", {"pushes": len(found), "seed": seed, **rows})


def ending_at_rim(seed: int) -> Iterator[Simulation]:
    """Yield the simulations that have a contact which ends at the rim."""
    for simulation in plan(SHAPES, COUNT // 100, seed, ideal=True).values():
        recording = replace(simulation, images=False).run()
        assert recording.contact is not None
        is_at_rim = np.abs(recording.extra["pad_angle"]) > AT_RIM
        for _, last in flag_runs(recording.contact):
            if is_at_rim[last - LEAST_FRAMES : last].all():
                yield simulation
                break


def scores_both_ways(simulation: Simulation) -> tuple[dict[str, float], dict[str, float]]:
    """Return the scores of a push whose contact is seen in its images, and of the same whose contact is told."""
    recording = simulation.run().oriented("upright")
    run = track(recording, TrackerSettings("learnt"))
    return scored(run), scored(told(recording, run))


class SeenTouch:
    """What touch measures in a recording where its images show it."""

    def __init__(self, recording: Recording) -> None:
        detector = ContactDetector(recording.sensor)
        reader = TouchReader("learnt", recording.sensor)
        self._measured: dict[float, Sequence[Measurement]] = {}
        for frame in recording:
            assert frame.image is not None
            image = detector.read(frame.image)
            if detector.update(image):
                self._measured[frame.time] = reader.read(replace(frame, image=image), detector.background)
            elif not frame.contact:
                reader.end_contact()

    def measure(self, frame: Frame) -> Sequence[Measurement]:
        """Return the measurements of a frame of contact."""
        return self._measured.get(frame.time, ())

    def end_contact(self) -> None:
        """Do nothing: all is measured."""


def told(recording: Recording, run: Run) -> Run:
    """Track a recording whose contact is told in each frame; the rest is as in this run."""
    noise = noise_of_unit(NoiseSettings(), Unit(recording.sensor), recording.set_up_sigma)
    given = {"first_pose_sigma": run.first_pose_sigma, "is_view_known": True, "touch": SeenTouch(recording)}
    tracker = Tracker(recording.shape, recording.sensor, run.first_pose, TrackerSettings(noise=noise), **given)
    estimates = [tracker.update(frame) for frame in replace(recording, image=None)]
    return replace(run, online=gathered(estimates)[0])


def scored(run: Run) -> dict[str, float]:
    """Return the scores of a run."""
    true = run.recording.contact
    assert true is not None
    error = translation_errors(run.online.pose[-1], run.recording.truth[-1])
    is_ambiguous = np.array(run.online.status) == "ambiguous"
    return {
        "rmse_mm": clipped_rmse(run),
        "final_mm": float(1e3 * error),
        "missed_frames": int(np.sum(true & ~run.online.contact)),
        "false_frames": int(np.sum(run.online.contact & ~true)),
        "contact_frames": int(true.sum()),
        "ambiguous_frames": int(is_ambiguous[run.online.contact].sum()),
    }


def pooled(scores: list[dict[str, float]]) -> dict[str, float]:
    """Return the scores of all pushes tracked one way."""

    def share(name: str) -> float:
        return sum(each[name] for each in scores) / sum(each["contact_frames"] for each in scores)

    return {
        "rmse_mm": pooled_rmse([each["rmse_mm"] for each in scores]),
        "final_median_mm": float(np.median([each["final_mm"] for each in scores])),
        "missed_share": share("missed_frames"),
        "false_share": share("false_frames"),
        "ambiguous_share": share("ambiguous_frames"),
    }


if __name__ == "__main__":
    main(*(int(each) for each in sys.argv[1:] or ("60", "20261306")))
