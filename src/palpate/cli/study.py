"""`palpate evaluate` and `palpate paper`: studies of many recordings, and the paper's experiments."""

import shlex
import sys
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from palpate.cli.console import complain, print_json, progress_bar, report
from palpate.cli.options import (
    Estimator,
    Json,
    RecordingsFolder,
    SensorUnit,
    Tactile,
    Workers,
    arg,
    check_torch,
)
from palpate.errors import SettingError

SHOWN = (
    *("final_mm", "final_deg", "contact_inside_95", "final_inside_95", "silently_wrong", "nats", "ambiguous"),
    *("knocks", "lost", "sequences"),
)
"""Columns of the table that is printed, by their keys in `results.json`."""


@dataclass(frozen=True)
class Methods(SensorUnit):
    """Ways to track, and the model and calibration of the sensor that made all recordings."""

    tactile: Annotated[tuple[Tactile, ...], arg("MODE...")] = ("none", "learnt", "oracle")
    """Sources of touch measurements, as in palpate track."""


def evaluate(
    folder: RecordingsFolder,
    /,
    *,
    out: Annotated[Path, arg("REPORT")],
    methods: Methods = Methods(),
    estimator: Estimator = Estimator(),
    work: Workers = Workers(),
    resume: bool = False,
    json: Json = False,
) -> int:
    """Track many recordings by many methods; write tables and figures.

    Example: palpate evaluate recordings --out report --workers 2

    Args:
        out: Folder of the report.
        resume: Continue a study: keep the trials that exist.
    """
    from palpate.lab.study.figures import write_figures
    from palpate.lab.study.recordings import find_recordings
    from palpate.lab.study.results import ALL, results_of, write_results
    from palpate.lab.study.study import StudySettings, run_study

    ways = tuple(dict.fromkeys(methods.tactile))
    settings = StudySettings(ways, estimator.settings("none"), *methods.load(*methods.tactile))
    files = find_recordings(folder, leave_out=out)
    with progress_bar("tracking", len(files) * len(ways)) as progress:
        study = run_study(files, out, settings, work.workers, work.dask, resume, progress)
    for name, error in dict.fromkeys((name, error) for (name, _), error in study.failed.items()):
        complain(f"{folder}/{name}: {error}")
    if study.skipped and not (study.trials or study.failed):
        (name, _), reason = next(iter(study.skipped.items()))
        raise SettingError(f"{folder}: no recording can be tracked by these methods; the first: {name} {reason}")
    command = shlex.join(("palpate", *sys.argv[1:]))
    results = results_of(study, settings, folder, work.workers, command)
    write_results(out, results, study.trials)
    if study.trials:
        with progress_bar("drawing figures"):
            write_figures(out / "figures", study.trials)
    if json:
        print_json({"report": str(out), **{key: results[key] for key in ("study", "table", "failed")}})
    else:
        counts = {key: results["study"][key] for key in ("trials", "kept", "skipped", "failed", "wall_s")}
        reasons = Counter(each["reason"] for each in results["skipped"])
        table = results["table"].get(ALL, {})
        rows = {method: {key: row[key] for key in SHOWN} for method, row in table.items()}
        report(json, "study", {"report": str(out), **counts, "reasons": dict(reasons), ALL: rows})
    return 3 if study.failed else 0


def paper(
    *,
    out: Annotated[Path, arg("FOLDER", "required")],
    full: bool = False,
    seed: Annotated[int, arg("N")] = 0,
    workers: Workers = Workers(),
    json: Json = False,
) -> int:
    """Repeat the paper's experiments on simulated pushes: Table II, tracking by mode, figures 5 to 8 and 10 to 12.

    Example: palpate paper --out paper --workers 2

    Args:
        out: Folder of the study. Finished parts in it are kept, so that an interrupted run continues.
        full: As many sequences as the paper has, which takes hours.
        seed: The same seed gives the same recordings.
    """
    check_torch("palpate paper", "sim,train,paper", "gtsam", "mujoco", "torch")
    from palpate.lab.paper.study import FULL, StudySettings, run

    if seed < 0:
        raise SettingError(f"seed is {seed}; allowed is 0 or more")
    settings = replace(FULL if full else StudySettings(), seed=seed)
    results = run(out, settings, progress_bar, workers.workers, workers.dask)
    tables = {"table2": results["table2"], "tracking": results["tracking"]}
    report(json, "experiments of the paper", tables if json else {"folder": str(out), **tables})
    return 0
