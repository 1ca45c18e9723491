"""Comparison of two studies of the same recordings.

It holds

    folder      the other study
    methods     {method: {sequences, better, worse, same, improved, worsened, and {before, after} of final_mm,
                final_deg, rmse_mm, rmse_deg and recovery_contact_s (medians) and of SHARES (means)}}
    sequences   [{recording, method, group, before, after, change}] with all of these scores, None if unknown

A change is the change of the final error in mm plus that in degrees; smaller ones than 0.1 mm and 0.1° are the same.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import fmean, median
from typing import Any

from palpate.errors import FileError, SettingError
from palpate.lab.study.results import FINALS, RMSES, flat, read_rows
from palpate.lab.study.study import read_index
from palpate.lab.study.trial import Method, Trial

SHARES = ("in_95_contact_share", "in_95_rest_share", "in_95_final", "silently_wrong_share", "recovered_in_2s")
RECOVERY = "recovery_contact_s"

Scores = dict[str, float | None]
"""`final_mm`, `final_deg`, `rmse_mm`, `rmse_deg`, SHARES and RECOVERY of a sequence."""


def read_scores(folder: Path) -> dict[tuple[str, Method], Scores]:
    """Return the scores of a finished study by recording and method; FileError if there is none."""
    read_index(folder)
    path = folder / "sequences.csv"
    if not path.is_file():
        raise FileError(f"{folder}: the study in it is not finished: there is no sequences.csv")
    try:
        return {
            (row["recording"], Method(row["tactile"], row["smoother"])): _scores(row)
            for row in read_rows(path)
            if row[FINALS["final_mm"]]
        }
    except (KeyError, ValueError) as error:
        raise FileError(f"{path}: is not a table of sequences ({error})") from error


def check_common(
    folder: Path, before: dict[tuple[str, Method], Scores], names: Iterable[str], methods: Sequence[Method]
) -> None:
    """Raise SettingError unless the other study has scored one of these recordings by one of these methods."""
    known = set(names)
    if not any(name in known and method in methods for name, method in before):
        raise SettingError(f"--against {folder}: has no recording and method in common with this study")


def compare(folder: Path, before: dict[tuple[str, Method], Scores], trials: Sequence[Trial]) -> dict[str, Any]:
    """Compare trials with the scores `before` of the study in another folder."""
    sequences = []
    for trial in trials:
        old = before.get((trial.recording, trial.method))
        if old is None or not trial.summary["scored_frames"]:
            continue
        new = _scores(flat(trial))
        mm, deg = ((new[name] or 0.0) - (old[name] or 0.0) for name in FINALS)
        change = 0.0 if abs(mm) <= 0.1 and abs(deg) <= 0.1 else mm + deg
        about = {"recording": trial.recording, "method": str(trial.method), "group": trial.group}
        sequences.append({**about, "before": old, "after": new, "change": change})
    methods = dict.fromkeys(each["method"] for each in sequences)
    changes = {method: _change([each for each in sequences if each["method"] == method]) for method in methods}
    return {"folder": str(folder), "methods": changes, "sequences": sequences}


def _scores(row: dict[str, Any]) -> Scores:
    """Return the scores in a row of `sequences.csv`, read from a file or not yet written."""

    def number(value: Any) -> float | None:
        return None if value in ("", None) else float(value == "True") if value in ("True", "False") else float(value)

    errors = {name: number(row[key]) for name, key in (FINALS | RMSES).items()}
    return errors | {name: number(row.get(name)) for name in (*SHARES, RECOVERY)}


def _change(sequences: Sequence[dict[str, Any]]) -> dict[str, Any]:
    ranked = sorted(sequences, key=lambda each: each["change"])
    better = [each for each in ranked if each["change"] < 0.0]
    worse = [each for each in ranked[::-1] if each["change"] > 0.0]
    return {
        "sequences": len(sequences),
        "better": len(better),
        "worse": len(worse),
        "same": len(sequences) - len(better) - len(worse),
        **{name: _both(sequences, name, median) for name in (*FINALS, *RMSES, RECOVERY)},
        **{name: _both(sequences, name, fmean) for name in SHARES},
        "improved": better[:10],
        "worsened": worse[:10],
    }


def _both(
    sequences: Sequence[dict[str, Any]], name: str, middle: Callable[[Sequence[float]], float]
) -> dict[str, float | None]:
    """Return a score before and after, over the sequences for which both are known."""
    pairs = [(each["before"].get(name), each["after"].get(name)) for each in sequences]
    known = [pair for pair in pairs if None not in pair]
    return {when: middle([pair[k] for pair in known]) if known else None for k, when in enumerate(("before", "after"))}
