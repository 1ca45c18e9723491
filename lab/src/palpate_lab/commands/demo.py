"""`palpate demo`: a push that is simulated and tracked."""

from pathlib import Path
from typing import Annotated

import palpate
from palpate.cli.console import Report, progress_bar
from palpate.cli.options import arg
from palpate.cli.track import run_report


def demo(*, out: Annotated[Path, arg("DIR")] = Path("demo-run")) -> Report:
    """Simulate a push with touch images and track it; shows a table and writes a figure in well under a minute.

    Example: palpate demo --out demo-run

    Args:
        out: Folder of the run; an earlier run there is replaced.
    """
    from palpate.pipeline.run_folder import RECORDING, new_run, write_files
    from palpate_lab.simulate.recordings import demo_recording

    with new_run(out, force=True) as part:
        with progress_bar("simulating", 450) as progress:
            recording = demo_recording(progress)
        with progress_bar("tracking", len(recording)) as progress:
            run = palpate.track(recording, palpate.TrackerSettings("learnt"), progress=progress)
        write_files(run, part)
    return run_report(out, run.summary, str(out / RECORDING))
