"""What learnt touch makes of a model, on a stand-in whose answers are known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from palpate.errors import EstimationError, SettingError
from palpate.touch.background import Background
from palpate.touch.calibration import DirectionCorrection
from palpate.touch.difference import COLUMNS, ROWS, difference, reduced
from palpate.touch.model import KINDS, Look, Spread, TouchModel
from palpate.touch.modes import make_touch
from palpate.touch.relative import BACK, compared_frames
from palpate.types.frame import Frame
from palpate.types.measurements import ContactDirection, RelativePoses, Turn
from palpate.types.sensor import DIGIT, GELSIGHT_MINI

BACKGROUND = Background(np.full((320, 240, 3), 100.0, np.float32), np.ones((320, 240, 3), np.float32))
SIGMAS = (1.0, 1.0, 0.1)


PATCH, SEEN = np.s_[150:160, 120:135], np.s_[15:16, 64:72]
"""Where images show a touch, and where it is in their differences."""


class StandIn:
    """A model that reads the level off a patch: 100 + k grey levels are k hundredths of everything."""

    settings = SimpleNamespace(
        sensor="DIGIT",
        image_height=320,
        image_width=240,
        spread={
            "direction": Spread(2.0, 3.0),
            "turn": Spread(0.5, 4.0),
            "pair": Spread(1.0, 30.0),
            "linear": Spread(0.01, 5.0),
        },
        linear=((0.5, 0.0), (2.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
    )
    linear = TouchModel.linear
    tells_turns = True

    @staticmethod
    def level(difference: Any) -> float:
        return 0.32 * float(difference[SEEN].mean())

    def look(self, difference: Any) -> Look:
        level = self.level(difference)
        return Look((level, 0.01), (2.0 * level, 0.02), np.array([level, 1.0], np.float32))

    def compare(self, earlier: Any, later: Any) -> tuple[Any, Any]:
        assert earlier.dtype == later.dtype == np.float32
        return (later - earlier)[:, 0].astype(float), np.full(len(earlier), 0.03)

    def keypoint(self, difference: Any) -> tuple[Any, Any]:
        return np.array([self.level(difference), 0.0]), np.eye(len(KINDS))[1]


def touch(mode: Any, background: Any = lambda: BACKGROUND) -> Any:
    model: Any = StandIn()
    return make_touch(mode, DIGIT, SIGMAS, SIGMAS, model, background)


def frame(k: int, light: float = 1.0) -> Frame:
    image = np.full((320, 240, 3), 100.0)
    image[PATCH] += k
    return Frame(k / 30, np.zeros(3), image=np.rint(light * image).astype(np.uint8))


def test_difference_is_of_reduced_images():
    image = np.zeros((320, 240, 3), np.uint8)
    image[:, 120:] = 64  # the right half
    found = difference(image, reduced(np.zeros((320, 240, 3), np.float32)))
    assert found.shape == (ROWS, COLUMNS, 3) and found.dtype == np.float32
    assert (found[:, : COLUMNS // 2] == 0.0).all() and (found[:, COLUMNS // 2 :] == 2.0).all()  # 64 / 32 levels


@pytest.mark.parametrize(
    ("mode", "kinds"),
    [
        ("learnt", [ContactDirection, Turn]),
        ("learnt-direction", [ContactDirection]),
        ("learnt-turn", [Turn]),
    ],
)
def test_images_tell_direction_and_turn(mode, kinds):
    said = {type(one): one for one in touch(mode).measure(frame(7))}
    assert list(said) == kinds
    if ContactDirection in kinds:
        assert said[ContactDirection].angle == pytest.approx(0.07, rel=1e-3)
        assert said[ContactDirection].variance == pytest.approx(0.01 * 2.0 * 3.0)
    if Turn in kinds:
        assert said[Turn].angle == pytest.approx(0.14, rel=1e-3)
        assert said[Turn].variance == pytest.approx(0.02 * 0.5 * 4.0)


def test_what_is_off_in_a_unit_is_corrected_in_directions_and_turns():
    model: Any = StandIn()
    unit = DirectionCorrection(offset=0.02, scale=0.8)
    images = make_touch("learnt", DIGIT, SIGMAS, SIGMAS, model, lambda: BACKGROUND, unit)
    direction, turn = images.measure(frame(10))
    assert isinstance(direction, ContactDirection) and isinstance(turn, Turn)
    assert direction.angle == pytest.approx((0.1 - 0.02) / 0.8, rel=1e-3)
    assert direction.variance == pytest.approx(0.01 * 2.0 * 3.0 / 0.8**2)
    assert turn.angle == pytest.approx(0.2 / 0.8, rel=1e-3)  # the contact's offset is an unknown
    assert turn.variance == pytest.approx(0.02 * 0.5 * 4.0 / 0.8**2)
    for mode in ("learnt-pairs", "learnt-linear"):
        plain, pairs = touch(mode), make_touch(mode, DIGIT, SIGMAS, SIGMAS, model, lambda: BACKGROUND, unit)
        for k in (0, 5):
            told, corrected = plain.measure(frame(k)), pairs.measure(frame(k))
        (told,), (corrected,) = told, corrected
        assert isinstance(told, RelativePoses) and isinstance(corrected, RelativePoses)
        np.testing.assert_allclose(corrected.pose, told.pose / 0.8)
        np.testing.assert_allclose(corrected.covariance[:, 2, 2], told.covariance[:, 2, 2] / 0.8**2)


@pytest.mark.parametrize(("mode", "variance"), [("learnt-pairs", 0.03 * 30.0), ("learnt-linear", 0.01 * 5.0)])
def test_pairs_tell_how_the_sensor_turned_since(mode, variance):
    # The ellipse's weight of the linear model is 2 and its sine is told; the stand-in's pairs tell the angle itself.
    told = (lambda back: np.arcsin(2.0 * 0.01 * back)) if mode == "learnt-linear" else (lambda back: 0.01 * back)
    pairs = touch(mode)
    assert not pairs.measure(frame(0))
    for k in range(1, 60):
        (found,) = pairs.measure(frame(k))
        assert found.back.tolist() == compared_frames(k).tolist()
        np.testing.assert_allclose(
            found.pose, np.column_stack([0 * found.back, 0 * found.back, told(found.back)]), atol=3e-4
        )
        np.testing.assert_allclose(
            found.covariance, np.broadcast_to(np.diag([1.0, 1.0, variance]), (len(found.back), 3, 3))
        )
    pairs.end_contact()
    assert not pairs.measure(frame(60))
    (found,) = pairs.measure(frame(61))
    assert found.back.tolist() == [1]
    assert BACK[0] > 1


def test_a_linear_turn_is_believed_as_the_settings_say():
    model: Any = StandIn()
    pairs = make_touch("learnt-linear", DIGIT, SIGMAS, SIGMAS, model, lambda: BACKGROUND, linear=1e-5)
    pairs.measure(frame(0))
    (found,) = pairs.measure(frame(1))
    assert isinstance(found, RelativePoses)
    assert found.covariance[0, 2, 2] == pytest.approx(1e-10)


def test_a_contact_keeps_the_background_it_began_with():
    known = BACKGROUND.mean.copy()
    images = touch("learnt-direction", lambda: Background(known, BACKGROUND.deviation))

    def angle() -> float:
        (direction,) = images.measure(frame(5))
        return direction.angle

    assert angle() == pytest.approx(0.05, rel=1e-3)
    known = BACKGROUND.mean.copy()
    known[PATCH] += 4.0
    assert angle() == pytest.approx(0.05, rel=1e-3)
    images.end_contact()
    assert angle() == pytest.approx(0.01, rel=1e-2)


@pytest.mark.parametrize("light", [0.6, 1.0, 1.4])
def test_light_that_changes_in_a_contact_is_told_from_what_is_untouched(light):
    images = touch("learnt-direction")
    images.measure(frame(20))
    (direction,) = images.measure(frame(20, light))
    assert direction.angle == pytest.approx(0.2 * light, rel=1e-2)


def test_linear_touch_mixes_kinds_as_likely_as_they_are():
    kinds = np.array([[0.5, 0.5, 0.0, 0.0, 0.0]])
    model: Any = StandIn()
    turned = TouchModel.linear(model, np.array([[0.1, 0.9]]), np.array([0.3, -0.9]), kinds)
    assert turned == pytest.approx(np.arcsin(0.2 * (0.5 * 0.5 + 0.5 * 2.0)))


def test_linear_touch_takes_the_kind_of_both_images(monkeypatch):
    # An untouched image is of the first kind, whose weight is 0.5, a touched one of the second, whose weight is 2.
    def keypoint(self: StandIn, difference: Any) -> Any:
        level = self.level(difference)
        return np.array([level, 0.0]), np.eye(len(KINDS))[int(level > 0.0)]

    monkeypatch.setattr(StandIn, "keypoint", keypoint)
    pairs = touch("learnt-linear")
    pairs.measure(frame(0))
    (found,) = pairs.measure(frame(10))
    assert found.pose[:, 2] == pytest.approx(np.arcsin(0.5 * (0.5 + 2.0) * 0.1), abs=1e-4)


def test_bad_input_is_named():
    with pytest.raises(EstimationError, match=r"frame at 0\.100 s has no image"):
        touch("learnt").measure(Frame(0.1, np.zeros(3)))
    model: Any = StandIn()
    with pytest.raises(SettingError, match="'GelSight Mini' has images of 240 x 320 px; the touch model is of 'DIGIT'"):
        make_touch("learnt", GELSIGHT_MINI, SIGMAS, SIGMAS, model, lambda: BACKGROUND)
