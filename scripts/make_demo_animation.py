"""Makes docs/demo.gif: the push of `palpate demo` as it is tracked, drawn by what draws the figure of a run.

python scripts/make_demo_animation.py [OUT]
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from palpate.cli.track import demo_recording
from palpate.config import TrackerSettings
from palpate.geometry import se2
from palpate.pipeline.figures import draw_above, draw_errors
from palpate.pipeline.metrics import pose_words, world_sigma
from palpate.pipeline.track import Run, track

PLACES = {
    "above": (0.08, 0.18, 0.44, 0.80),
    "touch": (0.61, 0.56, 0.2, 0.39),
    "words": (0.82, 0.56, 0.18, 0.39),
    "translation": (0.61, 0.32, 0.375, 0.17),
    "rotation": (0.61, 0.10, 0.375, 0.17),
}
"""Axes of a picture, in shares of its size."""


def animation(run: Run) -> list[Image.Image]:
    """Return a picture of every fourth frame of a run with touch images, all of one palette."""
    figure = Figure(figsize=(8.0, 5.2), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = {name: figure.add_axes(place) for name, place in PLACES.items()}
    last = len(run.online) - 1
    pictures = []
    for index in [*range(0, last, 4), last]:
        for each in axes.values():
            each.clear()
        draw_from_above(axes["above"], run, index)
        axes["touch"].imshow(np.asarray(run.recording[index].image))
        axes["touch"].set(xticks=(), yticks=(), title=f"touch at {run.recording.time[index]:.1f} s")
        write_words(axes["words"], run, index)
        draw_errors(axes["translation"], axes["rotation"], run)
        time = run.online.time - run.online.time[0]
        for name, unit in (("translation", "mm"), ("rotation", "°")):
            axes[name].axvspan(time[index], time[-1], color="white", lw=0, zorder=3)  # hides what is to come
            axes[name].axvline(time[index], color="#AAAAAA", lw=1.0, zorder=4)
            axes[name].set(ylabel=f"error [{unit}]")
            axes[name].yaxis.set_label_coords(-0.12, 0.5)
        canvas.draw()
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy()))
    palette = pictures[-1].quantize(256)
    return [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]


def draw_from_above(axes: Axes, run: Run, index: int) -> None:
    """Draw the push from above as it is at a frame, with 20 mm about all of it."""
    draw_above(axes, run, index)
    outlines = se2.transform(run.online.pose[:, None], run.recording.shape.closed_outline).reshape(-1, 2)
    points = 1e3 * np.concatenate((outlines, run.recording.sensor_pose[:, :2]))
    (left, low), (right, high) = points.min(axis=0) - 20.0, points.max(axis=0) + 20.0
    axes.set_aspect("equal", adjustable="box")
    axes.set(xlim=(left, right), ylim=(low, high))
    axes.legend(loc="upper center", bbox_to_anchor=(0.45, -0.1), ncols=2, fontsize=8, frameon=False)


def write_words(axes: Axes, run: Run, index: int) -> None:
    """Write status and pose at a frame."""
    assert run.online.covariance is not None and run.online.status is not None
    pose = run.online.pose[index]
    words = pose_words(pose, world_sigma(pose, run.online.covariance[index])).replace(", ", "\n")
    axes.axis("off")
    axes.text(0.0, 1.0, f"{run.online.status[index]}\n\n{words}", fontsize=10, va="top", linespacing=1.6)


if __name__ == "__main__":
    pictures = animation(track(demo_recording(), TrackerSettings("learnt")))
    durations = [90] * (len(pictures) - 1) + [1500]  # [ms]
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/demo.gif")
    pictures[0].save(out, save_all=True, append_images=pictures[1:], duration=durations, loop=0, optimize=True)
