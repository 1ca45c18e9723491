"""`palpate track`: tracks recordings and leaves a folder for each."""

from dataclasses import asdict, replace
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from palpate.cli.bag_options import BAG_DEFAULTS, Bag, BagOptions, read_with
from palpate.cli.options import (
    CalibrationOption,
    FirstPoseOption,
    FirstPoseSigmaOption,
    FirstPoseUnknownOption,
    ForceOption,
    HypothesesOption,
    JsonOption,
    ModelOption,
    NoiseOption,
    PressureOption,
    SmootherOption,
    TactileOption,
    check_model,
    check_new,
    check_window,
    pressure_of,
    stated_first_pose,
)
from palpate.cli.run_report import report_run, report_runs

if TYPE_CHECKING:
    from palpate.config import TrackerSettings
    from palpate.touch.calibration import Calibration
    from palpate.touch.model import TouchModel
    from palpate.types.recording import Recording


def track(
    files: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(metavar="FILE...", help="Recordings, in any known format.", help_behavior_hint="(required)"),
    ],
    /,
    *,
    tactile: TactileOption = "auto",
    model: ModelOption = None,
    calibration: CalibrationOption = None,
    smoother: SmootherOption = "fixed-lag",
    noise: NoiseOption = "palpate",
    pressure: PressureOption = "uniform",
    first_pose: FirstPoseOption = None,
    first_pose_sigma: FirstPoseSigmaOption = None,
    first_pose_unknown: FirstPoseUnknownOption = False,
    hypotheses: HypothesesOption = None,
    bag: Bag = BAG_DEFAULTS,
    mcap: Annotated[bool, tyro.conf.arg(help="Write the estimates as ROS 2 messages too, estimates.mcap.")] = False,
    out: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="DIR",
            help="Folder of the run; if FILEs are several, of their runs.",
            help_behavior_hint="(default: runs/<name>)",
        ),
    ] = None,
    html: Annotated[bool, tyro.conf.arg(help="Leave a page beside it that shows the push, for any browser.")] = False,
    view: Annotated[bool, tyro.conf.arg(help="Show it in Rerun while it is tracked.")] = False,
    save_rrd: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="FILE.rrd",
            help="Write what --view shows to a file for Rerun.",
            help_behavior_hint="(default: none)",
        ),
    ] = None,
    force: ForceOption = False,
    resume: Annotated[
        bool, tyro.conf.arg(help="Go on with runs that were interrupted; those that are whole stay as they are.")
    ] = False,
    dump: Annotated[
        bool,
        tyro.conf.arg(help="Where a step fails, write what reproduces it beside the folder, <folder>-failed.npz."),
    ] = False,
    json: JsonOption = False,
) -> int:
    """Track the object of each recording; leaves poses, covariances, scores and a figure in a folder."""
    from functools import partial

    from palpate.cli.console import complain, print_json
    from palpate.config import TrackerSettings, noise_of
    from palpate.errors import PalpateError, SettingError
    from palpate.touch.calibration import load_calibration
    from palpate.touch.model import TouchModel

    if not files:
        raise SettingError("track: no FILE given; name one or more recordings")
    settings = TrackerSettings(
        tactile=tactile,
        smoother=smoother,
        noise=noise_of(noise),
        pressure=pressure_of(pressure),
        **({} if hypotheses is None else {"hypotheses": hypotheses}),
    )
    check_model(model, [tactile])
    _check_view(files, view, save_rrd, force, resume)
    first_pose, first_pose_sigma = stated_first_pose(first_pose, first_pose_sigma, first_pose_unknown)
    learnt = None if model is None else TouchModel(model)
    unit = None if calibration is None else load_calibration(calibration)
    track_file = partial(
        run_file,
        settings=settings,
        first_pose=first_pose,
        model=learnt,
        calibration=unit,
        first_pose_sigma=first_pose_sigma,
        html=html,
        window=view,
        rrd=save_rrd,
        bag=bag,
        mcap=mcap,
        resume=resume,
        dump=dump,
    )
    folders = _folders(files, out)
    if len(files) == 1:
        report_run(track_file(files[0], folders[0], force=force), folders[0], json)
        return 0
    runs: list[dict[str, Any]] = []
    failed: list[dict[str, str]] = []
    for file, folder in zip(files, folders, strict=True):
        try:
            summary = track_file(file, folder, force=force)
        except PalpateError as error:
            complain(error)
            failed.append({"file": str(file), "error": str(error)})
        else:
            runs.append({"file": str(file), "folder": str(folder), **summary})
    if json:
        print_json({"runs": runs, "failed": failed})
    elif runs:
        report_runs(runs)
    return 3 if failed else 0


def run_file(
    file: Path,
    folder: Path,
    settings: "TrackerSettings",
    first_pose: tuple[float, float, float] | None = None,
    force: bool = False,
    model: "TouchModel | None" = None,
    calibration: "Calibration | None" = None,
    first_pose_sigma: tuple[float, float, float] | None = None,
    html: bool = False,
    window: bool = False,
    rrd: Path | None = None,
    bag: BagOptions = BAG_DEFAULTS,
    mcap: bool = False,
    resume: bool = False,
    dump: bool = False,
) -> dict[str, Any]:
    """Track one file, with progress, write its folder and return the summary.

    With a page, if `html`, and estimates as messages, if `mcap`; shown while it is tracked, if `window`, and in a file
    for Rerun, if one is given. With `resume` a run that is there is kept and an interrupted one gone on with; with
    `dump` a step that fails is written beside the folder.
    """
    from contextlib import nullcontext

    from palpate.cli.console import busy, progress_bar
    from palpate.pipeline.run import track
    from palpate.pipeline.run_folder import MCAP, PAGE, new_run, state_file, summary_of_whole, write_files
    from palpate.types.plane import flat
    from palpate.types.recording import Recording

    asked = {
        "recording": _written(file),
        **asdict(settings),
        "model": None if model is None else model.hash,
        "calibration": None if calibration is None or calibration.file is None else _written(calibration.file),
        "first_pose": first_pose,
        "first_pose_sigma": first_pose_sigma,
        **asdict(bag),
    }
    if resume and not force and folder.is_dir():
        return summary_of_whole(folder, asked, [name for name, given in ((PAGE, html), (MCAP, mcap)) if given])
    with new_run(folder, force, resume) as part:
        with busy(f"reading {file.name}"):
            reading = read_with(file, bag)
            if bag.time_offset == "fit" and not isinstance(reading, Recording):
                seconds = _fitted_offset(reading.recording, settings, first_pose, first_pose_sigma, calibration)
                reading = read_with(file, replace(bag, time_offset=seconds)) if seconds else reading
        recording, plane = (reading, flat()) if isinstance(reading, Recording) else (reading.recording, reading.plane)
        view = nullcontext()
        if window or rrd:
            from palpate.viewer.rerun_view import live_view

            view = live_view(recording, file.name, rrd, force, window)
        with view as log, progress_bar(file.name, len(recording)) as progress:
            watch = log.show if log else None
            run = track(
                recording,
                settings,
                first_pose,
                progress,
                model,
                calibration,
                first_pose_sigma,
                watch,
                state_file(part),
                folder.with_name(f"{folder.name}-failed.npz") if dump else None,
            )
        write_files(run, part, plane if mcap else None, asked)
        if html:
            from palpate.viewer.page import write_page

            write_page(run, file.name, part / PAGE)
    return run.summary


def _written(file: Path) -> list[object]:
    """What a later run knows a file by: where it is, and its signature."""
    from palpate.signature import signature

    return [str(file.absolute()), *signature(file)]


def _fitted_offset(
    recording: "Recording",
    settings: "TrackerSettings",
    first_pose: tuple[float, float, float] | None,
    first_pose_sigma: tuple[float, float, float] | None,
    calibration: "Calibration | None",
) -> float:
    """The time offset [s] that contacts tell, which is said; 0 where they cannot tell it from 0."""
    from palpate.cli.console import complain
    from palpate.pipeline.time_offset import time_offset

    pose_sigma = settings.noise.sensor_pose.calibration[0]
    if first_pose is not None:
        pose_sigma = hypot(pose_sigma, *(first_pose_sigma or settings.noise.first_pose.deviation)[:2])
    found = time_offset(recording, first_pose, pose_sigma, calibration)
    tells = abs(found.seconds) > 2.0 * found.sigma
    complain(
        f"{recording.file}: time offset {found.seconds:.3f} s, sigma {found.sigma:.3f} s, from the beginning of "
        f"{found.contacts} contact{'s' if found.contacts > 1 else ''}"
        f"{'' if tells else ': it cannot be told from 0, which is used'}"
    )
    return found.seconds if tells else 0.0


def _check_view(files: tuple[Path, ...], view: bool, save_rrd: Path | None, force: bool, resume: bool) -> None:
    """Raise SettingError where a view is asked for that cannot be had, before the work and not after it."""
    from palpate.errors import SettingError
    from palpate.viewer.rerun_view import check_rerun

    if not view and save_rrd is None:
        return
    check_rerun()
    if resume:
        raise SettingError("--view and --save-rrd show a run from its first frame, which --resume leaves out")
    if len(files) > 1:
        raise SettingError(f"--view and --save-rrd show one recording, and {len(files)} are given")
    if view:
        check_window("; --save-rrd FILE.rrd writes a file")
    if save_rrd:
        check_new(save_rrd, force)


def _folders(files: tuple[Path, ...], out: Path | None) -> list[Path]:
    """The folder of each file's run; SettingError if two would be the same."""
    from palpate.errors import SettingError

    if len(files) == 1 and out is not None:
        return [out]
    folders = [(out or Path("runs")) / _name(file) for file in files]
    for index, folder in enumerate(folders):
        if folder in folders[:index]:
            first = files[folders.index(folder)]
            raise SettingError(
                f"{first} and {files[index]} would both go to {folder}; track them apart, each with its own --out"
            )
    return folders


def _name(file: Path) -> str:
    """The file's name without .json.gz, .mcap and the like."""
    return (file.with_suffix("") if file.suffix == ".gz" else file).stem or file.name
