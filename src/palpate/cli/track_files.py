"""Recordings tracked into folders, one after the other or by several processes, and gone on with after a stop."""

import json
import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import palpate
from palpate.cli.console import complain, progress_bar, progress_log
from palpate.cli.learnt_outline import read_for
from palpate.cli.options import Start
from palpate.cli.quantities import ANGLE, LENGTH, quantity
from palpate.cli.sources import Source
from palpate.errors import FileError, PalpateError, SettingError
from palpate.files import read_json, read_table

logger = logging.getLogger(__name__)

POSE_COLUMNS = {"x": LENGTH, "y": LENGTH, "theta": ANGLE}
SIGMA_COLUMNS = {"sigma_x": LENGTH, "sigma_y": LENGTH, "sigma_theta": ANGLE}


@dataclass(frozen=True)
class Way:
    """Settings by which recordings are tracked."""

    settings: "palpate.TrackerSettings"
    start: Start
    source: Source
    model: "palpate.TouchModel | None" = None
    calibration: "palpate.Calibration | Mapping[str, palpate.Calibration] | None" = None
    first_poses: Mapping[str, Start] | None = None
    """Starts by the names of files, in place of one for all."""
    outline: "palpate.Unknown | palpate.Sketch | None" = None
    """Outline that is to be learnt, in place of that of the recording."""

    def start_of(self, file: Path) -> Start:
        """Return the start of a recording. Raises SettingError if there is none in the table of first poses."""
        if self.first_poses is None:
            return self.start
        for name in (str(file), file.name, file.stem):
            if name in self.first_poses:
                return self.first_poses[name]
        raise SettingError(f"{file}: the table of --first-poses has no row for {file.name}")

    def read(self, file: Path) -> "palpate.BagReading":
        """Return a recording, and the plane of its push. Raises PalpateError."""
        return read_for(self.outline, self.source, file)

    def about(self, file: Path) -> dict[str, Any]:
        """Return the state of a recording's file and the settings it is tracked by, as plain data."""
        stat = file.stat()
        options = {
            "settings": asdict(self.settings),
            "start": asdict(self.start_of(file)),
            **asdict(self.source),
            "model": self.model and self.model.hash,
            "calibration": _hash_of(self.calibration),
            **({} if self.outline is None else {"outline": asdict(self.outline)}),
        }
        about = {"file": str(file.absolute()), "size": stat.st_size, "modified_ns": stat.st_mtime_ns}
        return json.loads(json.dumps({**about, "options": options}, default=str))


def _hash_of(calibration: "palpate.Calibration | Mapping[str, palpate.Calibration] | None") -> Any:
    """Return the hash of a calibration's file, or those of a hand by finger; None where there is none."""
    if isinstance(calibration, Mapping):
        return {finger: _hash_of(each) for finger, each in calibration.items()}
    unit = calibration and calibration.file
    return unit and sha256(unit.read_bytes()).hexdigest()


@dataclass(frozen=True)
class Outputs:
    """Files of a run that are asked for besides those of every run."""

    mcap: bool = False
    """Estimates as messages."""
    tum: bool = False
    """The trajectory for evo."""
    page: bool = False
    """The page of the run."""
    video: Path | None = None
    """A video of the run."""
    may_replace: bool = False
    """An earlier run in the folder is replaced."""

    def names(self) -> set[str]:
        """Return the names of all files of a run that are asked for."""
        from palpate.pipeline.run_folder import FILES, MCAP, PAGE, TRAJECTORY

        asked = {MCAP: self.mcap, TRAJECTORY: self.tum, PAGE: self.page}
        return FILES | {name for name, is_asked in asked.items() if is_asked}


@dataclass(frozen=True)
class Outcome:
    """Outcome of one recording."""

    file: Path
    folder: Path
    summary: dict[str, Any] | None = None
    error: str = ""
    """Reason why there is no summary."""
    is_kept: bool = False
    """The run was there before."""


def read_first_poses(path: Path) -> dict[str, Start]:
    """Return the first poses in a table by file: columns file, x, y, theta, and sigma_x, sigma_y, sigma_theta.

    Numbers are in m and rad, or have their unit. Raises FileError.
    """
    starts: dict[str, Start] = {}
    for line, (file, *cells) in read_table(path, ("file", *POSE_COLUMNS), tuple(SIGMA_COLUMNS)):
        kinds = [*POSE_COLUMNS.values(), *SIGMA_COLUMNS.values()]
        try:
            numbers = [quantity(cell, kind) for cell, kind in zip(cells, kinds, strict=True) if cell]
        except SettingError as error:
            raise FileError(f"{path}: line {line}: {error}") from error
        if len(numbers) not in (3, 6) or file in starts:
            fault = "a second row" if file in starts else f"{len(numbers)} numbers, expected 3 or 6"
            raise FileError(f"{path}: line {line}: found {fault} for {file!r}")
        x, y, theta, *sigma = numbers
        starts[file] = Start((x, y, theta), (sigma[0], sigma[1], sigma[2]) if sigma else None)
    return starts


def load_estimator(fingers: int = 0) -> None:
    """Load compiled code, for a hand of so many fingers or for one sensor, with a bar as the first time takes 30 s."""
    from palpate.models.pushing.compiled import pushing_with
    from palpate.tracker import machine_code, warm_up

    graph = pushing_with(fingers)
    with progress_bar("loading the estimator", len(machine_code(graph))) as progress:
        warm_up(graph, progress)


def track_file(file: Path, folder: Path, way: Way, outputs: Outputs) -> dict[str, Any]:
    """Track a recording into a folder and return its summary. Raises PalpateError."""
    from palpate.io.ros_messages import nanoseconds
    from palpate.pipeline.figures import draw
    from palpate.pipeline.run_folder import PAGE, new_run, write_files
    from palpate.viewer.page import write_page
    from palpate.viewer.video import video_frames, write_video

    first_pose, sigma = way.start_of(file).pose_and_sigma()
    with new_run(folder, outputs.may_replace) as part:
        logger.info("reading %s", file)
        recording, plane = way.read(file)
        if outputs.mcap:
            nanoseconds(file, recording.time)  # raises before tracking if they cannot be stamps

        def keep(run: "palpate.Run") -> None:
            if outputs.page:
                logger.info("drawing %s", PAGE)
                with progress_bar(f"drawing {PAGE}"):
                    draw(part / PAGE, lambda page: write_page(run, page))
            if outputs.video:
                logger.info("drawing %s", outputs.video)
                with progress_bar(f"drawing {outputs.video.name}", len(video_frames(run))) as progress:
                    video = outputs.video
                    draw(video, lambda path: write_video(run, path, video.suffix.lower(), progress))
            logger.info("writing %s", folder)
            write_files(run, part, plane, way.about(file), outputs.names())

        start: Any = {"first_pose": first_pose, "first_pose_sigma": sigma, "outline": way.outline}
        model: Any = {"settings": way.settings, "model": way.model, "calibration": way.calibration}
        load_estimator(0 if recording.hand is None else len(recording.hand.fingers))
        with progress_bar(file.name, len(recording)) as progress:
            run = palpate.track(recording, **start, **model, progress=progress, keep=keep)
        keep(run)
    return run.summary


def track_files(
    jobs: Sequence[tuple[Path, Path]], way: Way, outputs: Outputs, workers: int, resume: bool
) -> list[Outcome]:
    """Track recordings, each with its folder, by some processes; errors are shown and do not stop the others.

    With `resume`, whole runs are kept that were made of the same files by the same settings. Returns the outcomes in
    the order of the jobs.
    """
    from palpate.parallel import processes, results_in_any_order

    jobs = list(dict.fromkeys(jobs))
    outcomes: dict[tuple[Path, Path], Outcome] = {}
    first_files: dict[Path, Path] = {}
    for file, folder in jobs:
        first = first_files.setdefault(folder, file)
        if first is not file:
            error = f"{file}: {folder}: already exists, as the run of {first}; track it apart with --out"
            outcomes[file, folder] = Outcome(file, folder, error=error)
    begun = [job for job in jobs if job not in outcomes]
    for outcome in outcomes.values():
        complain(outcome.error)
    work = partial(_tracked, way=way, outputs=outputs, resume=resume)

    def done(results: Iterator[Outcome], progress: Any) -> None:
        for outcome in results:
            if outcome.error:
                complain(outcome.error)
            outcomes[outcome.file, outcome.folder] = outcome
            progress(len(outcomes))

    if workers == 1:
        done(map(work, begun), lambda _: None)
    else:
        load_estimator()  # before there are workers, so that none has to
        with progress_bar("tracking", len(begun)) as progress, processes(workers) as pool:
            done(results_in_any_order(pool, partial(_silently, work), begun), progress)
    return [outcomes[job] for job in jobs]


def _silently(work: Any, job: tuple[Path, Path]) -> Outcome:
    """Do a job without bars and warnings of its own; a run keeps its warnings."""
    progress_log.setLevel(logging.ERROR)
    for handler in logging.root.handlers:
        handler.setLevel(logging.ERROR)
    return work(job)


def _tracked(job: tuple[Path, Path], way: Way, outputs: Outputs, resume: bool) -> Outcome:
    """Track a recording, or keep its run; an error becomes part of the outcome."""
    file, folder = job
    try:
        if resume and folder.exists():
            kept = _kept_summary(file, folder, way, outputs)
            if kept is not None:
                return Outcome(file, folder, kept, is_kept=True)
            outputs = replace(outputs, may_replace=True)
        return Outcome(file, folder, track_file(file, folder, way, outputs))
    except (PalpateError, OSError) as error:
        return Outcome(file, folder, error=f"{file}: {str(error).removeprefix(f'{file}: ')}")


def _kept_summary(file: Path, folder: Path, way: Way, outputs: Outputs) -> dict[str, Any] | None:
    """Return the summary of a run that is to be kept; None if it is incomplete, or if its recording has changed.

    Raises SettingError if it was made of another recording or by other settings.
    """
    from palpate.pipeline.run_folder import SUMMARY

    if not outputs.names() <= {path.name for path in folder.iterdir()}:
        return None
    made_of = read_json(folder / "settings.json").get("made_of")
    now = way.about(file)
    if not isinstance(made_of, dict) or made_of.get("file") != now["file"]:
        raise SettingError(f"{folder}: holds the run of another recording; --out names another folder")
    if made_of.get("options") != now["options"]:
        raise SettingError(f"{folder}: was made by other settings; --force replaces it, --out names another folder")
    summary = read_json(folder / SUMMARY)
    return summary if made_of == now and not summary["ended"] else None
