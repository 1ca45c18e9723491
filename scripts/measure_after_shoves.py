"""What two seconds of contact tell of an object that was shoved: docs/study/after_shoves.json.

    python scripts/measure_after_shoves.py FOLDER [--out docs/study/after_shoves.json]

FOLDER holds shoved recordings with images, as `palpate simulate --knocks` makes; discs are left out, for nothing tells
their yaw. After each shove that two seconds of contact follow, a tracker with one answer begins anew at the true pose,
which it is told to know as roughly as a shove leaves it (SIGMA): it need not search, and its graph is linearised at the
truth. What was learnt of friction before the shove it does not have. `near_share` is how often a pose drawn from what
it knows then is within 10 mm and 5 degrees of the truth, which says what there is to be found by searching and
weighing, as far as measurements are believed. `told_share` is how often its own estimate is near; that it began at the
truth helps it. `sigma_mm` is the larger standard deviation of place, in the median. Five minutes on two cores.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from statistics import fmean, median

import numpy as np

from palpate import Tracker, TrackerSettings, load_recording
from palpate.geometry import se2
from palpate.geometry.shapes import Disc
from palpate.parallel import spread
from palpate.pipeline.knocks import knocked_frames
from palpate.pipeline.recovery import FAR_DEG, FAR_MM, is_far
from palpate.pipeline.truth import flag_runs

OUT = Path(__file__).parents[1] / "docs/study/after_shoves.json"
SIGMA = (0.02, 0.02, 0.26)
"""Of an object that was shoved by half a centimetre to four and up to half a radian [m, m, rad]."""
SECONDS = 2.0
DRAWS = 2000


def main() -> None:
    """Judge all recordings of a folder and write the shares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    files = [file for file in sorted(arguments.folder.glob("*.h5")) if not file.name.startswith("disc")]
    rows = [row for of_file in spread(after_shoves, files, 2) for row in of_file]
    found = {
        "recordings": len(files),
        "shoves": len(rows),
        "near_share": fmean(near for near, _, _ in rows),
        "told_share": fmean(is_near for _, is_near, _ in rows),
        "sigma_mm": median(sigma for _, _, sigma in rows),
    }
    arguments.out.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def after_shoves(file: Path) -> list[tuple[float, bool, float]]:
    """Return for each shove the share near, whether the estimate is, and the larger deviation of place [mm]."""
    recording = load_recording(file)
    truth = recording.object_pose
    assert truth is not None and recording.contact is not None and not isinstance(recording.shape, Disc)
    runs = flag_runs(knocked_frames(recording))
    ends = [*(first for first, _ in runs), len(recording)][1:]
    found = []
    for (_, last), until in zip(runs, ends, strict=True):
        frames = last + 1 + np.flatnonzero(recording.contact[last + 1 : until])
        needed = round(SECONDS * recording.sensor.rate)
        if len(frames) < needed:
            continue
        end = int(frames[needed - 1])
        settings = TrackerSettings(hypotheses=1)
        tracker = Tracker(recording.shape, recording.sensor, truth[last + 1], settings, first_pose_sigma=SIGMA)
        still = [recording[index] for index in np.flatnonzero(~recording.contact)[:15]]
        start = recording.time[last + 1]
        seen = [replace(one, time=start - (len(still) - k) / recording.sensor.rate) for k, one in enumerate(still)]
        away = se2.compose(recording[last + 1].sensor_pose, [-0.1, 0.0, 0.0])
        for one in seen:  # the untouched gel, as it was seen before
            tracker.update(replace(one, sensor_pose=away, contact=False))
        estimate = [tracker.update(recording[index]) for index in range(last + 1, end + 1)][-1]
        drawn = np.random.default_rng(0).multivariate_normal(np.zeros(3), estimate.covariance, DRAWS)
        far = is_far(1e3 * np.hypot(drawn[:, 0], drawn[:, 1]), np.degrees(drawn[:, 2]))
        off = se2.between(estimate.pose, truth[end])
        is_near = 1e3 * np.hypot(*off[:2]) <= FAR_MM and abs(np.degrees(off[2])) <= FAR_DEG
        sigma = 1e3 * np.sqrt(np.linalg.eigvalsh(estimate.covariance[:2, :2])[-1])
        found.append((1.0 - float(far.mean()), bool(is_near), float(sigma)))
    return found


if __name__ == "__main__":
    main()
