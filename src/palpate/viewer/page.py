"""A run as one HTML page that plays; it needs no other file and no network.

Matplotlib draws what stays the same; the page draws object, sensor and time over it.
"""

import base64
import html
import io
import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.arrays import Array
from palpate.errors import FileError
from palpate.geometry.se2 import ellipses_95
from palpate.pipeline.figures import (
    ESTIMATE,
    OTHERS,
    SENSOR,
    STATUS_COLOURS,
    TRUTH,
    draw_errors,
    draw_from_above,
    draw_moment,
    draw_status,
    first_placed,
    name_others,
    title_of,
)
from palpate.pipeline.track import Run
from palpate.status import ORIGINS
from palpate.types.estimate import Origin
from palpate.viewer.touch_picture import touch_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TEMPLATE = Path(__file__).with_name("page.html")


def write_page(run: Run, path: Path) -> None:
    """Write the page of a run."""
    name, *result = title_of(run).split("\n")
    scores = ambiguity_text(run.summary["ambiguous_by_origin"]) + table(run.summary["innovations"])
    page = TEMPLATE.read_text(encoding="utf-8")
    page = page.replace("TITLE", html.escape(name))
    page = page.replace("RESULT", html.escape("; ".join(result)))
    page = page.replace("SCORES", html.escape(scores))
    data = json.dumps(content(run), allow_nan=False, separators=(",", ":"))
    page = page.replace("DATA", data.replace("<", "\\u003c"))  # last, as it may hold any word
    path.write_text(page, encoding="utf-8")


def content(run: Run) -> dict[str, Any]:
    """Return the content of the page: drawings, touch images, and all that moves, in mm, rad and s since the start."""
    online = run.online
    frames = _shown_frames(len(online))
    pose = online.pose[frames]
    ellipses = ellipses_95(pose, online.covariance[frames])
    quarter = ellipses.shape[1] // 4
    half_axes = ellipses[:, [0, quarter]] - pose[:, None, :2]
    reasons = list(dict.fromkeys(online.reason))
    recording = run.recording
    return {
        "time": np.round(online.time[frames] - online.time[0], 3).tolist(),
        "pose": _poses(pose),
        "halfAxes": np.round(1e3 * half_axes.reshape(-1, 4), 2).tolist(),
        "truth": _poses(recording.truth[frames]),
        "others": [_poses(np.array([answer.pose for answer in run.answers[frame][1:]])) for frame in frames],
        "status": [online.status[frame] for frame in frames],
        "reason": [reasons.index(online.reason[frame]) for frame in frames],
        "reasons": reasons,
        "touch": _touch_images(run, frames),
        "outline": np.round(1e3 * recording.shape.outline(100), 2).tolist(),
        "showsTruth": recording.is_shape_known,
        "learnt": _learnt_outlines(run, frames),
        "placedFrom": int(np.searchsorted(frames, first_placed(run))),
        "tips": [
            {"pads": [np.round(1e3 * pad, 2).tolist() for pad in sensor.pads], "pose": _poses(pose[frames])}
            for sensor, pose in recording.tips()
        ],
        "above": _picture(*_above(run)),
        "errors": _picture(*_over_time(run)),
        "colours": {"truth": TRUTH, "estimate": ESTIMATE, "sensor": SENSOR, "others": OTHERS, "status": STATUS_COLOURS},
    }


def ambiguity_text(shares: Mapping[Origin, float]) -> str:
    """Return the causes of a run's ambiguity, a line for each with its share of the ambiguous frames, or ""."""
    lines = [f"{share:>16.0%}  {ORIGINS[origin]}" for origin, share in shares.items()]
    return "\n".join(("share of ambiguous frames with answers by", *lines, "", "")) if lines else ""


def table(scores: Mapping[str, Mapping[str, float | None]]) -> str:
    """Return the scores of innovations as text, a line for each factor; 1, 1 and 0 are right."""
    names = next(iter(scores.values()), {})
    rows = [["innovations", *names]]
    for factor, numbers in scores.items():
        rows.append([factor, *("-" if number is None else f"{number:.3g}" for number in numbers.values())])
    return "\n".join("".join(f"{cell:>16}" for cell in row) for row in rows)


def _poses(poses: Array) -> list[Any]:
    """Return poses (N, 3) [m, m, rad] in mm and rad, None for unknown ones."""
    rounded = np.round(poses.reshape(-1, 3) * (1e3, 1e3, 1.0), 4).tolist()
    return [pose if np.isfinite(pose).all() else None for pose in rounded]


def _above(run: Run) -> "tuple[Figure, Axes, Axes]":
    """Return the paths from above, with room for the object and the sensor, and the axes that bound the picture."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6, 4.9), dpi=200)  # a screen shows half as many pixels
    axes = figure.add_axes((0.15, 0.22, 0.83, 0.76))
    draw_from_above(axes, run)
    for artist in draw_moment(axes, run, len(run.online) - 1):
        artist.set_visible(False)
    name_others(axes, run)
    figure.legend(*axes.get_legend_handles_labels(), loc="lower center", ncols=2, frameon=False, fontsize=9)
    return figure, axes, axes


def _over_time(run: Run) -> "tuple[Figure, Axes, Axes]":
    """Return errors and status over time, and the first and the last of their axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6, 4.9), dpi=200)  # a screen shows half as many pixels
    grid: Any = {"height_ratios": (3.0, 3.0, 0.4), "left": 0.15, "right": 0.98, "bottom": 0.25, "top": 0.98}
    translation, rotation, status = figure.subplots(3, sharex=True, gridspec_kw={**grid, "hspace": 0.1})
    draw_errors(translation, rotation, run)
    draw_status(status, run)
    handles: dict[str, Any] = {}
    for axes in (translation, status):
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles[label] = handle
    figure.legend(handles.values(), handles, loc="lower center", ncols=3, frameon=False, fontsize=9)
    return figure, translation, status


def _picture(figure: "Figure", first: "Axes", last: "Axes") -> dict[str, Any]:
    """Return a figure as a picture with its size, the box from its first axes to its last, and the limits of these."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure).draw()  # fixes the limits
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=figure.dpi)
    width, height = figure.bbox.size
    top_box = first.get_window_extent()
    bottom_box = last.get_window_extent()
    return {
        "picture": _uri("png", data.getvalue()),
        "size": [round(width), round(height)],
        "box": [top_box.x0, height - top_box.y1, top_box.x1, height - bottom_box.y0],
        "limits": [*last.get_xlim(), *last.get_ylim()],
    }


def _shown_frames(count: int, most: int = 1500) -> "np.typing.NDArray[np.int_]":
    """Return the frames that the page shows: all, or some of a long run at equal steps, and the last."""
    return np.unique(np.append(np.arange(0, count, -(-count // most)), count - 1))


def _learnt_outlines(
    run: Run, frames: "np.typing.NDArray[np.int_]", most: int = 300
) -> list[tuple[int, list[Any], list[Any], list[Any], list[int]]]:
    """Return outlines as they were learnt, each with its place among the frames.

    These are its points, inner and outer edge [mm], and which of the points were touched.
    """
    if not run.outlines:
        return []
    places = range(0, len(frames), -(-len(frames) // most))
    learnt = []
    for place in dict.fromkeys([*places, len(frames) - 1]):
        outline = run.outlines[frames[place]]
        lines = (np.round(1e3 * line, 1).tolist() for line in (outline.points, *outline.edges()))
        learnt.append((place, *lines, np.flatnonzero(outline.touched).tolist()))
    return learnt


def _touch_images(
    run: Run, frames: "np.typing.NDArray[np.int_]", most: int = 300, height: int = 220
) -> list[tuple[int, str]]:
    """Return touch images of a height [px], each with its place among the frames; damaged ones are left out."""
    from PIL import Image

    images: list[tuple[int, str]] = []
    if run.recording.image is None and run.recording.images is None:
        return images
    for place in range(0, len(frames), -(-len(frames) // most)):
        with suppress(FileError):  # of a damaged image
            image = touch_picture(run.recording, int(frames[place]))
            if image is None:
                continue
            size = (max(round(image.shape[1] * height / image.shape[0]), 1), height)
            coded = io.BytesIO()
            Image.fromarray(image).resize(size, Image.Resampling.BOX).save(coded, "jpeg", quality=80)
            images.append((place, _uri("jpeg", coded.getvalue())))
    return images


def _uri(kind: str, data: bytes) -> str:
    """Return a picture as a data URI."""
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
