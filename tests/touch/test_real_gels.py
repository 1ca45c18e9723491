"""Contact, camera view and readings on images of real sensors: untouched, pressed and gripping."""

import importlib
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from palpate import DIGIT, Background, Calibration, Disc, Frame, FrameError, Tracker, TrackerSettings

Array = np.ndarray
FIRST = 15  # frames of half a second
ROOT = Path(__file__).parents[2]
WITHIN = {"correlation": 0.002, "slope": 0.02, "offset_deg": 0.2, "rms_about_line_deg": 0.1, "pairs_rms_deg": 0.2}
"""Less than exchanged colours make of each; mirrored or upturned images turn the correlation's sign."""


def read(file: Path) -> Array:
    return np.ascontiguousarray(np.asarray(cv2.imread(str(file)), np.uint8)[..., ::-1])


def noisy(image: Array, rng: np.random.Generator) -> Array:
    return np.clip(np.rint(image + rng.normal(0.0, 2.0, image.shape)), 0, 255).astype(np.uint8)


def contacts(images: list[Array], calibration: Calibration | None = None) -> list[bool]:
    """Return contact at each image of a sensor that stands at a disc."""
    sensor = replace(DIGIT, image_height=images[0].shape[0], image_width=images[0].shape[1])
    how = TrackerSettings(tactile="none", hypotheses=1)
    tracker = Tracker(Disc(0.05), sensor, (0.05, 0.0, 0.0), how, calibration=calibration)
    frames = [Frame(k / 30.0, np.zeros(3), image=np.ascontiguousarray(image)) for k, image in enumerate(images)]
    return [tracker.update(frame).contact for frame in frames]


def refusal(image: Array, calibration: Calibration) -> str:
    try:
        contacts([image], calibration)
    except FrameError as error:
        return str(error)
    return ""


@pytest.fixture(scope="module")
def gels(shared_data) -> list[Array]:
    files = sorted((shared_data / "digit_backgrounds").glob("*.jpg"))
    assert len(files) == 17
    return [read(file) for file in files]


def known(image: Array) -> Calibration:
    return Calibration(Background(image.astype(np.float32), np.zeros((40, 30, 3), np.float32)), file=Path("unit.npz"))


def test_untouched_gels_give_no_alarm(gels):
    """Each with camera noise, JPEG at two qualities, flicker, and light that drifts, sideways by 10 %."""
    rng = np.random.default_rng(4)
    noise = rng.normal(size=4 * gels[0].size).astype(np.float32)
    for number, gel in enumerate(gels[::2]):
        levels, quality = (1.0, 2.0, 3.0)[number % 3], (95, 80)[number % 2]
        side = np.linspace(-0.1, 0.1, 240)[:, None] * rng.choice([-1.0, 1.0], 3)
        drift = 0.05 * rng.choice([-1.0, 1.0], 3)
        images = []
        for part in np.linspace(0.0, 1.0, 60):
            light = (1.0 + part * (drift + side) + rng.normal(0.0, 0.003)).astype(np.float32)
            start = int(rng.integers(3 * gel.size))
            image = np.clip(np.rint(gel * light + levels * noise[start : start + gel.size].reshape(gel.shape)), 0, 255)
            _, data = cv2.imencode(".jpg", image.astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])
            images.append(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8))
        assert not any(contacts(images)), number


def test_nearly_all_other_units_are_refused(gels):
    calibrations = [known(gel) for gel in gels]
    found = [
        refusal(gel, calibration)
        for number, calibration in enumerate(calibrations)
        for gel in gels[number + 1 :: 5] + gels[:number:5]
    ]
    assert np.mean(["that of unit.npz: was that another unit or a touched gel" in each for each in found]) > 0.9
    assert not any("lies otherwise" in each for each in found)  # another unit is not this one in another view


def test_every_press_on_a_marked_gel_is_felt(shared_data):
    folder = shared_data / "gelslim_presses"
    untouched, presses = read(folder / "no_contact.jpg"), sorted(folder.glob("press_*.jpg"))
    rng = np.random.default_rng(5)
    images = [noisy(untouched, rng) for _ in range(FIRST)]
    for press in presses:
        images += [noisy(untouched, rng), noisy(read(press), rng)]
    assert len(presses) == 12
    assert contacts(images) == [False] * FIRST + [False, True] * 12


@pytest.mark.parametrize("pair", ["02", "05", "07", "12"])
def test_a_grip_is_told_from_the_untouched_gel(shared_data, pair):
    untouched, gripped = (read(shared_data / f"digit_gripped/{pair}_{name}.png") for name in ("untouched", "gripped"))
    rng = np.random.default_rng(6)
    images = [noisy(untouched, rng) for _ in range(FIRST + 5)] + [noisy(gripped, rng) for _ in range(5)]
    assert contacts([*images, noisy(untouched, rng)]) == [False] * (FIRST + 5) + [True] * 5 + [False]


def test_real_presses_are_read_as_reported(shared_data, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "scripts")
    script = importlib.import_module("measure_real_gel")
    reported = json.loads((ROOT / "docs/study/real_gel.json").read_text())
    assert list(reported) == list(script.CASES)
    found = script.measured(shared_data / "digit_balls", "as it is", 0)
    for name, margin in WITHIN.items():
        assert found[name] == pytest.approx(reported["as it is"][name], abs=margin), name
    # A side that rolls would move the imprint as the presses do; a constant model is off by all of the change.
    assert found["turns_rms_deg"] < 0.25 * found["constant_pairs_rms_deg"]
    assert found["n"] == 20 and found["in_95_share"] > 0.85


def test_places_on_a_real_mini(shared_data, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "scripts")
    script = importlib.import_module("measure_real_gel")
    balls, edges = script.balls_on_mini(shared_data), script.edges_on_mini(shared_data)
    assert balls["median_mm"] < 0.7 and balls["in_95_share"] >= 0.85 and balls["slope"] == pytest.approx(1.0, abs=0.1)
    assert edges["worst_mm"] < 0.7 and edges["in_95_share"] == 1.0
