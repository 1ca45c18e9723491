"""Draw docs/pictures/status_*.png: runs in which each status of an estimate comes up, to be looked at.

python scripts/make_status_pictures.py
"""

import math
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from palpate import DIGIT, Estimate, ObjectPose, Recording, Rectangle, Tracker, TrackerSettings
from palpate.geometry import se2
from palpate.geometry.shapes import SHAPES
from palpate.graph.contact_geometry import contact_model
from palpate.lab.simulate.recordings import plan
from palpate.pipeline.metrics import deviations

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import Patch

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))
from limit_surface import Steering, push

PICTURES = Path(__file__).resolve().parents[1] / "docs/pictures"
FLOOR = 0.1
"""Smaller errors [mm], [deg] are drawn here."""
COLOURS = {
    "resting": "#cccccc",
    "tracking": "#009E73",
    "ambiguous": "#CC79A7",
    "strained": "#E69F00",
    "uncertain": "#56B4E9",
    "displaced": "#D55E00",
    "indeterminate": "#000000",
}


def simulated(shape: str, seed: int, index: int = 0, knocks: bool = False) -> Recording:
    """Return one of the recordings that `palpate simulate` makes of a shape and seed."""
    return list(plan({shape: SHAPES[shape]}, index + 1, seed, knocks=knocks, seconds=15.0).values())[index].run()


def turned_by_hand(angle: float) -> Recording:
    """Return a push drawn from the estimator's own model, in which a hand turns the object about the sensor's apex."""
    outline = Rectangle(0.12, 0.08)
    model = contact_model(outline, DIGIT)
    parts, object_pose, touched = [], np.zeros(3), np.array([-0.06, 0.01, 0.0])
    for _ in range(2):
        objects, sensors = push(model, object_pose[None], touched[None], 60, Steering())
        parts.append((objects[:, 0], sensors[:, 0]))
        turned = se2.compose(sensors[-1, 0], np.array([0.0, 0.0, angle]))
        object_pose = se2.compose(turned, se2.between(sensors[-1, 0], objects[-1, 0]))
        touched = se2.between(object_pose, sensors[-1, 0])
    objects, sensors = (np.concatenate(each) for each in zip(*parts, strict=True))
    time, contact = np.arange(len(objects)) / DIGIT.rate, np.ones(len(objects), np.bool_)
    return Recording(time, sensors, outline, DIGIT, objects, contact)


def tracked(
    recording: Recording,
    settings: TrackerSettings,
    off: Sequence[float] = (0.0, 0.0, 0.0),
    sigma: Sequence[float] | None = None,
    absurd: int | None = None,
) -> list[Estimate]:
    """Return the estimates of a recording.

    Its first pose is `off` [m, m, rad], and known as well as `sigma` says. At the frame `absurd` a camera sees the
    object 100 km away, and is sure of it.
    """
    truth = recording.object_pose
    assert truth is not None
    first = se2.compose(truth[0], np.asarray(off))
    tracker = Tracker(recording.shape, recording.sensor, first, settings, first_pose_sigma=sigma)
    far = ObjectPose(np.array([1e5, 0.0, 0.0]), 1e-6 * np.eye(3))
    return [tracker.update(frame, [far] if k == absurd else []) for k, frame in enumerate(recording)]


def draw(status: str, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """Draw errors with twice their standard deviation, over a strip of statuses."""
    time, truth = recording.time, recording.object_pose
    assert truth is not None
    pose = np.array([estimate.pose for estimate in estimates])
    sigma, turn_sigma = deviations(np.array([estimate.covariance for estimate in estimates]))
    off = 1e3 * np.hypot(*(pose - truth)[:, :2].T)
    turn = np.degrees(np.abs(se2.wrap(pose[:, 2] - truth[:, 2])))
    figure, axes = plt.subplots(3, sharex=True, figsize=(7.4, 3.6), height_ratios=(4, 4, 1), layout="constrained")
    for panel, error, band, unit in (
        (axes[0], off, 2e3 * sigma, "mm"),
        (axes[1], turn, 2 * np.degrees(turn_sigma), "°"),
    ):
        style = {"color": "#0072B2", "alpha": 0.2, "lw": 0, "label": "two standard deviations"}
        panel.fill_between(time, FLOOR, np.maximum(band, FLOOR), **style)
        panel.plot(time, np.maximum(error, FLOOR), color="#0072B2", lw=1.8, label="error")
        panel.set(ylabel=unit, yscale="log", ylim=(FLOOR, 1.3 * max(np.max(np.maximum(error, band)), 10.0)))
        panel.yaxis.set_major_formatter("{x:g}")
    axes[0].legend(loc="lower right", fontsize=8)
    statuses = [estimate.status for estimate in estimates]
    step = float(np.median(np.diff(time)))
    axes[2].bar(time, 1.0, width=1.05 * step, align="edge", color=[COLOURS[status] for status in statuses])
    axes[2].set(yticks=[], xlabel="time [s]", xlim=(time[0], time[-1]), ylabel="status")
    there = [status for status in COLOURS if status in statuses]
    handles = [Patch(color=COLOURS[status], label=status) for status in there]
    place = {"loc": "upper center", "bbox_to_anchor": (0.5, -1.2), "ncols": len(there)}
    axes[2].legend(handles=handles, frameon=False, fontsize=9, **place)
    figure.savefig(PICTURES / f"status_{status}.png", dpi=100)
    plt.close(figure)


def main() -> None:
    """Draw all of them, and say which statuses came up."""
    learnt = TrackerSettings(tactile="learnt")
    turned = turned_by_hand(math.radians(0.8))
    sure = TrackerSettings("oracle", hypotheses=1)
    calm, shoved = simulated("rectangle", 2), simulated("rectangle", 2, knocks=True)
    moved = simulated("rectangle", 9002, 2, knocks=True)
    rough: dict[str, Any] = {"off": (0.02, 0.02, 0.2), "sigma": (0.03, 0.03, 0.3)}
    runs = {
        "tracking": (calm, tracked(calm, learnt)),
        "ambiguous": (shoved, tracked(shoved, learnt)),
        "strained": (turned, tracked(turned, sure)),
        "uncertain": (calm, tracked(calm, learnt, **rough)),
        "displaced": (moved, tracked(moved, learnt)),
        "indeterminate": (calm, tracked(calm, learnt, absurd=268)),  # in the middle of a contact
    }
    for status, (recording, estimates) in runs.items():
        draw(status, recording, estimates)
        print(status, Counter(estimate.status for estimate in estimates))


if __name__ == "__main__":
    main()
