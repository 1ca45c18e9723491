"""What each error of a set-up costs by itself: docs/study/set_up_errors.json.

    python scripts/measure_set_up_errors.py FOLDER

FOLDER has recordings of exact set-ups, `palpate simulate FOLDER --ideal`. Each is tracked by touch as it is, with every
error that `lab/simulate/systematic.py` draws but the gel's drift, one at a time and all together, and again with all
but the outline taken for exact. The reported ones: `--count 18 --seed 87501 --seconds 15`. Eight minutes on two cores.
"""

import json
import sys
import zlib
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from statistics import fmean, median

import numpy as np

from palpate.config.settings import NoiseSettings
from palpate.config.tracker_settings import TrackerSettings
from palpate.io import load_recording
from palpate.lab.simulate.systematic import SystematicErrors, draw_errors, misstated
from palpate.parallel import spread
from palpate.pipeline.metrics import translation_errors
from palpate.pipeline.run import track
from palpate.types.recording import Recording

OUT = Path(__file__).parents[1] / "docs/study/set_up_errors.json"
NOTHING = {"mounting": np.zeros(3), "outline": 1.0, "late": 0, "first_pose": np.zeros(3)}
LEARNT = NoiseSettings()
EXACT = replace(LEARNT, priors=replace(LEARNT.priors, outline_scale=(0.0, 1e-9)))
CASES = {
    "none": ((), LEARNT),
    **{name: ((name,), LEARNT) for name in NOTHING},
    "all": (tuple(NOTHING), LEARNT),
    "outline, taken for exact": (("outline",), EXACT),
    "all, outline taken for exact": (tuple(NOTHING), EXACT),
}
"""Which errors there are, and how the outline is believed."""


def main(folder: Path) -> None:
    """Track all recordings in all cases, and write."""
    files = sorted(folder.glob("*.h5"))
    with closing(spread(scores, files, workers=2)) as results:
        found = list(results)
    rows = {
        case: {
            "contact_mm": median(each[case]["contact_mm"] for each in found),
            "final_mm": median(each[case]["final_mm"] for each in found),
            "final_mean_mm": fmean(each[case]["final_mm"] for each in found),
            "final_deg": median(each[case]["final_deg"] for each in found),
            "contact_inside_95": fmean(each[case]["inside"] for each in found),
            "final_inside_95": fmean(each[case]["final_inside"] for each in found),
        }
        for case in CASES
    }
    OUT.write_text(json.dumps({"recordings": len(files), "cases": rows}, indent=2) + "\n", encoding="utf-8")


def scores(file: Path) -> dict[str, dict[str, float]]:
    """Return how a recording is tracked in each case: mean error in contact, final errors, shares in the region."""
    recording = load_recording(file)
    errors = draw_errors(np.random.default_rng(zlib.crc32(file.stem.encode())))
    return {case: scored(misstated(recording, only(errors, wrong)), noise) for case, (wrong, noise) in CASES.items()}


def only(errors: SystematicErrors, wrong: tuple[str, ...]) -> SystematicErrors:
    """Return these errors alone."""
    return replace(errors, **{name: exact for name, exact in NOTHING.items() if name not in wrong})


def scored(recording: Recording, noise: NoiseSettings) -> dict[str, float]:
    """Track a recording with its stated first pose, and return its scores."""
    assert recording.object_pose is not None
    run = track(recording, TrackerSettings("learnt", noise=noise))
    summary, online = run.summary, run.online
    assert online.contact is not None
    errors = 1e3 * translation_errors(online.pose, recording.object_pose)
    return {
        "contact_mm": float(errors[online.contact].mean()),
        "final_mm": summary["final_translation_error_mm"],
        "final_deg": summary["final_rotation_error_deg"],
        "inside": summary["in_95_contact_share"],
        "final_inside": float(summary["in_95_final"]),
    }


if __name__ == "__main__":
    main(Path(sys.argv[1]))
