"""Trials as a study may find them, drawn instead of tracked."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Polygon, Rectangle, Shape, shape_to_dict
from palpate.lab.study.trial import Method, Trial
from palpate.pipeline.metrics import coverage, percentiles, rms

TACTILES = ("none", "constant", "learnt-linear", "learnt-pairs", "learnt-turn", "learnt-direction", "learnt", "oracle")
SHAPES: dict[str, Shape] = {
    "disc": Disc(0.088),
    "hexagon-edges": Polygon([(0.1 * np.cos(a), 0.1 * np.sin(a)) for a in np.arange(6) * np.pi / 3]),
}
"""Of groups; a rectangle where the group is not named."""
_RATE = {"none": 8.0, "constant": 5.0, "learnt-linear": 2.0, "learnt": 0.6, "oracle": 0.3}  # [mm] a root second


def drawn_trial(
    method: Method,
    group: str = "disc",
    number: int = 0,
    seconds: float = 15.0,
    rate: float = 30.0,
    truth: bool = True,
    slip: bool = True,
) -> Trial:
    """Return a trial with three contacts; its error is a random walk in contact, and its covariance right on average.

    One in twenty sequences of touch `none` is lost.
    """
    rng = np.random.default_rng((number, *f"{group} {method}".encode()))
    n = int(seconds * rate)
    time = 2.5 + np.arange(n) / rate
    contact = (np.arange(n) % max(n // 3, 1)) > 0.2 * (n // 3)
    pushed = np.cumsum(contact)
    course = number * 0.7
    true = np.column_stack([3e-4 * pushed * np.cos(course), 3e-4 * pushed * np.sin(course), course + 0.8e-3 * pushed])
    scale = _RATE.get(method.tactile, 1.0) * (0.7 + 0.06 * len(group)) * (30.0 if lost(method, number) else 1.0)
    sigma = scale * 1e-3 * np.array([1.0, 1.0, 8.0]) / np.sqrt(rate)  # of each step in contact
    error = np.cumsum(rng.normal(size=(n, 3)) * sigma * contact[:, None], axis=0)
    deviation = 1e-5 + sigma * np.sqrt(pushed)[:, None]
    pose = se2.compose(true, se2.exp(error))
    step_ms = rng.lognormal(1.0 + 0.3 * contact, 0.3)
    return Trial(
        recording=recording_name(group, number),
        group=group,
        method=method,
        time=time,
        truth=np.where(truth, true, np.nan),
        pose=pose,
        covariance=deviation[:, :, None] ** 2 * np.eye(3),
        contact=contact,
        sensor_pose=se2.compose(true, np.array([[-0.09, 0.0, 0.1]])),
        slid=np.cumsum(contact * rng.gamma(0.3, 1e-4, n)) * (1.0 if slip else np.nan),
        step_ms=step_ms,
        summary={},
    )


def lost(method: Method, number: int) -> bool:
    """Say whether a drawn trial is lost."""
    return method.tactile == "none" and number % 20 == 3


def recording_name(group: str, number: int) -> str:
    """Return the name of a recording, real ones in folders."""
    return f"{group}/StraightLine{number}.json.gz" if group in ("mit", "cmu") else f"{group}-{1100000 + number}.mcap"


def source_of(group: str, number: int) -> str:
    """Return what a recording says of itself."""
    if group in ("mit", "cmu"):
        return f"MIT cpush, StraightLine{number}.json.gz, read at 30 Hz"
    return f"simulated by palpate: MuJoCo, {group}, 15.0 s, seed {number}, drawn touch images of unit {362 * number}"


def with_summary(trial: Trial) -> Trial:
    """Return the trial with the summary that its arrays give."""
    translation, rotation = trial.translation_error * 1e3, np.degrees(np.abs(trial.rotation_error))
    scored = bool(np.isfinite(translation).any())
    slid = float(trial.slid[-1] * 1e3)
    trial.summary.update(
        frames=len(trial.time),
        contact_frames=int(trial.contact.sum()),
        tactile=trial.method.tactile,
        smoother=trial.method.smoother,
        step_ms=percentiles(trial.step_ms),
        translation_rmse_mm=rms(translation),
        rotation_rmse_deg=rms(rotation),
        final_translation_error_mm=float(translation[-1]) if scored else None,
        final_rotation_error_deg=float(rotation[-1]) if scored else None,
        nees_mean=float(np.mean(trial.nees)) if scored else None,
        **coverage(trial.contact, trial.nees),
        silently_wrong_share=0.01 if scored else None,
        ambiguous_share=0.2,
        knock_recovery_contact_s=[],
        slid_mm=slid if np.isfinite(slid) else None,
        scored_frames=len(translation) if scored else 0,
    )
    return trial


def drawn_trials(groups: Sequence[str], methods: Sequence[Method], count: int, seconds: float = 15.0) -> list[Trial]:
    """Return `count` sequences of each group, each by all methods; real ones are shorter, faster and without slip."""
    trials = []
    for group in groups:
        real = group in ("mit", "cmu")
        for number in range(count):
            length = seconds * (0.5 + 0.05 * number) if real else seconds
            for method in methods:
                trial = drawn_trial(method, group, number, length, 50.0 if real else 30.0, slip=not real)
                trials.append(with_summary(trial))
    return trials


def drawn_results(trials: Sequence[Trial]) -> dict[str, Any]:
    """Return the content of `results.json` of trials, two recordings broken, one mode skipped and one failed."""
    from palpate.lab.study.results import is_lost, table
    from palpate.pipeline.metrics import inside_95

    methods = list(dict.fromkeys(trial.method for trial in trials))
    recordings = {
        trial.recording: {
            "group": trial.group,
            "shape": shape_to_dict(SHAPES.get(trial.group, Rectangle(0.2363, 0.1579))),
            "source": source_of(trial.group, index),
            "frames": len(trial.time),
            "seconds": float(trial.time[-1] - trial.time[0]),
            "images": trial.group not in ("mit", "cmu"),
            "truth": trial.summary["scored_frames"] > 0,
        }
        for index, trial in enumerate(trials)
    }
    broken = [
        {"recording": "disc-2.mcap", "error": "disc-2.mcap: is truncated or damaged (<bad> & worse)"},
        {"recording": "disc-3.mcap", "error": "disc-3.mcap: is empty"},
    ]
    skipped = [{"recording": "mit/a.json.gz", "method": "learnt", "reason": "a.json.gz: has no images"}]
    failed = [{"recording": "disc-4.mcap", "method": "none", "error": "frame 7: cannot be solved"}]
    return {
        "command": "palpate evaluate recordings --out report",
        "settings": {
            "methods": [str(method) for method in methods],
            "pressure": "uniform",
            "noise": {"sensor_pose": {"deviation": [1e-4]}},
        },
        "study": {
            "palpate": "0.1.0",
            "folder": "recordings",
            "recordings": len(recordings),
            "trials": len(trials),
            "skipped": len(skipped),
            "failed": len(failed),
            "broken": len(broken),
            "kept": 0,
            "wall_s": 5400.0,
            "workers": 2,
            "cores": 2,
            "lost_above": {"mm": 50.0, "deg": 30.0},
        },
        "table": table(trials, methods),
        "recordings": recordings,
        "lost": [
            {
                "recording": trial.recording,
                "method": str(trial.method),
                "final_mm": trial.summary["final_translation_error_mm"],
                "final_deg": trial.summary["final_rotation_error_deg"],
                "final_inside_95": bool(inside_95(trial.nees[-1])),
            }
            for trial in trials
            if is_lost(trial)
        ],
        "skipped": skipped,
        "failed": failed,
        "broken": broken,
    }
