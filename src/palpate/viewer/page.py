"""A run as one HTML page with pictures of the push and a slider over time; it needs no other file and no network."""

import base64
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.geometry.se2 import ellipses_95
from palpate.pipeline.figures import ESTIMATE, OTHERS, draw_moment, millimetres, outline_at, run_figure
from palpate.pipeline.track import Run
from palpate.status import ORIGINS
from palpate.types.estimate import Answer, Origin, count_origins

PAGE = """<!DOCTYPE html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>palpate</title>
<style>
body { margin: 1rem auto; padding: 0 1rem; max-width: 1150px; }
input, img { width: 100%; margin: 0; }
</style>
<input id="slider" type="range" aria-label="time">
<img id="picture" alt="push from above, touch image, errors and status">
<pre>AMBIGUITY
INNOVATIONS</pre>
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


def write_page(run: Run, path: Path) -> None:
    """Write the page of a run."""
    from PIL import Image

    frames = np.unique(np.linspace(0, len(run.online) - 1, 150).round().astype(int))
    encoded: list[str] = []
    for picture in pictures(run, frames.tolist()):
        data = io.BytesIO()
        Image.fromarray(picture).save(data, "WEBP", quality=60)
        encoded.append(f"data:image/webp;base64,{base64.b64encode(data.getvalue()).decode()}")
    page = PAGE.replace("PICTURES", json.dumps(encoded))
    page = page.replace("AMBIGUITY", ambiguity_text(run.summary["ambiguous_by_origin"]))
    page = page.replace("INNOVATIONS", table(run.summary["innovations"]))
    path.write_text(page, encoding="utf-8")


def ambiguity_text(shares: Mapping[Origin, float]) -> str:
    """Return the causes of a run's ambiguity, a line for each with its share of the ambiguous frames, or ""."""
    lines = [f"{share:>16.0%}  {ORIGINS[origin]}" for origin, share in shares.items()]
    return "\n".join(("share of ambiguous frames with answers by", *lines, "")) if lines else ""


def table(scores: Mapping[str, Mapping[str, float | None]]) -> str:
    """Return the scores of innovations as text, a line for each factor; 1, 1 and 0 are right."""
    names = next(iter(scores.values()), {})
    rows = [["innovations", *names]]
    for factor, numbers in scores.items():
        rows.append([factor, *("-" if number is None else f"{number:.3g}" for number in numbers.values())])
    return "\n".join("".join(f"{cell:>16}" for cell in row) for row in rows)


def origin_lines(answers: Sequence[Answer]) -> list[str]:
    """Return a line for each origin of several answers, with their number; none for a single answer."""
    if len(answers) < 2:
        return []
    return [f"{origin}: {count}" for origin, count in count_origins(answers).items()]


def pictures(run: Run, frames: list[int]) -> Iterator[NDArray[np.uint8]]:
    """Draw a run at some frames, as RGB: the push from above, the touch image, and errors and status over time.

    What stays the same is drawn once, and what changes is drawn over it.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = run_figure(run, at_end=False)
    canvas = FigureCanvasAgg(figure)
    above, *plots = figure.axes
    figure.subplots_adjust(right=0.84)
    touch = figure.add_axes((0.85, 0.35, 0.14, 0.4))
    height = max(run.recording.sensor.image_height, 1)
    width = max(run.recording.sensor.image_width, 1)
    touch_image = touch.imshow(np.zeros((height, width, 3), np.uint8), animated=True)
    title = touch.set_title(" ", fontsize=11, animated=True)
    touch.axis("off")
    time = run.online.time - run.online.time[0]
    canvas.draw()
    above.autoscale(enable=False)
    still = canvas.copy_from_bbox(figure.bbox)
    for frame in frames:
        canvas.restore_region(still)
        moving = draw_moment(above, run, frame)
        ellipse = ellipses_95(run.online.pose[frame], run.online.covariance[frame])
        moving += above.plot(*millimetres(ellipse), color=ESTIMATE, lw=1.0)
        for answer in run.answers[frame][1:]:
            moving += above.plot(*outline_at(run, answer.pose), color=OTHERS, lw=1.0)
        moving += [axes.axvline(time[frame], color="black", lw=1.0) for axes in plots]
        lines = [f"{time[frame]:.2f} s", run.online.status[frame], *origin_lines(run.answers[frame])]
        title.set_text("\n".join(lines))
        shown = [*moving, title]
        with suppress(FileError):  # of a damaged image
            image = run.recording[frame].image
            if image is not None:
                touch_image.set_data(image)
                shown.append(touch_image)
        for artist in shown:
            figure.draw_artist(artist)
        yield np.array(canvas.buffer_rgba())[..., :3]
        for artist in moving:
            artist.remove()
