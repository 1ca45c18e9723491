"""What images of simulated recordings tell, on sensor units that no network has seen: docs/study/reading.json.

    palpate simulate FOLDER --count 9 --shape disc --shape ellipse ... --ideal
    python scripts/measure_reading.py FOLDER [--out docs/study/reading.json]

Contact is found in images and compared with what the simulator tells, by the F1 score of all frames; directions are
those of frames in contact, compared with where the contact shows (`extra/shown_angle`), after the offset of each unit.
Medians over the recordings of outlines that the DIGIT's model has learnt from and of others. A minute on two cores.
"""

import argparse
import json
from contextlib import closing
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from reported_numbers import SEEN

from palpate.io import load_recording
from palpate.lab.train.samples import SHOWN
from palpate.parallel import spread
from palpate.touch.detector import detector_for
from palpate.touch.difference import difference, reduced
from palpate.touch.model import shipped_model

OUT = Path(__file__).parents[1] / "docs/study/reading.json"


def main(folder: Path, out: Path) -> None:
    """Read all recordings and write."""
    with closing(spread(read, sorted(folder.glob("*.h5")), workers=2)) as results:
        found = list(results)
    both, false, missed = (sum(one[key] for one in found) for key in ("both", "false", "missed"))
    seen = [one["direction_deg"] for one in found if one["is_seen"]]
    unseen = [one["direction_deg"] for one in found if not one["is_seen"]]
    told = {
        "recordings": len(found),
        "frames_of_contact": both + missed,
        "false_frames": false,
        "missed_frames": missed,
        "contact_f1": 2.0 * both / (2.0 * both + false + missed),
        "seen_recordings": len(seen),
        "seen_direction_deg": median(seen),
        "unseen_direction_deg": median(unseen),
    }
    out.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(told, indent=2))


def read(file: Path) -> dict[str, Any]:
    """Return what images of one recording tell: frames of contact found, and how far directions are off [deg]."""
    recording = load_recording(file)
    assert recording.contact is not None
    model, detector = shipped_model(recording.sensor.name), detector_for(recording.sensor)
    touched, off = np.zeros(len(recording), np.bool_), []
    for number, (frame, shown) in enumerate(zip(recording, recording.extra[SHOWN], strict=True)):
        assert frame.image is not None
        touched[number] = detector.update(frame.image)
        if touched[number] and recording.contact[number]:
            background = detector.background
            assert background is not None
            look = model.look(difference(frame.image, reduced(background.mean)))
            off.append(look.direction[0] - shown)
    contact = np.asarray(recording.contact, np.bool_)
    counts = {"both": touched & contact, "false": touched & ~contact, "missed": ~touched & contact}
    return {
        "is_seen": file.stem.rsplit("-", 1)[0] in SEEN,
        "direction_deg": float(np.degrees(np.median(np.abs(np.array(off) - np.median(off))))),
        **{name: int(flags.sum()) for name, flags in counts.items()},
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    main(arguments.folder, arguments.out)
