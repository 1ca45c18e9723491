"""Presses on a ball or rod that stays somewhere: its place follows from where the sensor touched it."""

import dataclasses

import numpy as np
import pytest

from palpate.cli import main
from palpate.errors import FileError
from palpate.geometry import se2
from palpate.geometry.shapes import Disc
from palpate.io.recording_mcap import write_recording
from palpate.lab.simulate.gel import ball_overlap, touch_image
from palpate.lab.simulate.unit import draw_unit
from palpate.lab.train.presses_of import presses_of
from palpate.touch.calibration import load_calibration
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT

ANGLES = np.radians([-14.0, -9.0, -4.0, 1.0, 6.0, 13.0])
ALL_ROUND = np.radians([0.0, 65.0, 130.0, 180.0, -120.0, -50.0])
BALL, PLACE, DEPTH = Disc(0.006), np.array([0.31, -0.14]), 1.1e-3
UNIT = draw_unit(DIGIT, 6)


def pressed(yaw: np.ndarray, place: np.ndarray = PLACE, with_images: bool = False) -> Recording:
    """A recording of presses at ANGLES by a sensor turned by yaw, of a ball at place (2,) or one place for each."""
    rng = np.random.default_rng(0)
    apart = DIGIT.radius + BALL.radius - DEPTH
    # Seen from the sensor, whose origin is the tip's apex, the ball's centre lies at an angle about the tip's centre.
    seen = np.column_stack([apart * np.cos(ANGLES) - DIGIT.radius, apart * np.sin(ANGLES)])
    still = touch_image(UNIT, None, rng=rng)
    poses, images = [], []
    for angle, turn, ball, where in zip(ANGLES, yaw, seen, np.broadcast_to(place, (len(yaw), 2)), strict=True):
        touching = np.append(where - se2.rotation(turn) @ ball, turn)
        free = se2.compose(touching, [-0.05, 0.0, 0.0])
        overlap = ball_overlap(UNIT, BALL.radius, (UNIT.radius * np.sin(angle), 0.0), DEPTH) if with_images else None
        poses += [free] * 10 + [touching] * 9
        images += [still] * 10 + [touch_image(UNIT, overlap, rng=rng)] * 9
    count = len(poses)
    encoded = [encode_image(image) for image in images] if with_images else [encode_image(still)] * count
    flags = np.tile(np.arange(19) >= 10, len(yaw))
    return Recording(np.arange(count) / 30.0, np.array(poses), BALL, DIGIT, contact=flags, image=encoded)


def test_a_ball_is_found_where_it_was_touched():
    recording = pressed(ALL_ROUND)
    presses = presses_of(recording)
    np.testing.assert_allclose(presses.angle, ANGLES, atol=1e-3)
    assert presses.names[1] == "the recording: frame 33"
    there = np.tile([*PLACE, 0.0], (len(recording.time), 1))
    known = presses_of(dataclasses.replace(recording, object_pose=there))
    np.testing.assert_allclose(presses.angle, known.angle, atol=1e-3)


def test_presses_of_one_yaw_do_not_tell_where_a_ball_is():
    with pytest.raises(FileError, match=r"good to \d\.\d degrees, needed is 1; touch it from more sides, or state"):
        presses_of(pressed(np.zeros(6)))


def test_two_presses_do_not_tell_where_a_ball_is():
    recording = pressed(ALL_ROUND)
    flags = np.asarray(recording.contact) & (np.arange(len(recording.time)) < 38)
    with pytest.raises(FileError, match="the recording: has 2 contacts; three or more tell where a disc is"):
        presses_of(dataclasses.replace(recording, contact=flags))


def test_a_ball_that_moved_between_presses_is_noticed():
    place = PLACE + np.array([[0.0, 0.0]] * 3 + [[0.006, 0.0]] * 3)
    with pytest.raises(FileError, match=r"in touch with a disc of 6\.0 mm radius in one place .*; did it move\?"):
        presses_of(pressed(ALL_ROUND, place))


def test_the_command_calibrates_on_a_ball_whose_place_nobody_knows(tmp_path, capsys):
    file, out = tmp_path / "ball.mcap", tmp_path / "unit.npz"
    write_recording(pressed(ALL_ROUND, with_images=True), file)
    assert main.main(["calibrate", "--presses", str(file), "--out", str(out)]) == 0
    assert "6 presses: directions are off by" in capsys.readouterr().out
    assert load_calibration(out).view.keeps_left_and_right
