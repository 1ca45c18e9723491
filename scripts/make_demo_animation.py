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

from palpate.cli.demo import TACTILE, demo_recording
from palpate.config import TrackerSettings
from palpate.geometry import se2
from palpate.geometry.lines import closed_outline
from palpate.pipeline.figures import (
    ESTIMATE,
    draw_errors,
    draw_object,
    draw_path,
    draw_sensor,
    draw_start,
    draw_touch,
    frame_above,
)
from palpate.pipeline.metrics import pose_words, world_sigma
from palpate.pipeline.track import Run, track

SIZE, DPI = (8.0, 5.2), 100  # [inch], [px] each
PLACES = {
    "above": (0.08, 0.18, 0.44, 0.80),
    "touch": (0.61, 0.56, 0.2, 0.39),
    "words": (0.82, 0.56, 0.18, 0.39),
    "translation": (0.61, 0.32, 0.375, 0.17),
    "rotation": (0.61, 0.10, 0.375, 0.17),
}
EVERY, INTERVAL, HOLD = 4, 90, 1500  # frames of the recording for one picture, [ms] it is shown, [ms] the last one is
MARGIN = 20.0  # [mm] about what is seen from above


def animation(run: Run, every: int = EVERY) -> list[Image.Image]:
    """Return pictures of a run with touch images, of one palette, the last one of its last frame."""
    figure = Figure(figsize=SIZE, dpi=DPI)
    canvas = FigureCanvasAgg(figure)
    axes = {name: figure.add_axes(place) for name, place in PLACES.items()}
    limits = seen_from_above(run)
    last = len(run.online) - 1
    pictures = []
    for index in [*range(0, last, every), last]:
        for each in axes.values():
            each.clear()
        draw_scene(axes["above"], run, index, limits)
        draw_touch(axes["touch"], run, index)
        axes["touch"].set(xlabel="", xticks=(), yticks=())
        write_words(axes["words"], run, index)
        draw_errors(axes["translation"], axes["rotation"], run, [])
        axes["translation"].set(ylabel="error [mm]")
        axes["rotation"].set(ylabel="error [°]")
        for name in ("translation", "rotation"):
            hide_from(axes[name], run, index)
            axes[name].yaxis.set_label_coords(-0.12, 0.5)
        canvas.draw()
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy()))
    return of_one_palette(pictures, axes["touch"])


def draw_scene(axes: Axes, run: Run, index: int, limits: np.ndarray) -> None:
    """Draw the push from above as it is at a frame; limits (2, 2) [mm] are the least and largest x and y."""
    draw_start(axes, run)
    draw_path(axes, run, index)
    draw_object(axes, run, index, 1.8, 1.0)
    draw_sensor(axes, run, index)
    axes.plot([], [], "o", color=ESTIMATE, fillstyle="none", label="95 % ellipse of the estimate")
    frame_above(axes)
    axes.set_aspect("equal", adjustable="box")
    axes.set(xlim=limits[:, 0], ylim=limits[:, 1])
    axes.legend(loc="upper center", bbox_to_anchor=(0.45, -0.1), ncols=2, fontsize=8, frameon=False)


def hide_from(axes: Axes, run: Run, index: int) -> None:
    """Hide what comes after a frame."""
    time = run.online.time - run.online.time[0]
    axes.axvspan(time[index], time[-1], color="white", lw=0, zorder=3)
    axes.axvline(time[index], color="#AAAAAA", lw=1.0, zorder=4)


def write_words(axes: Axes, run: Run, index: int) -> None:
    """Write status and pose at a frame."""
    assert run.online.covariance is not None and run.online.status is not None
    pose = run.online.pose[index]
    said = pose_words(pose, world_sigma(pose, run.online.covariance[index])).replace(", ", "\n")
    axes.axis("off")
    axes.text(0.0, 1.0, f"{run.online.status[index]}\n\n{said}", fontsize=10, va="top", linespacing=1.6)


def seen_from_above(run: Run) -> np.ndarray:
    """Return the least and largest x and y (2, 2) [mm] of object and sensor."""
    outlines = se2.transform(run.online.pose[:, None], closed_outline(run.recording.shape)).reshape(-1, 2)
    points = 1e3 * np.concatenate((outlines, run.recording.sensor_pose[:, :2]))
    return np.array((points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN))


def of_one_palette(pictures: list[Image.Image], touch: Axes) -> list[Image.Image]:
    """Return pictures in the same 256 colours: those that lines have most, and as many that suit touch."""
    left, lower, width, height = (round(each) for each in touch.get_window_extent().bounds)
    crop = (left, pictures[0].height - lower - height, left + width, pictures[0].height - lower)
    last = pictures[-1].copy()
    felt = last.crop(crop)
    last.paste((255, 255, 255), crop)
    counts = sorted(last.getcolors(last.width * last.height) or [], reverse=True)
    lines: list[int] = np.ravel([colour for _, colour in counts[:128]]).astype(int).tolist()
    palette = Image.new("P", (1, 1))
    palette.putpalette([*lines, *(felt.quantize(256 - len(lines) // 3).getpalette() or [])])
    return [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]


def write_gif(pictures: list[Image.Image], path: Path) -> None:
    """Write pictures, the last of which stays for a while."""
    durations = [INTERVAL] * (len(pictures) - 1) + [HOLD]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=durations, loop=0, optimize=True)


if __name__ == "__main__":
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/demo.gif")
    pictures = animation(track(demo_recording(), TrackerSettings(tactile=TACTILE)))
    write_gif(pictures, out)
    seconds = (INTERVAL * (len(pictures) - 1) + HOLD) / 1e3
    print(f"{out}: {len(pictures)} pictures, {seconds:.1f} s, {out.stat().st_size / 1e6:.2f} MB")
