import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from live_samples import SIZE, TURNED, FakeTracker, poses_at, state, wait_for
from view_samples import CAMERA

from palpate.errors import SettingError
from palpate.geometry.shapes import Disc
from palpate.live import camera as camera_room
from palpate.live.camera import Camera, CameraTiming, V4l2Device, camera_path
from palpate.live.session import track_live
from palpate.live.setup import camera_set_up
from palpate.live.sources import Clock, Sources, TouchImage
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration
from palpate.touch.camera_view import CameraView

RATE = 200.0


class FakeCamera:
    """Stands for a camera and what it is plugged into: brightens up when opened, and can be lost."""

    def __init__(self, size: tuple[int, int] = SIZE, brightening: int = 20) -> None:
        self.size, self.brightening = size, brightening
        self.plugged, self.opened, self.closed = True, 0, 0
        self.count = 0

    def __call__(self, *_: Any) -> Any:
        if not self.plugged:
            raise SettingError("not there")
        self.opened += 1
        self.count = 0
        return self

    def grab(self) -> bool:
        time.sleep(1.0 / RATE)
        return self.plugged

    def image(self) -> Any:
        self.count += 1
        level = min(3 * self.count, 3 * self.brightening)
        return np.full((*self.size, 3), (level, level // 2, 10), np.uint8)

    def close(self) -> None:
        self.closed += 1


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(camera_room, "TIMING", CameraTiming(reopen_every=0.02))


def test_exposure_settles_before_the_first_image_and_the_rate_is_measured():
    fake = FakeCamera()
    camera = Camera(fake, Clock(0.0))
    assert fake.count == 20 + 14
    assert camera.size == SIZE
    assert 0.1 * RATE < camera.rate <= RATE
    stop = threading.Event()
    image = next(image for image in camera.images(stop) if isinstance(image, TouchImage))
    assert np.all(image.data == (60, 30, 10))
    assert fake.closed == 1


def test_exposure_that_never_settles_does_not_hold_it_up(monkeypatch):
    monkeypatch.setattr(camera_room, "TIMING", CameraTiming(longest_settling=0.1))
    fake = FakeCamera(brightening=80)
    Camera(fake, Clock(0.0)).close()
    assert 3 <= fake.count < 34


def test_a_camera_that_is_lost_five_times_is_opened_again_and_settles_again():
    fake, clock = FakeCamera(), Clock(0.0)
    camera = Camera(fake, clock)
    counts, said = state()
    tracker: Any = FakeTracker()
    stop = threading.Event()

    def plug() -> None:
        for times in range(1, 6):
            time.sleep(0.1)
            fake.plugged = False
            wait_for(lambda times=times: sum("is lost" in text for text in said) == times)
            time.sleep(0.3 if times == 1 else 0.05)
            fake.plugged = True
            wait_for(lambda times=times: sum("is back" in text for text in said) == times)
        time.sleep(0.1)
        stop.set()

    hand = threading.Thread(target=plug)
    hand.start()
    poses = poses_at(clock, clock.now() + np.arange(-10, 3000) / 100)
    track_live(tracker, Sources(camera.images, poses, clock, SIZE), counts, stop)
    hand.join()
    assert [text.split(" after")[0] for text in said if "camera" in text] == [
        "the camera is lost, and is opened again as soon as it is there",
        "the camera is back",
    ] * 5
    assert fake.opened == 6 == fake.closed
    assert len(tracker.frames) > 20
    assert all(np.all(frame.image == (60, 30, 10)) for frame in tracker.frames)  # settled each time
    assert np.diff([frame.time for frame in tracker.frames]).max() > 0.3
    assert counts.images == counts.tracked + counts.dropped + counts.without_pose


def test_damaged_images_are_passed_over(monkeypatch):
    fake = FakeCamera()
    camera = Camera(fake, Clock(0.0))
    whole = fake.image
    monkeypatch.setattr(fake, "image", lambda: whole() if fake.count % 3 else setattr(fake, "count", fake.count + 1))
    images = camera.images(threading.Event())
    assert all(isinstance(next(images), TouchImage) for _ in range(5))
    images.close()  # pyright: ignore[reportAttributeAccessIssue]


def test_a_camera_without_images_is_refused():
    fake = FakeCamera()
    fake.grab = lambda: False  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(SettingError, match="gives no images"):
        Camera(fake, Clock(0.0))
    assert fake.closed == 1


def set_up(monkeypatch: Any, fake: FakeCamera, calibration: Calibration | None = None, poses: str = "udp:47811") -> Any:
    monkeypatch.setattr("palpate.live.setup.camera_path", lambda name: Path("/dev/fake"))
    return camera_set_up("0", poses, Disc(0.05), [0.3, 0.0, 0.0], None, calibration, CAMERA, fake)


def test_images_lie_as_the_calibration_says(monkeypatch):
    background = Background(np.full((*SIZE, 3), 60, np.float32), np.ones((*SIZE, 3), np.float32))
    unit = Calibration(background, CameraView(1, True, (2, 1, 0)))
    fake = FakeCamera(size=TURNED)
    found = set_up(monkeypatch, fake, unit)
    assert (found.size, found.sensor.image_height, found.recorded_sensor.image_height) == (TURNED, 40, 30)
    assert 0.1 * RATE < found.sensor.rate <= RATE
    given = found.start()
    counts, _ = state()
    stop = threading.Event()
    stop.set()
    tracker: Any = FakeTracker()
    track_live(tracker, given, counts, stop)
    assert not tracker.frames and fake.closed == 1


def test_images_of_another_size_are_refused(monkeypatch):
    fake = FakeCamera(size=TURNED)
    with pytest.raises(SettingError, match="30 rows and 40 columns, expected 40 and 30; palpate calibrate --presses"):
        set_up(monkeypatch, fake)
    assert fake.closed == 1
    with pytest.raises(SettingError, match=r"have 99 rows and 40 columns, expected 40 and 30$"):
        set_up(monkeypatch, FakeCamera(size=(99, 40)))
    fake = FakeCamera()
    with pytest.raises(SettingError, match="'udp:x'; allowed are ports"):
        set_up(monkeypatch, fake, poses="udp:x")
    assert fake.closed == 1


def test_cameras_are_found_by_number_path_and_serial(tmp_path, monkeypatch):
    for name in ("usb-DIGIT_D20001-video-index0", "usb-DIGIT_D20001-video-index1", "usb-DIGIT_D20002-video-index0"):
        (tmp_path / name).touch()
    monkeypatch.setattr(camera_room, "BY_ID", tmp_path)
    assert camera_path("D20002") == tmp_path / "usb-DIGIT_D20002-video-index0"
    assert camera_path(str(tmp_path)) == tmp_path
    with pytest.raises(SettingError, match=r"'D2' fits 2 cameras; cameras are usb-DIGIT_D20001 \(.*D20002"):
        camera_path("D2")
    with pytest.raises(SettingError, match="'D3' is no number, path or serial of a camera; cameras are"):
        camera_path("D3")
    monkeypatch.setattr(camera_room, "BY_ID", tmp_path / "none")
    with pytest.raises(SettingError, match=r"/dev/video97: there is no such device; no camera is connected"):
        camera_path("97")


def test_opencv_is_asked_for_a_size_and_its_colours_are_turned(tmp_path, monkeypatch):
    import cv2

    asked: dict[int, Any] = {}
    blue_first = np.full((4, 2, 3), (1, 2, 3), np.uint8)
    capture = SimpleNamespace(
        isOpened=lambda: True,
        set=asked.__setitem__,
        grab=lambda: True,
        retrieve=lambda: (True, blue_first),
        release=lambda: asked.setdefault(-1, "closed"),
    )
    monkeypatch.setattr(cv2, "VideoCapture", lambda path, api: capture if api == cv2.CAP_V4L2 else None)
    path = tmp_path / "video0"
    path.touch()
    device = V4l2Device(path, (4, 2))
    assert (asked[cv2.CAP_PROP_FRAME_HEIGHT], asked[cv2.CAP_PROP_FRAME_WIDTH]) == (4, 2)
    assert device.grab()
    image = device.image()
    assert image is not None and image[0, 0].tolist() == [3, 2, 1]
    path.unlink()
    assert not device.grab()  # unplugged, though OpenCV reads on
    device.close()
    assert asked[-1] == "closed"
    capture.isOpened = lambda: False
    with pytest.raises(SettingError, match="cannot be opened: another program"):
        V4l2Device(path, (4, 2))
