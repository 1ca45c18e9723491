"""`palpate evaluate --faults`: what faults of sensors make of an estimate."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from palpate.lab.study.faults.table import FaultRow


def evaluate_faults(
    folder: Path, out: Path, other_options: Sequence[str], model: Path | None, workers: int, json: bool
) -> int:
    """Track a folder's recordings with each fault and leave `faults.csv` and `fault_runs.csv` in another.

    Raises SettingError where options are given that a bench of faults does not take.
    """
    from palpate.cli.console import print_json, print_line, progress_bar
    from palpate.errors import FileError, SettingError
    from palpate.files import held_folder
    from palpate.lab.study.faults.bench import run_faults
    from palpate.lab.study.faults.table import TABLE, rows_of, write_table
    from palpate.lab.study.files import find_recordings
    from palpate.touch.model import TouchModel

    if other_options:
        raise SettingError(f"--faults tracks by learnt touch as it ships; {', '.join(other_options)} cannot go with it")
    files = find_recordings(folder, leave_out=out)
    touch_model = TouchModel(model) if model else None
    with held_folder(out):
        if (out / TABLE).exists():
            raise FileError(f"{out / TABLE}: already exists; take another folder")
        with progress_bar("tracking", len(files)) as progress:
            runs = run_faults(files, model=touch_model, workers=workers, progress=progress)
        if not runs:
            raise SettingError(f"{folder}: holds recordings with shoves alone, and none while the sensor touches")
        write_table(out, runs)
    rows = rows_of(runs)
    if json:
        print_json({"report": str(out), "faults": [_plain(row) for row in rows]})
    else:
        _show(rows, len({run.recording for run in runs}))
        print_line(f"{len(runs)} runs   report: {out / TABLE}")
    return 3 if any(row.exceptions for row in rows) else 0


def _plain(row: "FaultRow") -> dict[str, object]:
    """The row with None where there is no number, which JSON knows no word for."""
    return {name: None if value != value else value for name, value in asdict(row).items()}


def _show(rows: Sequence["FaultRow"], recordings: int) -> None:
    from palpate.cli.console import number, print_table

    columns = ("fault", "mm (worst)", "deg", "x clean", "% in 95 %", "% told in 1 s", "% silently wrong", "% refused")
    cells = [
        [
            row.fault,
            f"{number(row.final_mm, 2)} ({number(row.worst_mm)})",
            number(row.final_deg, 2),
            number(row.times_clean, 2),
            *(
                number(value, 0)
                for value in (row.inside_percent, row.told_percent, row.silent_percent, row.refused_percent)
            ),
            str(row.exceptions),
            number(row.step_ms),
        ]
        for row in rows
    ]
    columns = (*columns, "exceptions", "ms")
    print_table(
        f"{recordings} recordings, one fault at a time: final error in the median",
        columns,
        cells,
        numbers=range(1, len(columns)),
    )
