"""Track the real pushes of MIT and CMU with the true relative yaw for touch: docs/study/real.json.

    python scripts/measure_real_pushes.py [../shared/data]

Every recording is tracked as by `palpate track FILE --tactile oracle`; none is left out. A minute on two cores.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from _common import DATA, for_each, write

import palpate
from palpate.geometry.se2 import wrap
from palpate.pipeline.metrics import flag_runs, translation_errors
from palpate.pipeline.track import track
from palpate_lab.study.recordings import find_recordings


def main(data: Path) -> None:
    """Track all recordings and write their summaries."""
    files = {
        f"{folder}/{name}": path
        for folder in ("mit_point_push", "cmu_two_finger")
        for name, path in find_recordings(data / folder).items()
    }
    summaries = for_each(summary, files.values())
    write("real", {"runs": [{"file": name, **each} for name, each in zip(files, summaries, strict=True)]})


def summary(path: Path) -> dict[str, Any]:
    """Return the summary of a tracked recording, with its knocks: pushing turns the object by 2 degrees in 5 frames.

    The error a second after each is None where truth is not known then.
    """
    recording = palpate.load_recording(path)
    assert recording.object_pose is not None
    turned = wrap(recording.object_pose[5:, 2] - recording.object_pose[:-5, 2])
    knocks = flag_runs(np.abs(turned) > np.radians(5.0))
    run = track(recording, palpate.TrackerSettings("oracle"))
    time = recording.time
    errors = [*(1e3 * translation_errors(run.online.pose, run.recording.truth)).tolist(), np.nan]
    later = [errors[int(np.searchsorted(time, time[last + 5] + 1.0))] for _, last in knocks]
    known = [None if np.isnan(error) else error for error in later]
    return run.summary | {"knocks": len(knocks), "mm_after_knocks": known}


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DATA)
