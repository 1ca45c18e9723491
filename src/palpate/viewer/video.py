"""A run as a video: the push from above, the touch image, errors and status, picture by picture."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, PalpateError, SettingError
from palpate.geometry.se2 import ellipses_95
from palpate.pipeline.figures import ESTIMATE, OTHERS, draw_moment, millimetres, outline_at, run_figure
from palpate.pipeline.track import Run
from palpate.types.estimate import Answer, count_origins
from palpate.viewer.touch_picture import picture_size, touch_picture

SUFFIXES = (".mp4", ".gif")
RATE = 10.0
"""Pictures in a second of a video."""


def check_video(path: Path) -> None:
    """Raise SettingError if a file has no name of a video."""
    if path.suffix.lower() not in SUFFIXES:
        raise SettingError(f"--video {path}: extension {path.suffix!r} is of no video, allowed are .mp4 and .gif")


def write_video(run: Run, path: Path, kind: str, progress: Callable[[int], None] | None = None) -> None:
    """Write a run as a video of a kind, .mp4 or .gif; `progress` is called with the number of pictures done."""
    drawn = _counted(pictures(run, video_frames(run)), progress)
    if kind == ".gif":
        _write_gif(drawn, path)
    else:
        _write_mp4(drawn, path)


def video_frames(run: Run, most: int = 1000) -> list[int]:
    """Return the frames that a video shows: at its rate, and the last one; fewer of a long run, which plays faster."""
    time = run.online.time
    count = min(max(round((time[-1] - time[0]) * RATE), 1) + 1, most)
    instants = np.linspace(time[0], time[-1], count)
    return np.searchsorted(time, instants).clip(0, len(time) - 1).tolist()


def _counted(drawn: Iterator[NDArray[np.uint8]], progress: Callable[[int], None] | None) -> Iterator[NDArray[np.uint8]]:
    """Yield pictures and call `progress` with their number."""
    for index, picture in enumerate(drawn):
        yield picture
        if progress:
            progress(index + 1)


def _write_gif(drawn: Iterator[NDArray[np.uint8]], path: Path) -> None:
    """Write pictures as an animation that starts again; all share the colours of the last, so that none flickers."""
    from PIL import Image

    images = [Image.fromarray(picture) for picture in drawn]
    palette = images[-1].quantize(256)
    coded = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    durations = [round(1e3 / RATE)] * (len(coded) - 1) + [1500]  # [ms]
    options: Any = {"save_all": True, "append_images": coded[1:], "duration": durations, "loop": 0}
    coded[0].save(path, format="gif", **options)


def _write_mp4(drawn: Iterator[NDArray[np.uint8]], path: Path) -> None:
    """Write pictures as VP9, which browsers play and OpenCV brings. Raises PalpateError if this OpenCV does not."""
    import cv2

    temporary = path.with_name(f"{path.name}.mp4")  # OpenCV takes the format from the name
    writer: cv2.VideoWriter | None = None
    try:
        for picture in drawn:
            height, width = (2 * (side // 2) for side in picture.shape[:2])  # the codec takes even sizes
            if writer is None:
                writer = cv2.VideoWriter(
                    str(temporary), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"vp09"), RATE, (width, height)
                )
                if not writer.isOpened():
                    raise PalpateError("OpenCV here writes no VP9 video; --video FILE.gif needs none")
            writer.write(cv2.cvtColor(picture[:height, :width], cv2.COLOR_RGB2BGR))
        if writer is not None:
            writer.release()
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def pictures(run: Run, frames: Sequence[int]) -> Iterator[NDArray[np.uint8]]:
    """Draw a run at some frames, as RGB: the push from above, the touch image, and errors and status over time.

    What stays the same is drawn once, and what changes is drawn over it.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = run_figure(run, at_end=False)
    canvas = FigureCanvasAgg(figure)
    above, *plots = figure.axes
    figure.subplots_adjust(right=0.84)
    touch = figure.add_axes((0.85, 0.35, 0.14, 0.4))
    touch_image = touch.imshow(np.zeros((*picture_size(run.recording), 3), np.uint8), animated=True)
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
        lines = [f"{time[frame]:.2f} s", run.online.status[frame], *_origin_lines(run.answers[frame])]
        title.set_text("\n".join(lines))
        shown = [*moving, title]
        with suppress(FileError):  # of a damaged image
            image = touch_picture(run.recording, frame)
            if image is not None:
                touch_image.set_data(image)
                shown.append(touch_image)
        for artist in shown:
            figure.draw_artist(artist)
        yield np.array(canvas.buffer_rgba())[..., :3]
        for artist in moving:
            artist.remove()


def _origin_lines(answers: Sequence[Answer]) -> list[str]:
    """Return a line for each origin of several answers, with their number; none for a single answer."""
    if len(answers) < 2:
        return []
    return [f"{origin}: {count}" for origin, count in count_origins(answers).items()]
