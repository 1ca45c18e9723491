"""Explore objects of an unknown outline with images of a round tip and of a flat pad: docs/study/unknown_images.json.

    python scripts/measure_unknown_outline_images.py [COUNT]

COUNT simulated recordings (10 by default) of each sensor, 40 s of contacts from several sides, with images and with
errors of a set-up, by units that were drawn anew; the known outline beside the unknown one. First poses are true. One
core, half a minute a recording.
"""

import sys
from typing import Any

from _common import write
from measure_unknown_outline import FIRST_SIGMA, OBJECTS, outline_scores, pose_scores, summarised

import palpate
from palpate.geometry.named_shapes import SHAPES
from palpate_lab.parallel import quiet
from palpate_lab.simulate.paths import kinds
from palpate_lab.simulate.recordings import Simulation

SEED = 774800
SENSORS = (palpate.DIGIT, palpate.GELSIGHT_MINI)


def main(count: int) -> None:
    """Track all recordings, and write scores of each and of each sensor together."""
    found: list[dict[str, Any]] = []
    for number in range(count):
        for sensor in SENSORS:
            shape = SHAPES[OBJECTS[number % len(OBJECTS)]]
            with quiet():
                recording = Simulation(shape, kinds(shape)[0], SEED + number, seconds=40.0, sensor=sensor).run()
                unknown = estimated(recording, palpate.Unknown())
                known = estimated(recording, shape)
            scores = {
                "unknown": pose_scores(unknown, recording) | outline_scores(unknown, recording),
                "known": pose_scores(known, recording),
            }
            found.append({"sensor": sensor.name, "name": OBJECTS[number % len(OBJECTS)], **scores})
            print(found[-1], flush=True)
        of_sensor = {each.name: [one for one in found if one["sensor"] == each.name] for each in SENSORS}
        together = {name: summarised(of_this) for name, of_this in of_sensor.items()}
        write("unknown_images", {"seed": SEED, "planned": count, "together": together, "runs": found})


def estimated(recording: palpate.Recording, shape: Any) -> list[palpate.Estimate]:
    """Return the estimates, with touch and contact by the images."""
    first = recording.truth[0]
    tracker = palpate.Tracker(shape, recording.sensor, first, first_pose_sigma=FIRST_SIGMA)
    return [tracker.update(frame) for frame in recording]


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
