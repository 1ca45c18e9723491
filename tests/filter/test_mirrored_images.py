"""Images that lie turned by half a turn or mirrored: found by the side on which a known object is felt."""

from dataclasses import replace

import numpy as np
import pytest
from push_samples import contact_directions, frames, model_of, touching, with_settings
from tracker_samples import nees

from palpate.config import NoiseSettings
from palpate.filter.hypothesis_bank import Hypotheses
from palpate.filter.mirrored_images import MirroredImages, mirrored
from palpate.geometry import se2
from palpate.geometry.objects import SHAPES
from palpate.lab.simulate.limit_surface import Steering, push
from palpate.lab.simulate.recordings import simulate_recording
from palpate.touch.calibration import Calibration, calibrate
from palpate.touch.camera_view import CameraView
from palpate.tracker import Tracker
from palpate.types.frame import Frame
from palpate.types.measurements import ContactDirection, ContactPlace, ObjectPose, RelativePoses, Turn

Array = np.ndarray
NOISE = with_settings(NoiseSettings(), priors={"depth": (0.0, 4e-4)})
KNOWN = np.array([5e-4, 5e-4, 5e-3])
MODEL = model_of("rectangle")
DEGREE = np.radians(1.0)
SAID = (4.0 * DEGREE) ** 2  # [rad^2] as images say


def felt(angle: float, steps: int = 40) -> tuple[list[Frame], Array]:
    """Frames of a push against the left side, at first felt at this angle [rad], and all angles."""
    o, e = push(MODEL, np.zeros((1, 3)), touching(MODEL, np.array([0.01]), -angle), steps, Steering())
    return frames(o[:, 0], e[:, 0]), contact_directions(se2.between(o[:, 0], e[:, 0]), MODEL)


def estimator(first: Array | None = None) -> Hypotheses:
    return Hypotheses(MODEL, NOISE, "fixed-lag", np.zeros(3) if first is None else first, KNOWN, 9)


def followed(
    seen: list[Frame], angles: Array, mirrored_images: MirroredImages, first: Array | None = None
) -> tuple[Hypotheses, list[bool]]:
    """The estimator in the end, and whether images are taken to be turned, after each frame."""
    one, turned = estimator(first), []
    for frame, angle in zip(seen, angles, strict=True):
        told = [ContactDirection(float(angle), SAID)]
        one = mirrored_images.see(one, frame, told)
        one.touch(frame.sensor_pose, mirrored_images.believed(told), frame.time)
        turned.append(mirrored_images.is_turned)
    return one, turned


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_is_felt_on_the_wrong_side_is_mirrored_and_what_was_believed_is_taken_back(side):
    seen, angles = felt(side * 6.0 * DEGREE)
    assert angles[0] == pytest.approx(side * 6.0 * DEGREE, abs=1e-6)
    mirrored_images = MirroredImages(looks=True)
    found, turned = followed(seen, -angles, mirrored_images)
    # It is contradicted after five frames, and half a second more is waited for.
    assert turned.index(True) == 20 and turned[-1]
    assert "turned by half a turn or mirrored" in mirrored_images.reason
    assert "the outline may be mirrored or the first pose wrong" in mirrored_images.reason
    as_they_are, never = followed(seen, angles, MirroredImages(looks=True))
    assert not any(never)
    np.testing.assert_array_equal(found.path(), as_they_are.path())


@pytest.mark.parametrize("rate", [15.0, 60.0])
def test_half_a_second_is_waited_for_at_any_rate(rate):
    seen, angles = felt(6.0 * DEGREE, 60)
    seen = [replace(frame, time=k / rate) for k, frame in enumerate(seen)]
    _, turned = followed(seen, -angles, MirroredImages(looks=True))
    assert turned.index(True) == pytest.approx(5.0 + 0.5 * rate, abs=1.0)


def test_what_is_felt_in_the_middle_tells_nothing():
    seen, _ = felt(0.0)
    mirrored_images = MirroredImages(looks=True)
    assert not any(followed(seen, np.zeros(len(seen)), mirrored_images)[1]) and mirrored_images.reason == ""


def test_sides_that_were_right_are_no_longer_doubted():
    seen, angles = felt(6.0 * DEGREE)
    mirrored_images = MirroredImages(looks=True)
    followed(seen, angles, mirrored_images)
    assert not any(followed(seen, -angles, mirrored_images)[1])
    assert not any(followed(seen, -angles, MirroredImages(looks=False))[1])


@pytest.mark.parametrize("frame", [8, 12])
def test_where_both_are_contradicted_nothing_is_known(frame):
    # Something turns the object by 20 degrees in the midst of it.
    seen, angles = felt(6.0 * DEGREE)
    angles[frame:] += 20.0 * DEGREE
    mirrored_images = MirroredImages(looks=True)
    assert not any(followed(seen, -angles, mirrored_images)[1])
    assert not any(followed(seen, -felt(6.0 * DEGREE)[1], mirrored_images)[1])


def test_an_object_that_is_elsewhere_tells_nothing_of_images():
    # It is felt on the other side since it stands turned, which its gap tells as well.
    seen, angles = felt(6.0 * DEGREE)
    turned = se2.exp(np.array([0.0, 0.0, 16.0 * DEGREE]))
    assert abs(estimator(turned).gap(seen[0].sensor_pose)[0]) > 5e-3
    assert not any(followed(seen, angles, MirroredImages(looks=True), turned)[1])


def test_of_an_object_that_is_known_roughly_nothing_is_asked():
    seen, angles = felt(6.0 * DEGREE)
    rough = Hypotheses(MODEL, NOISE, "fixed-lag", np.zeros(3), np.array([0.02, 0.02, 0.5]), 9)
    mirrored_images = MirroredImages(looks=True)
    for frame, angle in zip(seen, angles, strict=True):
        told = [ContactDirection(-float(angle), SAID)]
        rough = mirrored_images.see(rough, frame, told)
        rough.touch(frame.sensor_pose, mirrored_images.believed(told), frame.time)
    assert not mirrored_images.is_turned


def test_with_several_answers_nothing_is_asked():
    seen, angles = felt(6.0 * DEGREE)
    rough = Hypotheses(MODEL, NOISE, "fixed-lag", np.zeros(3), np.array([0.02, 0.02, 0.5]), 9)
    for frame, angle in zip(seen[:3], angles, strict=False):
        rough.touch(frame.sensor_pose, [ContactDirection(float(angle), SAID)], frame.time)
    rough.end_contact()
    assert len(rough.answers) > 1
    mirrored_images = MirroredImages(looks=True)
    for frame, angle in zip(seen, angles, strict=True):
        told = [ContactDirection(-float(angle), SAID)]
        found = mirrored_images.see(rough, frame, told)
        found.touch(frame.sensor_pose, mirrored_images.believed(told), 10.0 + frame.time)
    assert not mirrored_images.is_turned


def test_what_is_told_of_an_image_that_lies_turned():
    assert mirrored(ContactDirection(0.1, 2.0)) == ContactDirection(-0.1, 2.0)
    assert mirrored(Turn(0.1, 2.0)) == Turn(-0.1, 2.0)
    assert mirrored(ContactPlace(0.1, 2.0)) == ContactPlace(-0.1, 2.0)
    pairs = mirrored(RelativePoses(np.array([10]), np.array([[1.0, 2.0, 0.3]]), np.eye(3)[None]))
    assert isinstance(pairs, RelativePoses)
    np.testing.assert_array_equal(pairs.pose, [[1.0, -2.0, -0.3]])
    seen = ObjectPose(np.ones(3), np.eye(3))
    assert mirrored(seen) is seen


VIEWS = [CameraView(2), CameraView(0, mirrored=True)]


@pytest.mark.parametrize("view", VIEWS, ids=str)
def test_a_stream_that_comes_turned_is_tracked_as_one_that_does_not(view):
    recording = simulate_recording(SHAPES["ellipse"], "ellipse", 72, 3.5, ideal=True)
    assert recording.object_pose is not None and recording.contact is not None
    first, last = recording.object_pose[[0, -1]]
    as_it_is, turned = (
        Tracker(
            recording.shape,
            recording.sensor,
            first,
        )
        for _ in range(2)
    )
    expected = [as_it_is.update(frame) for frame in recording]
    found = [turned.update(replace(frame, image=view.of(upright(frame)))) for frame in recording]
    touched = [one for one in found if one.contact]
    assert all("only with the images turned by half a turn or mirrored" in one.reason for one in touched[50:])
    assert not any(one.reason for one in expected)
    turned.reset(first)
    again = [turned.update(replace(frame, image=view.of(upright(frame)))) for frame in recording]
    assert all("only with the images turned" in one.reason for one in again if one.contact)
    ends = [se2.between(last, poses[-1].pose) for poses in (expected, found)]
    assert np.hypot(*ends[1][:2]) < 0.002 + np.hypot(*ends[0][:2])
    assert nees(found[-1:], last[None])[0] < 7.8


def upright(frame: Frame) -> Array:
    assert frame.image is not None
    return frame.image


def test_a_unit_that_was_calibrated_with_presses_is_not_doubted():
    recording = simulate_recording(SHAPES["ellipse"], "ellipse", 72, 3.5, ideal=True)
    assert recording.object_pose is not None
    unit = Calibration(calibrate(recording)[0], CameraView(2), is_view_known=True)
    tracker = Tracker(recording.shape, recording.sensor, recording.object_pose[0], calibration=unit)
    for frame in recording:
        assert "half a turn" not in tracker.update(replace(frame, image=CameraView(2).of(upright(frame)))).reason


class Scripted:
    """Stands for an estimator of which it is written when it is contradicted and when it has one sure answer."""

    in_contact = is_displaced = False
    is_sure, is_contradicted = True, False

    def __init__(self, other: "Scripted | None" = None) -> None:
        self._other = other

    def copied(self) -> "Scripted | None":
        return self._other

    def touch(self, *_: object) -> None:
        self.in_contact = True


def test_images_are_not_mirrored_while_what_is_mirrored_needs_several_answers():
    told = [ContactDirection(0.1, SAID)]
    other = Scripted()
    as_told, images = Scripted(other), MirroredImages(looks=True)

    def see(first: int, last: int) -> bool:
        for k in range(first, last):
            found = images.see(as_told, Frame(k / 30.0, np.zeros(3)), told)  # pyright: ignore[reportArgumentType]
            assert (found is other) == images.is_turned
            as_told.in_contact = True
        return images.is_turned

    assert not see(0, 5)
    as_told.is_contradicted, other.is_sure = True, False
    assert not see(5, 60)  # both are in doubt: something else is wrong
    other.is_sure = True
    assert see(60, 61)
