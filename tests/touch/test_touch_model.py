"""A touch model on disk and what makes measurements of it, with networks that need no training."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from training_samples import LINEAR, SPREAD, model_settings

from palpate.errors import EstimationError, FileError
from palpate.touch.background import Background
from palpate.touch.difference import COLUMNS, ROWS, difference, reduced
from palpate.touch.learnt import DifferenceInput, ImageTouch, PairTouch, linear_touch, pair_touch
from palpate.touch.model import NETWORKS, Look, Spread, TouchModel, fingerprint, write_model
from palpate.touch.relative import BACK, compared_frames
from palpate.types.frame import Frame
from palpate.types.measurements import ContactDirection, RelativePoses, Turn

BYTES = {name: name.encode() for name in NETWORKS}


@pytest.fixture
def folder(tmp_path):
    write_model(tmp_path, model_settings(), BYTES)
    return tmp_path


def rewrite(folder, **changes):
    file = folder / "model.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))


def test_what_is_written_is_read(folder):
    model = TouchModel(folder)
    assert model.networks == BYTES
    assert (model.settings.sensor, model.settings.image_height, model.settings.image_width) == ("small", 64, 128)
    assert dict(model.settings.spread) == SPREAD
    np.testing.assert_array_equal(model.settings.linear, LINEAR)
    assert TouchModel(str(folder)).settings.training == {"seed": 0}


@pytest.mark.parametrize("name", ["model.json", *(f"{name}.onnx" for name in NETWORKS)])
def test_a_file_that_is_missing_is_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(FileError, match=rf"{name}: no such file"):
        TouchModel(folder)


@pytest.mark.parametrize("name", NETWORKS)
def test_an_altered_network_is_found(folder, name):
    (folder / f"{name}.onnx").write_bytes(b"another")
    with pytest.raises(FileError, match=r"hash is \w{12}, model.json says \w{12}: altered"):
        TouchModel(folder)


def test_networks_in_each_others_place_are_found(folder):
    (folder / "touch.onnx").write_bytes(BYTES["pair"])
    (folder / "pair.onnx").write_bytes(BYTES["touch"])
    with pytest.raises(FileError, match="altered"):
        TouchModel(folder)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "palpate-recording"}, "format is 'palpate-recording', expected 'palpate-touch-model'"),
        ({"version": 3}, "version is 3, this palpate reads up to 2"),
        ({"version": "1"}, "version is '1'"),
        ({"hash": None}, "altered"),
        ({"settings": {"sensor": "small"}}, "altered"),
    ],
)
def test_altered_settings_are_found(folder, changes, message):
    rewrite(folder, **changes)
    with pytest.raises(FileError, match=message):
        TouchModel(folder)


def test_a_network_that_gives_another_number_of_numbers_is_named(folder):
    model = TouchModel(folder)
    sizes = {"touch": [(1, 2), (1, 2), (1, 4)], "pair": [(3, 2)], "keypoint": [(1, 2), (1, 5)]}

    def gives(name: str, *shapes: tuple[int, ...]) -> None:
        found = [np.zeros(shape, np.float32) for shape in shapes]
        model._opened[name] = SimpleNamespace(run=lambda *_: found)

    seen, several = np.zeros((ROWS, COLUMNS, 3), np.float32), np.zeros((3, 4), np.float32)
    asked: dict[str, Any] = {"touch": lambda: model.look(seen), "keypoint": lambda: model.keypoint(seen)}
    asked["pair"] = lambda: model.compare(several, several[0])
    for name, shapes in sizes.items():
        gives(name, *shapes)
        asked[name]()
        gives(name, (shapes[0][0], 1), *shapes[1:])
        with pytest.raises(FileError, match=rf"{name}\.onnx: gives \w+ of shape \(\d, 1\), expected \(\d, 2\)"):
            asked[name]()
        gives(name, *shapes[1:])
        with pytest.raises(FileError, match=rf"{name}\.onnx: cannot be run"):
            asked[name]()


def test_one_altered_number_is_found(folder):
    file = folder / "model.json"
    text = file.read_text()
    assert text.count('"scale": 0.01') == 1
    file.write_text(text.replace('"scale": 0.01', '"scale": 0.02'))
    with pytest.raises(FileError, match="altered"):
        TouchModel(folder)


def test_settings_of_another_version_of_palpate(folder):
    settings = {**vars(model_settings()), "spread": {}, "colour": "red"}
    write_model(folder, model_settings(), BYTES)
    plain = json.loads(json.dumps(settings))
    rewrite(folder, settings=plain, hash=fingerprint(plain, BYTES))
    with pytest.raises(FileError, match=r"settings do not fit this version .*colour"):
        TouchModel(folder)


def test_what_is_no_model(tmp_path):
    with pytest.raises(FileError, match=r"no such folder; a touch model is a folder with model\.json in it"):
        TouchModel(tmp_path / "nothing")
    (tmp_path / "model.json").write_text("[1]")
    with pytest.raises(FileError, match="found a JSON list"):
        TouchModel(tmp_path)


def test_linear_by_hand(folder):
    earlier, later = np.array([[0.1, 0.2], [0.3, -0.1]]), np.array([0.2, 0.1])
    kinds = np.array([[0.0, 0, 0, 0, 1], [0.5, 0.5, 0, 0, 0]])
    # Of corners (5, 6): 5 * 0.1 + 6 * -0.1 = -0.1. Half a disc (1, 0), half an ellipse (0, 2): 0.5 * -0.1 + 1 * 0.2.
    wanted = np.arcsin([-0.1, 0.15])
    np.testing.assert_allclose(TouchModel(folder).linear(earlier, later, kinds), wanted, atol=1e-12)
    # 5 * 0.8 is no sine: a quarter turn is the most that can be told.
    assert TouchModel(folder).linear(np.array([[0.0, 0]]), np.array([0.8, 0]), kinds[:1]) == pytest.approx(np.pi / 2)


def test_difference_by_hand():
    mean = reduced(np.full((320, 240, 3), (90.0, 100.0, 110.0), np.float32))
    assert mean.shape == (ROWS, COLUMNS, 3) and mean.dtype == np.float32
    image = np.full((320, 240, 3), (90, 100, 110), np.uint8)
    image[:160, :, 0] += 32  # in the upper half, red is 32 levels brighter, which makes 1
    found = difference(image, mean)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found[:16], np.broadcast_to((1.0, 0.0, 0.0), (16, 128, 3)), atol=1e-6)
    np.testing.assert_allclose(found[16:], 0.0, atol=1e-6)


def test_a_cell_is_the_mean_of_its_pixels():
    image = np.zeros((64, 256, 3), np.float32)
    image[0, 0], image[62:, 254:] = 8.0, 4.0  # one pixel of the four of the first cell, all of the last
    assert reduced(image)[0, 0] == pytest.approx(2.0)
    assert reduced(image)[-1, -1] == pytest.approx(4.0)


PATCH, SEEN = np.s_[30:32, 60:64], np.s_[15, 60:64]
"""Where levels differ in images, and where that is in their differences; all else is as the light is."""


class Gel:
    """Tells the background, which may change, and counts how often it is asked."""

    def __init__(self) -> None:
        self.level, self.asked = 100.0, 0

    def __call__(self) -> Background:
        self.asked += 1
        return Background(image_of(self.level).astype(np.float32), np.ones((64, 128, 3), np.float32))


def image_of(level: float) -> Any:
    image = np.full((64, 128, 3), 100.0)
    image[PATCH] = level
    return image


def frame(level: int) -> Frame:
    return Frame(0.5, np.zeros(3), image_of(level).astype(np.uint8))


def level_of(seen: Any) -> float:
    return 32.0 * float(seen[SEEN].mean())


def test_a_view_keeps_the_background_of_a_contact():
    gel = Gel()
    network_input = DifferenceInput(gel)
    assert gel.asked == 0  # nothing is known of it before the contact
    assert level_of(network_input.of(frame(110))) == pytest.approx(10.0, abs=0.01)
    gel.level = 105.0
    assert level_of(network_input.of(frame(110))) == pytest.approx(10.0, abs=0.01)
    network_input.forget()
    assert level_of(network_input.of(frame(110))) == pytest.approx(5.0, abs=0.01)
    assert gel.asked == 2
    with pytest.raises(EstimationError, match=r"frame at 0.500 s has no image"):
        network_input.of(Frame(0.5, np.zeros(3)))


def stand_in(**changes: Any) -> Any:
    """A model whose networks tell the level of an image, as yaw in hundredths."""
    spread = {"direction": Spread(2.0, 3.0), "turn": Spread(5.0, 1.5), "pair": Spread(1.0, 7.0)}
    spread["linear"] = Spread(0.01, 4.0)
    settings = model_settings(spread=spread)

    def look(seen: Any) -> Look:
        level = 0.01 * level_of(seen)
        return Look((-level, 0.1), (level, 0.2), np.array([level, 1.0], np.float32))

    def compare(earlier: Any, later: Any) -> Any:
        assert earlier.dtype == later.dtype == np.float32
        return (later[0] - earlier[:, 0]).astype(float), 0.01 * np.arange(1, len(earlier) + 1)

    def keypoint(seen: Any) -> Any:
        return np.array([0.01 * level_of(seen), 0.0]), np.array([1.0, 0, 0, 0, 0])

    linear = TouchModel.linear
    made = SimpleNamespace(settings=settings, look=look, compare=compare, keypoint=keypoint)
    made.linear = lambda *given: linear(made, *given)  # pyright: ignore[reportArgumentType]
    return made


def test_what_an_image_tells_is_believed_as_far_as_was_measured():
    gel = Gel()
    direction, turn = ImageTouch(stand_in(), DifferenceInput(gel)).measure(frame(110))
    assert isinstance(direction, ContactDirection) and isinstance(turn, Turn)
    assert direction.angle == pytest.approx(-0.1, abs=1e-4)
    assert direction.variance == pytest.approx(0.1 * 2.0 * 3.0)  # scale and together
    assert turn.angle == pytest.approx(0.1, abs=1e-4)
    assert turn.variance == pytest.approx(0.2 * 5.0 * 1.5)
    (only,) = ImageTouch(stand_in(), DifferenceInput(gel), turn=False).measure(frame(110))
    assert isinstance(only, ContactDirection)
    (only,) = ImageTouch(stand_in(), DifferenceInput(gel), direction=False).measure(frame(110))
    assert isinstance(only, Turn)


@pytest.mark.parametrize("make", [pair_touch, linear_touch])
def test_pairs_tell_the_turn_since_each_earlier_frame(make):
    gel = Gel()
    touch = make(stand_in(), DifferenceInput(gel))
    for age in range(60):
        said = touch.measure(frame(100 + age))
        back = compared_frames(age) if age <= BACK[-1] else BACK
        if not len(back):
            assert not said
            continue
        (relative,) = said
        assert isinstance(relative, RelativePoses)
        np.testing.assert_array_equal(relative.back, back)
        # The level rises by 1 a frame: yaw by 0.01, or the key point by as much, which of discs is the sine.
        wanted = 0.01 * back if make is pair_touch else np.arcsin(0.01 * back)
        np.testing.assert_allclose(relative.pose[:, 2], wanted, atol=2e-4)
        told = 0.07 * np.arange(1, len(back) + 1) if make is pair_touch else np.full(len(back), 0.04)
        np.testing.assert_allclose(relative.covariance[:, 2, 2], told, rtol=1e-6)
        assert (relative.covariance[:, [0, 1], [0, 1]] >= 1.0).all()  # nothing is told of x and y, a metre is nothing
        assert not relative.pose[:, :2].any()
    touch.end_contact()
    assert not touch.measure(frame(100))  # another contact
    assert gel.asked == 2


def test_pairs_are_asked_with_features_in_the_order_of_back():
    asked: list[Any] = []

    def compare(earlier: Any, later: Any) -> Any:
        asked.append((earlier.copy(), later.copy()))
        return np.zeros(len(earlier)), np.ones(len(earlier))

    touch = PairTouch(DifferenceInput(Gel()), lambda seen: np.array([level_of(seen)]), compare)
    for age in range(13):
        touch.measure(frame(100 + age))
    earlier, later = asked[-1]
    np.testing.assert_allclose(later, [12.0], atol=0.01)
    np.testing.assert_allclose(earlier[:, 0], 12.0 - compared_frames(12), atol=0.01)
