"""What `palpate evaluate` says of a study."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from palpate.lab.study.study import Study

COUNTS = ("trials", "kept", "skipped", "failed", "broken")
"""What is said of a study at its end."""


def report_shard(out: Path, study: "Study", json: bool) -> int:
    """Print how many trials there are of a shard, and return the exit code; tables and figures are of them all."""
    from palpate.cli.console import print_json, print_line
    from palpate.lab.study.results import counted

    counts = counted(study)
    if json:
        print_json({"report": str(out), "study": counts})
    else:
        said = ", ".join(f"{counts[what]} {what}" for what in COUNTS)
        print_line(f"{said}, {study.wall_s:.0f} s   once all are done, --resume without --shard reports")
    return 3 if study.failed or study.broken else 0


def report_study(out: Path, results: Mapping[str, Any]) -> None:
    """Print the tables of a study, from the content of its `results.json`, and where its report is."""
    from palpate.cli.console import number, percent, print_line, print_table
    from palpate.lab.study.comparison import COVERAGE
    from palpate.lab.study.results import ALL

    finals = ("final_mm", "final_deg")
    shares = ("inside_95", "contact_inside_95", "rest_inside_95", "final_inside_95", "silently_wrong")
    methods = results["table"].get(ALL, {})
    rows = [
        [
            method,
            *(f"{number(row[of]['median'], 2)} ({number(row[of]['worst'])})" for of in finals),
            *(percent(row[name]) for name in shares),
            f"{row['lost']} of {row['sequences']}",
        ]
        for method, row in methods.items()
    ]
    if rows:
        columns = ("touch", "mm (worst)", "deg (worst)", "% in 95 %", "contact", "rests", "finals", "silently wrong")
        columns = (*columns, "lost")
        title = f"{ALL}: final error in the median, and frames in the 95 % region"
        print_table(title, columns, rows, numbers=range(1, len(columns)))
        rows = [
            [method, percent(row["ambiguous"]), *(number(row["step_ms"][share]) for share in ("p50", "p95", "p99"))]
            for method, row in methods.items()
        ]
        columns = ("touch", "% ambiguous", "ms", "95 %", "99 %")
        title = f"{ALL}: frames in contact that are ambiguous, and time of a step"
        print_table(title, columns, rows, numbers=range(1, len(columns)))
    if any(row["knocks"] for row in methods.values()):
        _show_knocks(methods)
    if against := results.get("against"):
        rows = [
            [
                method,
                *(str(change[what]) for what in ("better", "worse", "same")),
                *(" -> ".join(number(change[of][when], 2) for when in ("before", "after")) for of in finals),
                *(" -> ".join(percent(change[of][when]) for when in ("before", "after")) for of in COVERAGE[:3]),
            ]
            for method, change in against["methods"].items()
        ]
        columns = ("touch", "better", "worse", "same", "mm", "deg", "% in 95 %: contact", "rests", "finals")
        title = f"against {against['folder']}: final error in the median"
        print_table(title, columns, rows, numbers=range(1, len(columns)))
    counts = ", ".join(f"{results['study'][what]} {what}" for what in COUNTS)
    wrote = out / ("report.html" if results["table"] else "results.json")
    print_line(f"{counts}, {results['study']['wall_s']:.0f} s   report: {wrote}")


def _show_knocks(methods: Mapping[str, Mapping[str, Any]]) -> None:
    """Tell what becomes of the estimate after knocks, by each method."""
    from palpate.cli.console import number, percent, print_table
    from palpate.pipeline.metrics import AFTER, FAR_DEG, FAR_MM

    rows = [
        [
            method,
            str(row["knocks"]),
            *(number(error) for error in row["error_after_knock_mm"].values()),
            number(row["recovery_contact_s"], 2),
            percent(row["recovered_in_2s"]),
            percent(row["silently_wrong_unfelt"]),
        ]
        for method, row in methods.items()
    ]
    columns = ("touch", "knocks", *(f"mm at {after:g} s" for after in AFTER), "recovered s", "% in 2 s")
    columns = (*columns, "silently wrong before a touch")
    near = f"within {FAR_MM:g} mm and {FAR_DEG:g} deg"
    title = f"after knocks: error in the median, and time in contact until it is {near} to stay"
    print_table(title, columns, rows, numbers=range(1, len(columns)))
