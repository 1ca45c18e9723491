"""Figures 5 and 10 to 12 of the paper; 6 to 8 are those of any study."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from palpate.arrays import Array
from palpate.files import whole_file
from palpate.geometry import se2
from palpate.io.recording import Recording
from palpate.pipeline.figures import own_style
from palpate_lab.study.figures import COLOURS
from palpate_lab.study.study import Trial

Shown = tuple[NDArray[np.float16], Array]
"""Some images of a sequence (M, 32, 128, 3), as differences from the untouched gel, and their key points (M, 2)."""
Tracks = Mapping[str, tuple[Recording, Sequence[Trial]]]
"""Sequences by name, with a trial for each mode."""


@own_style()
def draw(out: Path, seen: Sequence[Shown], rectangles: Tracks, others: Tracks) -> None:
    """Write the figures to a folder."""
    for name, figure in (
        ("fig5_keypoints", keypoints(seen)),
        ("fig10_11_rect", trajectories(rectangles)),
        ("fig12_disc_ellip", trajectories(others)),
    ):
        with whole_file(out / f"{name}.png", overwrite=True) as part:
            figure.savefig(part, format="png", dpi=110)


def keypoints(seen: Sequence[Shown]) -> Figure:
    """Figure 5: key points on touch images over a contact, a row for each object."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    for row, (images, points) in zip(figure.subplots(len(seen), len(seen[0][0])), seen, strict=True):
        for axes, image, point in zip(row, images, points, strict=True):
            height, width = image.shape[:2]
            axes.imshow(np.clip(0.5 + 0.3 * image.astype(np.float32), 0.0, 1.0), aspect=4 / 3 * width / height)
            axes.plot(*(0.5 * (point + 1.0) * (width, height) - 0.5), "o", color="blue", markersize=5)
            axes.set_axis_off()
    return figure


def trajectories(tracks: Tracks) -> Figure:
    """Figures 10 to 12: true (grey) and estimated object poses over time, a row a sequence and a column a mode."""
    figure = Figure(figsize=(11.0, 2.2 * len(tracks)), layout="constrained")
    modes = len(next(iter(tracks.values()))[1])
    grid = figure.subplots(len(tracks), modes, squeeze=False)
    for row, (name, (recording, trials)) in zip(grid, tracks.items(), strict=True):
        for axes, trial in zip(row, trials, strict=True):
            _draw_poses(axes, recording, trial)
            axes.set_title(f"{name.removesuffix('.mcap')}, {trial.method}", fontsize=7)
    return figure


def _draw_poses(axes: Axes, recording: Recording, trial: Trial) -> None:
    chosen = np.linspace(0, len(trial.truth) - 1, 5).astype(int)
    outline = recording.shape.outline()
    closed = np.concatenate([outline, outline[:1]])
    for poses, look in ((trial.truth, "#999999"), (trial.pose, COLOURS[trial.method])):
        axes.plot(*poses[:, :2].T, color=look, linewidth=0.8)
        for pose in poses[chosen]:
            axes.plot(*se2.transform(pose, closed).T, color=look, linewidth=0.7)
    axes.plot(*recording.sensor_pose[:, :2].T, ":", color="#666666", linewidth=0.6)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=5)
