"""What is learned from: samples of recordings, and their labels."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from training_samples import DISC, RECTANGLE, on_disc, on_left_side, recording

from palpate import DIGIT, Background, Calibration, Ellipse, FileError, Polygon, Shape, write_recording
from palpate.geometry import se2
from palpate.touch.calibration import CameraView, DirectionCorrection
from palpate.touch.touch_model import COLUMNS, ROWS
from palpate.types.images import encode_image
from palpate_lab.train.samples import KINDS, SHOWN, read_samples, samples_of

RADIUS = DIGIT.radius


def touched(g: Any, shape: Shape) -> Any:
    """The sample of one pose of the sensor: three frames untouched, then a contact of nine that stays where it is."""
    path = np.tile(np.reshape(g, (1, 3)), (12, 1))
    return samples_of(recording(path, np.arange(12) >= 3, shape))


# --- labels ---


@pytest.mark.parametrize(
    ("y", "kind"),
    # The corners are at 30 mm; edges begin 8 mm from them, and 1 mm is the corner itself.
    [(0.0, "edge"), (-0.0215, "edge"), (0.0225, "near-corner"), (-0.0285, "near-corner"), (0.0295, "corner")],
)
@pytest.mark.parametrize("theta", [0.0, 0.25])
def test_labels_on_a_side(y, kind, theta):
    found = touched(on_left_side(y, theta), RECTANGLE)
    np.testing.assert_array_equal(found.kind, KINDS.index(kind))
    np.testing.assert_allclose(found.yaw, theta, atol=1e-12)
    # Inwards is +x of the object, which a sensor turned by theta sees at -theta.
    np.testing.assert_allclose(found.direction, -theta, atol=2e-3)


@pytest.mark.parametrize("angle", [0.4, np.pi / 4, 1.2])
def test_labels_on_a_corner(angle):
    # The tip's centre lies its radius from the corner at (-0.05, 0.03), out to the left and up by `angle`.
    theta = 0.1
    center = np.array([-0.05, 0.03]) + RADIUS * np.array([-np.cos(angle), np.sin(angle)])
    found = touched([*(center + RADIUS * np.array([np.cos(theta), np.sin(theta)])), theta], RECTANGLE)
    np.testing.assert_array_equal(found.kind, KINDS.index("corner"))
    np.testing.assert_allclose(found.direction, -angle - theta, atol=0.02)  # back to it, to the right and down
    np.testing.assert_allclose(found.corner, np.pi / 4 - angle, atol=0.02)  # off the bisector, -45 degrees
    np.testing.assert_allclose(found.cone, np.pi / 4, atol=1e-12)


def test_the_angle_at_a_corner_is_left_out_beside_it():
    # The corner is at 30 mm: 0.1, 0.5 and 5 mm from it along the side.
    found = [touched(on_left_side(y, 0.0), RECTANGLE).corner for y in (0.0299, 0.0295, 0.025)]
    np.testing.assert_allclose(found[0], np.pi / 4, atol=0.02)
    assert np.isinf(found[1]).all() and np.isnan(found[2]).all()


@pytest.mark.parametrize(("angle", "tilt"), [(0.1, 0.0), (2.0, 0.3), (-3.0, -0.2)])
def test_labels_on_a_disc(angle, tilt):
    # Pushed from where it is at `angle`, straight when the sensor looks back, angle + pi.
    found = touched(on_disc(angle, se2.wrap(angle + np.pi + tilt)), DISC)
    np.testing.assert_array_equal(found.kind, KINDS.index("disc"))
    np.testing.assert_allclose(found.yaw, se2.wrap(angle + np.pi + tilt), atol=1e-12)
    np.testing.assert_allclose(found.direction, -tilt, atol=2e-3)


def ring(count: int) -> Polygon:
    angle = np.arange(count) * 2.0 * np.pi / count
    return Polygon(0.04 * np.stack([np.cos(angle), np.sin(angle)], axis=1))


@pytest.mark.parametrize(
    ("shape", "kind"),
    # At the corner (-0.04, 0) the outline of an octagon turns by 45 degrees, that of 16 sides by 22.5: it is all edge.
    [(Ellipse(0.08, 0.06), "ellipse"), (ring(8), "corner"), (ring(16), "edge")],
)
def test_kinds_of_other_shapes(shape, kind):
    np.testing.assert_array_equal(touched([-0.04, 0.0, 0.0], shape).kind, KINDS.index(kind))


def test_frames_and_contacts():
    contact = np.zeros(42, bool)
    # Of 10 frames 6 are left without the first and last two; of 8 only 4, too few; of 9 to the very end 5.
    contact[5:15] = contact[20:28] = contact[33:] = True
    found = samples_of(recording(on_left_side(np.zeros(42), 0.0), contact), number=7)
    assert found.episode.tolist() == [0] * 6 + [1] * 5
    np.testing.assert_array_equal(found.recording, 7)
    assert len(found) == 11


@pytest.mark.parametrize("shown", ["by images", "by truth and outline"])
def test_contacts_without_flags_are(shown):
    touched, path = np.arange(60) >= 30, on_left_side(np.zeros(60), 0.0)
    if shown == "by images":
        given = recording(path, touched)
    else:  # images that show nothing
        given = recording(np.where(touched[:, None], path, path - [0.01, 0.0, 0.0]), np.zeros(60))
    found = samples_of(dataclasses.replace(given, contact=None))
    assert found.episode.tolist() == [0] * 26
    np.testing.assert_allclose(found.direction, 0.0, atol=2e-3)


def test_a_gap_in_the_ground_truth_parts_a_contact():
    given = recording(on_left_side(np.zeros(30), 0.0), np.arange(30) >= 2)
    pose: Any = given.object_pose
    pose = np.where(np.arange(30)[:, None] == 16, np.nan, pose)
    found = samples_of(dataclasses.replace(given, object_pose=pose))
    assert found.episode.tolist() == [0] * 10 + [1] * 9


def test_differences_are_from_the_frames_without_contact():
    found = samples_of(recording(on_left_side(np.zeros(30), 0.0), np.arange(30) >= 10, where=np.full(30, 0.5)))
    assert found.difference.shape == (16, ROWS, COLUMNS, 3) and found.difference.dtype == np.float16
    seen = found.difference.astype(np.float32).mean(axis=(0, 3))
    row, column = np.unravel_index(seen.argmax(), seen.shape)
    # 60 levels in the middle, of which 32 make 1; at 0.5 * (1 + 0.8 * 0.5) = 0.7 of the width and half the height.
    assert seen.max() == pytest.approx(60 / 32, rel=0.1)
    assert abs(column - 0.7 * 128) <= 2 and abs(row - 16) <= 1
    assert abs(np.median(seen)) < 0.03


# --- what cannot be learned from ---


@pytest.mark.parametrize("missing", [["image"], ["object_pose"], ["image", "object_pose"]])
def test_a_recording_that_lacks_something(missing):
    given = recording(on_left_side(np.zeros(12), 0.0), np.arange(12) >= 3)
    with pytest.raises(FileError, match=f"the recording: has no {' and no '.join(missing)}; learning needs them"):
        samples_of(dataclasses.replace(given, **dict.fromkeys(missing)))
    with pytest.raises(FileError, match="has 1 frames without contact; learning needs 2 to compare with"):
        samples_of(dataclasses.replace(given, contact=np.arange(12) >= 1))


def test_a_recording_without_contact_has_no_samples():
    found = samples_of(recording(on_left_side(np.zeros(12), 0.0), np.zeros(12)))
    assert len(found) == 0 and found.difference.shape == (0, ROWS, COLUMNS, 3)


def write(folder: Any, **recordings: Any) -> list[Any]:
    for name, given in recordings.items():
        write_recording(given, folder / f"{name}.mcap")
    return [folder / f"{name}.mcap" for name in recordings]


def test_recordings_are_joined_in_order(tmp_path, monkeypatch):
    g, contact = on_left_side(np.zeros(40), 0.0), np.zeros(40)
    one, two = contact.copy(), contact.copy()
    one[5:20] = one[25:40] = two[10:30] = 1
    given = {"a": recording(g, one), "b": recording(g, contact), "c": recording(g, two), "d": recording(g, one)}
    bare = dataclasses.replace(given["a"], image=None)
    files, counted = write(tmp_path, **given, e=bare), []
    # As several processes may give them.
    monkeypatch.setattr("palpate_lab.train.samples.spread", lambda f, items, _: map(f, reversed(items)))
    found, sensor, failed = read_samples(files, progress=counted.append)
    assert sensor == given["a"].sensor
    assert counted == [1, 2, 3, 4, 5]
    assert failed == {files[4]: f"{files[4]}: has no image; learning needs them"}
    assert found.recording.tolist() == [0] * 22 + [2] * 16 + [3] * 22
    assert found.episode.tolist() == [0] * 11 + [1] * 11 + [2] * 16 + [3] * 11 + [4] * 11
    np.testing.assert_array_equal(found.difference[-22:], found.difference[:22])


def test_recordings_that_cannot_be_learned_from_together(tmp_path):
    given = recording(on_left_side(np.zeros(12), 0.0), np.arange(12) >= 3)
    other = dataclasses.replace(given, sensor=dataclasses.replace(given.sensor, name="other"))
    files = write(tmp_path, a=given, b=other, c=dataclasses.replace(given, image=None))
    with pytest.raises(FileError, match=r"b.mcap: sensor 'other' is not the 'small' of .*a.mcap; a model is of one"):
        read_samples(files)
    with pytest.raises(FileError, match=r"no recording can be learned from; the first: .*c.mcap: has no image"):
        read_samples(files[2:])


# --- a unit that is known ---


def test_images_of_a_unit_are_seen_as_its_calibration_says():
    plainly = recording(on_left_side(np.zeros(30), 0.1), np.arange(30) >= 10, where=np.full(30, 0.5))
    plain = samples_of(plainly)
    view = CameraView(quarter_turns=2, channels=(2, 1, 0))  # turned back by the same
    turned = tuple(encode_image(view.of(frame.image), "png") for frame in plainly if frame.image is not None)
    untouched = Background(np.full((64, 128, 3), 100.0, np.float32), np.ones((30, 60, 3), np.float32))
    unit = Calibration(untouched, view, DirectionCorrection(0.02, 0.9))
    found = samples_of(dataclasses.replace(plainly, image=turned), calibration=unit)
    assert np.array_equal(found.difference, plain.difference)
    assert np.allclose(found.direction, 0.02 + 0.9 * plain.direction)
    assert np.allclose(np.diff(found.yaw), 0.9 * np.diff(plain.yaw))


def test_turns_past_half_a_turn_are_seen_as_a_calibration_says():
    yaw = np.linspace(np.pi - 0.1, np.pi + 0.1, 20)
    given = recording(np.column_stack([np.full(20, -0.1), np.zeros(20), yaw]), np.arange(20) >= 3)
    levels = np.full((64, 128, 3), 100.0, np.float32)
    unit = Calibration(Background(levels, levels), direction=DirectionCorrection(0.0, 0.75))
    assert np.allclose(np.diff(samples_of(given, calibration=unit).yaw), 0.75 * 0.2 / 19)


def test_directions_are_those_that_a_recording_says_its_images_show():
    given = recording(on_left_side(np.zeros(30), 0.1), np.arange(30) >= 10, where=np.full(30, 0.5))
    shown = np.linspace(0.1, 0.2, 30)
    given = dataclasses.replace(given, extra={SHOWN: shown})
    found = samples_of(given)
    assert np.array_equal(found.direction, shown[12:28])
    levels = np.full((64, 128, 3), 100.0, np.float32)
    unit = Calibration(Background(levels, levels), direction=DirectionCorrection(0.02, 0.9))
    measured = samples_of(given, calibration=unit).direction  # what was measured of the unit counts for more
    assert np.allclose(measured, 0.02 + 0.9 * samples_of(dataclasses.replace(given, extra={})).direction)
    for wrong in (np.full(30, np.nan), np.ones((30, 2)), shown + 180.0):
        with pytest.raises(FileError, match=r"extra/shown_angle must be an angle \[rad\] in each frame of a contact"):
            samples_of(dataclasses.replace(given, extra={SHOWN: wrong}))


def test_turns_are_as_large_as_images_show_directions():
    theta = np.linspace(-0.1, 0.1, 30)
    given = recording(on_left_side(np.zeros(30), theta), np.arange(30) >= 10)
    shown = np.arcsin(1.2 * np.sin(-theta))
    found = samples_of(dataclasses.replace(given, extra={SHOWN: shown}))
    np.testing.assert_allclose(found.yaw, 1.2 * theta[12:28], atol=2e-3)


def test_without_untouched_frames_the_gel_is_that_of_the_calibration():
    given = recording(on_left_side(np.zeros(12), 0.0), np.ones(12), where=np.full(12, 0.5))
    levels = np.broadcast_to(np.array([90.0, 100.0, 110.0], np.float32), (64, 128, 3))
    found = samples_of(given, calibration=Calibration(Background(levels, np.ones_like(levels))))
    assert found.difference.astype(np.float32).mean(axis=(0, 3)).max() == pytest.approx(60 / 32, rel=0.1)


def test_a_calibration_of_other_images():
    given = recording(on_left_side(np.zeros(30), 0.0), np.arange(30) >= 10)
    levels = np.full((320, 240, 3), 100.0, np.float32)
    with pytest.raises(FileError, match="is of images of 320 x 240 px; those of sensor 'small' have 64 x 128"):
        samples_of(given, calibration=Calibration(Background(levels, levels)))
