"""Tables of runs, as `palpate track` and `palpate demo` print them."""

from pathlib import Path
from statistics import median
from typing import Any

from palpate.cli.console import number, percent, print_json, print_line, print_quantities, print_table

SCORES = (
    ("translation_rmse_mm", "translation RMSE", "mm", "RMSE mm", 2),
    ("rotation_rmse_deg", "rotation RMSE", "deg", "RMSE deg", 2),
    ("final_translation_error_mm", "final translation error", "mm", "final mm", 2),
    ("final_rotation_error_deg", "final rotation error", "deg", "final deg", 2),
    ("nees_mean", "NEES, mean (3 if consistent)", "", "NEES", 1),
    ("in_95_share", "in the 95 % region", "% of frames since contact", "in 95 %", None),
    ("in_95_contact_share", "in the 95 % region, in contact", "% of frames", "contact", None),
    ("in_95_rest_share", "in the 95 % region, at rest", "% of frames", "rest", None),
    ("silently_wrong_share", "silently wrong", "% of frames since contact", "silently wrong", None),
)
"""Key in `summary.json`, name, unit, heading where each run is a row, and decimals, None for shares in %."""


def report_run(summary: dict[str, Any], folder: Path, json: bool) -> None:
    """Print the summary of one run."""
    from palpate.pipeline.metrics import pose_words

    if json:
        print_json(summary)
        return
    if "tactile_reason" in summary:
        print_line(f"touch is {summary['tactile']}: {summary['tactile_reason']}")
    if "unusual_colours" in summary:
        print_line(summary["unusual_colours"])
    knocks = [
        ("knocks", str(summary["knocks"]), ""),
        ("recovered after", _several(summary["knock_recovery_s"]), "s"),
        ("recovered after", _several(summary["knock_recovery_contact_s"]), "s in contact"),
        (
            "silently wrong before a touch",
            percent(summary["silently_wrong_before_touch_share"]),
            "% of frames since contact",
        ),
    ]
    rows = [
        ("frames", str(summary["frames"]), ""),
        ("in contact", str(summary["contact_frames"]), ""),
        ("contacts", str(summary["episodes"]), ""),
        ("final pose", pose_words(summary["final_pose"], summary["final_sigma"]), "1 sigma"),
        ("scored", str(summary["scored_frames"]), "frames"),
        *((name, _cell(summary[key], digits), unit) for key, name, unit, _, digits in SCORES),
        *(knocks if summary["knocks"] else ()),
        ("step time, median", number(summary["step_ms"]["p50"], 2), "ms"),
        ("step time, 95 %", number(summary["step_ms"]["p95"], 2), "ms"),
        ("step time, maximum", number(summary["step_ms"]["max"], 2), "ms"),
        ("status", ", ".join(f"{count} {status}" for status, count in summary["statuses"].items()), "frames"),
    ]
    print_quantities(f"tactile {summary['tactile']}, {summary['smoother']}", rows)
    print_line(f"run: {folder}   figure: {folder / 'figure.png'}")


def report_runs(runs: list[dict[str, Any]]) -> None:
    """Print a line for each of several runs, and their median."""
    columns: dict[str, list[str]] = {"run": [*(Path(run["folder"]).name for run in runs), "median"]}
    for key, _, _, heading, digits in SCORES:
        columns[heading] = _with_median([run[key] for run in runs], digits)
    columns["step ms"] = _with_median([run["step_ms"]["p50"] for run in runs], 2)
    title = f"tactile {' or '.join(dict.fromkeys(run['tactile'] for run in runs))}, {runs[0]['smoother']}"
    print_table(title, list(columns), zip(*columns.values(), strict=True), numbers=range(1, len(columns)))
    print_line(f"runs: {Path(runs[0]['folder']).parent}")


def _cell(value: float | None, digits: int | None) -> str:
    return percent(value) if digits is None else number(value, digits)


def _several(values: list[float | None] | None) -> str:
    return ", ".join(number(each, 2) for each in values or ())


def _with_median(values: list[float | None], digits: int | None) -> list[str]:
    """Return cells of a column, with the median of the known values at its end."""
    known = [value for value in values if value is not None]
    return [_cell(value, digits) for value in (*values, median(known) if known else None)]
