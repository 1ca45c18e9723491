"""`palpate track`: tracks recordings and leaves a folder for each."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from palpate.cli.options import Bag, Estimator, Force, Json, Smoother, Start, Touch, arg, positional

if TYPE_CHECKING:
    from palpate.config import TrackerSettings
    from palpate.pipeline.track import Run
    from palpate.touch.calibration import Calibration
    from palpate.types.recording import Recording
    from palpate.types.space import Plane


@dataclass(frozen=True)
class Output:
    """Files of the run."""

    out: Annotated[Path | None, arg("DIR", "runs/<name>")] = None
    """Folder of the run; for several FILEs, the folder of their runs."""
    mcap: bool = False
    """Write the estimates as ROS 2 messages too, estimates.mcap."""
    html: bool = False
    """Write a page that shows the push in any browser, page.html."""
    force: Force = False

    def write(self, run: "Run", folder: Path, plane: "Plane") -> None:
        """Write the files of a run."""
        from palpate.pipeline.run_folder import PAGE, write_files

        write_files(run, folder, plane if self.mcap else None)
        if self.html:
            from palpate.viewer.page import write_page

            write_page(run, run.recording.file.name if run.recording.file else "recording", folder / PAGE)

    def folders(self, files: tuple[Path, ...]) -> list[Path]:
        """Return the folder of each file's run. Raises SettingError if two would be the same."""
        from palpate.errors import SettingError

        if len(files) == 1 and self.out is not None:
            return [self.out]
        folders = [(self.out or Path("runs")) / stem_of(file) for file in files]
        for index, folder in enumerate(folders):
            if folder in folders[:index]:
                first = files[folders.index(folder)]
                raise SettingError(
                    f"{first} and {files[index]} would both go to {folder}; track them one by one, each with its --out"
                )
        return folders


def track(
    files: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        positional("FILE...", "Recordings in any known format, or bags of ROS messages.", required=True),
    ],
    /,
    *,
    smoother: Smoother = "fixed-lag",
    json: Json = False,
    start: Start = Start(),
    touch: Touch = Touch(),
    estimator: Estimator = Estimator(),
    bag: Bag = Bag(),
    output: Output = Output(),
) -> int:
    """Track the object of each recording, and write poses, covariances, scores and a figure to a folder.

    Example: palpate track push.mcap --first-pose 0.1 0 0.3 --first-pose-sigma 0.01 0.01 0.1
    """
    from palpate.cli.console import complain, print_json
    from palpate.cli.run_report import report_run, report_runs
    from palpate.errors import PalpateError, SettingError

    if not files:
        raise SettingError("track: no FILE given; name one or more recordings")
    settings = estimator.settings(touch.tactile, smoother)
    first_pose, sigma = start.pose_and_sigma()
    model, calibration = touch.load()

    def track_file(file: Path, folder: Path) -> dict[str, Any]:
        from palpate.cli.console import busy, progress_bar
        from palpate.pipeline.run_folder import new_run
        from palpate.pipeline.track import track as track_recording

        with new_run(folder, output.force) as part:
            with busy(f"reading {file.name}"):
                recording, plane = _read(file, bag, start, settings, calibration)
            with progress_bar(file.name, len(recording)) as progress:
                run = track_recording(
                    recording,
                    settings,
                    first_pose,
                    first_pose_sigma=sigma,
                    model=model,
                    calibration=calibration,
                    progress=progress,
                )
            output.write(run, part, plane)
        return run.summary

    folders = output.folders(files)
    if len(files) == 1:
        report_run(track_file(files[0], folders[0]), folders[0], json)
        return 0
    runs: list[dict[str, Any]] = []
    failed: list[dict[str, str]] = []
    for file, folder in zip(files, folders, strict=True):
        try:
            runs.append({"file": str(file), "folder": str(folder), **track_file(file, folder)})
        except PalpateError as error:
            complain(error)
            failed.append({"file": str(file), "error": str(error)})
    if json:
        print_json({"runs": runs, "failed": failed})
    elif runs:
        report_runs(runs)
    return 3 if failed else 0


def stem_of(file: Path) -> str:
    """Return the name of a file without .json.gz, .mcap and the like."""
    return (file.with_suffix("") if file.suffix == ".gz" else file).stem or file.name


def _read(
    file: Path, bag: Bag, start: Start, settings: "TrackerSettings", calibration: "Calibration | None"
) -> "tuple[Recording, Plane]":
    """Read a recording or a bag, with the time offset that was fitted where --time-offset fit asks for it."""
    from palpate.cli.console import complain
    from palpate.pipeline.time_offset import time_offset
    from palpate.types.recording import Recording
    from palpate.types.space import flat

    reading = bag.read(file)
    if isinstance(reading, Recording):
        return reading, flat()
    if bag.time_offset == "fit":
        found = time_offset(reading.recording, *start.pose_and_sigma(), settings.noise, calibration)
        complain(f"{file}: {found}")
        if found.is_significant:
            reading = replace(bag, time_offset=found.seconds).read(file)
            assert not isinstance(reading, Recording)
    return reading.recording, reading.plane
