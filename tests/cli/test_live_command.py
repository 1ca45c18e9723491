"""`palpate live` on recordings, on a fake camera with poses by UDP, and when it is killed."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from bag_samples import decoded_by_another, push_messages, write_bag
from view_samples import FRAMES, imaged_push, imaged_push_of_hand, without_display

import palpate

REPLAY = ("live", "--tactile", "none", "--replay", "push.mcap")
OBJECT = ("--shape", "rectangle", "--first-pose", "0.3", "0.05", "0")
RUBBISH = [
    *(b"", b"\xff\xfe\x00", b"[" * 60000, b"[1, 2, 3]", b'{"position": [1, 2, 3]}', b'{"pose": [1, 2]}'),
    *(b'{"pose": "abc"}', b'{"pose": [1, 2, NaN]}', b'{"pose": [1, 2, 1e999]}', b'{"pose": [1, 2, null]}'),
    *(b'{"time": Infinity, "pose": [1, 2, 3]}', b'{"time": {}, "pose": [1, 2, 3]}'),
    b'{"time": 12.0, "pose": [1, 2, 3]}',
]


class FakeCapture:
    """Stands for OpenCV's camera: brightens up when opened, is touched after a while, and can be unplugged."""

    def __init__(self, size: tuple[int, int] = (320, 240), rate: float = 100.0) -> None:
        self.size, self.rate, self.corner = size, rate, 0
        self.is_plugged, self.opened, self.released, self.count = True, 0, 0, 0
        self.asked: dict[int, float] = {}
        self.touched_from = self.unplugged_from = np.inf  # [images], for a busy machine takes longer for them

    def __call__(self, path: str, api: int) -> "FakeCapture":
        self.opened += self.is_plugged
        self.count = 0
        return self

    def set(self, name: int, value: float) -> None:
        self.asked[name] = value

    def grab(self) -> bool:
        time.sleep(1.0 / self.rate)
        self.count += 1
        self.is_plugged &= self.count < self.unplugged_from
        return self.is_plugged

    def retrieve(self) -> tuple[bool, Any]:
        if self.count % 7 == 0:
            return False, None  # damaged
        image = np.full((*self.size, 3), (10, 30, min(6 * self.count, 60)), np.uint8)  # blue first
        image[:20, :20, 1] += self.corner
        if self.count > self.touched_from:
            image[100:200, 80:160] += 60
        return True, image

    def release(self) -> None:
        self.released += 1


def free_port() -> int:
    """A UDP port that nobody listens on."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


@contextmanager
def sending(packets: Callable[[int], bytes], port: int, every: float = 0.01) -> Iterator[None]:
    """Send the packets of numbers 0, 1, ... to a port while the block runs."""
    done = threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            number = 0
            while not done.wait(every):
                sender.sendto(packets(number), ("127.0.0.1", port))
                number += 1

    robot = threading.Thread(target=send)
    robot.start()
    try:
        yield
    finally:
        done.set()
        robot.join()


def pose_packet(pose: Any = (0.1, 0.05, 0.0)) -> bytes:
    return json.dumps({"time": time.time(), "pose": list(pose)}).encode()


def wait_for(is_so: Callable[[], bool]) -> None:
    last = time.monotonic() + 20.0
    while not is_so():
        assert time.monotonic() < last, "it never came to be"
        time.sleep(0.005)


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    """Every test works in a folder of its own that holds push.mcap at 60 Hz, and has no display."""
    without_display(tmp_path, monkeypatch)
    push = imaged_push()
    palpate.write_recording(replace(push, time=np.arange(FRAMES) / 60.0), "push.mcap")


@pytest.fixture
def camera(monkeypatch) -> FakeCapture:
    """A camera at the path ./video0."""
    fake = FakeCapture()
    Path("video0").symlink_to("/dev/null")  # a device, not a file
    monkeypatch.setattr("cv2.VideoCapture", fake)
    return fake


def camera_words(poses: str) -> tuple[str, ...]:
    return ("live", "--tactile", "none", "--camera", str(Path("video0").absolute()), "--poses", poses, *OBJECT)


def same_frames(name: str, count: int | None = None) -> None:
    """The recording is the push: all of it, or its beginning."""
    push, found = palpate.load_recording("push.mcap"), palpate.load_recording(name)
    assert len(found) == (count or len(found)) and push.image is not None and found.image is not None
    assert [*found.image] == [*push.image[: len(found)]]
    assert np.allclose(found.time, push.time[: len(found)], rtol=0.0, atol=1e-9)
    assert np.allclose(found.sensor_pose, push.sensor_pose[: len(found)], rtol=0.0, atol=1e-12)
    assert (found.shape, found.sensor) == (push.shape, push.sensor)


def test_a_replay_is_tracked_in_real_time_and_recorded(run_palpate):
    begin = time.monotonic()
    code, out, err = run_palpate(*REPLAY, "--record", "live.mcap", "--json")
    assert code == 0 and time.monotonic() - begin > (FRAMES - 1) / 60
    assert all("further ones are counted" in line for line in err.splitlines())  # by a machine that is very busy
    found = json.loads(out)
    assert (found["images"], found["sensor_poses"], found["refused_poses"]) == (FRAMES, FRAMES, 0)
    assert found["tracked"] + found["dropped"] + found["without_pose"] + found["left_out"] == FRAMES
    assert found["tracked"] > FRAMES // 2
    assert found["rate_hz"] == pytest.approx(60.0)
    assert 0.0 < found["latency_ms"]["p50"] <= found["latency_ms"]["p99"] <= found["latency_ms"]["max"]
    same_frames("live.mcap", FRAMES)
    topics = decoded_by_another(Path("live.mcap"))
    poses, diagnoses = topics["/palpate/object_pose"], topics["/palpate/diagnostics"]
    assert len(poses) == len(diagnoses) == found["tracked"] and len(topics["/sensor/pose"]) == FRAMES
    values = [{each.key: each.value for each in one.status[0].values} for _, one in diagnoses]
    assert all("reason" in one for one in values)
    assert {one.status[0].message for _, one in diagnoses} == set(found["statuses"])
    code, out, _ = run_palpate("track", "live.mcap", "--first-pose", "0.3", "0.05", "0", "--json")
    assert code == 0 and json.loads(out)["frames"] == FRAMES


def test_a_machine_that_is_too_slow_is_told_of(run_palpate, monkeypatch):
    in_time = palpate.Tracker.update
    hint = "palpate track push.mcap"
    monkeypatch.setattr("palpate.cli.track.own_command", lambda: "palpate")

    def late(*words: Any) -> Any:
        time.sleep(0.1)
        return in_time(*words)

    monkeypatch.setattr(palpate.Tracker, "update", late)
    assert hint in run_palpate(*REPLAY)[1]


def test_a_bag_is_replayed(run_palpate, fails):
    write_bag(Path("bag.mcap"), "mcap", push_messages())
    words = ("live", "--tactile", "none", "--replay", "bag.mcap")
    code, out, _ = run_palpate(*words, "--shape", "disc", "--first-pose-unknown", "--seconds", "0.4")
    assert code == 0 and "latency" in out and "without_pose" in out
    assert "--first-pose X Y THETA" in fails(*words, "--shape", "disc")
    assert "needs --shape" in fails(*words)


def test_ctrl_c_ends_it_and_the_file_is_whole(run_palpate):
    palpate.write_recording(replace(imaged_push(), time=np.arange(FRAMES) / 2.0), "push.mcap", overwrite=True)
    before = signal.getsignal(signal.SIGINT)
    timer = threading.Timer(1.5, os.kill, [os.getpid(), signal.SIGINT])
    timer.start()
    code, out, _ = run_palpate(*REPLAY, "--record", "live.mcap", "--json")
    timer.join()
    assert code == 0 and signal.getsignal(signal.SIGINT) is before
    found = json.loads(out)
    assert 1 <= found["images"] <= 4
    same_frames("live.mcap", found["images"])


def test_a_kill_loses_at_most_the_last_second(caplog):
    palpate.write_recording(replace(imaged_push(), time=np.arange(FRAMES) / 8.0), "push.mcap", overwrite=True)
    words = (*REPLAY, "--record", "live.mcap")
    process = subprocess.Popen([sys.executable, "-m", "palpate", *words], stderr=subprocess.DEVNULL)
    wait_for(lambda: Path("live.mcap").exists() and Path("live.mcap").stat().st_size > 0)  # images come
    time.sleep(2.0)
    process.kill()
    process.wait()
    same_frames("live.mcap")
    assert palpate.load_recording("live.mcap").time[-1] > 1.0 - 0.3  # a busy machine begins a little later
    assert "is cut off or damaged" in caplog.text


def test_a_replay_that_cannot_be_tracked(fails):
    palpate.write_recording(replace(imaged_push(), image=None), "blind.mcap")
    Path("there.mcap").write_text("mine")
    assert "oracle needs ground truth" in fails(*REPLAY, "--tactile", "oracle")
    assert "--seconds is 0" in fails(*REPLAY, "--seconds", "0")
    assert "there.mcap: already exists" in fails(*REPLAY, "--record", "there.mcap")
    assert "folder nowhere does not exist" in fails(*REPLAY, "--record", "nowhere/a.mcap")
    assert "has no images" in fails("live", "--replay", "blind.mcap", "--record", "new.mcap")
    assert "gone.mcap: no such file" in fails("live", "--replay", "gone.mcap")
    assert not Path("new.mcap").exists()


def test_a_camera_with_poses_by_udp(camera, run_palpate, fails):
    """Rubbish among the poses is refused; the recording of the session is a recording."""
    port = free_port()
    words = camera_words(f"udp:{port}")
    camera.touched_from, camera.unplugged_from = 150, 400
    with sending(lambda n: pose_packet() if n % 5 else RUBBISH[n // 5 % len(RUBBISH)], port):
        assert "folder nowhere does not exist" in fails(*words, "--record", "nowhere/live.mcap")
        assert camera.released == camera.opened == 0
        code, out, err = run_palpate(*words, "--record", "live.mcap", "--json")
    assert code == 0 and camera.released == camera.opened == 1
    found = json.loads(out)
    assert "a sensor pose is refused: " in err and all(len(line) < 400 for line in err.splitlines())
    assert found["tracked"] > 20 and found["refused_poses"] > len(RUBBISH)
    assert 5.0 < found["rate_hz"] < 110.0  # the camera's 100; a busy machine grabs fewer
    assert sorted(camera.asked.values()) == [1, 240, 320]
    recorded = palpate.load_recording("live.mcap")
    assert len(recorded) > 20 and recorded.sensor.image_height == 320
    assert np.allclose(recorded.sensor_pose, [0.1, 0.05, 0.0])
    assert abs(recorded.time[-1] - time.time()) < 30.0
    data = next(filter(None, recorded.image or ()))  # others are damaged
    image: Any = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
    assert np.abs(image[0, 0].astype(int) - (60, 30, 10)).max() < 6  # settled, and red first


def test_poses_are_lost_and_come_back_and_a_lost_camera_ends_it(camera, run_palpate):
    port, camera.unplugged_from = free_port(), 400
    with sending(lambda n: b"stalled" if 200 < camera.count < 240 else pose_packet(), port):
        code, out, err = run_palpate(*camera_words(f"udp:{port}"), "--record", "live.mcap", "--json")
    found = json.loads(out)
    assert code == 0 and camera.opened == camera.released == 1
    for words in ("camera is lost", "without a sensor pose: the last one before it"):
        assert err.count(words) == 1
    assert found["without_pose"] > 0 and len(palpate.load_recording("live.mcap")) > 20
    assert found["images"] == found["tracked"] + found["dropped"] + found["without_pose"] + found["left_out"]


@pytest.mark.parametrize(("size", "orientation"), [((240, 320), ""), ((480, 640), ""), ((480, 640), "270")])
def test_images_as_a_digit_gives_them_are_turned_scaled_and_late(size, orientation, camera, run_palpate):
    """Landscape, where digit-interface turns them counter-clockwise, and 0.2 s late; poses are those of a flange."""
    camera.size, camera.corner, camera.unplugged_from, port = size, 100, 250, free_port()
    words = (*camera_words(f"udp:{port}"), "--record", "live.mcap", "--time-offset", "-0.2")
    words += ("--orientation", orientation) if orientation else ()
    words += ("--sensor-T-gel", *map(str, (0.1, 0.05, 0.1, 1.0, 0.0, 0.0, 0.0)))
    start = time.time()
    with sending(lambda n: pose_packet((0.01 * (time.time() - start), 0.1, 0.2, 1.0, 0.0, 0.0, 0.0)), port):
        code, out, _ = run_palpate(*words, "--json")
    found = json.loads(out)
    assert code == 0 and found["tracked"] > 10 and found["latency_ms"]["p50"] > 200.0
    recorded = palpate.load_recording("live.mcap")
    data = next(filter(None, recorded.image or ()))  # others are damaged
    image: Any = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
    assert image.shape == (320, 240, 3)
    corners = [image[row, column, 1] for row, column in ((5, 5), (5, -5), (-5, 5), (-5, -5))]
    assert int(np.argmax(corners)) == (1 if orientation else 2) and max(corners) > 90  # the camera's top left corner
    assert np.allclose(recorded.sensor_pose[:, 0], 0.1 + 0.01 * (recorded.time - start), atol=1e-4)
    assert np.allclose(recorded.sensor_pose[:, 1:], (0.05, 0.0))


@pytest.mark.parametrize("kind", ["folder", "video"])
def test_a_folder_of_images_or_a_video_stands_in_for_a_camera(kind, run_palpate, fails):
    gel = np.full((320, 240, 3), (10, 30, 60), np.uint8)  # blue first
    if kind == "folder":
        Path("film").mkdir()
        for index in range(20):
            cv2.imwrite(f"film/frame_{index}.png", gel + np.uint8(2 * index))
        Path("film/frame_7.png").write_bytes(b"torn")
        Path("film/._frame_1.png").write_bytes(b"of another file system")
    else:
        video = cv2.VideoWriter("film.avi", cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (240, 320))
        for _ in range(20):
            video.write(gel)
        video.release()
        Path("film.avi").rename("film")
    port = free_port()
    words = ("live", "--tactile", "none", "--camera", "film", "--poses", f"udp:{port}", *OBJECT, "--json")
    with sending(lambda n: pose_packet(), port):
        code, out, err = run_palpate(*words, "--record", "live.mcap")
    found = json.loads(out)
    assert code == 0 and found["images"] == 20 and found["tracked"] > 10
    assert found["left_out"] == (kind == "folder") and ("a frame is left out: " in err) == (kind == "folder")
    images = [frame.image for frame in palpate.load_recording("live.mcap").until(5)]
    assert images[0] is not None and np.abs(images[0][0, 0].astype(int) - (60, 30, 10)).max() < 6
    if kind == "folder":  # in the order in which people count
        assert np.all(np.diff([image[0, 0, 0] for image in images if image is not None]) < 5)
    Path("empty").mkdir()
    for name in ("empty", "push.mcap"):
        assert "is no video that OpenCV reads, nor a folder" in fails(*words[:4], name, *words[5:])


def test_a_video_that_opens_and_cannot_be_decoded_is_refused(fails):
    av = pytest.importorskip("av")
    with av.open("film.mp4", "w") as container:
        stream = container.add_stream("libsvtav1", rate=30)
        stream.width = 240
        stream.height = 320
        stream.pix_fmt = "yuv420p"
        for _ in range(3):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((320, 240, 3), np.uint8))))
        container.mux(stream.encode())
    if cv2.VideoCapture("film.mp4").grab():
        pytest.skip("this OpenCV decodes AV1")
    words = ("live", "--tactile", "none", "--camera", "film.mp4", "--poses", f"udp:{free_port()}", *OBJECT)
    assert "is no video that OpenCV reads" in fails(*words)


def test_a_camera_that_cannot_be_used(camera, fails):
    words = camera_words(f"udp:{free_port()}")
    camera.grab = lambda: False
    assert "gives no images" in fails(*words)
    camera.is_plugged = False
    assert "cannot be opened: another program" in fails(*words)
    assert camera.released == 2
    Path("video0").unlink()
    assert "video0 cannot be opened: there is none" in fails(*words)
    assert "/dev/video97 cannot be opened: there is none" in fails(*words[:4], "97", *words[5:])


def test_options_of_a_camera_that_do_not_go_together(camera, fails):
    assert "either --camera with --poses, or --replay" in fails("live")
    assert "either --camera with --poses, or --replay" in fails("live", "--camera", "0")
    assert "X Y THETA or --first-pose-unknown" in fails("live", "--camera", "0", "--poses", "udp:9")
    refused = fails(*camera_words("udp:9"), "--clock", "log")
    assert "only --shape, --shape-unit, --shape-layer, --sensor, --mounts, --orientation" in refused
    assert "plane is fit, which needs all poses" in fails(*camera_words("udp:9"), "--plane", "fit")
    for wrong in ("udp:x", "other", "udp:70000"):
        assert f"{wrong!r}; allowed is udp:PORT" in fails(*camera_words(wrong))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", port := free_port()))
        assert f"cannot listen on port {port} of 127.0.0.1" in fails(*camera_words(f"udp:{port}"))
    assert camera.opened == camera.released


def write_hand() -> palpate.Recording:
    """Write hand.mcap, at 60 Hz."""
    hand = replace(imaged_push_of_hand(), time=np.arange(FRAMES) / 60.0)
    palpate.write_recording(hand, "hand.mcap")
    return hand


def test_a_replayed_hand_is_tracked_and_recorded(run_palpate):
    push = write_hand()
    words = ("live", "--tactile", "none", "--replay", "hand.mcap", "--record", "live.mcap", "--json")
    code, out, err = run_palpate(*words)
    assert code == 0 and all("further ones are counted" in line for line in err.splitlines())
    found = json.loads(out)
    assert (found["images"], found["sensor_poses"]) == (2 * FRAMES, FRAMES)
    assert found["tracked"] + found["dropped"] + found["without_pose"] + found["left_out"] == 2 * FRAMES
    assert found["tracked"] > 2
    kept = palpate.load_recording("live.mcap")
    assert kept.hand == push.hand and push.images is not None and kept.images is not None
    for finger, images in push.images.items():
        assert [image for image in kept.images[finger] if image] == [*images][: len(kept)]
    assert np.allclose(kept.sensor_pose, push.sensor_pose[: len(kept)], rtol=0.0, atol=1e-9)


def hand_words(cameras: str, poses: str) -> tuple[str, ...]:
    mounts = ("--mounts", "left=0,20mm,0", "right=0,-20mm,0")
    return ("live", "--tactile", "none", "--camera", cameras, "--poses", poses, *mounts, *OBJECT)


def test_two_cameras_are_the_fingers_of_a_hand(run_palpate, fails):
    gel = np.full((320, 240, 3), 90, np.uint8)
    for name, count in (("a", 20), ("b", 10)):
        Path(name).mkdir()
        for number in range(count):
            assert cv2.imwrite(f"{name}/{number}.png", gel + number % 2)
    port = free_port()
    with sending(lambda number: pose_packet(), port):
        words = (*hand_words("left=a,right=b", f"udp:{port}"), "--record", "two.mcap", "--json")
        code, out, err = run_palpate(*words)
    # The first images may come before the first pose, which is told.
    assert code == 0 and all("further ones are counted" in line for line in err.splitlines())
    found = json.loads(out)
    assert found["images"] == 30 and found["tracked"] > 2
    kept = palpate.load_recording("two.mcap")
    assert kept.hand is not None and list(kept.hand.fingers) == ["left", "right"]
    for cameras, named in (
        ("left=a,right=a", "a"),
        ("left=a,thumb=b", "thumb"),
        ("left=a", "right"),
        ("a", "--mounts"),
    ):
        assert named in fails(*hand_words(cameras, f"udp:{port}"))


def test_both_gels_of_a_hand_are_calibrated_at_once(succeeds, fails):
    write_hand()
    palpate.write_recording(imaged_push(), "left.mcap")
    assert succeeds("calibrate", "left.mcap", "--out", "alone.npz")
    assert "a.npz" in succeeds("calibrate", "hand.mcap", "--out", "left=a.npz,right=b.npz")
    alone = palpate.load_calibration("alone.npz").background.mean
    np.testing.assert_allclose(palpate.load_calibration("a.npz").background.mean, alone, atol=1e-3)
    np.testing.assert_allclose(palpate.load_calibration("b.npz").background.mean, np.flip(alone, 1), atol=1e-3)
    for out, named in (
        ("left=c.npz,thumb=d.npz", "thumb"),
        ("right=c.npz,left=a.npz", "a.npz"),
        ("left=c.npz,right=c.npz", "right"),
        ("c.npz", "left="),
    ):
        assert named in fails("calibrate", "hand.mcap", "--out", out)
    assert not Path("c.npz").exists() and not Path("d.npz").exists()
