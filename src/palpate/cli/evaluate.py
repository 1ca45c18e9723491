"""`palpate evaluate`: a study of many recordings by many methods, or of one method with faults."""

import shlex
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from palpate.cli.options import (
    Estimator,
    Json,
    RecordingsFolder,
    SmootherName,
    Start,
    Tactile,
    Workers,
    arg,
    check_model,
)

if TYPE_CHECKING:
    from palpate.lab.study.fault_bench import FaultRow
    from palpate.lab.study.study import Study


@dataclass(frozen=True)
class Methods:
    """Ways to track: each source of touch measurements with each solver of the graph."""

    tactile: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[Tactile, ...], ...]], arg("MODE...", "none learnt oracle")
    ] = ()
    """Sources of touch measurements, as in palpate track."""
    smoother: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[SmootherName, ...], ...]], arg("NAME...", "fixed-lag")
    ] = ()
    """Solvers of the graph, as in palpate track."""
    model: Annotated[Path | None, arg("MODEL", "the sensor's own")] = None
    """Folder of a touch model."""
    calibration: Annotated[Path | None, arg("UNIT.npz", "the first half second is taken as untouched")] = None
    """Calibration of the sensor unit that made all recordings, from palpate calibrate."""

    def tactiles(self) -> list[str]:
        """Return the sources of touch measurements, each once."""
        return list(dict.fromkeys(mode for modes in self.tactile for mode in modes)) or ["none", "learnt", "oracle"]

    def smoothers(self) -> list[str]:
        """Return the solvers, each once."""
        return list(dict.fromkeys(name for names in self.smoother for name in names)) or ["fixed-lag"]


def evaluate(
    folder: RecordingsFolder,
    /,
    *,
    out: Annotated[Path, arg("REPORT")],
    methods: Methods = Methods(),
    start: Start = Start(),
    estimator: Estimator = Estimator(),
    work: Workers = Workers(),
    resume: bool = False,
    faults: bool = False,
    json: Json = False,
) -> int:
    """Track many recordings by many methods; write tables, figures and a report page.

    Example: palpate evaluate recordings --out report --workers 2

    Args:
        folder: Folder of recordings in any known format; folders in it are searched too.
        out: Folder of the report.
        methods: Ways to track.
        start: The object's pose at the start of recordings without ground truth, or of all if it is unknown.
        estimator: The estimator.
        work: Processes that share the work.
        resume: Continue a study: keep the trials that exist.
        faults: Track by learnt touch with one fault of sensors or prior knowledge after the other.
        json: Print one JSON object.
    """
    from palpate.cli.console import busy, complain, print_json, progress_bar
    from palpate.errors import SettingError
    from palpate.lab.study.recordings import find_recordings
    from palpate.lab.study.report import write_report
    from palpate.lab.study.results import results_of, write_results
    from palpate.lab.study.study import run_study
    from palpate.lab.study.trial import Method, StudySettings
    from palpate.touch.calibration import load_calibration
    from palpate.touch.touch_model import TouchModel

    given = _given(methods, start, estimator)
    if faults:
        more = _given(work, resume=resume)
        wrong = [option for option in (*given, *more) if option not in ("--model", "--workers")]
        return _evaluate_faults(folder, out, wrong, methods.model, work.workers, json)
    ways = tuple(Method(mode, name) for name in methods.smoothers() for mode in methods.tactiles())
    check_model(methods.model, methods.tactiles())
    settings = StudySettings(
        ways,
        estimator.settings("none"),
        *start.pose_and_sigma(),
        first_pose_of_all=start.first_pose_unknown,
        model=methods.model and TouchModel(methods.model),
        calibration=methods.calibration and load_calibration(methods.calibration),
    )
    files = find_recordings(folder, leave_out=out)
    with progress_bar("tracking", len(files) * len(ways)) as progress:
        study = run_study(files, out, settings, work.workers, work.dask, resume, progress)
    for complaint in _complaints(study):
        complain(f"{folder}/{complaint}")
    if study.skipped and not (study.trials or study.broken or study.failed):
        (name, _), reason = next(iter(study.skipped.items()))
        raise SettingError(f"{folder}: no recording can be tracked by these methods; the first: {name} {reason}")
    results = results_of(study, settings, folder, work.workers, _command(folder, out, given))
    write_results(out, results, study.trials)
    if study.trials:
        with busy("drawing figures"):
            write_report(out, results, study.trials)
    if json:
        print_json({"report": str(out), **{key: results[key] for key in ("study", "table", "failed", "broken")}})
    else:
        _show(out, results)
    return 3 if study.failed or study.broken else 0


def _given(*groups: Any, **others: Any) -> dict[str, list[object]]:
    """Return the options that differ from their defaults, with their words."""
    values = {field.name: getattr(group, field.name) for group in groups for field in fields(group)}
    defaults = {field.name: field.default for group in groups for field in fields(group)}
    given: dict[str, list[object]] = {}
    for name, value in (values | others).items():
        if value in (defaults.get(name), None, False):
            continue
        words = value if isinstance(value, tuple) else [] if value is True else [value]
        flat = [word for each in words for word in (each if isinstance(each, tuple) else [each])]
        given[f"--{name.replace('_', '-')}"] = list(dict.fromkeys(flat)) if name in ("tactile", "smoother") else flat
    return given


def _command(folder: Path, out: Path, given: Mapping[str, Sequence[object]]) -> str:
    """Return the command line that makes the same report, without options that only change its duration."""
    options = [word for option, words in given.items() for word in (option, *words)]
    return shlex.join(map(str, ("palpate", "evaluate", folder, "--out", out, *options)))


def _complaints(study: "Study") -> Iterator[str]:
    """Yield a line for each broken recording, and for each error with the methods that ended in it."""
    for name, error in study.broken.items():
        yield f"{name}: {error}"
    methods = defaultdict[tuple[str, str], list[str]](list)
    for (name, method), error in study.failed.items():
        methods[name, error].append(str(method))
    for (name, error), failed in methods.items():
        yield f"{name} by {', '.join(failed)}: {error}"


def _show(out: Path, results: Mapping[str, Any]) -> None:
    """Print the tables of a study and the path of its report."""
    from palpate.cli.console import number, percent, print_line, print_table
    from palpate.lab.study.results import ALL

    methods = results["table"].get(ALL, {})
    columns = {
        "mm (worst)": lambda row: f"{number(row['final_mm']['median'], 2)} ({number(row['final_mm']['worst'])})",
        "deg (worst)": lambda row: f"{number(row['final_deg']['median'], 2)} ({number(row['final_deg']['worst'])})",
        "% in 95 %": lambda row: percent(row["inside_95"]),
        "contact": lambda row: percent(row["contact_inside_95"]),
        "rest": lambda row: percent(row["rest_inside_95"]),
        "final": lambda row: percent(row["final_inside_95"]),
        "silently wrong": lambda row: percent(row["silently_wrong"]),
        "ambiguous": lambda row: percent(row["ambiguous"]),
        "lost": lambda row: f"{row['lost']} of {row['sequences']}",
        "ms, 95 %": lambda row: f"{number(row['step_ms']['p50'])}, {number(row['step_ms']['p95'])}",
    }
    if any(row["knocks"] for row in methods.values()):
        columns |= {
            "knocks": lambda row: str(row["knocks"]),
            "recovered [s]": lambda row: number(row["recovery_contact_s"], 2),
            "% in 2 s": lambda row: percent(row["recovered_in_2s"]),
            "silent before a touch": lambda row: percent(row["silently_wrong_before_touch"]),
        }
    if methods:
        rows = [[method, *(cell(row) for cell in columns.values())] for method, row in methods.items()]
        print_table(
            f"{ALL}: median final error, and frames in the 95 % region", ("touch", *columns), rows, numbers=range(1, 20)
        )
    counts = ", ".join(f"{results['study'][key]} {key}" for key in ("trials", "kept", "skipped", "failed", "broken"))
    page = out / ("report.html" if methods else "results.json")
    print_line(f"{counts}, {results['study']['wall_s']:.0f} s   report: {page}")


def _evaluate_faults(folder: Path, out: Path, given: list[str], model: Path | None, workers: int, json: bool) -> int:
    """Track a folder's recordings with each fault, and write `faults.csv` and `fault_runs.csv`."""
    from palpate.cli.console import print_json, print_line, progress_bar
    from palpate.errors import FileError, SettingError
    from palpate.files import held_folder
    from palpate.lab.study.fault_bench import rows_of, run_faults, write_table
    from palpate.lab.study.recordings import find_recordings
    from palpate.touch.touch_model import TouchModel

    if given:
        raise SettingError(f"--faults tracks by learnt touch with default settings; remove {', '.join(given)}")
    files = find_recordings(folder, leave_out=out)
    touch_model, table = TouchModel(model) if model else None, out / "faults.csv"
    with held_folder(out):
        if table.exists():
            raise FileError(f"{table}: already exists; name another folder")
        with progress_bar("tracking", len(files)) as progress:
            runs = run_faults(files, model=touch_model, workers=workers, progress=progress)
        if not runs:
            raise SettingError(
                f"{folder}: in all recordings the object is shoved, and never while the sensor touches it"
            )
        write_table(out, runs)
    rows = rows_of(runs)
    if json:
        plain = [{key: None if value != value else value for key, value in asdict(row).items()} for row in rows]
        print_json({"report": str(out), "faults": plain})
    else:
        _show_faults(rows, len({run.recording for run in runs}))
        print_line(f"{len(runs)} runs   report: {table}")
    return 3 if any(row.exceptions for row in rows) else 0


def _show_faults(rows: list["FaultRow"], recordings: int) -> None:
    from palpate.cli.console import number, print_table

    cells = [
        [
            row.fault,
            f"{number(row.final_mm, 2)} ({number(row.worst_mm)})",
            number(row.final_deg, 2),
            number(row.times_clean, 2),
            *(number(x, 0) for x in (row.inside_percent, row.told_percent, row.silent_percent, row.refused_percent)),
            str(row.exceptions),
            number(row.step_ms),
        ]
        for row in rows
    ]
    percents = ("% in 95 %", "% noticed in 1 s", "% silently wrong", "% refused")
    columns = ("fault", "mm (worst)", "deg", "x clean", *percents, "exceptions", "ms")
    print_table(
        f"{recordings} recordings, one fault at a time: median final error", columns, cells, numbers=range(1, 10)
    )
