"""A recording from one's own arrays: every way of giving them, and what is refused in words."""

import io
import logging
from datetime import UTC, datetime, timedelta
from typing import Any

import cv2
import numpy as np
import planar as se2
import pytest
from PIL import Image
from recording_samples import TINY_CAMERA, encoded, tiny_images
from scipy.spatial.transform import Rotation

import palpate
from palpate import (
    POINT,
    Disc,
    FileError,
    Frame,
    FrameError,
    PalpateError,
    Recording,
    Tracker,
)

IMAGE_TIME = 0.02 + np.arange(20) / 30
POSE_TIME = np.arange(50) / 50


def true_pose(time: Any) -> Any:
    """Where the gel is at times (N,) [s]: it goes on evenly and turns through pi."""
    return np.column_stack([0.1 + 0.05 * time, -0.2 * time, se2.wrap(np.pi - 0.3 + 0.8 * time)])


def in_space(pose: Any, height: float = 0.25) -> Any:
    """Planar poses (N, 3) as matrices (N, 4, 4)."""
    matrices = np.tile(np.eye(4), (len(pose), 1, 1))
    matrices[:, :3, :3] = Rotation.from_euler("z", pose[:, 2:]).as_matrix()
    matrices[:, :3, 3] = np.column_stack([pose[:, :2], np.full(len(pose), height)])
    return matrices


def rows(matrices: Any) -> Any:
    """Matrices (N, 4, 4) as rows x, y, z, qx, qy, qz, qw."""
    return np.column_stack([matrices[:, :3, 3], Rotation.from_matrix(matrices[:, :3, :3]).as_quat()])


def made(**changes: Any) -> Any:
    """A recording from good arrays but for what is changed; untyped, since its optional fields are there."""
    fields: dict[str, Any] = {
        "image_time": IMAGE_TIME,
        "images": [encoded(image) for image in tiny_images(20)],
        "pose_time": POSE_TIME,
        "poses": true_pose(POSE_TIME),
        "shape": Disc(0.05),
        "sensor": TINY_CAMERA,
    }
    return Recording.from_arrays(**(fields | changes))


def same(found: Any, expected: Any, within: float = 1e-7) -> None:
    difference = found - expected
    difference[:, 2] = se2.wrap(difference[:, 2])
    assert difference == pytest.approx(0.0, abs=within)


def test_images_get_the_pose_at_their_time():
    recording = made()
    same(recording.sensor_pose, true_pose(IMAGE_TIME))
    assert recording.time == pytest.approx(IMAGE_TIME, abs=1e-9)
    assert all((frame.image == image).all() for frame, image in zip(recording, tiny_images(20), strict=True))
    assert made(images=(encoded(image) for image in tiny_images(20))).image == recording.image


@pytest.mark.parametrize("way", [in_space, lambda pose: rows(in_space(pose)), lambda pose: in_space(pose).tolist()])
def test_poses_in_space(way):
    recording = made(poses=way(true_pose(POSE_TIME)))
    same(recording.sensor_pose, true_pose(IMAGE_TIME))


class Tensor:
    """Poses as PyTorch has them where a gradient is computed."""

    def __init__(self, values: Any) -> None:
        self.values = values

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise RuntimeError("Can't call numpy() on Tensor that requires grad.")

    def detach(self) -> Any:
        return self.values


def test_tensors_with_a_gradient_are_arrays():
    poses = true_pose(POSE_TIME)
    given = {"poses": Tensor(poses), "object_poses": Tensor(poses), "images": map(Tensor, tiny_images(20))}
    same(made(**given).object_pose, true_pose(IMAGE_TIME))
    with pytest.raises(FileError, match=r"poses: is no array of NumPy, nor can it be made one .*requires grad"):
        made(poses=list(map(Tensor, poses)))
    tracker = Tracker(Disc(0.05), POINT, Tensor([0.1, 0.0, 0.0]))  # type: ignore[arg-type]
    tracker.update(Frame(0.0, Tensor([0.0, 0.0, 0.0]), contact=False))  # type: ignore[arg-type]
    with pytest.raises(FrameError, match="three finite numbers"):
        tracker.update(Frame(0.1, [Tensor(0.0)] * 3, contact=False))  # type: ignore[arg-type]


def test_quaternions_with_w_first_are_asked_about_in_a_frame():
    turned = in_space(np.array([[0.1, 0.0, 1.0]]))
    tracker = Tracker(Disc(0.05), POINT, None)
    tracker.update(Frame(0.0, rows(turned)[0], contact=False))
    with pytest.raises(FrameError, match=r"z axis up to \d+ degrees off .*: is w the last of each quaternion\?"):
        tracker.update(Frame(0.1, rows(turned)[0, [0, 1, 2, 6, 3, 4, 5]], contact=False))


def test_what_is_masked_is_unknown():
    lost = np.arange(50) % 25 == 5
    masked = np.ma.masked_array(true_pose(POSE_TIME), np.tile(lost[:, None], 3))
    masked.data[lost] = 9.0
    assert len(made(poses=masked)) == 18  # the 5th is at 0.1 s, between two images
    with pytest.raises(FrameError, match="sensor pose"):
        Tracker(Disc(0.05), POINT, None).update(Frame(0.0, np.ma.masked_array([0.1, 0.0, 0.0], True), contact=False))


@pytest.mark.parametrize("scale", [1e9, 1])
def test_times_in_nanoseconds_are_integers(scale):
    start = 1_700_000_000_000_000_000 if scale == 1e9 else 1.7e9
    kinds = ("i8", "M8[ns]") if scale == 1e9 else ("f8", "f8")
    times = [(start + each * scale).astype(kind) for each, kind in zip((IMAGE_TIME, POSE_TIME), kinds, strict=True)]
    same(made(image_time=times[0], pose_time=times[1]).sensor_pose, true_pose(IMAGE_TIME), within=1e-6)


def test_times_are_whole_numbers_as_objects():
    """As a table that holds words too gives its columns."""
    times = [(1_700_000_000_000_000_000 + each * 1e9).astype(int).astype(object) for each in (IMAGE_TIME, POSE_TIME)]
    same(made(image_time=times[0], pose_time=times[1]).sensor_pose, true_pose(IMAGE_TIME), within=1e-6)


def test_times_are_dates_or_durations_of_python():
    start = datetime(2026, 5, 1, 12, 0, tzinfo=UTC)
    in_seconds = made().sensor_pose
    for begin in (start, start.replace(tzinfo=None), timedelta()):
        times = [[begin + timedelta(seconds=float(time)) for time in each] for each in (IMAGE_TIME, POSE_TIME)]
        same(made(image_time=times[0], pose_time=times[1]).sensor_pose, in_seconds, within=1e-5)


def test_numbers_of_frames_are_no_seconds(caplog):
    made(image_time=np.arange(20.0), pose_time=np.arange(50.0))
    assert "image_time: times are whole seconds, one apart; are these numbers of frames?" in caplog.text


def test_the_gel_is_somewhere_on_the_hand():
    flat = se2.compose(true_pose(POSE_TIME), se2.inverse(np.array([0.03, 0.01, 0.4]))[None])
    found = made(image_time=POSE_TIME[:20], poses=flat, sensor_T_gel=[0.03, 0.01, 0.4])
    same(found.sensor_pose, true_pose(POSE_TIME[:20]))


def test_poses_are_unknown_in_long_gaps_of_a_motion():
    numbers = np.zeros((6, 7))
    numbers[:, 0] = 0.0, 0.011, 0.01, 0.02, 0.02, 0.03
    numbers[:, 5:] = np.array([[1], [1], [-1], [1], [1], [1]]) * (np.sin(0.1), np.cos(0.1))
    asked = np.array([0.05, 0.1, 0.15, 0.7, 1.2, 1.5, 1.8])
    found = made(
        image_time=asked, images=None, sensor=POINT, contact=np.zeros(7, bool),
        pose_time=[0.0, 0.1, 0.1, 0.2, 1.2, 1.8], poses=numbers,
    )  # fmt: skip
    # Of two poses at 0.1 s the last counts. Nothing moves up to 1.2 s, so that gap hides nothing; the next one does.
    assert found.time == pytest.approx(np.delete(asked, 5))
    assert found.sensor_pose[:, 0] == pytest.approx([0.005, 0.01, 0.015, 0.02, 0.02, 0.03])
    assert found.sensor_pose[:, 2] == pytest.approx(0.2)


def test_two_takes_are_not_sorted_into_one():
    other = true_pose(POSE_TIME) + np.array([0.1, 0.05, 0.3])
    for time in (POSE_TIME, POSE_TIME + 0.004, POSE_TIME[:20] + 0.002):
        with pytest.raises(FileError, match=r"pose_time: times go back once by .* s .*two takes"):
            made(pose_time=np.r_[POSE_TIME, time], poses=np.vstack([true_pose(POSE_TIME), other[: len(time)]]))


@pytest.mark.parametrize("value", [3600.0, np.nan, 0.0])
def test_one_wrong_time_costs_itself(value, caplog):
    poses = true_pose(POSE_TIME)
    wrong = POSE_TIME.copy()
    wrong[25] = value
    found = made(pose_time=wrong, poses=poses)
    same(found.sensor_pose, true_pose(found.time), within=1e-3)
    assert len(found) == 20 and "pose_time: 1 of 50 times" in caplog.text
    wrong = IMAGE_TIME.copy()
    wrong[10] = value
    found = made(image_time=wrong)
    assert found.time == pytest.approx(np.delete(IMAGE_TIME, 10), abs=1e-9)
    assert all(
        (frame.image == image).all() for frame, image in zip(found, np.delete(tiny_images(20), 10, 0), strict=True)
    )
    assert "image_time: 1 of 20 times" in caplog.text


def test_a_clock_that_is_set_forward_costs_itself(caplog):
    time = POSE_TIME[:34]  # as long as the images
    true = true_pose(time)
    set_forward = time + 3.7 * (np.arange(34) >= 15)
    found = made(pose_time=set_forward, poses=true, object_poses=true)
    same(found.sensor_pose, true_pose(IMAGE_TIME))
    same(found.object_pose, true_pose(IMAGE_TIME))
    assert "pose_time: nothing for 3.700 s from 0.280 s on" in found.warnings[0]
    found = made(image_time=IMAGE_TIME + 0.4 * (np.arange(20) >= 8), pose_time=time, poses=true)
    assert found.time == pytest.approx(IMAGE_TIME, abs=1e-7)
    assert "image_time: nothing for 0.400 s" in found.warnings[0]

    caplog.clear()  # a pause of one of them is no clock
    kept = np.r_[0:8, 14:20]
    images = [encoded(image) for image in tiny_images(20)]
    found = made(image_time=IMAGE_TIME[kept], images=[images[k] for k in kept], pose_time=time, poses=true)
    assert found.time == pytest.approx(IMAGE_TIME[kept], abs=1e-9)
    late = np.r_[time[:15], time[15:] + 0.4]  # of poses that are later than the images, too
    found = made(pose_time=late, poses=true_pose(late), image_time=np.r_[IMAGE_TIME[:-1], late[-1]])
    same(found.sensor_pose[-1:], true_pose(late[-1:]))
    assert not caplog.text


def changed(poses: Any, value: Any) -> Any:
    """Poses of which the 26th, at 0.5 s, has another value."""
    poses = np.array(poses, dtype=object if value is None else float)
    poses[25] = value
    return poses


@pytest.mark.parametrize("value", [None, 0.0, 1.0, 1e9])
@pytest.mark.parametrize("way", [np.asarray, in_space])
def test_one_wrong_pose_costs_itself(way, value):
    same(made(poses=changed(way(true_pose(POSE_TIME)), value)).sensor_pose, true_pose(np.delete(IMAGE_TIME, 14)))


def test_one_wrong_image_costs_itself(caplog):
    images = list(tiny_images(20))
    for wrong in (None, images[0][:9], images[0] / 255, images[0][..., 0]):
        caplog.clear()
        found = made(images=[wrong if index == 7 else image for index, image in enumerate(images)])
        assert [not each for each in found.image] == [index == 7 for index in range(20)]
        assert "images: 1 of 20 images are left out: image 7: " in caplog.text


def test_noise_is_no_second_sender():
    noise = np.random.default_rng(0).normal(scale=(0.004, 0.004, 0.05), size=(50, 3))
    assert len(made(object_poses=true_pose(POSE_TIME) + noise)) == 20


def test_images_that_are_stamped_late(caplog):
    recording = made(time_offset=-0.05)
    assert len(recording) == 19
    same(recording.sensor_pose, true_pose(IMAGE_TIME[1:] - 0.05))
    assert "1 of 20 images have no sensor pose at their time" in caplog.text
    assert (recording[0].image == tiny_images(20)[1]).all()


def test_images_come_in_any_form(tmp_path, caplog):
    pixels = tiny_images(20)
    data = [encoded(image) for image in pixels]
    files = [tmp_path / f"{index}.png" for index in range(20)]
    for file, each in zip(files, data, strict=True):
        file.write_bytes(each)
    messages = [np.frombuffer(each, np.uint8) for each in data]
    columns = [each[:, None] for each in messages]  # as some OpenCV encodes
    for images in (pixels, list(pixels), data, messages, columns, files, list(map(str, files))):
        found = [frame.image for frame in made(images=images, codec="png")]
        assert np.array_equal(found, pixels)
    even = np.full_like(pixels, 90) + np.arange(20, dtype=np.uint8)[:, None, None, None]
    for images in (even, list(even)):
        found = made(images=images)
        assert found.image[0].startswith(b"\xff\xd8")
        assert np.abs([frame.image - each.astype(int) for frame, each in zip(found, even, strict=True)]).max() < 3
    assert not caplog.text
    files[3].write_bytes(b"")
    assert [not each for each in made(images=files).image] == [index == 3 for index in range(20)]
    assert "1 of 20 images are left out: image 3: " in caplog.text
    data[::3] = [b""] * 7  # every third, the step at which images are checked
    assert [not each for each in made(images=data).image] == [index % 3 == 0 for index in range(20)]
    made(images=sorted(files, key=lambda file: int(file.stem)))
    assert "texts" not in caplog.text
    made(images=sorted(files))
    assert "images: the paths are sorted as texts, in which 10 comes before 2" in caplog.text
    big = np.repeat(np.repeat(pixels, 3, axis=1), 3, axis=2)
    turned = np.rot90(big, -1, (1, 2))
    for images, orientation in ((big, ""), (turned, "90")):
        found = made(images=[encoded(image) for image in images], orientation=orientation)
        assert all((frame.image == image).all() for frame, image in zip(found, pixels, strict=True))
    even[:, :6] = 200  # brighter above
    for image, array in zip(made(images=np.rot90(even, -1, (1, 2)), orientation="90"), even, strict=True):
        assert np.abs(image.image - array.astype(int)).mean() < 10
    upside_down = made(images=[encoded(image[::-1, ::-1, ::-1]) for image in pixels]).oriented("180,BGR")
    assert all((frame.image == image).all() for frame, image in zip(upside_down, pixels, strict=True))
    touched = np.arange(20) > 5
    blind = made(images=None, sensor=POINT, contact=touched)
    assert blind.image is None and blind.contact.tolist() == touched.tolist()


def test_encoded_images_are_scaled_as_arrays_are():
    big = np.repeat(np.repeat(tiny_images(20), 3, axis=1), 3, axis=2)
    stored = made(images=[encoded(image) for image in big]).image
    decoded = [np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)) for data in stored]
    assert {image.shape for image in decoded} == {(12, 8, 3)}


def test_a_dark_border_round_the_gel_is_told(caplog):
    gel = np.random.default_rng(0).normal(120, 2, (240, 320, 3)).clip(0, 255).astype(np.uint8)
    framed = np.full_like(gel, 10)
    framed[30:-30, 40:-40] = gel[30:-30, 40:-40]
    for image, is_told in ((gel, False), (framed, True)):
        made(images=[image] * 20, sensor="gelsight-mini", codec="png")
        assert ("dark border on all sides" in caplog.text) == is_told


def png_of(levels, kind):
    """A PNG (height, width, 3) as other programs write it: of 16 bits, or grey."""
    if kind.startswith("grey"):
        image = Image.fromarray((levels >> 8).astype(np.uint8)).convert("L" if kind == "grey" else "LA")
        target = io.BytesIO()
        image.save(target, "png")
        return target.getvalue()
    code, data = cv2.imencode(".png", levels)
    assert code
    return data.tobytes()


@pytest.mark.parametrize("shift", [0, 4, 6, 8])
def test_images_of_16_bits_that_hold_fewer_are_named(shift):
    levels = np.random.default_rng(0).normal(120, 9, (320, 240, 3)).clip(0, 255).astype(np.uint16) * 257 >> shift
    images = [png_of(levels, "rgb")] * 20
    if not shift:
        assert np.abs(made(images=images, sensor="digit")[0].image.astype(int) - (levels >> 8)[..., ::-1]).max() <= 1
        return
    with pytest.raises(FileError, match="has 16 bits, of which"):
        made(images=images, sensor="digit")


@pytest.mark.parametrize("kind", ["grey", "grey, alpha", "three channels"])
def test_grey_images_of_a_sensor_of_colours_are_told(kind, caplog):
    levels = np.random.default_rng(0).normal(120, 9, (320, 240, 1)).clip(0, 255).astype(np.uint8)
    grey = np.repeat(levels, 3, axis=2)
    image = grey if kind == "three channels" else png_of(grey.astype(np.uint16) * 257, kind)
    made(images=[image] * 20, sensor="digit")
    assert "red, green and blue are alike" in caplog.text


def test_ground_truth_has_times_and_holes_of_its_own():
    when = np.arange(0.0, 1.0, 0.1)
    truth = true_pose(when)
    truth[3] = np.nan
    found = made(object_poses=truth, object_time=when).object_pose
    known = (IMAGE_TIME < 0.2) | (IMAGE_TIME > 0.4)
    assert (np.isfinite(found).all(axis=1) == known).all()
    same(found[known], true_pose(IMAGE_TIME)[known])
    assert made(object_poses=in_space(true_pose(POSE_TIME), 0.02)).object_pose is not None


def test_a_tilted_plane(caplog):
    tilt = np.eye(4)
    tilt[:3, :3] = Rotation.from_euler("y", 0.1).as_matrix()
    poses = tilt @ in_space(true_pose(POSE_TIME), 0.0)
    assert not caplog.records
    same(made(poses=poses, plane=tuple(tilt[:3, 2])).sensor_pose, true_pose(IMAGE_TIME))
    made(poses=poses, off_plane=0.1)
    assert "tilted out of the plane by up to 5.7 degrees" in caplog.text
    with pytest.raises(FileError, match=r"off the plane .* allowed are 1 mm; off_plane .* allows more"):
        made(poses=poses, off_plane=0.001)
    curved = true_pose(POSE_TIME) + np.column_stack([0.2 * POSE_TIME**2, np.zeros((50, 2))])
    caplog.clear()
    found = made(poses=tilt @ in_space(curved, 0.0), plane="fit", image_time=POSE_TIME[:20])
    same(found.sensor_pose, curved[:20])
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert "the sensor moves in the plane of normal (0.09" in caplog.text


POSES = rows(in_space(true_pose(POSE_TIME)))
W_FIRST = rows(in_space(true_pose(POSE_TIME) + np.array([0.0, 0.0, 1.5])))[:, [0, 1, 2, 6, 3, 4, 5]]
MIRRORED = in_space(true_pose(POSE_TIME)) * np.array([1.0, -1.0, 1.0, 1.0])[:, None]
TURNED = [encoded(np.zeros((8, 12, 3), np.uint8), "jpeg")] * 20
LINE = np.linspace(0, 1, 50)[:, None] * np.array([1.0, 2.0, 0.0])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"image_time": IMAGE_TIME * 1e9}, "image_time: .*floats, which are seconds.*are these nanoseconds"),
        ({"pose_time": (POSE_TIME * 1e6).astype(int)}, "pose_time: .*integers, which are nano.*are these microseconds"),
        ({"pose_time": POSE_TIME + 1e6}, "sensor pose is known at the time of 0 of 20 images.* are both by one clock"),
        ({"image_time": (np.arange(20) / 15 * 1e6).astype(int)}, "image_time: .*are these microseconds"),
        ({"pose_time": np.float32(1e6 + POSE_TIME)}, "pose_time: .* as float32 has them, exact to 0.0625 s"),
        ({"pose_time": np.float32(1e6 + POSE_TIME).astype(float)}, "pose_time: .* as float32 has them"),
        ({"pose_time": (np.round(POSE_TIME * 1e9) + 2**63).astype(np.uint64)}, "pose_time: .* are nanoseconds"),
        ({"pose_time": np.round(POSE_TIME, 1)}, "pose_time: .*; were they rounded"),
        ({"image_time": IMAGE_TIME[::-1]}, "image_time: times go back always, .*a time after the one before"),
        ({"image_time": []}, "image_time: found no times"),
        ({"poses": true_pose(POSE_TIME) * [1e3, 1e3, 1]}, "poses: .*span 126.7 m.*are these millimetres"),
        ({"poses": true_pose(POSE_TIME) * [1, 1, 57]}, "poses: found angles up to 1[78].* rad: are these degrees"),
        ({"poses": W_FIRST}, "z axis up to .* off the plane.s normal, .*is w the last"),
        ({"poses": MIRRORED}, "poses: frame 0 .* allowed is a rotation.*left-handed"),
        ({"poses": in_space(true_pose(POSE_TIME)).transpose(0, 2, 1)}, "poses: frame 0 .*by columns"),
        ({"poses": in_space(true_pose(POSE_TIME)).reshape(50, 16)}, r"\(50, 16\), .*reshape\(-1, 4, 4\)"),
        ({"poses": list(map(str, range(50)))}, "poses: found text, expected numbers"),
        ({"image_time": np.ma.masked_less(np.arange(20), 2)}, "image_time: 2 of 20 values, int64, are masked"),
        ({"image_time": [{}] * 20}, "image_time: found values of type dict, expected numbers"),
        ({"images": {b"a", b"b"}}, "images: found a set, which has no order"),
        ({"poses": POSES * 2.0}, "poses: pose 0 .*a quaternion of length 1"),
        ({"poses": POSES[:, :6]}, r"poses: found shape \(50, 6\), expected \(N, 3\)"),
        ({"poses": POSES[:40]}, "poses: found 40 poses for 50 times"),
        ({"poses": np.full((50, 3), np.nan)}, "poses: none of 50 poses is known"),
        ({"images": tiny_images(19)}, "images: found 19 images for 20 times"),
        ({"images": tiny_images(20) / 255}, r"image 0: is float64 .* uint8 \(height, width, 3\)"),
        ({"images": ["gone.png"] * 20}, "gone.png: no such file"),
        (
            {"images": [cv2.imencode(".png", np.full((12, 8), 999, np.uint16))[1].tobytes()] * 20},
            "image 0: is grey in 16 bits",
        ),
        ({"images": [io.BytesIO(b"GIF89a")] * 20}, "images: image 0: pixels: is an open file, BytesIO; give what it"),
        ({"images": [b"GIF89a"] * 20}, "images: image 0: its 6 bytes do not decode as JPEG or PNG"),
        ({"codec": "gif", "images": tiny_images(20)}, "codec: found 'gif', allowed are 'jpeg' and 'png'"),
        ({"images": "images/"}, "images: found 'images/', expected N arrays"),
        ({"images": TURNED}, "image 0: found 8 rows and 12 columns.*lie on their side: orientation=.90"),
        ({"images": tiny_images(20)[:, :11]}, "image 0: found 11 rows and 8 columns, .* crop and scale"),
        ({"orientation": "sideways"}, "orientation is 'sideways'; allowed are, with commas, upright, 90"),
        ({"orientation": 90}, "image 0: found 12 rows and 8 columns, .* upright before they are turned by 90"),
        ({"images": None}, "images: found None, and no contact"),
        ({"time_offset": -50}, "is time_offset in seconds"),
        ({"shape": Disc(50.0)}, "the outline is 100 m wide, .*are these millimetres"),
        ({"sensor": "digits"}, "sensor is 'digits'; allowed are digit, gelsight-mini, point"),
        ({"sensor": POINT}, "images: found images, but the sensor 'point' has none"),
        ({"shape": "box.svg"}, "shape is 'box.svg'.*palpate.load_shape"),
        ({"plane": "flat"}, "plane is 'flat'; allowed are fit"),
        ({"plane": (0.0, 0.0, 0.0)}, "not all 0"),
        ({"plane": "fit", "poses": LINE}, "moves along a line, 0.0 mm across"),
        ({"off_plane": "a"}, "off_plane is 'a'; allowed is a length above 0"),
        ({"time_offset": np.nan}, "time_offset is nan; allowed are up to 1e.06 s"),
    ],
)
def test_what_does_not_fit_is_said(change, words):
    with pytest.raises(PalpateError, match=words):
        made(**change)


def test_images_that_were_squeezed_are_warned_of(caplog):
    seen = np.random.default_rng(0).normal(120.0, 3.0, (2, 240, 320, 3)).astype(np.uint8)  # on their side
    upright, squeezed = np.rot90(seen, axes=(1, 2)), [cv2.resize(each, (240, 320)) for each in seen]
    for images in (upright, squeezed):
        assert "lay on their side" not in caplog.text
        made(image_time=IMAGE_TIME[:2], images=images, sensor="DIGIT")
    assert "images seem to have been scaled to their size while they lay on their side" in caplog.text


class NamedColumns:
    """A table as pandas has it."""

    def __init__(self, columns: list[Any], values: Any) -> None:
        self.columns = columns
        self.values = values

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        return np.array(self.values, dtype)


def test_columns_of_a_table_are_in_the_order_of_a_pose():
    poses = true_pose(POSE_TIME)
    for columns in (["x", "y", "theta"], ["X", "y", "th"], [0, 1, 2], ["a", "b", "c"]):
        same(made(poses=NamedColumns(columns, poses)).sensor_pose, made().sensor_pose)
    for columns in (["theta", "x", "y"], ["y", "x", "theta"], ["x", "y", "theta_deg"]):
        with pytest.raises(FileError, match="columns"):
            made(poses=NamedColumns(columns, poses))


def test_halves_of_complex_numbers_and_flags_are_no_pose():
    tracker = Tracker(Disc(0.05), POINT, (0.0, 0.0, 0.0))
    for pose in (np.full(3, 0.1 + 0.2j), np.array([True, False, True])):
        with pytest.raises(FrameError, match="sensor pose"):
            tracker.update(Frame(0.0, pose, contact=False))


def test_a_path_is_no_recording_to_track():
    not_read: Any = "push.mcap"
    with pytest.raises(PalpateError, match="load_recording"):
        palpate.track(not_read)
