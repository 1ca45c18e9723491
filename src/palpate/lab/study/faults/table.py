"""The table of the fault bench: a row a fault."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from palpate.lab.study.faults.bench import FaultRun
from palpate.lab.study.faults.faults import CLEAN
from palpate.lab.study.rows import write_rows

TABLE, RUNS = "faults.csv", "fault_runs.csv"
"""A row a fault, and a row a run."""


@dataclass(frozen=True)
class FaultRow:
    """What one fault does to all recordings."""

    fault: str
    """Its name."""
    runs: int
    """Recordings."""
    final_mm: float
    """Final error in the median [mm]."""
    worst_mm: float
    """The largest final error [mm]."""
    final_deg: float
    """Final error of yaw in the median [deg]."""
    times_clean: float
    """Final error in the median against that of the runs without a fault."""
    inside_percent: float
    """Estimates in the 95 % region from the fault on, mean over runs [%]."""
    told_percent: float
    """Runs in which a status, reason or refusal comes within a second of the fault [%]."""
    silent_percent: float
    """Runs that were silently wrong for longer than a second [%]."""
    refused_percent: float
    """Frames that were refused [%]."""
    exceptions: int
    """Runs that ended in an exception that is no refusal."""
    step_ms: float
    """Time of a frame in the mean [ms]."""


def rows_of(runs: Sequence[FaultRun]) -> list[FaultRow]:
    """Return a row for each fault, in the order of runs."""
    by_fault: dict[str, list[FaultRun]] = {}
    for run in runs:
        by_fault.setdefault(run.fault, []).append(run)
    clean = _median([run.final_mm for run in by_fault.get(CLEAN, [])])
    return [_row(fault, those, clean) for fault, those in by_fault.items()]


def write_table(folder: Path, runs: Sequence[FaultRun]) -> None:
    """Write RUNS and TABLE into an existing folder; who finds the latter has both."""
    write_rows(folder / RUNS, [_short(run) for run in runs])
    write_rows(folder / TABLE, [_short(row) for row in rows_of(runs)])


def _row(fault: str, runs: Sequence[FaultRun], clean: float) -> FaultRow:
    final = _median([run.final_mm for run in runs])
    frames = sum(run.frames for run in runs)
    known = [run.inside_share for run in runs if np.isfinite(run.inside_share)]
    return FaultRow(
        fault,
        len(runs),
        final,
        max((run.final_mm for run in runs if np.isfinite(run.final_mm)), default=np.nan),
        _median([run.final_deg for run in runs]),
        final / clean,
        100.0 * float(np.mean(known)) if known else np.nan,
        100.0 * float(np.mean([run.told for run in runs])),
        100.0 * float(np.mean([run.silently_wrong for run in runs])),
        100.0 * sum(run.refused for run in runs) / frames,
        sum(bool(run.exception) for run in runs),
        1e3 * sum(run.wall_s for run in runs) / frames,
    )


def _median(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else np.nan


def _short(row: FaultRow | FaultRun) -> dict[str, object]:
    """A row with numbers as short as they are exact."""
    return {name: f"{value:.6g}" if isinstance(value, float) else value for name, value in asdict(row).items()}
