"""Tables of runs, as `palpate track` and `palpate demo` print them."""

from pathlib import Path
from statistics import median
from typing import Any

ERRORS = {
    "translation_rmse_mm": ("translation RMSE", "mm", "RMSE mm"),
    "rotation_rmse_deg": ("rotation RMSE", "deg", "RMSE deg"),
    "final_translation_error_mm": ("final translation error", "mm", "final mm"),
    "final_rotation_error_deg": ("final rotation error", "deg", "final deg"),
    "nees_mean": ("NEES, mean (3 if consistent)", "", "NEES"),
}
"""Name, unit and column heading of each."""
SHARES = {
    "in_95_share": ("in the 95 % region", "% of frames since contact", "in 95 %"),
    "in_95_contact_share": ("in the 95 % region, in contact", "% of frames", "contact"),
    "in_95_rest_share": ("in the 95 % region, at rest", "% of frames", "rest"),
    "silently_wrong_share": ("silently wrong", "% of frames since contact", "silently wrong"),
}
STEPS = {"p50": "step time, median", "p95": "step time, 95 %", "max": "step time, maximum"}


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
    rows = [
        ("frames", str(summary["frames"]), ""),
        ("in contact", str(summary["contact_frames"]), ""),
        ("contacts", str(summary["episodes"]), ""),
        ("final pose", pose_words(summary["final_pose"], summary["final_sigma"]), "1 sigma"),
        ("scored", str(summary["scored_frames"]), "frames"),
        *(
            (name, number(summary[key], 1 if key == "nees_mean" else 2), unit)
            for key, (name, unit, _) in ERRORS.items()
        ),
        *((name, percent(summary[key]), unit) for key, (name, unit, _) in SHARES.items()),
        *_knock_rows(summary),
        *((name, number(summary["step_ms"][key], 2), "ms") for key, name in STEPS.items()),
        ("status", ", ".join(f"{count} {status}" for status, count in summary["statuses"].items()), "frames"),
    ]
    print_table(f"tactile {summary['tactile']}, {summary['smoother']}", ("metric", "value", "unit"), rows, numbers=(1,))
    print_line(f"run: {folder}   figure: {folder / 'figure.png'}")


def report_runs(runs: list[dict[str, Any]]) -> None:
    """Print a line for each of several runs, and their median."""
    from palpate.cli.console import number, percent, print_line, print_table

    table = [{**{key: run[key] for key in (*ERRORS, *SHARES)}, "step_ms": run["step_ms"]["p50"]} for run in runs]
    known = {key: [row[key] for row in table if row[key] is not None] for key in table[0]}
    table.append({key: median(values) if values else None for key, values in known.items()})
    names = [*(Path(run["folder"]).name for run in runs), "median"]
    rows = (
        [name, *(percent(value) if key in SHARES else number(value, 2) for key, value in row.items())]
        for name, row in zip(names, table, strict=True)
    )
    columns = ("run", *(heading for *_, heading in (*ERRORS.values(), *SHARES.values())), "step ms")
    title = f"tactile {' or '.join(dict.fromkeys(run['tactile'] for run in runs))}, {runs[0]['smoother']}"
    print_table(title, columns, rows, numbers=range(1, len(columns)))
    print_line(f"runs: {Path(runs[0]['folder']).parent}")


def _knock_rows(summary: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Return rows about the recovery from knocks, if there are any."""
    from palpate.cli.console import number, percent

    if not summary["knocks"]:
        return []
    times = (("knock_recovery_s", "s"), ("knock_recovery_contact_s", "s in contact"))
    return [
        ("knocks", str(summary["knocks"]), ""),
        *(("recovered after", ", ".join(number(each, 2) for each in summary[key]), unit) for key, unit in times),
        ("silently wrong before a touch", percent(summary["silently_wrong_unfelt_share"]), "% of frames since contact"),
    ]
