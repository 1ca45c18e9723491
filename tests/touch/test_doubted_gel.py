"""Calibrations that are of another unit, of a touched gel, or of images of another size."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import FrameError, SettingError
from palpate.geometry.objects import SHAPES
from palpate.lab.simulate.gel import ball_overlap, touch_image
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.touch.background import Background, background_of
from palpate.touch.calibration import Calibration, detector_for
from palpate.touch.camera_view import CameraView
from palpate.touch.contact_detector import ContactDetector
from palpate.tracker import Tracker
from palpate.types.frame import Frame
from palpate.types.sensor import DIGIT

FILE = Path("unit.npz")


@pytest.fixture(scope="module")
def units() -> list[SensorUnit]:
    return [draw_unit(DIGIT, seed) for seed in range(300, 305)]


def seen(unit: SensorUnit, depth: float, rng: np.random.Generator) -> np.ndarray:
    """What a camera sees of a ball of 4 mm radius pressed in by a depth [m]."""
    return touch_image(unit, ball_overlap(unit, 0.004, (0.002, -0.003), depth) if depth else None, rng=rng)


def known(unit: SensorUnit, rng: np.random.Generator, depth: float = 0.0) -> Calibration:
    """A calibration as if from a file: of the untouched gel, or of a press that lasted."""
    return Calibration(background_of([seen(unit, depth, rng) for _ in range(15)]), file=FILE)


def doubted_share(calibrations: list[Calibration], images: list[np.ndarray]) -> tuple[float, float]:
    """Share of the pairs of different units whose first image is refused, and of those that are at least doubted."""
    refused, doubted = [], []
    for number, calibration in enumerate(calibrations):
        for image in images[:number] + images[number + 1 :]:
            detector = detector_for(DIGIT, calibration)
            try:
                detector.update(detector.read(image))
            except SettingError as error:
                assert "that of unit.npz: was that another unit or a touched gel" in str(error)
                refused.append(True)
            else:
                refused.append(False)
            doubted.append("looks like the untouched gel of unit.npz" in detector.doubt)
    return float(np.mean(refused)), float(np.mean(doubted))


def test_nearly_all_other_units_are_refused_and_the_rest_doubted(units):
    rng = np.random.default_rng(0)
    refused, doubted = doubted_share([known(unit, rng) for unit in units], [seen(unit, 0.0, rng) for unit in units])
    assert refused > 0.9 and doubted == 1.0


def test_nearly_all_other_real_units_are_refused_and_the_rest_doubted(shared_data):
    import cv2

    files = sorted((shared_data / "digit_backgrounds").glob("*.jpg"))
    images = [np.ascontiguousarray(np.asarray(cv2.imread(str(file)), np.uint8)[..., ::-1]) for file in files]
    nothing = np.zeros((320, 240, 3), np.float32)
    stills = [Calibration(Background(image.astype(np.float32), nothing), file=FILE) for image in images]
    refused, doubted = doubted_share(stills, images)
    assert len(files) == 17 and refused > 0.95 and doubted == 1.0


def test_a_calibration_that_was_never_a_file_is_doubted_likewise(units, caplog):
    rng = np.random.default_rng(5)
    own, still = replace(known(units[0], rng), file=None), seen(units[0], 0.0, rng)
    with pytest.raises(SettingError, match=r"expected is that of the calibration: was that another unit or a touched"):
        detector_for(DIGIT, own).update(seen(units[1], 0.0, rng))
    detector, sure = detector_for(DIGIT, own), detector_for(DIGIT, replace(own, is_sure=True))
    with caplog.at_level(logging.WARNING):
        assert all(each.update(seen(units[0], 1e-3, rng)) for _ in range(20) for each in (detector, sure))
    assert [record.message for record in caplog.records] == [detector.doubt]
    assert detector.doubt.startswith("no image so far looks like the untouched gel of the calibration: unless")
    assert sure.doubt == ""  # of the same recording
    assert not detector.update(still) and detector.doubt == ""


def test_a_right_calibration_is_doubted_only_until_the_gel_is_seen_untouched(units):
    rng = np.random.default_rng(1)
    for unit in units:
        untouched, begun_in_contact = (detector_for(DIGIT, known(unit, rng)) for _ in range(2))
        assert not untouched.update(seen(unit, 0.0, rng)) and untouched.doubt == ""
        assert untouched.update(seen(unit, 1e-3, rng)) and untouched.doubt == ""
        for _ in range(5):
            assert begun_in_contact.update(seen(unit, 2e-3, rng)) and begun_in_contact.doubt
        assert not begun_in_contact.update(seen(unit, 0.0, rng)) and begun_in_contact.doubt == ""


def marked(share: float) -> np.ndarray:
    """A grey image of 60 x 60 px, a share of whose 30 x 30 cells is darker and brighter by turns."""
    cells = np.full(900, 100, np.uint8)
    off = np.random.default_rng(2).permutation(900)[: round(900 * share)]
    cells[off[::2]], cells[off[1::2]] = 50, 150
    return np.broadcast_to(cells.reshape(30, 30).repeat(2, axis=0).repeat(2, axis=1)[..., None], (60, 60, 3)).copy()


def test_what_a_touch_may_make_is_less_until_the_gel_of_a_file_was_seen():
    still = Background(marked(0.0).astype(np.float32), np.zeros((60, 60, 3), np.float32))
    from_file, from_here = ContactDetector(still, doubted="unit.npz"), ContactDetector(still)
    assert from_here.update(marked(0.7)) and from_here.doubt == ""
    with pytest.raises(SettingError, match="unlike the untouched gel"):
        from_file.update(marked(0.7))
    assert from_file.update(marked(0.5)) and from_file.doubt
    assert not from_file.update(marked(0.0))
    assert from_file.update(marked(0.7)) and from_file.doubt == ""


def pushed(images: list[np.ndarray]) -> list[Frame]:
    """Frames of a sensor that stands beside a disc."""
    return [Frame(k / 30, np.array([-0.1, 0.0, 0.0]), image) for k, image in enumerate(images)]


def test_the_gel_of_a_press_that_lasted_is_told_by_the_reason_and_a_warning(units, caplog):
    rng = np.random.default_rng(3)
    tracker = Tracker(SHAPES["disc"], DIGIT, np.zeros(3), calibration=known(units[0], rng, depth=1e-3))
    with caplog.at_level(logging.WARNING):
        found = [tracker.update(frame) for frame in pushed([seen(units[0], 0.0, rng) for _ in range(20)])]
    assert {"that was another unit or a touched gel" in estimate.reason for estimate in found} == {True}
    assert [record.message for record in caplog.records] == [found[0].reason]


def test_a_tracker_with_the_calibration_of_another_unit_names_its_file(units):
    rng = np.random.default_rng(4)
    tracker = Tracker(SHAPES["disc"], DIGIT, np.zeros(3), calibration=known(units[0], rng))
    with pytest.raises(FrameError, match=r"frame at 0\.000 s: image: .* expected is that of unit.npz"):
        tracker.update(pushed([seen(units[1], 0.0, rng)])[0])


@pytest.mark.parametrize(
    ("size", "view", "words"),
    [
        ((160, 120), CameraView(), "160 x 120 px; those of sensor 'DIGIT' have 320 x 240"),
        ((240, 320), CameraView(1), "240 x 320 px; those of sensor 'DIGIT', turned by 90 degrees as it says, have"),
    ],
)
def test_a_calibration_of_another_size_is_refused_before_any_image(size, view, words):
    level = np.full((*size, 3), 100.0, np.float32)
    with pytest.raises(SettingError, match=f"^unit.npz: is of images of {words}"):
        Tracker(SHAPES["disc"], DIGIT, np.zeros(3), calibration=Calibration(Background(level, level), view, file=FILE))
