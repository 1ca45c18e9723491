"""Judge a shipped touch model on simulated recordings of other units: docs/study/[gelsight_mini/]touch_model.json.

    python scripts/measure_touch_model.py FOLDER

The folder is the `test` of scripts/train_digit_model.sh, or of that of the GelSight Mini, whose model has no corners.
`turns_over_constant_model` is the mean square error of the sine of the turn between two frames of a contact, over that
of the claim that nothing turns. At corners a turn is that of the normal off the bisector less that of the contact on
the tip, where the model finds the corner.
"""

import re
import sys
from pathlib import Path

import numpy as np
from _common import write
from numpy.typing import NDArray

from palpate.io import load_recording
from palpate.models.pushing.contact_geometry import HALF_RIGHT_ANGLE
from palpate.touch.touch_model import LEAST_CORNER_LOG_ODDS, shipped_model
from palpate_lab.simulate.unit import draw_unit
from palpate_lab.study.recordings import find_recordings
from palpate_lab.train.networks import TouchNetwork, restore
from palpate_lab.train.samples import KINDS, Samples, read_samples
from palpate_lab.train.scores import errors_of, judge

Array = NDArray[np.float64]


def main(folder: Path) -> None:
    """Measure and write."""
    files = list(find_recordings(folder).values())
    samples, sensor, _ = read_samples(files, workers=2)
    model = shipped_model(sensor.name)
    network = TouchNetwork(tuple(model.settings.spread))
    restore(network, model.network)
    errors = errors_of(network, samples)
    near = np.abs(samples.direction) < 0.4
    of_unit = [errors["direction"][0][near & (samples.recording == n)] for n in range(len(files))]
    found = {
        "frames": len(samples),
        "recordings": {"judged_by": len(files)},
        "honesty": judge(errors, model.settings.spread),
        "direction_offset_of_units_deg": float(np.degrees(np.median([abs(one.mean()) for one in of_unit if one.size]))),
    }
    if "corner" not in model.settings.spread:
        return write("gelsight_mini/touch_model", found)
    readings = [model.read(each) for each in samples.difference.astype(np.float32)]
    direction = np.array([reading["direction"] for reading in readings]).T
    turn = np.array([reading["turn"] for reading in readings]).T
    corner = np.array([reading["corner"] for reading in readings]).T
    units = [re.findall(r"unit (\d+)", load_recording(file).source)[0] for file in files]
    pitch = np.array([draw_unit(sensor, int(unit)).pitch for unit in units])[samples.recording]
    shown = pitch / (sensor.pixel_pitch or 1.0) * sensor.shown  # share of the pad that an image shows
    is_found = corner[3] > LEAST_CORNER_LOG_ODDS
    normal = corner[0] + corner[2] * (samples.cone - HALF_RIGHT_ANGLE)
    at_corner = normal - np.arcsin(np.clip(np.sin(direction[0]) * shown, -1.0, 1.0))
    found |= {
        "turns_over_constant_model": {
            kind: over_constant(samples, shown, at_corner if kind == "corner" else turn[0] * shown, of_kind)
            for number, kind in enumerate(KINDS)
            for of_kind in [(samples.kind == number) & (is_found | (kind != "corner"))]
        },
        "corners_found_share": float(is_found[np.isfinite(samples.corner)].mean()),
        "corners_found_elsewhere_share": float(is_found[np.isnan(samples.corner)].mean()),
    }
    return write("touch_model", found)


def over_constant(samples: Samples, shown: Array, told: Array, among: NDArray[np.bool_]) -> float:
    """Return the score of turns told (N,) [rad] among some samples; images show yaws larger by 1 / shown (N,)."""
    groups = [np.flatnonzero(among & (samples.episode == each)) for each in np.unique(samples.episode[among])]
    rng = np.random.default_rng(0)
    first, second = np.concatenate([rng.choice(each, (3 * len(each), 2)) for each in groups]).T
    true = np.sin(shown[first] * (samples.yaw[second] - samples.yaw[first]))
    return float(np.mean((np.sin(told[second] - told[first]) - true) ** 2) / np.mean(true**2))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
