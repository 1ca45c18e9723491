"""A run as one HTML page that needs no other file and no network: pictures of the push, and a slider over time."""

import base64
import html
import io
import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, printable
from palpate.files import whole_file
from palpate.geometry.se2 import ellipses_95
from palpate.pipeline.figures import (
    CONTACT,
    ESTIMATE,
    SENSOR,
    TRUTH,
    draw_errors,
    draw_moment,
    draw_path,
    millimetres,
    outline_at,
    own_style,
    title_of,
)
from palpate.pipeline.track import Run
from palpate.pipeline.truth import flag_runs
from palpate.types.estimate import Status

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
PAGE = """<!DOCTYPE html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>palpate</title>
<style>
body { margin: 1rem auto; padding: 0 1rem; max-width: 1000px; font: 16px/1.5 sans-serif; overflow-wrap: break-word; }
input, img { width: 100%; margin: 0; }
</style>
<p>TITLE</p>
<input id="slider" type="range" aria-label="time">
<img id="picture" alt="push from above, touch image, errors and status">
<script>
const pictures = PICTURES;
const slider = document.getElementById("slider");
const show = () => { document.getElementById("picture").src = pictures[slider.value]; };
slider.max = pictures.length - 1;
slider.value = slider.max;
slider.addEventListener("input", show);
show();
</script>
</html>
"""


@own_style()
def write_page(run: Run, path: Path) -> None:
    """Write the page of a run, whole or not at all; FileError if it exists."""
    from PIL import Image

    encoded: list[str] = []
    for picture in pictures(run, np.unique(np.linspace(0, len(run.online) - 1, 150).round().astype(int)).tolist()):
        data = io.BytesIO()
        Image.fromarray(picture).save(data, "WEBP", quality=60)
        encoded.append(f"data:image/webp;base64,{base64.b64encode(data.getvalue()).decode()}")
    title = html.escape(printable(title_of(run))).replace("\n", "<br>")
    with whole_file(path) as part:
        page = PAGE.replace("PICTURES", json.dumps(encoded)).replace("TITLE", title)
        part.write_text(page, encoding="utf-8")


def pictures(run: Run, frames: list[int]) -> Iterator[NDArray[np.uint8]]:
    """Draw a run at some frames, as RGB: the push from above, the touch image, and errors and status over time.

    What stays is drawn once, and what moves is drawn over it.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    assert run.online.covariance is not None and run.online.status is not None
    figure = Figure(figsize=(10.0, 6.2), dpi=100, layout="constrained")
    canvas, names = FigureCanvasAgg(figure), ("touch", "translation", "rotation", "status")
    axes = figure.subplot_mosaic([["above", name] for name in names], height_ratios=(3.0, 2.0, 2.0, 0.4))
    above, touch, translation, rotation, status = (axes[name] for name in ("above", *names))
    draw_path(above, run)
    above.plot([], [], color=COLOURS["others"], label="other answers")
    for frame in np.linspace(0, len(run.online) - 1, 20).astype(int):  # makes room for the object
        above.plot(*outline_at(run, run.online.pose[frame]), alpha=0.0)
    draw_errors(translation, rotation, run)
    time = run.online.time - run.online.time[0]
    for word, colour in STATUS_COLOURS.items():
        for first, last in flag_runs(np.array(run.online.status) == word):
            status.axvspan(time[first], time[min(last + 1, len(time) - 1)], color=colour, lw=0)
    status.set(xlim=rotation.get_xlim(), yticks=[], ylabel="status", xlabel="time [s]")
    rotation.set(xlabel="")
    rotation.tick_params(labelbottom=False)
    size = max(run.recording.sensor.image_height, 1), max(run.recording.sensor.image_width, 1)
    seen = touch.imshow(np.zeros((*size, 3), np.uint8), animated=True)
    words = touch.set_title(" ", animated=True)
    touch.axis("off")
    figure.legend(loc="outside lower center", ncols=5, frameon=False, handles=above.get_legend_handles_labels()[0])
    canvas.draw()
    figure.set_layout_engine("none")
    above.autoscale(enable=False)
    still = canvas.copy_from_bbox(figure.bbox)
    for frame in frames:
        canvas.restore_region(still)
        moving = draw_moment(above, run, frame)
        ellipse = ellipses_95(run.online.pose[frame], run.online.covariance[frame])
        moving += above.plot(*millimetres(ellipse), color=ESTIMATE, lw=1.0)
        for answer in run.answers[frame][1:]:
            moving += above.plot(*outline_at(run, answer.pose), color=COLOURS["others"], lw=1.0)
        moving += [each.axvline(time[frame], color="black", lw=1.0) for each in (translation, rotation, status)]
        words.set_text(f"{time[frame]:.2f} s, {run.online.status[frame]}")
        image = None
        with suppress(FileError):  # of a damaged one
            image = run.recording[frame].image
        if image is not None:
            seen.set_data(image)
        for artist in (*moving, words, *([] if image is None else [seen])):
            figure.draw_artist(artist)
        yield np.array(canvas.buffer_rgba())[..., :3]
        for artist in moving:
            artist.remove()
