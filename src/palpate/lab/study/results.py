"""What a study found, as plain data: `results.json`, and a row a trial in `sequences.csv`.

`results.json` holds

    command     the command line
    settings    methods, noise, pressure, hypotheses, model, calibration, first_pose, first_pose_sigma,
                first_pose_of_all
    study       palpate, folder, recordings, trials, kept, skipped, failed, broken, wall_s, workers, cores, lost_above
    table       {group: {method: row}}, the groups by name and then "all groups"; see `table`
    recordings  {recording: {group, shape, source, frames, seconds, images, truth}}
    lost        [{recording, method, final_mm, final_deg, final_inside_95}]
    skipped     [{recording, method, reason}]: what a recording cannot be tracked with
    failed      [{recording, method, error}]: what could not be tracked to its end
    broken      [{recording, error}]: what could not be read
    against     see `comparison`, where there is something to compare with
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import palpate
from palpate.config import PRESETS
from palpate.errors import FileError
from palpate.files import whole_file
from palpate.lab.study.job import StudySettings
from palpate.lab.study.rows import write_rows
from palpate.lab.study.study import Study
from palpate.lab.study.trial import Method, Trial
from palpate.pipeline.metrics import AFTER, inside_95, since_contact
from palpate.touch.model import TouchModel

Array = NDArray[np.float64]
ALL = "all groups"
LOST_MM, LOST_DEG = 50.0, 30.0
"""A sequence is lost if its final error is above either."""

FINALS = {"final_mm": "final_translation_error_mm", "final_deg": "final_rotation_error_deg"}
RMSES = {"rmse_mm": "translation_rmse_mm", "rmse_deg": "rotation_rmse_deg"}
"""What columns of the table are called in a trial's summary."""
SOON = 2.0
"""[s] in contact within which an estimate should recover from a knock."""


def results_of(
    study: Study, settings: StudySettings, model: TouchModel | None, folder: Path, workers: int, command: str
) -> dict[str, Any]:
    """Return the content of `results.json`, but `against`."""
    unit = settings.calibration
    return {
        "command": command,
        "settings": {
            "methods": [str(method) for method in settings.methods],
            "noise_preset": next((name for name, preset in PRESETS.items() if preset == settings.noise), None),
            "noise": asdict(settings.noise),
            "pressure": settings.pressure,
            "hypotheses": settings.hypotheses,
            "model": None if model is None else {"folder": str(model.folder), "hash": model.hash},
            "calibration": None if unit is None else {"file": str(unit.file or ""), "hash": unit.hash},
            "first_pose": settings.first_pose,
            "first_pose_sigma": settings.first_pose_sigma,
            "first_pose_of_all": settings.first_pose_of_all,
        },
        "study": {
            "palpate": palpate.__version__,
            "folder": str(folder),
            **counted(study),
            "workers": workers,
            "cores": os.cpu_count(),
            "lost_above": {"mm": LOST_MM, "deg": LOST_DEG},
        },
        "table": table(study.trials, settings.methods),
        "recordings": study.recordings,
        "lost": [
            {"recording": trial.recording, "method": str(trial.method), **_finals(trial), **_final_inside(trial)}
            for trial in study.trials
            if is_lost(trial)
        ],
        "skipped": _named(study.skipped, "reason"),
        "failed": _named(study.failed, "error"),
        "broken": [{"recording": name, "error": error} for name, error in study.broken.items()],
    }


def counted(study: Study) -> dict[str, float]:
    """Return how many recordings and trials there are, how many went which way, and how long it took [s]."""
    counts = {name: len(getattr(study, name)) for name in ("recordings", "trials", "skipped", "failed", "broken")}
    return {**counts, "kept": study.kept, "wall_s": study.wall_s}


def table(trials: Sequence[Trial], methods: Sequence[Method]) -> dict[str, dict[str, Any]]:
    """Return a row of figures for each group and method, and for all groups together.

    A row holds, of its `sequences` with ground truth:
    final_mm, final_deg: {median, p75, worst} of the error at the last frame with truth;
    rmse_mm, rmse_deg: median of the RMSE over a sequence;
    nees: {median, mean} and inside_95: share in the 95 % region, both of all frames from the first contact on, before
    which the pose is as good as given;
    contact_inside_95, rest_inside_95, final_inside_95: share of those in contact, of the others and of the last ones;
    silently_wrong, silently_wrong_unfelt: means over sequences of such shares; see `metrics.summarise`;
    knocks: how many, and what `recovered` tells of them;
    error_after_knock_mm: see `errors_after_knock`;
    lost: how many;
    and, of all sequences, ambiguous: share of the frames in contact that have that status, and step_ms: {p50, p95,
    p99}, medians over sequences.
    What cannot be told is None.
    """
    scored = [(trial, _nees_by_kind(trial)) for trial in trials]
    names = [*sorted({trial.group for trial in trials}), ALL] if trials else []
    found: dict[str, dict[str, Any]] = {name: {} for name in names}
    for name in names:
        for method in methods:
            chosen = [pair for pair in scored if pair[0].method == method and name in (pair[0].group, ALL)]
            if chosen:
                found[name][str(method)] = _row(*zip(*chosen, strict=True))
    return found


def is_lost(trial: Trial) -> bool:
    """Say whether the final error is beyond what can be called tracked; that of a yaw that does not show never is."""
    mm, deg = _finals(trial).values()
    turned = trial.summary.get("yaw_shows", True) and deg is not None and deg > LOST_DEG
    return mm is not None and (mm > LOST_MM or turned)


def recovered(summaries: Sequence[Mapping[str, Any]]) -> dict[str, float | None]:
    """Return how the knocks of trials with these summaries were recovered from.

    They are `recovery_contact_s`, the median time in contact, and `recovered_in_2s`, the share that took up to SOON. A
    knock may be followed by the next one or the end before that: what is not known of it is left open (the estimate of
    Kaplan and Meier). Without knocks both are None, and so is what is beyond the longest that any was followed for.
    """
    from scipy.stats import CensoredData, ecdf  # importing it takes a second

    known = [summary for summary in summaries if summary.get("knock_contact_s")]
    if not known:
        return {"recovery_contact_s": None, "recovered_in_2s": None}
    taken = [each for summary in known for each in summary["knock_recovery_contact_s"]]
    until = [each for summary in known for each in summary["knock_contact_s"]]
    seconds = [end if each is None else each for each, end in zip(taken, until, strict=True)]
    lasting = ecdf(CensoredData.right_censored(seconds, [each is None for each in taken])).sf
    half = lasting.quantiles[lasting.probabilities <= 0.5]
    is_known = max(seconds) >= SOON or lasting.probabilities[-1] == 0.0
    return {
        "recovery_contact_s": float(half[0]) if len(half) else None,
        "recovered_in_2s": float(1.0 - lasting.evaluate(SOON)) if is_known else None,
    }


def errors_after_knock(summaries: Sequence[Mapping[str, Any]]) -> dict[str, float | None]:
    """Return, by the seconds after a knock ("0.5"), the median error [mm] over knocks of trials with these summaries.

    Those knocks count of which the error is known then; where there is none it is None.
    """
    told = [known for summary in summaries if (known := summary.get("knock_error_mm"))]
    medians: dict[str, float | None] = {}
    for after in (f"{seconds:g}" for seconds in AFTER):
        errors = [error for known in told for error in known[after] if error is not None]
        medians[after] = median(errors) if errors else None
    return medians


def write_results(folder: Path, results: Mapping[str, Any], trials: Sequence[Trial]) -> None:
    """Write `results.json` and `sequences.csv`, each whole or not at all."""
    try:
        with whole_file(folder / "results.json", overwrite=True) as part:
            part.write_text(json.dumps(results, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        write_rows(folder / "sequences.csv", [flat(trial) for trial in trials])
    except OSError as error:
        raise FileError(f"{folder}: cannot be written ({error.strerror})") from error


def _row(trials: Sequence[Trial], kinds: Sequence[Mapping[str, Array]]) -> dict[str, Any]:
    """The row of trials, from `_nees_by_kind` of each."""
    scored = [trial for trial in trials if trial.summary["scored_frames"]]
    steps = {share: [trial.summary["step_ms"][share] for trial in trials] for share in ("p50", "p95", "p99")}
    pooled = {kind: np.concatenate([each[kind] for each in kinds]) for kind in kinds[0]}
    nees = pooled["all"]
    silent, unfelt = (
        [known for trial in scored if (known := trial.summary.get(key)) is not None]
        for key in ("silently_wrong_share", "silently_wrong_unfelt_share")
    )
    return {
        "sequences": len(scored),
        "unscored": len(trials) - len(scored),
        **{name: _spread([trial.summary[key] for trial in scored]) for name, key in FINALS.items()},
        **{name: _spread([trial.summary[key] for trial in scored])["median"] for name, key in RMSES.items()},
        "nees": {
            "median": float(np.median(nees)) if len(nees) else None,
            "mean": float(np.mean(nees)) if len(nees) else None,
        },
        "inside_95": _share(inside_95(nees)),
        **{f"{kind}_inside_95": _share(inside_95(pooled[kind])) for kind in ("contact", "rest", "final")},
        "silently_wrong": _share(silent),
        "silently_wrong_unfelt": _share(unfelt),
        "knocks": sum(trial.summary.get("knocks") or 0 for trial in scored),
        **recovered([trial.summary for trial in scored]),
        "error_after_knock_mm": errors_after_knock([trial.summary for trial in scored]),
        "lost": sum(is_lost(trial) for trial in scored),
        "ambiguous": _ambiguous([trial.summary for trial in trials]),
        "step_ms": {share: float(np.median(values)) for share, values in steps.items()},
    }


def _ambiguous(summaries: Sequence[Mapping[str, Any]]) -> float | None:
    """The share of all frames in contact that are ambiguous, of the summaries that tell it."""
    told = [(share, each["contact_frames"]) for each in summaries if (share := each.get("ambiguous_share")) is not None]
    return sum(share * frames for share, frames in told) / sum(frames for _, frames in told) if told else None


def _nees_by_kind(trial: Trial) -> dict[str, Array]:
    """The NEES (M,) of the frames with truth since the first contact: all, those in contact, at rest, and the last."""
    nees = trial.nees
    since = since_contact(trial.contact, nees)
    contact, rest = nees[since & trial.contact], nees[since & ~trial.contact]
    return {"all": nees[since], "contact": contact, "rest": rest, "final": nees[since][-1:]}


def _share(values: ArrayLike) -> float | None:
    values = np.asarray(values, np.float64)
    return float(np.mean(values)) if len(values) else None


def _spread(values: Sequence[float]) -> dict[str, float | None]:
    shares = {"median": 50, "p75": 75, "worst": 100}
    if not values:
        return dict.fromkeys(shares)
    return {name: float(np.percentile(values, share)) for name, share in shares.items()}


def _finals(trial: Trial) -> dict[str, float | None]:
    return {name: trial.summary[key] for name, key in FINALS.items()}


def _final_inside(trial: Trial) -> dict[str, bool | None]:
    last = _nees_by_kind(trial)["final"]
    return {"final_inside_95": bool(inside_95(last)[0]) if len(last) else None}


def _named(found: Mapping[tuple[str, Method], str], what: str) -> list[dict[str, str]]:
    return [{"recording": name, "method": str(method), what: said} for (name, method), said in found.items()]


def flat(trial: Trial) -> dict[str, Any]:
    """Return the trial as a row of `sequences.csv`: its summary, lists and tables in it told in single values."""
    row = {"recording": trial.recording, "group": trial.group, **asdict(trial.method), "lost": is_lost(trial)}
    row |= {key: value for key, value in trial.summary.items() if not isinstance(value, dict | list)}
    row |= recovered([trial.summary])
    row |= {f"error_after_knock_mm_{after}": mm for after, mm in errors_after_knock([trial.summary]).items()}
    return row | {f"step_ms_{share}": value for share, value in trial.summary["step_ms"].items()}
