"""A run as a video: the push from above, the touch image, errors and status, picture by picture."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, SettingError
from palpate.geometry import se2
from palpate.geometry.se2 import ellipses_95
from palpate.hints import library
from palpate.pipeline.figures import (
    ESTIMATE,
    OTHERS,
    SENSOR,
    TOUCHED_STYLE,
    TRUTH,
    band_at,
    estimated_outline_at,
    first_placed,
    millimetres,
    outline_at,
    run_figure,
    touched_at,
)
from palpate.pipeline.track import Run
from palpate.types.estimate import Answer, count_origins
from palpate.viewer.touch_picture import picture_size, touch_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SUFFIXES = (".mp4", ".gif")
RATE = 10.0
"""Pictures in a second of a video."""


def check_video(path: Path) -> None:
    """Raise SettingError if a file has no name of a video, or what writes it is not installed."""
    if path.suffix.lower() not in SUFFIXES:
        raise SettingError(f"--video {path}: extension {path.suffix!r} is of no video, allowed are .mp4 and .gif")
    if path.suffix.lower() == ".mp4":
        library("av", "video", f"--video {path}, unlike a .gif,")


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
    """Write pictures as H.264, which browsers and players take."""
    av = library("av", "video", "a video")
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=round(RATE), options={"crf": "20", "preset": "veryfast"})
        stream.pix_fmt = "yuv420p"
        for number, picture in enumerate(drawn):
            height, width = (2 * (side // 2) for side in picture.shape[:2])  # the codec takes even sizes
            if number == 0:
                stream.height = height
                stream.width = width
            even = np.ascontiguousarray(picture[:height, :width])
            container.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="rgb24")))
        container.mux(stream.encode())


class _Moving:
    """Parts that move in the push from above, and lines of the present moment in the plots: made once, then moved."""

    def __init__(self, above: "Axes", plots: "Sequence[Axes]", run: Run) -> None:
        self._run = run
        self._pads = [
            above.fill(*np.zeros((2, 3)), color=SENSOR, alpha=0.8, lw=0)[0] for _ in run.recording.sensor.pads
        ]
        self._truth = above.fill(*np.zeros((2, 3)), facecolor=TRUTH, edgecolor=TRUTH, alpha=0.2, lw=3.0)[0]
        self._band = above.fill(*np.zeros((2, 3)), facecolor=ESTIMATE, alpha=0.15, lw=0)[0]
        self._estimate = above.plot([], [], color=ESTIMATE, lw=1.8)[0]
        self._touched = above.plot([], [], **TOUCHED_STYLE)[0]
        self._ellipse = above.plot([], [], color=ESTIMATE, lw=1.0)[0]
        self._others = above.plot([], [], color=OTHERS, lw=1.0)[0]
        self._now = [axes.axvline(0.0, color="black", lw=1.0) for axes in plots]
        lines = [self._touched, self._estimate, *self._pads, self._ellipse, self._others, *self._now]
        self.artists: list[Any] = [self._truth, self._band, *lines]

    def move(self, frame: int) -> None:
        """Move all to a frame."""
        run = self._run
        online = run.online
        truth = run.recording.truth[frame]
        self._truth.set_visible(bool(np.isfinite(truth).all()) and run.recording.is_shape_known)
        if self._truth.get_visible():
            self._truth.set_xy(outline_at(run, truth).T)
        is_placed = frame >= first_placed(run)
        for part in (self._band, self._touched, self._estimate, self._ellipse):
            part.set_visible(is_placed)
        if run.outlines:
            self._band.set_xy(band_at(run, frame).T)
            self._touched.set_data(*touched_at(run, frame))
        self._estimate.set_data(*estimated_outline_at(run, frame))
        for artist, pad in zip(self._pads, run.recording.sensor.pads, strict=True):
            artist.set_xy(millimetres(se2.transform(run.recording.sensor_pose[frame], pad)).T)
        self._ellipse.set_data(*millimetres(ellipses_95(online.pose[frame], online.covariance[frame])))
        gap = np.full((2, 1), np.nan)
        others = [np.hstack([outline_at(run, answer.pose), gap]) for answer in run.answers[frame][1:]]
        self._others.set_data(*np.hstack([gap, *others]))
        for line in self._now:
            line.set_xdata([online.time[frame] - online.time[0]] * 2)


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
    blank = np.zeros((*picture_size(run.recording), 3), np.uint8)
    touch_image = touch.imshow(blank, animated=True, interpolation="nearest")
    title = touch.set_title(" ", fontsize=11, animated=True, parse_math=False)
    touch.axis("off")
    time = run.online.time - run.online.time[0]
    canvas.draw()
    above.autoscale(enable=False)
    still = canvas.copy_from_bbox(figure.bbox)
    moving = _Moving(above, plots, run)
    for frame in frames:
        canvas.restore_region(still)
        moving.move(frame)
        lines = [f"{time[frame]:.2f} s", run.online.status[frame], *_origin_lines(run.answers[frame])]
        title.set_text("\n".join(lines))
        shown = [*moving.artists, title]
        with suppress(FileError):  # of a damaged image
            image = touch_picture(run.recording, frame)
            if image is not None:
                touch_image.set_data(image)
                shown.append(touch_image)
        for artist in shown:
            figure.draw_artist(artist)
        yield np.array(canvas.buffer_rgba())[..., :3]


def _origin_lines(answers: Sequence[Answer]) -> list[str]:
    """Return a line for each origin of several answers, with their number; none for a single answer."""
    if len(answers) < 2:
        return []
    return [f"{origin}: {count}" for origin, count in count_origins(answers).items()]
