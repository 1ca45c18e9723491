"""Draw a simulated push by two fingers for docs/guide/several_fingers.md: docs/pictures/several_fingers.png.

    python scripts/make_hand_picture.py

It is one picture of the video that `palpate track --video` writes, in the middle of the longest contact of both.
"""

from pathlib import Path

import numpy as np
from PIL import Image

from palpate.geometry.named_shapes import SHAPES
from palpate.pipeline.figures import own_style
from palpate.pipeline.metrics import flag_runs
from palpate.pipeline.track import track
from palpate.viewer.video import pictures
from palpate_lab.simulate.hand_recordings import HandSimulation

TARGET = Path(__file__).parents[1] / "docs" / "pictures" / "several_fingers.png"


def main() -> None:
    """Simulate, track and draw the push."""
    recording = HandSimulation(SHAPES["disc"], "disc", 300_000, 8.0).run()
    assert recording.contacts is not None
    run = track(recording)
    both = np.all(list(recording.contacts.values()), axis=0)
    first, last = max(flag_runs(both), key=lambda ends: ends[1] - ends[0])
    with own_style():
        (picture,) = pictures(run, [(first + last) // 2])
    Image.fromarray(picture).save(TARGET, optimize=True)


if __name__ == "__main__":
    main()
