"""`palpate track`, `live` and `warm-up`: recordings tracked, a push as it happens, and compiled code."""

import shlex
import webbrowser
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import palpate
from palpate.cli.console import Report, complain, progress_bar
from palpate.cli.learnt_outline import LearntOutline, read_for
from palpate.cli.options import Bag, BagOptions, Estimator, Force, Start, Touch, arg
from palpate.cli.quantities import TIME, quantities
from palpate.cli.sources import Source
from palpate.cli.track_files import Outcome, Outputs, Way, load_estimator, read_first_poses, track_file, track_files
from palpate.errors import SettingError
from palpate.files import new_file
from palpate.hints import own_command
from palpate.types.choices import Placement, TableChoices

if TYPE_CHECKING:
    from palpate.live.sources import Sources

MOST_DROPPED = 0.1
"""Share of dropped images of a live session above which a note says why."""


@dataclass(frozen=True)
class RunFiles:
    """Files of a run besides poses, scores and figure."""

    tum: bool = False
    """Write trajectory.tum, which evo reads, and truth.tum if there is ground truth."""
    video: Annotated[Path | None, arg("FILE.mp4|FILE.gif", "none")] = None
    """Write a video of the push."""
    html: bool = False
    """Write a page that plays the push in any browser, page.html."""
    view: bool = False
    """Write this page and open it."""
    mcap: bool = False
    """Write the estimates as ROS 2 messages too, estimates.mcap."""

    def check(self, files: int, force: bool) -> None:
        """Raise PalpateError if the video cannot be written, or there are several files for it."""
        from palpate.viewer.video import check_video

        if self.video is None:
            return
        check_video(self.video)
        if files > 1:
            raise SettingError(f"--video {self.video}: is of one recording, found {files}")
        new_file(self.video, force)

    def outputs(self, may_replace: bool) -> Outputs:
        """Return the outputs that these options ask for."""
        return Outputs(self.mcap, self.tum, self.html or self.view, self.video, may_replace)


def track(
    files: Annotated[tuple[Path, ...], arg("FILE [FILE ...]", "required")],
    /,
    *,
    start: Start = Start(),
    first_poses: Annotated[Path | None, arg("TABLE", "none")] = None,
    touch: Touch = Touch(),
    estimator: Estimator = Estimator(),
    bag: Bag = Bag(),
    tables: TableChoices = TableChoices(),
    episode: Annotated[int, arg("N")] = 0,
    outline: LearntOutline = LearntOutline(),
    out: Annotated[Path | None, arg("DIR", "runs/<name>")] = None,
    files_of_run: RunFiles = RunFiles(),
    workers: Annotated[int, arg("N")] = 1,
    resume: bool = False,
    force: Force = False,
) -> Report:
    """Track the object of a recording, and write poses, covariances, scores and a figure to a folder.

    Example: palpate track push.mcap --first-pose 0.1 0 17deg --first-pose-sigma 10mm 10mm 6deg

    Example: palpate track images --poses ee.csv --shape 0.09x0.06 --first-pose 0.1 0 0.3

    Args:
        files: Recordings in any known format, bags of ROS messages, a folder of images with --poses, or a dataset of
            LeRobot.
        first_poses: The first poses of several files: a table with the columns file, x, y, theta and, if known,
            sigma_x, sigma_y, sigma_theta [m, rad, or with units].
        episode: Episode of a dataset of LeRobot.
        out: Folder of the run; of several files, the folder of their runs.
        workers: Processes that share several files.
        resume: Keep whole runs of the same files by the same settings, and make the rest.
    """
    from palpate.parallel import check_workers
    from palpate.pipeline.run_folder import PAGE

    if not files:
        raise SettingError("track takes a recording or several: palpate track FILE ...")
    files_of_run.check(len(files), force)
    check_workers(workers)
    if first_poses and start != Start():
        raise SettingError("--first-poses cannot be combined with the options of one first pose")
    start.pose_and_sigma()  # raises here, once for all files
    model, unit = touch.load(touch.tactile)
    table = read_first_poses(first_poses) if first_poses else None
    source = Source(bag, tables, episode)
    settings = estimator.settings(touch.tactile, touch.markers)
    way = Way(settings, start, source, model, unit, table, outline.of(bag))
    outputs = files_of_run.outputs(force)
    jobs = [(file, _folder_of(file, out, is_only=len(files) == 1)) for file in files]
    if len(files) == 1 and not resume:
        summary = track_file(*jobs[0], way, outputs)
        done = [Outcome(*jobs[0], summary)]
    else:
        done = track_files(jobs, way, outputs, workers, resume)
    if files_of_run.view:
        _open_pages([outcome.folder / PAGE for outcome in done])
    if len(files) == 1 and done[0].summary is not None:
        return run_report(done[0].folder, done[0].summary, files[0].name, files_of_run.video)
    return _runs_report(done)


def _folder_of(file: Path, out: Path | None, is_only: bool) -> Path:
    """Return the folder for the run of a file, the only one or one of several."""
    if out and is_only:
        return out
    file = file.resolve() if file.name in ("", "..") else file  # as the current folder is named
    name = (file.with_suffix("") if file.suffix == ".gz" else file).stem or file.name
    return (out or Path("runs")) / name


def _open_pages(pages: Sequence[Path]) -> None:
    """Open pages in the browser, but for those that could not be drawn, for which there was a warning."""
    for page in pages:
        if page.exists():
            webbrowser.open(page.resolve().as_uri())


def run_report(folder: Path, summary: dict[str, Any], name: str, video: Path | None = None) -> Report:
    """Return the result of one run, with its final pose in words for people."""
    from palpate.pipeline.metrics import pose_words
    from palpate.pipeline.report import run_lines

    shown = summary | {"final_pose": pose_words(summary["final_pose"], summary["final_sigma"])}
    lines = run_lines(name, summary, folder)
    if video is not None:
        lines[-1] += f"; {video}"
    return Report("run", summary, shown, lines)


def _runs_report(outcomes: Sequence[Outcome]) -> Report:
    """Return the results of several recordings, a row for each."""
    from palpate.pipeline.report import run_row

    runs = {str(outcome.folder): outcome.summary for outcome in outcomes if outcome.summary is not None}
    failed = [{"file": str(outcome.file), "error": outcome.error} for outcome in outcomes if outcome.error]
    kept = sum(outcome.is_kept for outcome in outcomes)
    data = {"runs": runs, "kept": kept, "failed": failed}
    shown = {
        "kept": kept,
        "failed": len(failed),
        "runs": {folder: run_row(summary) for folder, summary in runs.items()},
    }
    return Report("recordings", data, shown, code=3 if failed else 0)


def warm_up() -> Report:
    """Compile what tracking needs and keep it, for example while a container image is built.

    Example: palpate warm-up
    """
    from palpate.compiled.library import path_of
    from palpate.models.pushing.compiled import PUSHING

    load_estimator()
    path = path_of(PUSHING.improve)
    assert path is not None, "it was made just now"
    return Report("compiled code", {"folder": str(path.parent)})


def ros2(*words: str) -> int:
    """Run a ROS 2 node that tracks an object as it happens.

    Example: palpate ros2 --ros-args -p shape:=rectangle -p first_pose:='[0.1, 0.0, 0.3]'

    Args:
        words: Arguments of ROS; --help explains them.
    """
    from palpate.ros2 import main

    return main(words)


@dataclass(frozen=True)
class Session:
    """The length of a live session, and its recording."""

    seconds: Annotated[float | None, quantities("--seconds", "S", TIME), arg("S", "until Ctrl-C")] = None
    """End after this time [s]."""
    record: Annotated[Path | None, arg("OUT.mcap", "none")] = None
    """Record images, sensor poses and estimates; a kill loses at most the last second."""
    force: Force = False


def live(
    *,
    camera: Annotated[str | None, arg("N|PATH", "none; or --replay")] = None,
    poses: Annotated[str | None, arg("udp:PORT", "none; --camera needs it")] = None,
    replay: Annotated[Path | None, arg("FILE", "none; or --camera")] = None,
    session: Session = Session(),
    start: Start = Start(),
    touch: Touch = Touch(),
    bag: Bag = Bag(),
    outline: LearntOutline = LearntOutline(),
) -> Report:
    """Track as it happens: the newest image with the sensor's pose at its time; Ctrl-C ends it.

    A line shows status and pose; images that arrive faster than they are tracked are dropped and counted.

    Example: palpate live --camera 0 --poses udp:5005 --shape rectangle --first-pose 0.1 0 0.3

    Args:
        camera: Camera of the --sensor, by default a DIGIT, or a video or a folder of images in its place; of a hand,
            with --mounts, left=0,right=1.
        poses: Sensor poses: JSON by UDP on this machine.
        replay: A recording or a bag, played in real time.
    """
    from palpate.live.session import LiveSession, recorder, stop_on_signals
    from palpate.pipeline.metrics import pose_words, world_sigma

    if touch.tactile == "oracle":
        raise SettingError("--tactile oracle needs ground truth, which is unknown live")
    record = session.record
    seconds = session.seconds
    if seconds is not None and not seconds > 0.0:
        raise SettingError(f"--seconds is {seconds:g}; allowed is a time above 0 [s]")
    if (camera is None) == (replay is None) or (camera is None) != (poses is None):
        raise SettingError("live takes either --camera with --poses, or --replay FILE")
    if record:
        new_file(record, session.force)
    model, unit = touch.load(touch.tactile)
    load_estimator()  # before images come
    with ExitStack() as stack:
        if replay is None:
            setting = _live_setting(stack, str(camera), str(poses), start, bag, outline.of(bag))
        else:
            setting = _replay_setting(replay, start, bag, outline.of(bag))
        sources = setting.sources
        settings = palpate.TrackerSettings(touch.tactile, markers=touch.markers)
        options: Any = {"first_pose_sigma": setting.first_pose_sigma, "is_view_known": sources.is_view_known}
        tracker = palpate.Tracker(setting.shape, sources.sensor, setting.first_pose, settings, model, unit, **options)
        keep = record and stack.enter_context(recorder(record, setting.shape, sources, session.force))
        stop = stack.enter_context(stop_on_signals())
        running = LiveSession(tracker, sources, complain)
        bar = stack.enter_context(progress_bar(setting.name))

        def listen(item: Any) -> None:
            if keep:
                keep(item)
            if isinstance(item, palpate.Estimate):
                words = pose_words(item.pose, world_sigma(item.pose, item.covariance))
                bar(running.counts["tracked"], f"{item.status} {item.reason} {words}")

        running.run(stop, listen, float("inf") if seconds is None else seconds)
    notes = [f"recorded: {record}"] if record else []
    dropped = running.counts["dropped"]
    if dropped > MOST_DROPPED * running.counts["images"]:
        every = f"; {own_command()} track {shlex.quote(str(replay))} takes every image" if replay else ""
        notes.append(
            f"{dropped} images were dropped, as this machine takes longer for a step than there is time{every}"
        )
    return Report("live", running.summary(), notes=notes)


@dataclass(frozen=True, eq=False)
class _LiveSetting:
    """Sources of a live session, and the object."""

    name: str
    """Name of the sources for people."""
    sources: "Sources"
    shape: "palpate.Shape | palpate.Unknown | palpate.Sketch"
    first_pose: Any
    """world_T_object at the start, (3,) [m, m, rad]; None if the first contact makes it."""
    first_pose_sigma: Any
    """Standard deviations of the first pose; None for the default."""


def _live_setting(
    stack: ExitStack,
    camera: str,
    poses: str,
    start: Start,
    bag: Bag,
    outline: "palpate.Unknown | palpate.Sketch | None",
) -> _LiveSetting:
    """Open a camera and a source of poses, which the stack closes. Raises SettingError on missing or wrong options."""
    from palpate.live.camera import camera_sources, hand_sources
    from palpate.types.hand import by_finger
    from palpate.types.sensor_file import known_sensor

    first, sigma = start.pose_and_sigma()
    if bag.shape is None or (first is None and not isinstance(outline, palpate.Unknown)):
        raise SettingError("--camera needs --shape NAME|AxB|FILE, --first-pose X Y THETA or --first-pose-unknown")
    placement = {field.name: getattr(bag.choices, field.name) for field in fields(Placement)}
    given = Bag(bag.shape, bag.shape_unit, bag.shape_layer, bag.sensor, bag.mounts, BagOptions(**placement))
    if bag != given:
        names = ("shape", "shape_unit", "shape_layer", "sensor", "mounts", *placement)
        words = ", ".join(f"--{name.replace('_', '-')}" for name in names)
        raise SettingError(f"--camera: of the options for bags, only {words} apply")
    shape = outline or palpate.load_shape(bag.shape, bag.shape_unit, bag.shape_layer)
    hand = bag.hand(camera)
    with progress_bar("looking for images and poses"):
        if hand is None:
            opened = camera_sources(camera, poses, known_sensor(bag.sensor), bag.choices)
        else:
            opened = hand_sources(by_finger("--camera", camera), poses, hand, bag.choices)
        sources = stack.enter_context(opened)
    return _LiveSetting(f"camera {camera}", sources, shape, first, sigma)


def _replay_setting(
    file: Path, start: Start, bag: Bag, outline: "palpate.Unknown | palpate.Sketch | None"
) -> _LiveSetting:
    """Return a recording as sources that play it in real time."""
    from palpate.live.sources import replayed
    from palpate.pipeline.track import start_of

    given_pose, given_sigma = start.pose_and_sigma()
    recording = read_for(outline, Source(bag), file).recording
    sources = replayed(recording)
    first, sigma = start_of(recording, palpate.NoiseSettings(), given_pose, given_sigma, outline)
    return _LiveSetting(file.name, sources, outline or recording.shape, first, sigma)
