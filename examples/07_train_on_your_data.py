"""Train a touch model on recordings of your own, and track with it.

They need images, contact flags and ground truth of the object, for it is from these that the model learns. A folder of
simulated ones will do for a try (needs the extras sim and train; the default number of steps takes an hour):

    palpate simulate recordings --count 10 --ideal
    python 07_train_on_your_data.py recordings my-model 100

`palpate train` does the same, and with `--from` goes on from a model to fit it to another unit.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import palpate
from palpate.pipeline.track import track
from palpate_lab.train.train import TrainSettings, train

recordings = sorted(Path(sys.argv[1]).glob("*.mcap"))
folder = Path(sys.argv[2])
steps = int(sys.argv[3]) if len(sys.argv) > 3 else None  # None: as many as the training is made for


@contextmanager
def progress(title: str, total: int) -> Iterator[Callable[..., None]]:
    """Say what is being done."""
    print(f"{title}, {total} to do")
    yield lambda done, note="": None


results = train(recordings, folder, TrainSettings(seed=0, steps=steps), progress)
for why in results["recordings"]["left_out"].values():
    print(f"left out: {why}")
for name, scores in results["scores"].items():
    print(f"{name}: {scores['median_deg']:.2f} degrees off in the median")

# A model is a folder of ONNX files and one JSON; it is for sensors like the one it has learned from.
model = palpate.TouchModel(folder)
recording = palpate.load_recording(recordings[-1])
run = track(recording, palpate.TrackerSettings(tactile="learnt"), model=model)
print(f"{recordings[-1].name}: final error {run.summary['final_translation_error_mm']:.1f} mm")
