"""What `palpate track` and `palpate demo` say of runs."""

from pathlib import Path
from statistics import median
from typing import Any

METRICS = (
    ("translation_rmse_mm", "translation RMSE", "mm", 2),
    ("rotation_rmse_deg", "rotation RMSE", "deg", 2),
    ("final_translation_error_mm", "final translation error", "mm", 2),
    ("final_rotation_error_deg", "final rotation error", "deg", 2),
    ("nees_mean", "NEES, mean (3 is right)", "", 1),
)
COVERAGES = (
    ("in_95_share", "in the 95 % region", "% of frames since contact"),
    ("in_95_contact_share", "in the 95 % region, in contact", "% of frames"),
    ("in_95_rest_share", "in the 95 % region, at rest", "% of frames"),
    ("silently_wrong_share", "silently wrong", "% of frames since contact"),
)
STEPS = (("p50", "step time, median", 2), ("p95", "step time, 95 %", 2), ("max", "step time, largest", 2))


def report_run(summary: dict[str, Any], folder: Path, json: bool) -> None:
    """Print the summary of one run."""
    from palpate.cli.console import number, percent, print_json, print_line, print_table
    from palpate.pipeline.metrics import pose_words

    if json:
        print_json(summary)
        return
    if "tactile_reason" in summary:
        print_line(f"touch is {summary['tactile']}: {summary['tactile_reason']}")
    if "unusual_colours" in summary:
        print_line(summary["unusual_colours"])
    statuses = ", ".join(f"{count} {status}" for status, count in summary["statuses"].items())
    rows = [
        ("frames", str(summary["frames"]), ""),
        ("in contact", str(summary["contact_frames"]), ""),
        ("contacts", str(summary["episodes"]), ""),
        ("final pose", pose_words(summary["final_pose"], summary["final_sigma"]), "1 sigma"),
        ("scored", str(summary["scored_frames"]), "frames"),
        *((name, number(summary[key], digits), unit) for key, name, unit, digits in METRICS),
        *((name, percent(summary[key]), unit) for key, name, unit in COVERAGES),
        *_knock_rows(summary),
        *((name, number(summary["step_ms"][key], digits), "ms") for key, name, digits in STEPS),
        ("status", statuses, "frames"),
    ]
    print_table(
        f"tactile {summary['tactile']}, {summary['smoother']}",
        ("metric", "value", "unit"),
        rows,
        numbers=(1,),
    )
    print_line(f"run: {folder}   figure: {folder / 'figure.png'}")


def _knock_rows(summary: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Rows about knocks, where there are some: how long it took to recover from each, and what no touch could tell."""
    from palpate.cli.console import number, percent

    if not summary["knocks"]:
        return []
    times = (("knock_recovery_s", "s"), ("knock_recovery_contact_s", "s in contact"))
    return [
        ("knocks", str(summary["knocks"]), ""),
        *(("recovered after", ", ".join(number(each, 2) for each in summary[key]), unit) for key, unit in times),
        ("silently wrong before a touch", percent(summary["silently_wrong_unfelt_share"]), "% of frames since contact"),
    ]


def report_runs(runs: list[dict[str, Any]]) -> None:
    """Print a line for each of several runs, and their median."""
    from palpate.cli.console import number, percent, print_line, print_table

    errors, shares = [key for key, *_ in METRICS], [key for key, *_ in COVERAGES]
    table = [{**{key: run[key] for key in (*errors, *shares)}, "step_ms": run["step_ms"]["p50"]} for run in runs]
    known = {key: [row[key] for row in table if row[key] is not None] for key in table[0]}
    table.append({key: median(values) if values else None for key, values in known.items()})
    names = [*(Path(run["folder"]).name for run in runs), "median"]
    rows = (
        [name, *(percent(value) if key in shares else number(value, 2) for key, value in row.items())]
        for name, row in zip(names, table, strict=True)
    )
    columns = ("run", "RMSE mm", "RMSE deg", "final mm", "final deg", "NEES")
    columns = (*columns, "in 95 %", "contact", "rest", "silently wrong", "step ms")
    title = f"tactile {' or '.join(dict.fromkeys(run['tactile'] for run in runs))}, {runs[0]['smoother']}"
    print_table(title, columns, rows, numbers=range(1, len(columns)))
    print_line(f"runs: {Path(runs[0]['folder']).parent}")
