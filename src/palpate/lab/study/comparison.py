"""Two studies of the same recordings: which of them came out better and which worse.

The comparison holds

    folder      the other study
    methods     {method: {sequences, better, worse, same, final_mm, final_deg, rmse_mm, rmse_deg, COVERAGE,
                recovery_contact_s, improved, worsened}}, where errors are {before, after}, medians over the sequences,
                coverage and recovery, too, but means and a median over those of which both studies tell it, and the
                last two are lists of sequences
    sequences   [{recording, method, group, before, after, change}] with all of these figures, None where not told
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean, median
from typing import Any

from palpate.errors import FileError, SettingError
from palpate.lab.study.folder import read_study
from palpate.lab.study.results import FINALS, RMSES, flat
from palpate.lab.study.rows import read_rows
from palpate.lab.study.trial import Method, Trial

COVERAGE = ("in_95_contact_share", "in_95_rest_share", "in_95_final", "silently_wrong_share", "recovered_in_2s")
RECOVERY = "recovery_contact_s"
"""Columns of `sequences.csv` that studies of earlier versions lack."""

Figures = dict[str, float | None]
Scores = dict[tuple[str, Method], Figures]
"""Of each recording and method `final_mm`, `final_deg`, `rmse_mm` and `rmse_deg`, COVERAGE and RECOVERY."""

SAME_MM, SAME_DEG = 0.1, 0.1
"""Final errors that differ by no more are the same."""
MM_PER_DEG = 1.0
"""What a degree counts in a change for better or worse: it moves a point 6 cm from the centre by a millimetre."""
NAMED = 10
"""So many sequences that changed most are named."""


def read_scores(folder: Path) -> Scores:
    """Return the scores of a study that is done; FileError where there is none."""
    read_study(folder)
    path = folder / "sequences.csv"
    if not path.is_file():
        raise FileError(f"{folder}: holds a study that is not done: there is no sequences.csv in it")
    scores: Scores = {}
    try:
        for row in read_rows(path):
            if row[FINALS["final_mm"]]:
                errors: Figures = {name: float(row[key]) for name, key in (FINALS | RMSES).items()}
                more = {name: _number(row.get(name)) for name in (*COVERAGE, RECOVERY)}
                scores[row["recording"], Method(row["tactile"], row["smoother"])] = errors | more
    except (KeyError, ValueError) as error:
        raise FileError(f"{path}: is not a table of sequences ({error})") from error
    return scores


def check_common(folder: Path, before: Scores, names: Iterable[str], methods: Sequence[Method]) -> None:
    """SettingError unless the other study has scored one of these recordings by one of these methods."""
    known = set(names)
    if not any(name in known and method in methods for name, method in before):
        raise SettingError(f"--against {folder}: has no recording and method in common with this study")


def compare(folder: Path, before: Scores, trials: Sequence[Trial]) -> dict[str, Any]:
    """Return what became of sequences since the other study in `folder`, whose scores are `before`."""
    sequences = [
        _sequence(trial, before[trial.recording, trial.method])
        for trial in trials
        if trial.summary["scored_frames"] and (trial.recording, trial.method) in before
    ]
    methods = dict.fromkeys(each["method"] for each in sequences)
    return {
        "folder": str(folder),
        "methods": {method: _change([each for each in sequences if each["method"] == method]) for method in methods},
        "sequences": sequences,
    }


def _number(text: str | None) -> float | None:
    """A number or a flag of a table; None where there is none."""
    return float({"True": 1, "False": 0}.get(text, text)) if text else None


def _sequence(trial: Trial, before: Figures) -> dict[str, Any]:
    row = flat(trial)
    after = {name: row[key] for name, key in (FINALS | RMSES).items()}
    after |= {name: row.get(name) for name in (*COVERAGE, RECOVERY)}
    mm, deg = (after[name] - before[name] for name in FINALS)
    same = abs(mm) <= SAME_MM and abs(deg) <= SAME_DEG
    return {
        "recording": trial.recording,
        "method": str(trial.method),
        "group": trial.group,
        "before": before,
        "after": after,
        "change": 0.0 if same else mm + MM_PER_DEG * deg,
    }


def _change(sequences: Sequence[dict[str, Any]]) -> dict[str, Any]:
    ranked = sorted(sequences, key=lambda each: each["change"])
    better = [each for each in ranked if each["change"] < 0.0]
    worse = [each for each in ranked if each["change"] > 0.0]
    medians: Mapping[str, Any] = {
        name: {when: median(each[when][name] for each in sequences) for when in ("before", "after")}
        for name in FINALS | RMSES
    }
    return {
        "sequences": len(sequences),
        "better": len(better),
        "worse": len(worse),
        "same": len(sequences) - len(better) - len(worse),
        **medians,
        **{name: _both(sequences, name, fmean) for name in COVERAGE},
        RECOVERY: _both(sequences, RECOVERY, median),
        "improved": better[:NAMED],
        "worsened": worse[: -NAMED - 1 : -1],
    }


def _both(
    sequences: Sequence[dict[str, Any]], name: str, middle: Callable[[Sequence[float]], float]
) -> dict[str, float | None]:
    """A figure before and after, of the sequences of which both are known."""
    known = [
        (float(before), float(after))
        for each in sequences
        if (before := each["before"].get(name)) is not None and (after := each["after"].get(name)) is not None
    ]
    if not known:
        return {"before": None, "after": None}
    before, after = zip(*known, strict=True)
    return {"before": middle(before), "after": middle(after)}
