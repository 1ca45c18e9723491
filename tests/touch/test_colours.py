"""Exchanged channels, and images that lie turned or mirrored, show in where an untouched gel has its colours."""

from itertools import permutations

import numpy as np

from palpate import Frame, Tracker
from palpate.geometry.shapes import Disc
from palpate.recording.sensor import DIGIT, GELSIGHT_MINI
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration
from palpate.touch.colours import sides, unusual_colours
from palpate.touch.model import SHIPPED, TouchModel
from palpate.touch.press_files import read_image

IN_A_TURN = list(permutations(range(3)))


def gel(*slopes: float) -> np.ndarray:
    """An image whose red, green and blue grow by these shares from the middle to the right."""
    x = np.linspace(-1.0, 1.0, 240)[:, None]
    row = 100.0 * (1.0 + np.array(slopes) * x)
    return np.rint(np.broadcast_to(row, (320, 240, 3))).astype(np.uint8)


USUAL = gel(-0.5, 0.4, 0.1)


def test_sides_are_the_slopes_of_the_shares():
    # The sum of the colours is the same all over, so that their shares have the slopes that they have.
    np.testing.assert_allclose(sides(gel(-0.55, 0.44, 0.11)) * 110.0, [-55.0, 44.0, 11.0], atol=0.5)
    np.testing.assert_allclose(sides(gel(0.5, 0.5, 0.5)), 0.0, atol=1e-9)  # light alone is no colour


def test_every_other_order_is_unusual_and_so_is_what_lies_the_other_way_round():
    assert unusual_colours(USUAL, DIGIT) == ""
    assert unusual_colours(USUAL[::-1], DIGIT) == ""  # upside down, as mirrored up and down
    for order in IN_A_TURN[1:]:
        assert unusual_colours(USUAL[..., order], DIGIT), order
    for turned in (USUAL[:, ::-1], np.rot90(USUAL, 2)):
        assert "green at the left and red at the right, and most units are red at the left" in unusual_colours(
            turned, DIGIT
        )
    assert "the gel is blue at the left and green at the right" in unusual_colours(USUAL[..., ::-1], DIGIT)


def test_nothing_is_said_where_nothing_can_be():
    for slopes in ((0.0, 0.0, 0.0), (0.03, -0.02, -0.01), (-0.4, 0.5, -0.42)):  # grey, faint, two alike
        assert unusual_colours(gel(*slopes), DIGIT) == ""
    assert unusual_colours(USUAL[..., ::-1], GELSIGHT_MINI) == ""  # whose lights nobody has told us


def test_real_gels_are_told_from_their_exchanged_selves(shared_data):
    files = sorted((shared_data / "digit_backgrounds").glob("*.jpg"))
    images = [read_image(file) for file in files]
    said = {order: sum(bool(unusual_colours(image[..., order], DIGIT)) for image in images) for order in IN_A_TURN}
    assert said.pop((0, 1, 2)) <= 1 and min(said.values()) >= len(images) - 1


def first_seen(image: np.ndarray, calibration: Calibration | None = None, model: TouchModel | None = None) -> str:
    """What a tracker says of touch after a first image."""
    tracker = Tracker(Disc(0.05), DIGIT, (0.2, 0.0, 0.0), calibration=calibration, model=model)
    for _ in range(2):
        tracker.update(Frame(0.0, np.zeros(3), image=image))
        tracker.reset()
    return tracker.tactile_reason


def test_a_tracker_says_it_once():
    swapped = USUAL[..., ::-1].copy()
    fits, unusual = "images fit the touch model of the DIGIT", unusual_colours(swapped, DIGIT)
    assert first_seen(USUAL) == fits
    assert first_seen(swapped) == f"{fits}, but {unusual}"


def test_a_tracker_asks_nothing_that_is_known():
    swapped = USUAL[..., ::-1].copy()
    background = Background(swapped.astype(np.float32), np.ones(swapped.shape, np.float32))
    pressed = Calibration(background, is_view_known=True)
    assert "but" in first_seen(swapped, calibration=Calibration(background))  # how images lie is not known from it
    assert "but" not in first_seen(swapped, calibration=pressed)
    assert "but" not in first_seen(swapped, model=TouchModel(SHIPPED))  # one of the user's own, learnt from his unit
