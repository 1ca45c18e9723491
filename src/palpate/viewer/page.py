"""A run as one HTML page that needs no other file and no network: the push, played, with touch images and plots.

Matplotlib draws what does not move, as SVG; the page lays object, sensor and time over it.
"""

import base64
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, printable
from palpate.files import whole_file
from palpate.geometry.se2 import half_axes_95
from palpate.pipeline.figures import CONTACT, ESTIMATE, SENSOR, TRUTH, draw_errors, draw_path, frame_above, own_style
from palpate.pipeline.track import Run
from palpate.pipeline.truth import flag_runs
from palpate.types.estimate import Status
from palpate.types.images import encode_image
from palpate.types.recording import Recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

COLOURS = {"truth": TRUTH, "estimate": ESTIMATE, "sensor": SENSOR, "contact": CONTACT, "others": "#CC79A7"}
STATUS_COLOURS: dict[Status, str] = {
    "tracking": "#009E73",
    "resting": "#A6B8C2",
    "ambiguous": "#E69F00",
    "strained": "#D55E00",
    "uncertain": "#F0E442",
    "displaced": "#CC79A7",
    "indeterminate": "#7F3FBF",
    "faulty": "#B00020",
}


@own_style(**{"svg.fonttype": "none", "svg.hashsalt": "palpate"})
def write_page(run: Run, name: str, path: Path) -> None:
    """Write the page of a run, whole or not at all; FileError if it exists."""
    import jinja2
    import markupsafe

    data = json.dumps(_moving(run), allow_nan=False, separators=(",", ":"))
    template = Path(__file__).with_name("page.html.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    page = environment.from_string(template).render(
        name=printable(name),
        summary=run.summary,
        colours=COLOURS,
        outline=_svg_points(run.recording.shape.closed_outline),
        pads=[_svg_points(pad) for pad in run.recording.sensor.pads],
        above=_above(run),
        plots=_plots(run),
        data=markupsafe.Markup(data.replace("<", "\\u003c")),  # which is safe inside a script element
    )
    with whole_file(path) as part:
        part.write_text(page, encoding="utf-8")


def _above(run: Run) -> dict[str, Any]:
    """Return the paths seen from above, and the matrix that takes millimetres to units of the drawing."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.5, 5.5), dpi=72, layout="constrained")
    axes = figure.add_subplot()
    draw_path(axes, run, len(run.online) - 1)
    axes.plot([], [], color=COLOURS["others"], label="other answers")
    reach = 1e3 * np.hypot(*run.recording.shape.outline().T).max()
    places = 1e3 * run.online.pose[:, :2]
    axes.update_datalim([places.min(axis=0) - reach, places.max(axis=0) + reach])
    axes.autoscale_view()
    frame_above(axes)
    drawing = _svg_with_legend(figure)
    (left, bottom), (right, top) = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
    matrix = [right - left, 0.0, 0.0, bottom - top, left, figure.bbox.height - bottom]
    return {"drawing": drawing, "size": figure.bbox.size, "matrix": " ".join(f"{one:.6g}" for one in matrix)}


def _plots(run: Run) -> dict[str, Any]:
    """Return errors and status over time, the places of the first and the last frame across, and the lower end."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.5, 6.0), dpi=72, layout="constrained")
    translation, rotation, status = figure.subplots(3, sharex=True, height_ratios=(3.0, 3.0, 0.4))
    draw_errors(translation, rotation, run)
    time = run.online.time - run.online.time[0]
    for word, colour in STATUS_COLOURS.items():
        for first, last in flag_runs(np.array(run.online.status) == word):
            status.axvspan(time[first], time[min(last + 1, len(time) - 1)], color=colour, lw=0, label=word)
    status.set(yticks=[], ylabel="status", xlabel="time [s]")
    rotation.set(xlabel="")
    drawing = _svg_with_legend(figure)
    ends = status.transData.transform([(time[0], 0.0), (time[-1], 0.0)])[:, 0]
    bottom = figure.bbox.height - status.bbox.y0
    return {"drawing": drawing, "size": figure.bbox.size, "from": ends[0], "to": ends[1], "bottom": bottom}


def _svg_with_legend(figure: "Figure") -> Any:
    """Return a figure as an SVG element, whose text is text."""
    import markupsafe

    pairs = (zip(*axes.get_legend_handles_labels(), strict=True) for axes in figure.axes)
    handles = {label: handle for some in pairs for handle, label in some}
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=3, frameon=False)
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    text = file.getvalue()
    return markupsafe.Markup(text[text.index("<svg") :])


def _svg_points(points: Array) -> str:
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in 1e3 * points)


def _moving(run: Run) -> dict[str, Any]:
    """Return what changes over time, in mm and degrees, None where it is unknown; long runs are thinned."""
    online, recording = run.online, run.recording
    assert online.covariance is not None and online.contact is not None and online.status is not None
    frames = np.arange(0, len(online), -(-len(online) // 600))
    axes = half_axes_95(online.covariance[frames]).swapaxes(1, 2).reshape(-1, 4)
    others = (np.reshape([one.pose for one in run.answers[frame][1:]], (-1, 3)) for frame in frames)
    return {
        "time": np.round(online.time[frames] - online.time[0], 3).tolist(),
        "estimate": _poses(online.pose[frames]),
        "truth": _poses(run.truth[frames]),
        "sensor": _poses(recording.sensor_pose[frames]),
        "contact": online.contact[frames].tolist(),
        "others": list(map(_poses, others)),
        "halfAxes": np.round(1e3 * axes, 3).tolist(),
        "status": [online.status[frame] for frame in frames],
        "touch": [_touch(recording, frame) for frame in frames.tolist()],
    }


def _touch(recording: Recording, frame: int) -> str | None:
    """Return a touch image 160 pixels wide; None if there is none, or it is damaged."""
    import cv2

    try:
        image = recording[frame].image
    except FileError:
        return None
    if image is None:
        return None
    small = cv2.resize(image, (160, round(image.shape[0] * 160 / image.shape[1])), interpolation=cv2.INTER_AREA)
    return f"data:image/jpeg;base64,{base64.b64encode(encode_image(np.asarray(small, np.uint8))).decode()}"


def _poses(pose: Array) -> list[list[float] | None]:
    """Return poses (N, 3) in mm and degrees, None for unknown ones."""
    rounded = np.round(pose * (1e3, 1e3, np.degrees(1.0)), 3)
    return [one.tolist() if np.isfinite(one).all() else None for one in rounded]
