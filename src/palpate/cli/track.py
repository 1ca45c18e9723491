"""`palpate track`, `live` and `warm-up`: recordings tracked, a push as it happens, and compiled code."""

import webbrowser
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import palpate
from palpate.cli.console import Report, complain, progress_bar
from palpate.cli.options import Bag, Estimator, Force, Start, Touch, arg
from palpate.errors import PalpateError, SettingError
from palpate.files import new_file
from palpate.types.choices import BagChoices, Placement

if TYPE_CHECKING:
    from palpate.live.sources import Sources

SHOWN = ("final_status", "final_translation_error_mm", "final_rotation_error_deg", "silently_wrong_share")
"""Columns of the table of several runs."""


def track(
    files: Annotated[tuple[Path, ...], arg("FILE [FILE ...]", "required")],
    /,
    *,
    start: Start = Start(),
    touch: Touch = Touch(),
    estimator: Estimator = Estimator(),
    bag: Bag = Bag(),
    out: Annotated[Path | None, arg("DIR", "runs/<name>")] = None,
    mcap: bool = False,
    html: bool = False,
    view: bool = False,
    force: Force = False,
) -> Report:
    """Track the object of a recording, and write poses, covariances, scores and a figure to a folder.

    Example: palpate track push.mcap --first-pose 0.1 0 0.3 --first-pose-sigma 0.01 0.01 0.1

    Args:
        files: Recordings in any known format, or bags of ROS messages.
        out: Folder of the run; of several files, the folder of their runs.
        mcap: Write the estimates as ROS 2 messages too, estimates.mcap.
        html: Write a page that shows the push in any browser, page.html.
        view: Write this page and open it.
    """
    from palpate.pipeline.run_folder import PAGE

    if not files:
        raise SettingError("track takes a recording or several: palpate track FILE ...")
    settings = estimator.settings(touch.tactile, touch.markers)
    first_pose, sigma = start.pose_and_sigma()
    model, unit = touch.load(touch.tactile)
    tracking: dict[str, Any] = {
        "settings": settings,
        "first_pose": first_pose,
        "first_pose_sigma": sigma,
        "model": model,
        "calibration": unit,
    }
    runs: dict[Path, dict[str, Any]] = {}
    for file in files:
        folder = _folder_of(file, out, is_only=len(files) == 1)
        may_replace = force and folder not in runs
        try:
            runs[folder] = _track_file(file, folder, bag, tracking, _Output(mcap, html or view, may_replace))
        except PalpateError as error:
            if len(files) == 1:
                raise
            complain(f"{file}: {str(error).removeprefix(f'{file}: ')}")
    if view:
        _open_pages([folder / PAGE for folder in runs])
    if len(files) == 1:
        return run_report(*runs.popitem())
    shown = {str(folder): {key: summary[key] for key in SHOWN} for folder, summary in runs.items()}
    data = {"runs": {str(folder): summary for folder, summary in runs.items()}}
    return Report("runs", data, {"runs": shown}, code=3 if len(runs) < len(files) else 0)


@dataclass(frozen=True)
class _Output:
    """Files of a run that are asked for."""

    mcap: bool
    """Estimates as messages."""
    page: bool
    """The page of the run."""
    may_replace: bool
    """An earlier run in the folder is replaced."""


def _folder_of(file: Path, out: Path | None, is_only: bool) -> Path:
    """Return the folder for the run of a file, the only one or one of several."""
    if out and is_only:
        return out
    name = (file.with_suffix("") if file.suffix == ".gz" else file).stem or file.name
    return (out or Path("runs")) / name


def _track_file(file: Path, folder: Path, bag: Bag, tracking: dict[str, Any], output: _Output) -> dict[str, Any]:
    """Track a file into a folder and return the summary; `tracking` are the arguments of `palpate.track`."""
    from palpate.io.ros_messages import nanoseconds
    from palpate.pipeline.figures import draw
    from palpate.pipeline.run_folder import PAGE, new_run, write_files
    from palpate.pipeline.track import kept_warnings
    from palpate.viewer.page import write_page

    with new_run(folder, output.may_replace) as part:
        with kept_warnings() as warnings:
            recording, plane = bag.read(file)
        if output.mcap:
            nanoseconds(file, recording.time)  # raises before tracking if they cannot be stamps

        def keep(run: "palpate.Run") -> None:
            run.summary["warnings"][:0] = warnings
            if output.page:
                draw(part / PAGE, lambda page: write_page(run, page))
            write_files(run, part, plane if output.mcap else None)

        with progress_bar(file.name, len(recording)) as progress:
            run = palpate.track(recording, **tracking, progress=progress, keep=keep)
        keep(run)
    return run.summary


def _open_pages(pages: Sequence[Path]) -> None:
    """Open pages in the browser, but for those that could not be drawn, for which there was a warning."""
    for page in pages:
        if page.exists():
            webbrowser.open(page.resolve().as_uri())


def run_report(folder: Path, summary: dict[str, Any], *notes: str) -> Report:
    """Return the result of one run, with its final pose in words for people."""
    from palpate.pipeline.metrics import pose_words

    shown = summary | {"final_pose": pose_words(summary["final_pose"], summary["final_sigma"])}
    return Report("run", summary, shown, (*notes, f"run: {folder}   figure: {folder / 'figure.png'}"))


def warm_up() -> Report:
    """Compile what tracking needs and keep it, for example while a container image is built.

    Example: palpate warm-up
    """
    from palpate.compiled import cache_folder
    from palpate.models.pushing.compiled import PUSHING

    folder = cache_folder(PUSHING.improve)
    if not folder:
        raise PalpateError("compiled code cannot be kept: set NUMBA_CACHE_DIR to a folder that only you can write to")
    palpate.Tracker(palpate.Disc(0.05), palpate.DIGIT, None, palpate.TrackerSettings("learnt"))
    return Report("compiled code", {"folder": str(folder)})


def live(
    *,
    camera: Annotated[str | None, arg("N|PATH", "none; or --replay")] = None,
    poses: Annotated[str | None, arg("udp:PORT", "none; --camera needs it")] = None,
    replay: Annotated[Path | None, arg("FILE", "none; or --camera")] = None,
    record: Annotated[Path | None, arg("OUT.mcap", "none")] = None,
    seconds: Annotated[float | None, arg("S", "until Ctrl-C")] = None,
    force: Force = False,
    start: Start = Start(),
    touch: Touch = Touch(),
    bag: Bag = Bag(),
) -> Report:
    """Track as it happens: the newest image with the sensor's pose at its time; Ctrl-C ends it.

    A line shows status and pose; images that arrive faster than they are tracked are dropped and counted.

    Example: palpate live --camera 0 --poses udp:5005 --shape rectangle --first-pose 0.1 0 0.3

    Args:
        camera: Camera of the --sensor, by default a DIGIT, or a video or a folder of images in its place.
        poses: Sensor poses: JSON by UDP on this machine.
        replay: A recording or a bag, played in real time.
        record: Record images, sensor poses and estimates; a kill loses at most the last second.
        seconds: End after this time [s].
    """
    from palpate.live.session import LiveSession, recorder, stop_on_signals
    from palpate.pipeline.metrics import pose_words, world_sigma

    if touch.tactile == "oracle":
        raise SettingError("--tactile oracle needs ground truth, which is unknown live")
    if seconds is not None and not seconds > 0.0:
        raise SettingError(f"--seconds is {seconds:g}; allowed is a time above 0 [s]")
    if (camera is None) == (replay is None) or (camera is None) != (poses is None):
        raise SettingError("live takes either --camera with --poses, or --replay FILE")
    if record:
        new_file(record, force)
    model, unit = touch.load(touch.tactile)
    with ExitStack() as stack:
        if replay is None:
            setting = _live_setting(stack, str(camera), str(poses), start, bag)
        else:
            setting = _replay_setting(replay, start, bag)
        sources = setting.sources
        settings = palpate.TrackerSettings(touch.tactile, markers=touch.markers)
        options: Any = {"first_pose_sigma": setting.first_pose_sigma, "is_view_known": sources.is_view_known}
        tracker = palpate.Tracker(setting.shape, sources.sensor, setting.first_pose, settings, model, unit, **options)
        keep = record and stack.enter_context(recorder(record, setting.shape, sources, force))
        stop = stack.enter_context(stop_on_signals())
        session = LiveSession(tracker, sources, complain)
        bar = stack.enter_context(progress_bar(setting.name))

        def listen(item: Any) -> None:
            if keep:
                keep(item)
            if isinstance(item, palpate.Estimate):
                words = pose_words(item.pose, world_sigma(item.pose, item.covariance))
                bar(session.counts["tracked"], f"{item.status} {item.reason} {words}")

        session.run(stop, listen, float("inf") if seconds is None else seconds)
    return Report("live", session.summary(), notes=[f"recorded: {record}"] if record else ())


@dataclass(frozen=True, eq=False)
class _LiveSetting:
    """Sources of a live session, and the object."""

    name: str
    """Name of the sources for people."""
    sources: "Sources"
    shape: "palpate.Shape"
    first_pose: Any
    """world_T_object at the start, (3,) [m, m, rad]."""
    first_pose_sigma: Any
    """Standard deviations of the first pose; None for the default."""


def _live_setting(stack: ExitStack, camera: str, poses: str, start: Start, bag: Bag) -> _LiveSetting:
    """Open a camera and a source of poses, which the stack closes. Raises SettingError on missing or wrong options."""
    from palpate.live.camera import camera_sources
    from palpate.types.sensor_file import known_sensor

    first, sigma = start.pose_and_sigma()
    if bag.shape is None or first is None:
        raise SettingError("--camera needs --shape NAME|FILE, --first-pose X Y THETA or --first-pose-unknown")
    placement = {field.name: getattr(bag.choices, field.name) for field in fields(Placement)}
    if bag != Bag(bag.shape, bag.shape_unit, bag.sensor, choices=BagChoices(**placement)):
        words = ", ".join(f"--{name.replace('_', '-')}" for name in ("shape", "shape_unit", "sensor", *placement))
        raise SettingError(f"--camera: of the options for bags, only {words} apply")
    shape = palpate.load_shape(bag.shape, bag.shape_unit)
    with progress_bar("looking for images and poses"):
        sources = stack.enter_context(camera_sources(camera, poses, known_sensor(bag.sensor), bag.choices))
    return _LiveSetting(f"camera {camera}", sources, shape, first, sigma)


def _replay_setting(file: Path, start: Start, bag: Bag) -> _LiveSetting:
    """Return a recording as sources that play it in real time."""
    from palpate.live.sources import replayed
    from palpate.pipeline.track import first_pose_of_recording

    given_pose, given_sigma = start.pose_and_sigma()
    recording = bag.read(file).recording
    sources = replayed(recording)
    first, sigma = first_pose_of_recording(recording, palpate.NoiseSettings(), given_pose, given_sigma)
    return _LiveSetting(file.name, sources, recording.shape, first, sigma)
