"""Draw docs/pictures/status_*.png: runs in which each status of an estimate comes up, to be looked at.

python scripts/make_status_pictures.py
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from palpate import Estimate, Recording, Tracker, TrackerSettings
from palpate.geometry import se2
from palpate.geometry.named_shapes import SHAPES
from palpate.pipeline.metrics import deviations
from palpate_lab.simulate.recordings import plan

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import Patch

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


def tracked(
    recording: Recording,
    settings: TrackerSettings,
    off: Sequence[float] = (0.0, 0.0, 0.0),
    sigma: Sequence[float] | None = None,
) -> list[Estimate]:
    """Return the estimates of a recording.

    Its first pose is `off` [m, m, rad], and known as well as `sigma` says.
    """
    truth = recording.object_pose
    assert truth is not None
    first = se2.compose(truth[0], np.asarray(off))
    tracker = Tracker(recording.shape, recording.sensor, first, settings, first_pose_sigma=sigma)
    return [tracker.update(frame) for frame in recording]


def draw(status: str, recording: Recording, estimates: Sequence[Estimate]) -> None:
    """Draw errors with twice their standard deviation, over a strip of statuses."""
    time = recording.time
    truth = recording.object_pose
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
    calm = simulated("rectangle", 2)
    shoved = simulated("rectangle", 2, knocks=True)
    moved = simulated("rectangle", 9002, 2, knocks=True)
    rough: dict[str, Any] = {"off": (0.02, 0.02, 0.2), "sigma": (0.03, 0.03, 0.3)}
    runs = {
        "tracking": (calm, tracked(calm, learnt)),
        "ambiguous": (shoved, tracked(shoved, learnt)),
        "uncertain": (calm, tracked(calm, learnt, **rough)),
        "displaced": (moved, tracked(moved, learnt)),
    }
    for status, (recording, estimates) in runs.items():
        draw(status, recording, estimates)
        print(status, Counter(estimate.status for estimate in estimates))


if __name__ == "__main__":
    main()
