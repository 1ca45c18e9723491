"""`palpate demo`: tracks the small recording that comes with palpate."""

from pathlib import Path
from typing import Annotated

import tyro

RECORDING = Path(__file__).resolve().parents[1] / "data" / "demo.h5"


def demo(
    *,
    out: Annotated[
        Path, tyro.conf.arg(metavar="DIR", help="Folder of the run; an earlier run there is replaced.")
    ] = Path("demo-run"),
    json: Annotated[bool, tyro.conf.arg(help="Print one JSON object.")] = False,
) -> int:
    """Track the small recording that comes with palpate: a modelled push, touch from its truth."""
    from palpate.cli.console import print_line
    from palpate.cli.track import report_run, run_file
    from palpate.tracker import TrackerSettings

    summary = run_file(RECORDING, out, TrackerSettings(tactile="oracle"), force=True)
    if not json:
        print_line(
            "Three pushes of a rectangle, drawn from the limit-surface model; touch tells the true relative poses."
        )
    report_run(summary, out, json)
    return 0
