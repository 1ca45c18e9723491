"""Exchanged channels, and images that lie turned or mirrored, show in where an untouched gel has its colours."""

import json
from itertools import permutations

import numpy as np
import pytest

from palpate import Frame, Tracker
from palpate.cli.main import main
from palpate.geometry.shapes import Disc
from palpate.io.recording_mcap import write_recording
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration
from palpate.touch.camera_view import unusual_colours
from palpate.touch.model import SHIPPED, TouchModel
from palpate.touch.press_files import read_image
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT, GELSIGHT_MINI

IN_A_TURN = list(permutations(range(3)))


def gel(*slopes: float) -> np.ndarray:
    """An image whose red, green and blue grow by these shares from the middle to the right."""
    x = np.linspace(-1.0, 1.0, 240)[:, None]
    row = 100.0 * (1.0 + np.array(slopes) * x)
    return np.rint(np.broadcast_to(row, (320, 240, 3))).astype(np.uint8)


USUAL = gel(-0.5, 0.4, 0.1)
SWAPPED = np.ascontiguousarray(USUAL[..., ::-1])


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


def first_seen(image: np.ndarray, calibration: Calibration | None = None, model: TouchModel | None = None) -> Tracker:
    """A tracker that has seen an image."""
    tracker = Tracker(Disc(0.05), DIGIT, (0.2, 0.0, 0.0), calibration=calibration, model=model)
    assert tracker.unusual_colours == ""
    tracker.update(Frame(0.0, np.zeros(3), image=image))
    return tracker


def test_a_tracker_asks_at_the_first_frame(tmp_path):
    assert first_seen(USUAL).unusual_colours == ""
    tracker = first_seen(SWAPPED)
    asked = unusual_colours(SWAPPED, DIGIT)
    assert (tracker.unusual_colours, tracker.tactile_reason) == (asked, "images fit the touch model of the DIGIT")
    tracker.save(tmp_path / "tracker.npz")
    for going_on in (tracker, Tracker.load(tmp_path / "tracker.npz")):
        going_on.update(Frame(0.1, np.zeros(3), image=USUAL))
        assert going_on.unusual_colours == asked
    tracker.reset()
    tracker.update(Frame(0.0, np.zeros(3), image=USUAL))
    assert tracker.unusual_colours == ""


def test_a_tracker_asks_nothing_that_is_known():
    background = Background(SWAPPED.astype(np.float32), np.ones(SWAPPED.shape, np.float32))
    assert first_seen(SWAPPED, calibration=Calibration(background)).unusual_colours
    assert not first_seen(SWAPPED, calibration=Calibration(background, is_view_known=True)).unusual_colours
    assert not first_seen(SWAPPED, model=TouchModel(SHIPPED)).unusual_colours  # one of the user's own, for all we know


@pytest.mark.parametrize(("source", "asks"), [("a DIGIT", True), ("simulated by palpate: MuJoCo, disc", False)])
def test_track_asks_of_recordings_that_no_simulator_made(tmp_path, capsys, source, asks):
    count = 30
    recording = Recording(
        time=np.arange(count) / 30.0,
        sensor_pose=np.tile([-0.2, 0.0, 0.0], (count, 1)),
        shape=Disc(0.05),
        sensor=DIGIT,
        image=[encode_image(SWAPPED)] * count,
        source=source,
    )
    write_recording(recording, tmp_path / "push.mcap")
    words = ("track", str(tmp_path / "push.mcap"), "--first-pose", "0", "0", "0", "--out", str(tmp_path / "run"))
    assert main(words) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert (unusual_colours(SWAPPED, DIGIT) in said) == asks
    summary = json.loads((tmp_path / "run/summary.json").read_text())
    assert ("unusual_colours" in summary) == asks
